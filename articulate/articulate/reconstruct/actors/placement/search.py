"""Search: the largest part first, then each where it explains most of what is left.

What a placement costs is counted in pixels of the given picture that differ wholly. Parts that
touch nothing pay for it a little, since the depth of a small part is hardly to be seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from articulate.reconstruct.actors.placement.initial_placements import (
    above_ground,
    grid,
    hidden_seats,
    is_small,
    sibling_seats,
    thin_seats,
)
from articulate.reconstruct.actors.placement.placement_problem import (
    SAME,
    Level,
    PlacementProblem,
    Places,
    Rest,
)
from articulate.transforms import Array

STARTS, SIBLINGS, KEPT = 4, 2, 2
"""Places from which a part is moved to where it costs least, of all and of those that like parts
suggest, and how many of these are looked at more closely."""
BEST_OF = 4000
"""Places of a grid that are compared with each other."""
BEGINNINGS = 3
"""Places of the largest part that are tried while the picture is not explained."""
EXPLAINED = 0.005
"""Less than this share of the object's pixels left unexplained is as good as it gets."""
MOST_PARTS = 15
"""Objects of more parts are put together once only."""
EXCHANGES = 12
"""Most pairs of parts that change places."""
GAP_PX = 160.0
"""What a gap costs for each unit of length [px/m]."""
LEAST_GAIN_PX, LEAST_GAIN = 12.0, 0.04
"""A part that explains fewer pixels, or a smaller share of those it is seen in, is hidden."""
SHOWN = 0.2
"""What each pixel costs in which a part is seen that should be hidden."""
FROM_MIDDLE_PX = 20.0
"""What a hidden part costs for each unit of length that it is off the middle [px/m]."""
HIDDEN_PLACES = 40
"""So many places of a hidden part are asked for what it touches."""
LAST_STEP_PX = 0.2
"""Steps in the picture smaller than this are not taken."""
ALONG_RAY = 4.0
"""Steps along the ray of sight are this much longer than across."""
RAY_M = np.linspace(-0.5, 0.5, 81)
"""Where along the ray a part is tried, from where it was found [m]."""
CUBE = np.array([m for m in product((-1.0, 0.0, 1.0), repeat=3) if 0.0 in m])
"""Steps that are compared, in the camera's axes."""


def solve(puzzle: PlacementProblem) -> dict[int, Array]:
    """Where the middle of each part is, in the camera's frame, by its index."""
    order = sorted(range(len(puzzle.parts)), key=puzzle.volume, reverse=True)
    beginnings = _found(puzzle, order[0], {})[:BEGINNINGS]
    if len(order) > MOST_PARTS:
        beginnings = beginnings[:1]
    best: dict[int, Array] = {}
    least = np.inf
    for beginning, _ in beginnings:
        places = _assembled(puzzle, order, beginning)
        cost = total_cost(puzzle, 1, places)
        if cost < least:
            best, least = places, cost
        if unexplained_share(puzzle, best) <= EXPLAINED:
            break
    for part in order:
        best[part] = settled(puzzle, 2, part, best, best[part], 1.0)[0]
    return best


def total_cost(puzzle: PlacementProblem, k: int, places: Places) -> float:
    """What a placement costs at level ``k``."""
    level = puzzle.levels[k]
    misfit = sum(puzzle.misfit(part, shift, places) for part, shift in places.items())
    return level.total(level.rest(places, puzzle.light)) + GAP_PX * misfit


def _assembled(
    puzzle: PlacementProblem, order: Sequence[int], beginning: Array
) -> dict[int, Array]:
    """All parts, one after the other, then each again among the others."""
    places = {order[0]: beginning}
    for part in order[1:]:
        places[part] = _placed(puzzle, part, places)
    _descend(puzzle, 1, order, places)
    if unexplained_share(puzzle, places) > EXPLAINED:
        for part in order:
            _reseat(puzzle, part, places)
        if len(order) <= MOST_PARTS:
            places = _exchanged(puzzle, order[1:], places)
        _descend(puzzle, 1, order, places)
    return places


def _exchanged(
    puzzle: PlacementProblem, parts: Sequence[int], places: dict[int, Array]
) -> dict[int, Array]:
    """Parts of much the same size in each other's place, where that costs less."""
    cost = total_cost(puzzle, 1, places)
    pairs = [
        (a, b)
        for a, b in combinations(parts, 2)
        if puzzle.alike(a, b) and not puzzle.alike(a, b, SAME)
    ]
    for a, b in pairs[:EXCHANGES]:
        trial = {**places, a: places[b], b: places[a]}
        for part in (a, b, a):
            trial[part] = settled(puzzle, 1, part, trial, trial[part], 2.0)[0]
        cost_now = total_cost(puzzle, 1, trial)
        if cost_now < cost - LEAST_GAIN_PX:
            places, cost = trial, cost_now
    return places


def unexplained_share(puzzle: PlacementProblem, places: Places) -> float:
    """Share of the object's pixels that lie in spots that look other than the parts there."""
    level = puzzle.levels[1]
    left = level.unexplained(level.rest(places, puzzle.light))
    return left / max(level.solid_px, 1.0)


def _descend(
    puzzle: PlacementProblem, k: int, order: Sequence[int], places: dict[int, Array]
) -> None:
    for _ in range(2):
        for part in order:
            places[part] = settled(puzzle, k, part, places, places[part], 2.0)[0]


def _reseat(puzzle: PlacementProblem, part: int, places: dict[int, Array]) -> None:
    """Put a part elsewhere if that costs less."""
    others = {i: shift for i, shift in places.items() if i != part}
    if not others:
        return
    k = 2 if is_small(puzzle, part, others) else 1
    here = settled(puzzle, k, part, places, places[part], 1.0)
    there = min(_found(puzzle, part, others), key=lambda f: f[1])
    places[part] = there[0] if there[1] < here[1] - LEAST_GAIN_PX else here[0]


def _placed(puzzle: PlacementProblem, part: int, places: Places) -> Array:
    """Where a part costs least; where nothing can be seen of it if it explains nothing."""
    best = min(_found(puzzle, part, places), key=lambda f: f[1])[0]
    level = puzzle.levels[1]
    rest = puzzle.rest(1, part, places)
    gain, shown = level.costs(part, best[None], rest, puzzle.light)
    if -gain[0] >= max(LEAST_GAIN_PX, LEAST_GAIN * shown[0]):
        return best
    return _hidden(puzzle, part, places, rest)


def _hidden(puzzle: PlacementProblem, part: int, places: Places, rest: Rest) -> Array:
    """Where a part may be of which nothing is seen."""
    siblings, others = sibling_seats(puzzle, part, places), hidden_seats(puzzle, part, places)
    seats = above_ground(puzzle, part, np.concatenate([siblings, others]))
    costs, shown = puzzle.levels[1].costs(part, seats, rest, puzzle.light)
    costs = np.maximum(costs, 0.0) + SHOWN * shown
    off = np.linalg.norm(seats - others[0], axis=1)
    if len(siblings):
        to_sibling = np.linalg.norm(seats[:, None] - siblings[None], axis=-1).min(axis=1)
        off = np.minimum(off, to_sibling)
    costs += FROM_MIDDLE_PX * off
    likely = np.argsort(costs, kind="stable")[:HIDDEN_PLACES]
    misfit = [GAP_PX * puzzle.misfit(part, seats[q], places) for q in likely]
    return np.asarray(seats[likely[int(np.argmin(costs[likely] + misfit))]])


def _found(puzzle: PlacementProblem, part: int, places: Places) -> list[tuple[Array, float]]:
    """Places where a part costs little, and what, cheapest first."""
    k = 1 if is_small(puzzle, part, places) else 0
    level = puzzle.levels[k]
    rest = puzzle.rest(k, part, places)
    along = thin_seats(puzzle, k, part, places, rest)
    starts = _apart(along, np.arange(len(along), dtype=np.float64), puzzle, part, STARTS)
    for seats, most in (
        (grid(puzzle, k, part, places, rest), STARTS),
        (sibling_seats(puzzle, part, places), SIBLINGS),
    ):
        costs, _ = level.costs(part, seats, rest, puzzle.light)
        starts += _apart(seats, costs, puzzle, part, most)
    if not starts:  # everything is explained already
        starts = [hidden_seats(puzzle, part, places)[0]]
    found = [settled(puzzle, k, part, places, s, 1.5) for s in starts]
    found = sorted(found, key=lambda f: f[1])[:KEPT]
    k += 1
    found = [settled(puzzle, k, part, places, s, 1.5) for s, _ in found]
    if places:
        touching = [_touching(puzzle, k, part, places, s) for s, _ in found]
        found += [settled(puzzle, k, part, places, s, 1.0) for s in touching]
    return sorted(found, key=lambda f: f[1])


def _touching(puzzle: PlacementProblem, k: int, part: int, places: Places, start: Array) -> Array:
    """The place along the ray of sight that costs least."""
    level = puzzle.levels[k]
    shifts = start * (1.0 + np.maximum(RAY_M, 0.2 - start[2]) / start[2])[:, None]
    rest = puzzle.rest(k, part, places)
    return _cheapest(puzzle, level, part, places, rest, shifts, np.inf)[0]


def _apart(
    seats: Array, costs: Array, puzzle: PlacementProblem, part: int, most: int
) -> list[Array]:
    """The cheapest places, each some way from the cheaper ones."""
    size = puzzle.sizes[part]
    apart = max(0.04, 0.15 * float(np.median(size)))
    chosen: list[Array] = []
    for q in np.argsort(costs, kind="stable")[:BEST_OF]:
        if all(np.linalg.norm(seats[q] - other) > apart for other in chosen):
            chosen.append(seats[q])
        if len(chosen) == most:
            break
    return chosen


def settled(
    puzzle: PlacementProblem, k: int, part: int, places: Places, start: Array, step_px: float
) -> tuple[Array, float]:
    """The place near ``start`` that costs least, and what it costs against a part not there."""
    level = puzzle.levels[k]
    rest = puzzle.rest(k, part, places)
    best, best_cost = _cheapest(puzzle, level, part, places, rest, start[None], np.inf)
    focal = float(level.shot.pinhole[0])
    world = puzzle.camera.T_cw[:3, :3].T
    while step_px > LAST_STEP_PX:
        side = step_px * best[2] / focal
        steps = np.stack([[side, 0.0, 0.0], [0.0, side, 0.0], ALONG_RAY * side * best / best[2]])
        moves = np.concatenate([CUBE @ steps, 2.0 * side * world, -2.0 * side * world])
        near = above_ground(puzzle, part, best + moves)
        found, cost = _cheapest(puzzle, level, part, places, rest, near, best_cost)
        if cost < best_cost:
            best, best_cost = found, cost
        else:
            step_px *= 0.5
    return best, best_cost


def _cheapest(
    puzzle: PlacementProblem,
    level: Level,
    part: int,
    places: Places,
    rest: Rest,
    shifts: Array,
    below: float,
) -> tuple[Array, float]:
    """The cheapest of some places (Q, 3) and its cost, if that is less than ``below``."""
    costs, _ = level.costs(part, shifts, rest, puzzle.light)
    best, least = shifts[0], below
    for q in np.argsort(costs, kind="stable"):
        if costs[q] >= least - 1e-6:
            break
        cost = float(costs[q]) + GAP_PX * puzzle.misfit(part, shifts[q], places)
        if cost < least - 1e-6:
            best, least = shifts[q], cost
    return best, least
