"""Moving points of a video after the camera's motion is removed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array
from articulate.video.tracks import PointTracks

STATIC_PX = 1.5
"""Points that fit the background's motion to within this are static [px]."""
MIN_POINTS = 12
"""Fewer points in two frames do not determine the camera's motion."""
MIN_MOTION_SHARE = 0.025
"""A point moves if it travels farther than this share of the larger side of the image."""
CELLS = 10
"""Cells along each side of the image; each counts equally in the camera's motion."""
CELL_POINTS = 4
"""Points of a cell that count."""
ROUNDS = 3
"""Times that the camera's motion is fitted again to the mean places of static points."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingPoints:
    """Points that move against the background, in pixels of the first frame."""

    uv: Array
    """Pixels (T, N, 2) as seen from the first camera pose."""
    visible: NDArray[np.bool_]
    """Visibility (T, N), boolean."""
    camera: Array
    """Homographies from each frame to the first (T, 3, 3)."""


def camera_motion(tracks: PointTracks) -> Array:
    """Return the homographies from each frame to the first (T, 3, 3), by the motion of most points.

    Most of the image is assumed to be background, counted by cells, so that one textured surface
    does not outvote the rest; where too few points are visible, the camera is assumed to be static.
    The steps between frames are then corrected by the mean places of static points, which removes
    the drift of long videos.
    """
    n_frames = len(tracks.uv)
    motion = np.tile(np.eye(3), (n_frames, 1, 1))
    for t in range(1, n_frames):
        both = np.nonzero(tracks.visible[t] & tracks.visible[t - 1])[0]
        both = both[_spread(tracks.uv[t][both])]
        motion[t] = motion[t - 1] @ _similarity(tracks.uv[t][both], tracks.uv[t - 1][both])
    for _ in range(ROUNDS):
        motion = _aligned(tracks, motion)
    return motion


def stabilised(tracks: PointTracks, camera: Array) -> Array:
    """Return the pixels (T, N, 2) of tracks as seen from the first camera pose.

    Args:
        tracks: Tracked points.
        camera: Homographies from each frame to the first (T, 3, 3).
    """
    ones = np.ones((*tracks.uv.shape[:2], 1))
    uv = np.einsum("tij,tnj->tni", camera, np.concatenate([tracks.uv, ones], axis=2))
    return np.asarray(uv[..., :2] / uv[..., 2:])


def _similarity(here: Array, there: Array) -> Array:
    """Return the transform (3, 3) by shift, turn and scaling of most of ``here`` to ``there``."""
    step = np.eye(3)
    if len(here) >= MIN_POINTS:
        found, _ = cv2.estimateAffinePartial2D(
            here, there, method=cv2.RANSAC, ransacReprojThreshold=STATIC_PX
        )
        if found is not None:
            step[:2] = found
    return step


def _spread(uv: Array) -> NDArray[np.int64]:
    """Return the indices of at most ``CELL_POINTS`` points in each cell of the image."""
    if len(uv) == 0:
        return np.empty(0, dtype=np.int64)
    low, high = uv.min(axis=0), uv.max(axis=0)
    at = np.minimum((uv - low) / np.maximum(high - low, 1.0) * CELLS, CELLS - 1).astype(int)
    cell = at[:, 0] * CELLS + at[:, 1]
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], cell[order])
    return np.sort(order[np.arange(len(order)) - start < CELL_POINTS])


def _aligned(tracks: PointTracks, motion: Array) -> Array:
    """Return the motion of the camera (T, 3, 3), fitted to the mean places of static points."""
    uv = stabilised(tracks, motion)
    seen = tracks.visible
    count = np.maximum(seen.sum(axis=0), 1)
    places = np.where(seen[..., None], uv, 0.0).sum(axis=0) / count[:, None]
    off = np.linalg.norm(uv - places, axis=2)
    spread = np.where(seen, off, 0.0).max(axis=0)
    limit = max(2.0 * STATIC_PX, float(np.median(spread[count > 3])) if (count > 3).any() else 0.0)
    static = (spread <= limit) & (count > 3)
    corrected = motion.copy()
    for t in range(len(uv)):
        now = np.nonzero(seen[t] & static)[0]
        now = now[_spread(tracks.uv[t][now])]
        if len(now) < MIN_POINTS:
            continue
        corrected[t] = _similarity(tracks.uv[t][now], places[now])
    return np.asarray(np.linalg.inv(corrected[0]) @ corrected)


def moving_points(tracks: PointTracks, size_px: tuple[int, int]) -> MovingPoints:
    """Return the points of ``tracks`` that move against the background.

    Args:
        tracks: Tracked points.
        size_px: Width and height of the video [px].
    """
    camera = camera_motion(tracks)
    uv = stabilised(tracks, camera)
    visible_uv = np.where(tracks.visible[..., None], uv, np.nan)
    with np.errstate(all="ignore"):
        spread = np.nanmax(visible_uv, axis=0, initial=-np.inf) - np.nanmin(
            visible_uv, axis=0, initial=np.inf
        )
    moved = np.linalg.norm(np.nan_to_num(spread, posinf=0.0, neginf=0.0), axis=1)
    chosen = moved > MIN_MOTION_SHARE * max(size_px)
    return MovingPoints(uv=uv[:, chosen], visible=tracks.visible[:, chosen], camera=camera)
