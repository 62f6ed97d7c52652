"""Adversarial actions through the safety filter, the set-point filter and the guard.

Sequences of targets that no policy should request: not finite, infinite, jumps over the range,
oscillation at the largest step, random walks. Prints how many set points leave the limit table of
the arm, measured as the arm's controller does, by backward differences over 1 ms.

    python benchmarks/adversarial_actions.py --actions 10000000
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate.transforms import Array
from articulate_deploy.arms.guard import SetPoints, guard_limits

KINDS = ("not finite", "jumps", "oscillation", "random walk", "step-limited")
SPECIAL = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300])


def targets(kind: str, last: Array, k: int, rng: np.random.Generator) -> Array:
    """Return the targets (N, 7) of one control step."""
    low, high = PANDA.bounds()
    if kind == "not finite":
        return np.asarray(
            np.where(rng.random(last.shape) < 0.5, rng.choice(SPECIAL, last.shape), last)
        )
    if kind == "jumps":
        return rng.uniform(low - 1.0, high + 1.0, last.shape)
    if kind == "oscillation":
        return np.where(k % 2, low, high) * np.ones(last.shape)
    if kind == "random walk":
        return last + rng.normal(0.0, 0.3, last.shape)
    step: Array = joint_steps(ControlConfig(), PANDA) * rng.choice([-1.0, 1.0], last.shape)
    return last + step


def run(actions: int, rows: int, seed: int) -> dict[str, float]:
    """Return counts and largest shares of the limits."""
    rng, control = np.random.default_rng(seed), ControlConfig()
    limits = guard_limits(PANDA, margin_rad=0.01)
    tables = [np.asarray(t) for t in (PANDA.dq_max, PANDA.ddq_max, PANDA.dddq_max)]
    low, high = PANDA.bounds()
    steps = round(control.step_s * 1e3)
    most, outside, done, points_run = np.zeros(3), 0, 0, 0
    begun = time.perf_counter()
    blocks = max(round(actions / rows / 40), len(KINDS))
    points = SetPoints(np.tile(PANDA.home, (rows, 1)), control.omega_rad_s, limits)
    history = [points.state[..., 0].copy()] * 4
    for block in range(blocks):
        kind = KINDS[block % len(KINDS)]
        for k in range(40):
            points.set_target(targets(kind, points.target, k, rng))
            for _ in range(steps):
                history = [*history[1:], points.step()]
                q = history
                speed = (q[3] - q[2]) / 1e-3
                acceleration = (q[3] - 2 * q[2] + q[1]) / 1e-6
                jerk = (q[3] - 3 * q[2] + 3 * q[1] - q[0]) / 1e-9
                bad = (q[3] < low) | (q[3] > high)
                for i, (values, table) in enumerate(
                    zip((speed, acceleration, jerk), tables, strict=True)
                ):
                    share = np.abs(values) / table
                    most[i] = max(most[i], float(share.max()))
                    bad |= ~(share <= 1.0)
                outside += int(np.count_nonzero(bad))
                points_run += rows
            done += rows
        if block % 5 == 4:
            print(f"{done} actions, {outside} outside", flush=True)
        if done >= actions:
            break
    return {
        "actions": done,
        "set_points": points_run,
        "outside": outside,
        "share_speed": float(most[0]),
        "share_acceleration": float(most[1]),
        "share_jerk": float(most[2]),
        "limited_joint_steps": points.limited / (7 * points_run),
        "braked_joint_steps": points.braked / (7 * points_run),
        "seconds": time.perf_counter() - begun,
    }


def main() -> None:
    """Run and print the result as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--actions", type=int, default=100_000)
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    flags = parser.parse_args()
    print(json.dumps(run(flags.actions, flags.rows, flags.seed)))


if __name__ == "__main__":
    main()
