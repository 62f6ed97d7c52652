"""Send adversarial actions through safety filter, set-point filter and force limiter.

Sequences of targets that no policy should request: not finite, infinite, jumps over the range,
oscillation at the largest step, random walks. Each target is held for 1 to 50 ms, and every second
block skips the safety filter. The set points are compared with the limit table of the arm like in
the arm's controller: by backward differences over 1 ms. Each block is one line of ``--out``, so
the same command continues after an interruption.

    python benchmarks/adversarial_actions.py --actions 10000000 --out adversarial.jsonl
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate.transforms import Array
from articulate_deploy.arms.guard import SetPoints, guard_limits
from articulate_deploy.safety import safe_target

KINDS = ("not finite", "jumps", "oscillation", "random walk", "step-limited")
SPECIAL = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300])
HOLDS_MS = (*(1, 2, 3, 1, 2, 3, 1, 2, 3, 5) * 2, 50)
"""Times for which a target is held, one for each pair of blocks of all kinds [ms]."""
ACTIONS = 50
"""Actions of each row in a block."""


def targets(kind: str, last: Array, k: int, rng: np.random.Generator) -> Array:
    """Return the targets (N, 7) of one action."""
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


def run_block(block: int, rows: int) -> dict[str, Any]:
    """Return counts and the largest shares of the limits of one block.

    Each block begins at rest at random joint angles.
    """
    rng, control = np.random.default_rng([block, 55]), ControlConfig()
    kind, pair = KINDS[block // 2 % len(KINDS)], block // (2 * len(KINDS))
    hold_ms, filtered = HOLDS_MS[pair % len(HOLDS_MS)], block % 2 == 0
    limits = guard_limits(PANDA, margin_rad=0.01)
    tables = [np.asarray(t) for t in (PANDA.dq_max, PANDA.ddq_max, PANDA.dddq_max)]
    low, high = PANDA.bounds()
    points = SetPoints(rng.uniform(limits.low, limits.high, (rows, 7)), control.omega_rad_s, limits)
    most, outside = np.zeros(3), 0
    history = [points.state[..., 0].copy()] * 4
    for k in range(ACTIONS):
        requested = targets(kind, points.target, k, rng)
        if filtered:
            requested = safe_target(requested, points.target, control, PANDA)
        points.set_target(requested)
        for _ in range(hold_ms):
            history = [*history[1:], points.step()]
            q = history
            speed = (q[3] - q[2]) / 1e-3
            acceleration = (q[3] - 2 * q[2] + q[1]) / 1e-6
            jerk = (q[3] - 3 * q[2] + 3 * q[1] - q[0]) / 1e-9
            good = (q[3] >= low) & (q[3] <= high)
            for i, (values, table) in enumerate(
                zip((speed, acceleration, jerk), tables, strict=True)
            ):
                share = np.abs(values) / table
                most[i] = max(most[i], float(share.max()))
                good &= share <= 1.0
            outside += int(good.size - np.count_nonzero(good))
    return {
        "block": block,
        "kind": kind,
        "safety_filter": filtered,
        "hold_ms": hold_ms,
        "actions": rows * ACTIONS,
        "set_points": rows * ACTIONS * hold_ms,
        "outside": outside,
        "share_speed": float(most[0]),
        "share_acceleration": float(most[1]),
        "share_jerk": float(most[2]),
        "limited_joint_steps": points.limited,
        "braked_joint_steps": points.braked,
    }


def summary(blocks: list[dict[str, Any]]) -> dict[str, Any]:
    """Return sums and largest values over all blocks."""
    sums = ("actions", "set_points", "outside", "limited_joint_steps", "braked_joint_steps")
    out: dict[str, Any] = {name: sum(block[name] for block in blocks) for name in sums}
    for name in ("share_speed", "share_acceleration", "share_jerk"):
        out[name] = max((block[name] for block in blocks), default=0.0)
    return out


def main() -> None:
    """Run the blocks that are missing and print the sums as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--actions", type=int, default=100_000, help="number of target poses")
    parser.add_argument("--rows", type=int, default=400, help="number of arms simulated together")
    parser.add_argument("--out", type=Path, help="file of results, one line for each block")
    flags = parser.parse_args()
    blocks: list[dict[str, Any]] = []
    if flags.out is not None and flags.out.exists():
        blocks = [json.loads(line) for line in flags.out.read_text().splitlines()]
    count, begun = -(-flags.actions // (flags.rows * ACTIONS)), time.perf_counter()
    for block in range(len(blocks), count):
        blocks.append(run_block(block, flags.rows))
        if flags.out is not None:
            with flags.out.open("a") as out:
                out.write(json.dumps(blocks[-1]) + "\n")
    print(json.dumps({**summary(blocks), "seconds": time.perf_counter() - begun}))


if __name__ == "__main__":
    main()
