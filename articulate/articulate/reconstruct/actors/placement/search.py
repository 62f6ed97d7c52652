"""Search of placements: the largest part first, then each part where it explains most of the rest.

Costs are in completely different pixels of the input image [px]. Gaps between parts cost a little,
since the depth of a small part is hardly visible.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from articulate.reconstruct.actors.placement.initial_placements import (
    above_ground,
    grid_candidates,
    hidden_candidates,
    is_small,
    symmetric_candidates,
    thin_part_candidates,
)
from articulate.reconstruct.actors.placement.placement_problem import (
    EQUAL,
    PlacementLevel,
    PlacementProblem,
    Placements,
    RenderedParts,
)
from articulate.transforms import Array

MAX_STARTS, SIBLINGS, KEPT = 4, 2, 2
"""Initial placements that are refined, of all and of those suggested by similar parts, and how many
of these reach the next level."""
MAX_GRID = 4000
"""Placements of a grid that are compared with each other."""
BASE_PLACEMENTS = 3
"""Placements of the largest part that are tried until the image is explained."""
EXPLAINED_SHARE = 0.005
"""Unexplained share of the object's pixels below which the search stops."""
MAX_PARTS = 15
"""Objects of more parts are assembled once."""
MAX_SWAPS = 12
"""Pairs of parts that are swapped at most."""
GAP_PX = 160.0
"""Cost of a gap [px/m]."""
MIN_GAIN_PX, MIN_GAIN_SHARE = 12.0, 0.04
"""A part that explains fewer pixels [px], or a smaller share of its visible ones, is hidden."""
VISIBLE_COST = 0.2
"""Cost of each visible pixel of a part that should be hidden."""
FROM_MIDDLE_PX = 20.0
"""Cost of a hidden part's distance from the centre [px/m]."""
HIDDEN_CANDIDATES = 40
"""Placements of a hidden part whose gaps are measured."""
LAST_STEP_PX = 0.2
"""Smallest step in the image [px]."""
RAY_STEP_RATIO = 4.0
"""Ratio of steps along the viewing ray to steps across it."""
RAY_M = np.linspace(-0.5, 0.5, 81)
"""Offsets along the viewing ray that are tried [m]."""
CUBE = np.array([m for m in product((-1.0, 0.0, 1.0), repeat=3) if 0.0 in m])
"""Directions of the steps, in camera axes."""


def solve(problem: PlacementProblem) -> dict[int, Array]:
    """Return the centre of each part in the camera frame (3,) [m], by index."""
    order = sorted(range(len(problem.parts)), key=problem.volume, reverse=True)
    bases = _best_placements(problem, order[0], {})[:BASE_PLACEMENTS]
    if len(order) > MAX_PARTS:
        bases = bases[:1]
    best: dict[int, Array] = {}
    least = np.inf
    for base_placement, _ in bases:
        placements = _assemble(problem, order, base_placement)
        cost = total_cost(problem, 1, placements)
        if cost < least:
            best, least = placements, cost
        if unexplained_share(problem, best) <= EXPLAINED_SHARE:
            break
    for part in order:
        best[part] = refine_placement(problem, 2, part, best, best[part], 1.0)[0]
    return best


def total_cost(problem: PlacementProblem, k: int, placements: Placements) -> float:
    """Return the cost of a placement at level ``k``."""
    level = problem.levels[k]
    misfit = sum(problem.misfit(part, shift, placements) for part, shift in placements.items())
    return level.total(level.rendered(placements, problem.light)) + GAP_PX * misfit


def _assemble(
    problem: PlacementProblem, order: Sequence[int], base_placement: Array
) -> dict[int, Array]:
    """Place all parts one after the other, then refine each among the others."""
    placements = {order[0]: base_placement}
    for part in order[1:]:
        placements[part] = _place_part(problem, part, placements)
    _refine_all(problem, 1, order, placements)
    if unexplained_share(problem, placements) > EXPLAINED_SHARE:
        for part in order:
            _relocate(problem, part, placements)
        if len(order) <= MAX_PARTS:
            placements = _swap_similar(problem, order[1:], placements)
        _refine_all(problem, 1, order, placements)
    return placements


def _swap_similar(
    problem: PlacementProblem, parts: Sequence[int], placements: dict[int, Array]
) -> dict[int, Array]:
    """Swap parts of similar size where that lowers the cost."""
    cost = total_cost(problem, 1, placements)
    pairs = [
        (a, b)
        for a, b in combinations(parts, 2)
        if problem.is_similar(a, b) and not problem.is_similar(a, b, EQUAL)
    ]
    for a, b in pairs[:MAX_SWAPS]:
        trial = {**placements, a: placements[b], b: placements[a]}
        for part in (a, b, a):
            trial[part] = refine_placement(problem, 1, part, trial, trial[part], 2.0)[0]
        cost_now = total_cost(problem, 1, trial)
        if cost_now < cost - MIN_GAIN_PX:
            placements, cost = trial, cost_now
    return placements


def unexplained_share(problem: PlacementProblem, placements: Placements) -> float:
    """Return the share of the object's pixels in regions that differ from the placed parts."""
    level = problem.levels[1]
    left = level.unexplained(level.rendered(placements, problem.light))
    return left / max(level.solid_px, 1.0)


def _refine_all(
    problem: PlacementProblem, k: int, order: Sequence[int], placements: dict[int, Array]
) -> None:
    for _ in range(2):
        for part in order:
            placements[part] = refine_placement(
                problem, k, part, placements, placements[part], 2.0
            )[0]


def _relocate(problem: PlacementProblem, part: int, placements: dict[int, Array]) -> None:
    """Move a part elsewhere if that lowers the cost."""
    others = {i: shift for i, shift in placements.items() if i != part}
    if not others:
        return
    k = 2 if is_small(problem, part, others) else 1
    here = refine_placement(problem, k, part, placements, placements[part], 1.0)
    there = min(_best_placements(problem, part, others), key=lambda f: f[1])
    placements[part] = there[0] if there[1] < here[1] - MIN_GAIN_PX else here[0]


def _place_part(problem: PlacementProblem, part: int, placements: Placements) -> Array:
    """Return the placement of least cost; one where the part is hidden if it explains nothing."""
    best = min(_best_placements(problem, part, placements), key=lambda f: f[1])[0]
    level = problem.levels[1]
    rendered = problem.rendered(1, part, placements)
    gain, visible_px = level.costs(part, best[None], rendered, problem.light)
    if -gain[0] >= max(MIN_GAIN_PX, MIN_GAIN_SHARE * visible_px[0]):
        return best
    return _hidden(problem, part, placements, rendered)


def _hidden(
    problem: PlacementProblem, part: int, placements: Placements, rendered: RenderedParts
) -> Array:
    """Return a placement of a part that is not visible."""
    siblings, others = (
        symmetric_candidates(problem, part, placements),
        hidden_candidates(problem, part, placements),
    )
    candidates = above_ground(problem, part, np.concatenate([siblings, others]))
    costs, visible_px = problem.levels[1].costs(part, candidates, rendered, problem.light)
    costs = np.maximum(costs, 0.0) + VISIBLE_COST * visible_px
    off = np.linalg.norm(candidates - others[0], axis=1)
    if len(siblings):
        to_sibling = np.linalg.norm(candidates[:, None] - siblings[None], axis=-1).min(axis=1)
        off = np.minimum(off, to_sibling)
    costs += FROM_MIDDLE_PX * off
    likely = np.argsort(costs, kind="stable")[:HIDDEN_CANDIDATES]
    misfit = [GAP_PX * problem.misfit(part, candidates[q], placements) for q in likely]
    return np.asarray(candidates[likely[int(np.argmin(costs[likely] + misfit))]])


def _best_placements(
    problem: PlacementProblem, part: int, placements: Placements
) -> list[tuple[Array, float]]:
    """Return placements of low cost, and their costs, cheapest first."""
    k = 1 if is_small(problem, part, placements) else 0
    level = problem.levels[k]
    rendered = problem.rendered(k, part, placements)
    along = thin_part_candidates(problem, k, part, placements, rendered)
    starts = _spread_out(along, np.arange(len(along), dtype=np.float64), problem, part, MAX_STARTS)
    for candidates, most in (
        (grid_candidates(problem, k, part, placements, rendered), MAX_STARTS),
        (symmetric_candidates(problem, part, placements), SIBLINGS),
    ):
        costs, _ = level.costs(part, candidates, rendered, problem.light)
        starts += _spread_out(candidates, costs, problem, part, most)
    if not starts:  # the image is already explained
        starts = [hidden_candidates(problem, part, placements)[0]]
    found = [refine_placement(problem, k, part, placements, s, 1.5) for s in starts]
    found = sorted(found, key=lambda f: f[1])[:KEPT]
    k += 1
    found = [refine_placement(problem, k, part, placements, s, 1.5) for s, _ in found]
    if placements:
        touching = [_refine_along_ray(problem, k, part, placements, s) for s, _ in found]
        found += [refine_placement(problem, k, part, placements, s, 1.0) for s in touching]
    return sorted(found, key=lambda f: f[1])


def _refine_along_ray(
    problem: PlacementProblem, k: int, part: int, placements: Placements, start: Array
) -> Array:
    """Return the cheapest placement along the viewing ray."""
    level = problem.levels[k]
    shifts = start * (1.0 + np.maximum(RAY_M, 0.2 - start[2]) / start[2])[:, None]
    rendered = problem.rendered(k, part, placements)
    return _cheapest(problem, level, part, placements, rendered, shifts, np.inf)[0]


def _spread_out(
    candidates: Array, costs: Array, problem: PlacementProblem, part: int, most: int
) -> list[Array]:
    """Return the cheapest placements that are apart from each other."""
    size = problem.sizes[part]
    apart = max(0.04, 0.15 * float(np.median(size)))
    chosen: list[Array] = []
    for q in np.argsort(costs, kind="stable")[:MAX_GRID]:
        if all(np.linalg.norm(candidates[q] - other) > apart for other in chosen):
            chosen.append(candidates[q])
        if len(chosen) == most:
            break
    return chosen


def refine_placement(
    problem: PlacementProblem,
    k: int,
    part: int,
    placements: Placements,
    start: Array,
    step_px: float,
) -> tuple[Array, float]:
    """Return the cheapest placement close to ``start`` (3,) [m], and its cost."""
    level = problem.levels[k]
    rendered = problem.rendered(k, part, placements)
    best, best_cost = _cheapest(problem, level, part, placements, rendered, start[None], np.inf)
    focal = float(level.crop.pinhole[0])
    world = problem.camera.T_cw[:3, :3].T
    while step_px > LAST_STEP_PX:
        side = step_px * best[2] / focal
        steps = np.stack(
            [[side, 0.0, 0.0], [0.0, side, 0.0], RAY_STEP_RATIO * side * best / best[2]]
        )
        moves = np.concatenate([CUBE @ steps, 2.0 * side * world, -2.0 * side * world])
        near = above_ground(problem, part, best + moves)
        found, cost = _cheapest(problem, level, part, placements, rendered, near, best_cost)
        if cost < best_cost:
            best, best_cost = found, cost
        else:
            step_px *= 0.5
    return best, best_cost


def _cheapest(
    problem: PlacementProblem,
    level: PlacementLevel,
    part: int,
    placements: Placements,
    rendered: RenderedParts,
    shifts: Array,
    below: float,
) -> tuple[Array, float]:
    """Return the cheapest placement of ``shifts`` (Q, 3) and its cost, if below ``below``."""
    costs, _ = level.costs(part, shifts, rendered, problem.light)
    best, least = shifts[0], below
    for q in np.argsort(costs, kind="stable"):
        if costs[q] >= least - 1e-6:
            break
        cost = float(costs[q]) + GAP_PX * problem.misfit(part, shifts[q], placements)
        if cost < least - 1e-6:
            best, least = shifts[q], cost
    return best, least
