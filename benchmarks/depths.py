"""How deep a hand stands as it closes, and what becomes of it: does it stop short of the handle?

python benchmarks/depths.py runs/cabinet --seed 0 --episodes 400
python benchmarks/depths.py runs/cabinet --seed 0 --episodes 400 --deeper-mm 4

A row a range of depths: the place of the tool beyond the handle's middle, along the handle's
approach, when the fingers have closed for the first time or have met something; in how many of the
episodes they closed on nothing, the largest force until then, and how many succeed. With
``--deeper-mm`` the handle is told to be so much deeper than it is: what a policy would do that aims
deeper.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch

from articulate.draw import Draw, draw
from articulate.judgement import REASONS
from articulate.kinematics import tool_pose
from articulate.transforms import Array, Ints, Mask
from articulate_envs.compiled.reward import HELD_SHARE
from articulate_envs.episodes import Episodes, Tick
from articulate_envs.rewards import grasp_of
from articulate_envs.settings import RewardConfig
from articulate_envs.starts import home_start
from articulate_envs.threads import ThreadEngine
from articulate_train.policy import load_policy
from articulate_train.run import open_run
from policy_flags import policy_parser

SOON, LATE = 8, 20
"""Ticks from the first one of closing fingers to that of the depth, and to that of what they have:
fingers close from 80 mm on at 0.1 m/s."""
EDGES_MM = (-np.inf, -6.0, -3.0, -1.0, 1.0, 3.0, 5.0, 7.0, 9.0, np.inf)
"""Bounds of the ranges of depth [mm]; what is below 0 is short of the handle's middle."""


@dataclass(frozen=True)
class Row:
    """Episodes in which the hand closed within a range of depths."""

    from_mm: float
    to_mm: float
    episodes: int
    on_nothing: int
    """In so many the fingers closed on nothing."""
    force_n: float
    """Largest filtered force up to then, in the mean [N]."""
    successes: int


@dataclass(frozen=True)
class Seen:
    """What N episodes did, a row a tick."""

    depth_mm: Array
    """Of the tool beyond the handle's middle (T, N) [mm]."""
    closing: Mask
    """Whether fingers close or are closed (T, N)."""
    width: Array
    """Opening between them (T, N) [m]."""
    force: Array
    """Filtered (T, N) [N]."""
    code: Ints
    """How the episodes ended (N,), 0 a success."""
    thick: Array
    """What there is to hold (N,) [m]."""


def told_deeper(drawn: Draw, T_wh: Array, deeper_m: float) -> Draw:
    """As ``drawn``, with handles at poses (N, 4, 4) told so much deeper along their approach."""
    told = Draw(drawn.values.copy())
    told["bias"][:] += deeper_m * T_wh[:, :3, 2]
    return told


def episodes(
    folder: Path, seed: int, count: int, draws: int, ranges: float = 1.0, deeper_m: float = 0.0
) -> Seen:
    """Run ``count`` drawn episodes of a policy from home.

    Args:
        folder: Run.
        seed: Which of its policies.
        count: So many.
        draws: Seed of what is drawn.
        ranges: So many times as wide is every range of the randomisation.
        deeper_m: So much deeper than it is the handle is told to be [m].
    """
    run = open_run(folder).widened(ranges)
    scene, policy = run.scene(), load_policy(run.seed_folder(seed))
    engine = ThreadEngine(scene, count, threads=2)
    runs = Episodes(engine, draws=run.config.draw, reward=RewardConfig(), starts=None, seed=draws)
    drawn = draw(run.config.draw, np.random.default_rng(draws), count, begin=scene.task.begin)
    runs.reset(start=home_start(scene, drawn))
    told = told_deeper(drawn, engine.state().T_wh, deeper_m)
    seen = runs.reset(start=home_start(scene, told))
    depth, closing, width, force = [], [], [], []
    tick: Tick | None = None
    for _ in range(scene.ticks):
        tick = runs.step(policy.act(seen))
        seen = tick.observation
        if tick.ended is None:
            state = engine.state()
            offset_w = tool_pose(scene.arm, state.q)[:, :3, 3] - state.T_wh[:, :3, 3]
            depth.append(1e3 * np.einsum("ni,ni->n", state.T_wh[:, :3, 2], offset_w))
            closing.append(state.hand.closing > 0.0)
            width.append(state.hand_width.copy())
            force.append(np.linalg.norm(state.samples[:, :3], axis=1))
    engine.close()
    assert tick is not None
    assert tick.ended is not None
    thick = grasp_of(scene.asset.handle_of(scene.task.joint)).thick_m * drawn["scale"]
    return Seen(
        depth_mm=np.array(depth),
        closing=np.array(closing),
        width=np.array(width),
        force=np.array(force),
        code=tick.ended.code,
        thick=np.asarray(thick),
    )


def rows(seen: Seen, edges_mm: Sequence[float] = EDGES_MM) -> list[Row]:
    """Episodes by how deep the hand stood as it closed first; those that never did are left out."""
    last, n = len(seen.width) - 1, np.arange(seen.width.shape[1])
    first, closed = seen.closing.argmax(axis=0), seen.closing.any(axis=0)
    depth = seen.depth_mm[np.minimum(first + SOON, last), n]
    late = np.minimum(first + LATE, last)
    nothing = seen.width[late, n] < HELD_SHARE * seen.thick
    until = np.arange(last + 1)[:, None] <= late
    force = np.where(until, seen.force, 0.0).max(axis=0)
    out = []
    for low, high in pairwise(edges_mm):
        own = closed & (depth >= low) & (depth < high)
        if own.any():
            out.append(
                Row(
                    from_mm=float(low),
                    to_mm=float(high),
                    episodes=int(own.sum()),
                    on_nothing=int(nothing[own].sum()),
                    force_n=round(float(force[own].mean()), 1),
                    successes=int((seen.code[own] == 0).sum()),
                )
            )
    return out


def result(seen: Seen) -> dict[str, Any]:
    """Rows, and how all episodes ended; a range without a bound has None there."""
    reasons = Counter(REASONS[int(code)] for code in seen.code if code)
    return {
        "episodes": len(seen.code),
        "successes": int((seen.code == 0).sum()),
        "reasons": dict(reasons),
        "rows": [
            {k: v if np.isfinite(v) else None for k, v in asdict(row).items()} for row in rows(seen)
        ],
    }


def line(row: Row) -> str:
    """A row as people read it."""
    return (
        f"{row.from_mm:+5.0f} to {row.to_mm:+5.0f} mm  {row.episodes:4d} episodes  "
        f"{row.on_nothing:3d} on nothing  {row.force_n:5.1f} N  {row.successes:4d} succeed"
    )


def main() -> int:
    """Print the rows."""
    parser = policy_parser(__doc__, episodes=400)
    parser.add_argument("--deeper-mm", type=float, default=0.0, help="the handle is told deeper")
    flags = parser.parse_args()
    torch.set_num_threads(1)
    deeper_m = 1e-3 * flags.deeper_mm
    seen = episodes(flags.run, flags.seed, flags.episodes, flags.draws, flags.ranges, deeper_m)
    told = result(seen)
    if flags.json:
        print(json.dumps(told, indent=1))
        return 0
    for row in rows(seen):
        print(line(row))
    print(f"{told['successes']} of {told['episodes']} succeed; {told['reasons']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
