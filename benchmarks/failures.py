"""What happened in each failed episode of a policy: where the hand was when it went wrong.

python benchmarks/failures.py runs/cabinet --seed 0 --episodes 200

One line an episode. The moment is the first tick beyond the task's limit of force, else that of
the largest force; the handle's place in the hand is that of three ticks before: across the
fingers, ahead of the tool and along the bar [mm]. Then follow the tick at which the part was first
at its target, and the one at which a hand that held the handle closed on nothing: most episodes
that end open but moving, or a little short of the target, have slipped long after they were there.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from articulate.judgement import REASONS
from articulate.kinematics import tool_pose
from articulate.task import beyond_target
from articulate.transforms import Array, Mask
from articulate_envs.compiled.reward import HELD_SHARE
from articulate_envs.episodes import Episodes, Tick
from articulate_envs.rewards import grasp_of
from articulate_envs.settings import RewardConfig
from articulate_envs.threads import ThreadEngine
from articulate_train.policy import load_policy
from articulate_train.run import open_run
from policy_flags import policy_parser

BEFORE = 3
"""The handle's place is told so many ticks before the moment."""
HELD_TICKS = 4
"""So long a handle lies between fingers before it counts as held."""
HELD_OPEN_M = 0.01
"""Fingers farther apart than the handle's thickness and this do not hold it yet [m]."""
DRAWN = ("hand_latency_s", "stiffness", "damping", "delay_ticks", "friction", "joint_friction")
"""Drawn parameters that are told."""


@dataclass(frozen=True)
class Failure:
    """One failed episode."""

    episode: int
    reason: str
    tick: int
    """Of the moment."""
    force_n: float
    """Largest filtered force of the episode [N]."""
    across_mm: float
    ahead_mm: float
    along_mm: float
    width_mm: float
    """Between the fingers, at the moment [mm]."""
    told_to_close: bool
    """Whether the hand had acted on a command to close."""
    opened: float
    """Fraction open at the moment."""
    opened_end: float
    """Fraction open at the end."""
    reached: int | None
    """First tick at which the part is at its target or beyond."""
    slipped: int | None
    """First tick at which a closed hand that held the handle has nothing between its fingers."""
    drawn: dict[str, float]


def first(mask: Mask) -> int | None:
    """First tick at which ``mask`` (T,) holds."""
    return int(np.argmax(mask)) if mask.any() else None


def slip(width: Array, closed: Mask, thick: float) -> int | None:
    """First tick at which a closed hand has lost what it held.

    Args:
        width: Openings between the fingers (T,) [m].
        closed: Whether the hand was told to close (T,).
        thick: What it holds [m].
    """
    least, held = HELD_SHARE * thick, 0
    for t, (wide, told) in enumerate(zip(width.tolist(), closed.tolist(), strict=True)):
        if held >= HELD_TICKS and told and wide < least:
            return t
        held = held + 1 if told and least <= wide <= thick + HELD_OPEN_M else 0
    return None


def failures(
    folder: Path, seed: int, episodes: int, draws: int, ranges: float = 1.0
) -> tuple[list[Failure], int]:
    """The failed ones of ``episodes`` drawn episodes from home, and how many ticks each has.

    Args:
        folder: Run.
        seed: Which of its policies.
        episodes: So many.
        draws: Seed of what is drawn.
        ranges: So many times as wide is every range of the randomisation.
    """
    run = open_run(folder).widened(ranges)
    scene, policy = run.scene(), load_policy(run.seed_folder(seed))
    engine = ThreadEngine(scene, episodes, threads=2)
    runs = Episodes(engine, draws=run.config.draw, reward=RewardConfig(), starts=None, seed=draws)
    seen, drawn = runs.reset(), runs.drawn
    place, closing, opened, width, force = [], [], [], [], []
    tick: Tick | None = None
    for _ in range(scene.ticks):
        tick = runs.step(policy.act(seen))
        seen = tick.observation
        if tick.ended is None:
            state = engine.state()
            T_wt = tool_pose(scene.arm, state.q)
            offset_w = state.T_wh[:, :3, 3] - T_wt[:, :3, 3]
            place.append(np.einsum("nij,ni->nj", T_wt[:, :3, :3], offset_w))
            closing.append(state.hand.closing > 0.0)
            opened.append(state.opened.copy())
            width.append(state.hand_width.copy())
            force.append(np.linalg.norm(state.samples[:, :3], axis=1))
    engine.close()
    assert tick is not None
    assert tick.ended is not None
    thick = grasp_of(scene.asset.handle_of(scene.task.joint)).thick_m * drawn["scale"]
    widths, closed = np.array(width), np.array(closing)
    at = beyond_target(scene.task, np.array(opened))
    out = []
    for i in np.flatnonzero(tick.ended.code != 0).tolist():
        forces = np.array([f[i] for f in force])
        over = np.flatnonzero(forces > scene.task.limits.force_n)
        t = int(over[0]) if len(over) else int(forces.argmax())
        along, across, ahead = 1e3 * place[max(t - BEFORE, 0)][i]
        out.append(
            Failure(
                episode=i,
                reason=REASONS[int(tick.ended.code[i])],
                tick=t,
                force_n=round(float(forces.max()), 1),
                across_mm=round(float(across), 1),
                ahead_mm=round(float(ahead), 1),
                along_mm=round(float(along), 1),
                width_mm=round(1e3 * float(width[t][i]), 1),
                told_to_close=bool(closing[t][i]),
                opened=round(float(opened[t][i]), 3),
                opened_end=round(float(opened[-1][i]), 3),
                reached=first(at[:, i]),
                slipped=slip(widths[:, i], closed[:, i], float(thick[i])),
                drawn={name: round(float(drawn[name][i]), 3) for name in DRAWN},
            )
        )
    return out, scene.ticks


def _tick(tick: int | None) -> str:
    return "  -" if tick is None else f"{tick:3d}"


def line(failure: Failure) -> str:
    """A failure as people read it."""
    f = failure
    return (
        f"{f.episode:4d} {f.reason:9s} tick {f.tick:3d}  {f.force_n:5.1f} N  handle "
        f"{f.across_mm:+5.0f} across {f.ahead_mm:+5.0f} ahead {f.along_mm:+5.0f} along mm  "
        f"fingers {f.width_mm:3.0f} mm {'closing' if f.told_to_close else 'open   '}  "
        f"open {f.opened:.2f}, at the end {f.opened_end:.2f}  "
        f"reached {_tick(f.reached)} slipped {_tick(f.slipped)}  "
        + " ".join(f"{name} {value:g}" for name, value in f.drawn.items())
    )


def main() -> int:
    """Print the failed episodes."""
    flags = policy_parser(__doc__, episodes=200).parse_args()
    torch.set_num_threads(1)
    found, ticks = failures(flags.run, flags.seed, flags.episodes, flags.draws, flags.ranges)
    if flags.json:
        rows = [asdict(f) for f in found]
        print(json.dumps({"episodes": flags.episodes, "ticks": ticks, "failed": rows}, indent=1))
        return 0
    for failure in found:
        print(line(failure))
    print(f"{len(found)} of {flags.episodes} failed; an episode has {ticks} ticks")
    return 0


if __name__ == "__main__":
    sys.exit(main())
