"""Search: every candidate motion at every position, against every frame; the cheapest path wins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.reconstruct.actors.geometric.candidates import Motion
from articulate.reconstruct.actors.geometric.compositing import CAP, Layers
from articulate.reconstruct.actors.geometric.kernels import best_line, best_path
from articulate.transforms import Array

TURN_STEPS, MOST_TURN_STEPS = 48, 144
"""Positions on a full turn; and of what is thin, which else would not meet its picture between."""
FINE_TURN_STEPS = 120
"""The same, when every frame is looked at."""
SLIDE_STEP_PX = 1.6
"""Motion in the picture between two positions of a slide."""
MOST_SLIDE_STEPS = 61
CHANGE_COST = 1e-3
"""Cost of a step, in positions from frame to frame, that differs by one from the step before, as a
share of the largest cost of all pixels of what moves."""
FINE = 0.3
"""Share of it where positions are fine, and changes by one mean little."""
BEND, MOST_BEND = 5e-4, 2e-2
"""The same of a position that lies a pixel beside the middle of its neighbours, squared: what shows
little follows the motion before and after. And the most that one costs: motions begin and end."""
REACH = 0.5
"""Farthest a slide goes, as a share of the object's size."""
LEAST_MOTION_PX = 2.0
"""What moves less does not explain a clip in which something changes."""
NUDGE_PX = 0.8
"""Motion in the picture that is one unit of a position."""
MOST_TURN = 1.2
"""Turns of a whole circle and this share of it are looked for as one even motion."""
STILL_POSES = 13
"""Poses in which a part is thought to rest through the whole shot, for comparison."""
MOST_POSITIONS = 160
"""Most positions when a path is sought again."""
LARGEST_STEP = 9
"""Most positions a part moves by between two frames."""


FROM_REST_RAD, AWAY = 0.8, 0.5
"""A turn that stays farther than this from the rest pose is worth this share of its gain less."""
JUMP_RAD, JUMP_STEPS, JUMP_GAP = 0.3, 4.0, 3
"""A turn jumps that makes more than this from frame to frame, and this many times its usual step;
and over how many frames that are left out it may go on so."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A motion and how well it explains a shot."""

    motion: Motion
    q: Array
    """Position in each frame of the shot (T,) [m or rad]."""
    cost: float
    """Sum over pixels and frames."""
    parts: tuple[int, ...]
    """What moves."""
    gain: float = 0.0
    """How much less it costs, bends included, than the best pose in which nothing would move. What
    the model of the object gets wrong costs both alike."""
    bends: float = 0.0
    """What the bends of its path cost."""
    even: bool = False
    """Whether it was found as an even motion through the whole shot."""

    @property
    def share(self) -> float:
        """What it explains of what it costs that nothing moves, 1 at most."""
        return self.gain / max(self.gain + self.price, 1e-12)

    @property
    def worth(self) -> float:
        """Its gain, less what a turn has to make up that never comes near where the part rests."""
        away = self.motion.kind == "turn" and np.abs(wrapped(self.q)).min() > FROM_REST_RAD
        return self.gain - (AWAY * abs(self.gain) if away else 0.0)

    @property
    def price(self) -> float:
        """What it costs altogether."""
        return self.cost + self.bends


def on_one_scale(fits: Sequence[Fit]) -> list[Fit]:
    """``fits`` of the same parts in the same shot, gains counted from the same pose at rest."""
    rest = min((fit.price + fit.gain for fit in fits), default=0.0)
    return [replace(fit, gain=rest - fit.price) for fit in fits]


def free_path(
    costs: Array, layers: Layers, share: float, largest: int, *, circular: bool
) -> tuple[Array, float]:
    """The cheapest path through ``costs`` (T, Q), in columns (T,), and the sum of what it passes.

    Args:
        costs: Cost of each position in each frame of ``layers``.
        layers: The shot.
        share: Of the cost of a changed step.
        largest: Most columns from frame to frame.
        circular: The last column is next to the first.
    """
    change = share * CHANGE_COST * CAP * layers.own_px
    path = best_path(costs, change, largest, circular)
    passed = costs[np.arange(len(costs)), path % costs.shape[1]]
    return np.asarray(path, dtype=np.float64), float(passed.sum())


def even_path(costs: Array, layers: Layers, *, circular: bool) -> tuple[Array, float]:
    """The same of the cheapest even motion, which is not caught where poses look alike.

    Args:
        costs: Cost of each position in each frame of ``layers``.
        layers: The shot.
        circular: The last column is next to the first.
    """
    n_frames, n_columns = costs.shape
    times = layers.shot.indices - layers.shot.indices[0]
    times = times / max(float(times[-1]), 1.0)
    most = int(MOST_TURN * n_columns) if circular else n_columns - 1
    path = best_line(costs, times, most, circular)
    passed = costs[np.arange(n_frames), np.rint(path).astype(int) % n_columns]
    return np.asarray(path), float(passed.sum())


def positions(motion: Motion, layers: Layers, reach_m: float) -> Array:
    """Positions at which a motion is tried (Q,) [m or rad].

    Args:
        motion: What is tried.
        layers: The shot.
        reach_m: Farthest a slide may go [m].
    """
    if motion.kind == "turn":
        n = turn_steps(motion, layers)
        return np.arange(n, dtype=np.float64) * (2.0 * np.pi / n)
    step = max(slide_step(motion, layers), 2.0 * reach_m / (MOST_SLIDE_STEPS - 1))
    half = max(1, round(reach_m / step))
    return np.arange(-half, half + 1, dtype=np.float64) * step


def turn_steps(motion: Motion, layers: Layers) -> int:
    """Positions on a full turn so near to each other that what moves overlaps itself.

    A handle of wire that passes between its pictures costs as much as one that is elsewhere.
    """
    round_px = 2.0 * np.pi / position_unit(motion, layers) * NUDGE_PX
    return int(np.clip(round_px / layers.thickness_px, TURN_STEPS, MOST_TURN_STEPS))


def slide_step(motion: Motion, layers: Layers) -> float:
    """How far a slide goes while its part's middle moves by `SLIDE_STEP_PX` in the picture [m]."""
    ends = layers.shot.project(motion.pivot_o + np.outer([-0.1, 0.1], motion.axis_o))
    px_per_m = float(np.linalg.norm(ends[1] - ends[0])) / 0.2
    return SLIDE_STEP_PX / max(px_per_m, 1e-6)


def coarse_fit(motion: Motion, layers: Layers, parts: tuple[int, ...], reach_m: float) -> Fit:
    """The cheapest path of ``motion`` through the shot."""
    return min(coarse_fits(motion, layers, parts, reach_m), key=lambda fit: fit.price)


def coarse_fits(
    motion: Motion, layers: Layers, parts: tuple[int, ...], reach_m: float, *, near: bool = False
) -> tuple[Fit, Fit]:
    """The cheapest path of ``motion`` through the shot, and the cheapest even one.

    Args:
        motion: What is tried.
        layers: The shot and the parts that move.
        parts: These parts.
        reach_m: Farthest a slide may go [m].
        near: Try slides near rest too, in steps of a pixel or two. Marks of a round part that turns
            look like such slides across its axis.
    """
    fits = _tried(motion, layers, parts, reach_m)
    near_m = 0.5 * (MOST_SLIDE_STEPS - 1) * slide_step(motion, layers)
    if near and motion.kind == "slide" and near_m < reach_m:
        # Steps that reach so far may be longer than all of a short slide.
        fits += _tried(motion, layers, parts, near_m)
    fits = on_one_scale(fits)
    free, even = ([fit for fit in fits if fit.even is is_even] for is_even in (False, True))
    return min(free, key=lambda fit: fit.price), min(even, key=lambda fit: fit.price)


def _tried(motion: Motion, layers: Layers, parts: tuple[int, ...], reach_m: float) -> list[Fit]:
    """The cheapest path through positions that go as far as ``reach_m``, and the cheapest even."""
    q = positions(motion, layers, reach_m)
    costs = np.ascontiguousarray(layers.costs(motion.T_o(q)).T)
    turning = motion.kind == "turn"
    finer = len(q) / TURN_STEPS if turning else 1.0
    free = free_path(costs, layers, 1.0 / finer, round(finer * LARGEST_STEP), circular=turning)
    even = even_path(costs, layers, circular=turning)
    rest = float(costs.sum(axis=0).min())
    found = []
    for (path, cost), is_even in ((free, False), (even, True)):
        fit = Fit(motion, q[0] + path * (q[1] - q[0]), cost, parts, even=is_even)
        bends = unevenness(fit, layers)
        found.append(replace(fit, bends=bends, gain=rest - cost - bends))
    return found


def path_again(fit: Fit, layers: Layers, step: float) -> Fit:
    """``fit`` with the cheapest path through positions a ``step`` apart, around its own.

    Args:
        fit: Where from; its positions are those of the frames of ``layers``. If it is even, so is
            the path.
        layers: The shot.
        step: Between neighbouring positions [m or rad].
    """
    low, high = float(fit.q.min()), float(fit.q.max())
    margin = 0.12 * (high - low) + 4.0 * step
    step = max(step, (high - low + 2.0 * margin) / MOST_POSITIONS)
    q = np.arange(low - margin, high + margin + 0.5 * step, step)
    costs = np.ascontiguousarray(layers.costs(fit.motion.T_o(q)).T)
    if fit.even:
        path, cost = even_path(costs, layers, circular=False)
    else:
        path, cost = free_path(costs, layers, FINE, max(8, len(q) // 2), circular=False)
    return _walked(replace(fit, q=q[0] + path * step, cost=cost), layers)


def turned_paths(fit: Fit, layers: Layers) -> tuple[Fit, Fit]:
    """The cheapest path of a turn through all of the circle, in fine steps; and the even one."""
    q = np.arange(FINE_TURN_STEPS, dtype=np.float64) * (2.0 * np.pi / FINE_TURN_STEPS)
    costs = np.ascontiguousarray(layers.costs(fit.motion.T_o(q)).T)
    free = free_path(costs, layers, FINE, LARGEST_STEP, circular=True)
    even = even_path(costs, layers, circular=True)
    first, second = (
        _walked(replace(fit, q=path * (q[1] - q[0]), cost=cost, even=is_even), layers)
        for (path, cost), is_even in ((free, False), (even, True))
    )
    return first, second


def without_jumps(q: Array) -> Array:
    """Positions of a turn (T,) [rad] as the longest sequence without a jump has them.

    A wire that cannot be seen in a frame may as well be anywhere, and a full turn more is the same
    pose. What is left out is put between its neighbours; ``q`` itself where nothing jumps.
    """
    steps = np.abs(np.diff(q))
    largest = max(JUMP_RAD, JUMP_STEPS * float(np.median(np.abs(wrapped(np.diff(q))))))
    if len(q) < 3 or steps.max() <= largest:
        return q
    frames = np.arange(len(q))
    gaps = frames[:, None] - frames[None]
    near = np.abs(wrapped(q[:, None] - q[None])) <= largest * np.minimum(gaps, JUMP_GAP)
    length, before = np.ones(len(q), dtype=np.int64), np.full(len(q), -1)
    for t in frames[1:]:
        linked = np.flatnonzero(near[t, :t])
        if len(linked):
            last = linked[length[linked] == length[linked].max()][-1]
            length[t], before[t] = length[last] + 1, last
    kept = [int(np.argmax(length))]
    while before[kept[-1]] >= 0:
        kept.append(int(before[kept[-1]]))
    kept = kept[::-1]
    chain = q[kept[0]] + np.concatenate([[0.0], np.cumsum(wrapped(np.diff(q[kept])))])
    return np.asarray(np.interp(frames, kept, chain))


def wrapped(angle: Array) -> Array:
    """Angles [rad] between minus and plus half a turn."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _walked(fit: Fit, layers: Layers) -> Fit:
    return replace(fit, bends=unevenness(fit, layers))


def with_gain(fit: Fit, layers: Layers) -> Fit:
    """``fit`` with its gain and bends in this shot."""
    still = np.unique([0.0, *np.linspace(fit.q.min(), fit.q.max(), STILL_POSES)])
    costs = layers.costs(fit.motion.T_o(still)).sum(axis=1)
    bends = unevenness(fit, layers)
    return replace(fit, bends=bends, gain=float(costs.min()) - fit.cost - bends)


def position_unit(motion: Motion, layers: Layers) -> float:
    """Change of position that moves the part by about a pixel [m or rad]."""
    points = layers.moving.points_o
    pixel_m = NUDGE_PX * layers.shot.pixel_m(points.mean(axis=0))
    if motion.kind == "slide":
        return pixel_m
    arm = points - motion.pivot_o
    across = arm - np.outer(arm @ motion.axis_o, motion.axis_o)
    return pixel_m / (float(np.percentile(np.linalg.norm(across, axis=1), 90)) + 1e-9)


def moves(fit: Fit, layers: Layers) -> bool:
    """Whether something moves by more than a pixel or two."""
    return float(np.ptp(fit.q)) >= LEAST_MOTION_PX * position_unit(fit.motion, layers)


def bending(motion: Motion, layers: Layers) -> Array:
    """What makes of positions (T,) their weighted second differences (T - 2,), whose squares cost.

    Frames need not be evenly spaced.
    """
    weight = np.sqrt(BEND * CAP * layers.own_px) / position_unit(motion, layers)
    gaps = np.diff(np.asarray(layers.shot.indices, dtype=np.float64))
    gaps /= np.mean(gaps)
    out = np.zeros((max(0, len(gaps) - 1), len(gaps) + 1))
    for i in range(len(out)):
        out[i, i : i + 3] = 1.0 / gaps[i], -1.0 / gaps[i] - 1.0 / gaps[i + 1], 1.0 / gaps[i + 1]
    return np.asarray(weight * out)


def unevenness(fit: Fit, layers: Layers) -> float:
    """What the bends of the path of ``fit`` cost."""
    squares = (bending(fit.motion, layers) @ fit.q) ** 2
    return float(np.minimum(squares, MOST_BEND * CAP * layers.own_px).sum())
