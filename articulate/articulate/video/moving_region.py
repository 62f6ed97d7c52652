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

    Most points from one frame to the next are assumed to be background; where too few are visible,
    the camera is assumed to be static.
    """
    n_frames = len(tracks.uv)
    motion = np.tile(np.eye(3), (n_frames, 1, 1))
    for t in range(1, n_frames):
        both = tracks.visible[t] & tracks.visible[t - 1]
        step = np.eye(3)
        if both.sum() >= MIN_POINTS:
            here, there = tracks.uv[t][both], tracks.uv[t - 1][both]
            found, _ = cv2.estimateAffinePartial2D(
                here, there, method=cv2.RANSAC, ransacReprojThreshold=STATIC_PX
            )
            if found is not None:
                step[:2] = found
        motion[t] = motion[t - 1] @ step
    return motion


def moving_points(tracks: PointTracks, size_px: tuple[int, int]) -> MovingPoints:
    """Return the points of ``tracks`` that move against the background.

    Args:
        tracks: Tracked points.
        size_px: Width and height of the video [px].
    """
    camera = camera_motion(tracks)
    ones = np.ones((*tracks.uv.shape[:2], 1))
    uv = np.einsum("tij,tnj->tni", camera, np.concatenate([tracks.uv, ones], axis=2))
    uv = uv[..., :2] / uv[..., 2:]
    visible_uv = np.where(tracks.visible[..., None], uv, np.nan)
    with np.errstate(all="ignore"):
        spread = np.nanmax(visible_uv, axis=0, initial=-np.inf) - np.nanmin(
            visible_uv, axis=0, initial=np.inf
        )
    moved = np.linalg.norm(np.nan_to_num(spread, posinf=0.0, neginf=0.0), axis=1)
    chosen = moved > MIN_MOTION_SHARE * max(size_px)
    return MovingPoints(uv=uv[:, chosen], visible=tracks.visible[:, chosen], camera=camera)
