"""Fit a hinge and a slide to point tracks: bundle adjustment with one joint position per frame.

Each point has a place in space at joint position 0; each frame has one joint position; all share
the joint's axis. The camera is static (its motion is removed before) and its focal length is
assumed. Levenberg-Marquardt with the points eliminated (Schur complement), robust weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array, Ints
from articulate.video.joint_kernels import DEPTH_SPREAD, NEAREST, place, refine, residuals

PIXEL = 1.0
"""Noise of a track [px]; residuals are in this unit."""
FRAMES = 16
"""Frames that are fitted."""
POINTS = 100
"""Points that are fitted."""
SHORT, LONG = 7, 30
"""Iterations from each start, and of the best one."""

Kind = Literal["revolute", "prismatic"]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackSet:
    """Tracks in a few frames, in units of the focal length from the image centre."""

    xy: Array
    """Positions (N, T, 2)."""
    seen: NDArray[np.bool_]
    """Visibility (N, T)."""
    frames: Ints
    """Frame of the video of each column (T,)."""
    names: Ints
    """Index of each track in the video (N,)."""
    focal_px: float
    """Assumed focal length [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFit:
    """A fitted joint in the camera frame; the mean depth of the points is 1."""

    kind: Kind
    axis: Array
    """Unit axis (3,)."""
    pivot: Array
    """Point on the axis (3,), at depth 1; zeros for a slide."""
    positions: Array
    """Joint position at each frame (T,) [rad or mean depths]."""
    points: Array
    """Points at position 0 (N, 3)."""
    rms: Array
    """Root mean square residual of each track (N,) [px]."""
    cost: float
    """Robust cost for each observation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """First guess of a joint."""

    axis: Array
    pivot: Array
    positions: Array
    points: Array


def best_fit(kind: Kind, tracks: TrackSet, starts: list[Start]) -> JointFit:
    """Return the best fit of a joint type from several starts.

    Args:
        kind: Joint type.
        tracks: Tracks of one rigid part.
        starts: First guesses; at least one.
    """
    turns = kind == "revolute"
    scale = tracks.focal_px / PIXEL
    found = []
    for start in starts:
        state = (
            start.axis.copy(),
            start.pivot.copy(),
            start.positions.copy(),
            start.points.copy(),
        )
        cost = refine(turns, *state, tracks.xy, tracks.seen, scale, SHORT)
        found.append((cost, state))
    found.sort(key=lambda one: one[0])
    best_cost, best_state = np.inf, found[0][1]
    for _, state in found[:2]:
        cost = refine(turns, *state, tracks.xy, tracks.seen, scale, LONG)
        if cost < best_cost:
            best_cost, best_state = cost, state
    off = residuals(turns, *best_state, tracks.xy, tracks.seen, scale)
    count = np.maximum(tracks.seen.sum(axis=1), 1)
    axis, pivot, positions, points = best_state
    return JointFit(
        kind=kind,
        axis=axis,
        pivot=pivot,
        positions=positions,
        points=points,
        rms=np.sqrt((off**2).sum(axis=1) / count),
        cost=float(best_cost) / max(int(tracks.seen.sum()), 1),
    )


def residuals_under(fit: JointFit, tracks: TrackSet) -> Array:
    """Return the root mean square residual (N,) [px] of other tracks under a fitted joint.

    Args:
        fit: The joint.
        tracks: Tracks in the same frames.
    """
    turns = fit.kind == "revolute"
    scale = tracks.focal_px / PIXEL
    middle = int(np.argmin(np.abs(fit.positions - np.median(fit.positions))))
    first = np.where(tracks.seen[:, middle, None], tracks.xy[:, middle], _first_seen(tracks))
    points = np.concatenate([first, np.ones((len(first), 1))], axis=1)
    state = (fit.axis, fit.pivot, fit.positions, points)
    place(turns, *state, tracks.xy, tracks.seen, scale)
    off = residuals(turns, *state, tracks.xy, tracks.seen, scale)
    rms = np.sqrt((off**2).sum(axis=1) / np.maximum(tracks.seen.sum(axis=1), 1))
    compact = np.abs(np.log(np.maximum(points[:, 2], NEAREST))) < 2.5 * DEPTH_SPREAD
    return np.asarray(np.where(compact, rms, np.inf))


def _first_seen(tracks: TrackSet) -> Array:
    at = tracks.seen.argmax(axis=1)
    return np.asarray(tracks.xy[np.arange(len(at)), at])
