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
from typing import Any

import numpy as np
import torch

from articulate.task.episode_monitor import REASONS
from policy_flags import policy_parser
from watched import Watched, watch

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


def rows(seen: Watched, edges_mm: Sequence[float] = EDGES_MM) -> list[Row]:
    """Episodes by how deep the hand stood as it closed first; those that never did are left out."""
    last, n = len(seen.width) - 1, np.arange(seen.width.shape[1])
    first, closed = seen.closing.argmax(axis=0), seen.closing.any(axis=0)
    depth = 1e3 * seen.depth[np.minimum(first + SOON, last), n]
    late = np.minimum(first + LATE, last)
    nothing = seen.width[late, n] < seen.least
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


def result(seen: Watched) -> dict[str, Any]:
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
    seen = watch(
        flags.run,
        flags.seed,
        episodes=flags.episodes,
        draws=flags.draws,
        ranges=flags.ranges,
        deeper_m=1e-3 * flags.deeper_mm,
    )
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
