"""Search: every candidate motion at every position, against every frame; the cheapest path wins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.reconstruct.actors.geometric.compositing import Compositing
from articulate.reconstruct.actors.geometric.kernels import best_path, best_uniform_path
from articulate.reconstruct.actors.geometric.parameters import COMPOSITING, SEARCH
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.transforms import Array


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A motion and how well it explains the frames of a crop."""

    motion: JointMotion
    q: Array
    """Position in each frame (T,) [m or rad]."""
    cost: float
    """Sum of the costs over pixels and frames."""
    parts: tuple[int, ...]
    """Indices of the moving parts, the leading one first."""
    gain: float = 0.0
    """Decrease of the total cost relative to the best constant pose; errors of the model cost both
    alike."""
    bend_cost: float = 0.0
    """Cost of the bends of its path."""
    uniform: bool = False
    """The path was found as a uniform motion."""

    @property
    def share(self) -> float:
        """Gain as a share of the cost of a static object, 1 at most."""
        return self.gain / max(self.gain + self.total_cost, 1e-12)

    @property
    def score(self) -> float:
        """Gain, reduced for a rotation that never comes close to the rest pose."""
        away = (
            self.motion.kind == "turn"
            and np.abs(wrap_angle(self.q)).min() > SEARCH.max_rest_distance_rad
        )
        return self.gain - (SEARCH.away_penalty * abs(self.gain) if away else 0.0)

    @property
    def total_cost(self) -> float:
        """Cost of pixels and bends."""
        return self.cost + self.bend_cost


def rescale_gains(fits: Sequence[MotionFit]) -> list[MotionFit]:
    """Recompute the gains of ``fits`` of the same parts from one common rest cost."""
    rest = min((fit.total_cost + fit.gain for fit in fits), default=0.0)
    return [replace(fit, gain=rest - fit.total_cost) for fit in fits]


def free_path(
    costs: Array, layers: Compositing, share: float, largest: int, *, circular: bool
) -> tuple[Array, float]:
    """Return the cheapest path through ``costs`` (T, Q) in columns (T,), and its pixel cost.

    Args:
        costs: Cost of each position in each frame of ``layers`` (T, Q).
        layers: The frames.
        share: Factor on the cost of a changed step (dimensionless).
        largest: Most columns from frame to frame.
        circular: The last column is next to the first.
    """
    change = share * SEARCH.step_change_cost * COMPOSITING.pixel_cost_cap * layers.own_px
    path = best_path(costs, change, largest, circular)
    passed = costs[np.arange(len(costs)), path % costs.shape[1]]
    return np.asarray(path, dtype=np.float64), float(passed.sum())


def uniform_path(costs: Array, layers: Compositing, *, circular: bool) -> tuple[Array, float]:
    """Return the cheapest uniform path, which ambiguous poses do not distort, and its pixel cost.

    Args:
        costs: Cost of each position in each frame of ``layers`` (T, Q), dimensionless.
        layers: The frames.
        circular: The last column is next to the first.
    """
    n_frames, n_columns = costs.shape
    times = layers.crop.indices - layers.crop.indices[0]
    times = times / max(float(times[-1]), 1.0)
    most = int(SEARCH.max_uniform_turns * n_columns) if circular else n_columns - 1
    path = best_uniform_path(costs, times, most, circular)
    passed = costs[np.arange(n_frames), np.rint(path).astype(int) % n_columns]
    return np.asarray(path), float(passed.sum())


def trial_positions(motion: JointMotion, layers: Compositing, reach_m: float) -> Array:
    """Return the positions at which a motion is tried (Q,) [m or rad].

    Args:
        motion: The motion.
        layers: The frames.
        reach_m: Longest travel of a slide [m].
    """
    if motion.kind == "turn":
        n = turn_steps(motion, layers)
        return np.arange(n, dtype=np.float64) * (2.0 * np.pi / n)
    step = max(slide_step(motion, layers), 2.0 * reach_m / (SEARCH.max_slide_positions - 1))
    half = max(1, round(reach_m / step))
    return np.arange(-half, half + 1, dtype=np.float64) * step


def turn_steps(motion: JointMotion, layers: Compositing) -> int:
    """Return the number of positions on a full turn at which consecutive images overlap.

    A wire handle that passes between two positions costs as much as one that is elsewhere.
    """
    round_px = 2.0 * np.pi / position_unit(motion, layers) * SEARCH.position_unit_px
    return int(
        np.clip(round_px / layers.thickness_px, SEARCH.turn_positions, SEARCH.max_turn_positions)
    )


def slide_step(motion: JointMotion, layers: Compositing) -> float:
    """Return the travel that moves the part's centre by one position step in the image [m]."""
    ends = layers.crop.project(motion.pivot_o + np.outer([-0.1, 0.1], motion.axis_o))
    px_per_m = float(np.linalg.norm(ends[1] - ends[0])) / 0.2
    return SEARCH.slide_step_px / max(px_per_m, 1e-6)


def coarse_fit(
    motion: JointMotion, layers: Compositing, parts: tuple[int, ...], reach_m: float
) -> MotionFit:
    """Return the cheapest path of ``motion``."""
    return min(coarse_fits(motion, layers, parts, reach_m), key=lambda fit: fit.total_cost)


def coarse_fits(
    motion: JointMotion,
    layers: Compositing,
    parts: tuple[int, ...],
    reach_m: float,
    *,
    near: bool = False,
) -> tuple[MotionFit, MotionFit]:
    """Return the cheapest path of ``motion`` and the cheapest uniform path.

    Args:
        motion: The motion.
        layers: The frames and the moving parts.
        parts: Indices of these parts.
        reach_m: Longest travel of a slide [m].
        near: Try short slides too, in steps of a pixel or two. Marks of a rotating round part look
            like such slides across its axis.
    """
    fits = _tried(motion, layers, parts, reach_m)
    near_m = 0.5 * (SEARCH.max_slide_positions - 1) * slide_step(motion, layers)
    if near and motion.kind == "slide" and near_m < reach_m:
        # Steps that cover the full reach may be longer than a short slide.
        fits += _tried(motion, layers, parts, near_m)
    fits = rescale_gains(fits)
    free, uniform = (
        [fit for fit in fits if fit.uniform is is_uniform] for is_uniform in (False, True)
    )
    return min(free, key=lambda fit: fit.total_cost), min(uniform, key=lambda fit: fit.total_cost)


def _tried(
    motion: JointMotion, layers: Compositing, parts: tuple[int, ...], reach_m: float
) -> list[MotionFit]:
    """Return the cheapest paths, free and uniform, through positions up to ``reach_m``."""
    q = trial_positions(motion, layers, reach_m)
    costs = np.ascontiguousarray(layers.costs(motion.T_o(q)).T)
    turning = motion.kind == "turn"
    finer = len(q) / SEARCH.turn_positions if turning else 1.0
    free = free_path(
        costs, layers, 1.0 / finer, round(finer * SEARCH.max_step_positions), circular=turning
    )
    uniform = uniform_path(costs, layers, circular=turning)
    rest = float(costs.sum(axis=0).min())
    found = []
    for (path, cost), is_uniform in ((free, False), (uniform, True)):
        fit = MotionFit(motion, q[0] + path * (q[1] - q[0]), cost, parts, uniform=is_uniform)
        bend_cost = path_bend_cost(fit, layers)
        found.append(replace(fit, bend_cost=bend_cost, gain=rest - cost - bend_cost))
    return found


def refine_path(fit: MotionFit, layers: Compositing, step: float) -> MotionFit:
    """Search the path again through positions a ``step`` apart, around those of ``fit``.

    Args:
        fit: The fit, with positions in the frames of ``layers``; a uniform path stays uniform.
        layers: The frames.
        step: Distance of neighbouring positions [m or rad].
    """
    low, high = float(fit.q.min()), float(fit.q.max())
    margin = 0.12 * (high - low) + 4.0 * step
    step = max(step, (high - low + 2.0 * margin) / SEARCH.max_positions)
    q = np.arange(low - margin, high + margin + 0.5 * step, step)
    costs = np.ascontiguousarray(layers.costs(fit.motion.T_o(q)).T)
    if fit.uniform:
        path, cost = uniform_path(costs, layers, circular=False)
    else:
        path, cost = free_path(
            costs, layers, SEARCH.fine_change_share, max(8, len(q) // 2), circular=False
        )
    return _with_bend_cost(replace(fit, q=q[0] + path * step, cost=cost), layers)


def full_turn_paths(fit: MotionFit, layers: Compositing) -> tuple[MotionFit, MotionFit]:
    """Return the cheapest paths of a rotation on the full circle, free and uniform."""
    q = np.arange(SEARCH.fine_turn_positions, dtype=np.float64) * (
        2.0 * np.pi / SEARCH.fine_turn_positions
    )
    costs = np.ascontiguousarray(layers.costs(fit.motion.T_o(q)).T)
    free = free_path(
        costs, layers, SEARCH.fine_change_share, SEARCH.max_step_positions, circular=True
    )
    uniform = uniform_path(costs, layers, circular=True)
    first, second = (
        _with_bend_cost(replace(fit, q=path * (q[1] - q[0]), cost=cost, uniform=is_uniform), layers)
        for (path, cost), is_uniform in ((free, False), (uniform, True))
    )
    return first, second


def without_jumps(q: Array) -> Array:
    """Return positions of a rotation (T,) [rad] along the longest sequence without a jump.

    A wire that is invisible in a frame may be anywhere, and a full turn more is the same pose.
    Frames outside the sequence are interpolated; ``q`` itself is returned if it has no jump.
    """
    steps = np.abs(np.diff(q))
    largest = max(
        SEARCH.jump_rad, SEARCH.jump_step_ratio * float(np.median(np.abs(wrap_angle(np.diff(q)))))
    )
    if len(q) < 3 or steps.max() <= largest:
        return q
    frames = np.arange(len(q))
    gaps = frames[:, None] - frames[None]
    near = np.abs(wrap_angle(q[:, None] - q[None])) <= largest * np.minimum(
        gaps, SEARCH.jump_gap_frames
    )
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
    chain = q[kept[0]] + np.concatenate([[0.0], np.cumsum(wrap_angle(np.diff(q[kept])))])
    return np.asarray(np.interp(frames, kept, chain))


def wrap_angle(angle: Array) -> Array:
    """Return angles (...) [rad] in [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _with_bend_cost(fit: MotionFit, layers: Compositing) -> MotionFit:
    return replace(fit, bend_cost=path_bend_cost(fit, layers))


def with_gain(fit: MotionFit, layers: Compositing) -> MotionFit:
    """Return ``fit`` with its gain and bend cost in this crop."""
    still = np.unique([0.0, *np.linspace(fit.q.min(), fit.q.max(), SEARCH.still_poses)])
    costs = layers.costs(fit.motion.T_o(still)).sum(axis=1)
    bend_cost = path_bend_cost(fit, layers)
    return replace(fit, bend_cost=bend_cost, gain=float(costs.min()) - fit.cost - bend_cost)


def position_unit(motion: JointMotion, layers: Compositing) -> float:
    """Return the change of position that moves the part by about a pixel [m or rad]."""
    points = layers.moving.points_o
    pixel_m = SEARCH.position_unit_px * layers.crop.pixel_m(points.mean(axis=0))
    if motion.kind == "slide":
        return pixel_m
    arm = points - motion.pivot_o
    across = arm - np.outer(arm @ motion.axis_o, motion.axis_o)
    return pixel_m / (float(np.percentile(np.linalg.norm(across, axis=1), 90)) + 1e-9)


def moves(fit: MotionFit, layers: Compositing) -> bool:
    """Return whether the part moves by more than a pixel or two."""
    return float(np.ptp(fit.q)) >= SEARCH.min_motion_px * position_unit(fit.motion, layers)


def bend_matrix(motion: JointMotion, layers: Compositing) -> Array:
    """Return the weighted second differences of positions as a matrix (T - 2, T).

    Their squares are costs.

    Frames need not be evenly spaced.
    """
    weight = np.sqrt(SEARCH.bend_cost * COMPOSITING.pixel_cost_cap * layers.own_px) / position_unit(
        motion, layers
    )
    gaps = np.diff(np.asarray(layers.crop.indices, dtype=np.float64))
    out = np.zeros((max(0, len(gaps) - 1), len(gaps) + 1))
    gaps /= np.mean(gaps) if len(gaps) else 1.0
    for i in range(len(out)):
        out[i, i : i + 3] = 1.0 / gaps[i], -1.0 / gaps[i] - 1.0 / gaps[i + 1], 1.0 / gaps[i + 1]
    return np.asarray(weight * out)


def path_bend_cost(fit: MotionFit, layers: Compositing) -> float:
    """Return the cost of the bends of the path of ``fit``."""
    squares = (bend_matrix(fit.motion, layers) @ fit.q) ** 2
    return float(
        np.minimum(squares, SEARCH.max_bend_cost * COMPOSITING.pixel_cost_cap * layers.own_px).sum()
    )
