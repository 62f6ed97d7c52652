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

import numpy as np
import torch

from articulate.task.episode_monitor import REASONS
from articulate.task.task import beyond_target
from articulate.transforms import Array, Mask
from articulate_envs.compiled.reward import HELD_SHARE
from policy_flags import policy_parser
from watched import Watched, watch

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


def failure(seen: Watched, i: int) -> Failure:
    """What happened in episode ``i``, which failed."""
    forces = seen.force[:, i]
    over = first(forces > seen.scene.task.limits.force_n)
    t = int(forces.argmax()) if over is None else over
    along, across, ahead = 1e3 * seen.place_t[max(t - BEFORE, 0), i]
    return Failure(
        episode=i,
        reason=REASONS[int(seen.code[i])],
        tick=t,
        force_n=round(float(forces.max()), 1),
        across_mm=round(float(across), 1),
        ahead_mm=round(float(ahead), 1),
        along_mm=round(float(along), 1),
        width_mm=round(1e3 * float(seen.width[t, i]), 1),
        told_to_close=bool(seen.closing[t, i]),
        opened=round(float(seen.opened[t, i]), 3),
        opened_end=round(float(seen.opened[-1, i]), 3),
        reached=first(beyond_target(seen.scene.task, seen.opened[:, i])),
        slipped=slip(seen.width[:, i], seen.closing[:, i], float(seen.thick[i])),
        drawn={name: round(float(seen.drawn[name][i]), 3) for name in DRAWN},
    )


def failures(seen: Watched) -> list[Failure]:
    """The failed ones of the episodes."""
    return [failure(seen, i) for i in np.flatnonzero(seen.code != 0).tolist()]


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
    seen = watch(
        flags.run, flags.seed, episodes=flags.episodes, draws=flags.draws, ranges=flags.ranges
    )
    found, ticks = failures(seen), seen.scene.ticks
    if flags.json:
        rows = [asdict(f) for f in found]
        print(json.dumps({"episodes": flags.episodes, "ticks": ticks, "failed": rows}, indent=1))
        return 0
    for failed in found:
        print(line(failed))
    print(f"{len(found)} of {flags.episodes} failed; an episode has {ticks} ticks")
    return 0


if __name__ == "__main__":
    sys.exit(main())
