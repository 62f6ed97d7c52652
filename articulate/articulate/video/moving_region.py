"""Moving: what moves in a film, the motion of the camera taken away."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array
from articulate.video.tracks import PointTracks

STILL_PX = 1.5
"""Points that fit the motion of the background to within this stand still."""
FEWEST = 12
"""Fewer points in two frames say nothing of the camera."""
MOVED = 0.025
"""A point has moved that went farther than this share of the picture's larger side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingPoints:
    """Points that move against the background, in the picture of the first frame."""

    uv: Array
    """Pixels (T, N, 2), as if the camera had stood where it stood first."""
    visible: NDArray[np.bool_]
    """(T, N)."""
    camera: Array
    """Takes pixels of each frame to pixels of the first (T, 3, 3)."""


def camera_motion(tracks: PointTracks) -> Array:
    """What takes each frame's pixels to those of the first, by what most points do (T, 3, 3).

    The background is thought to be what most points agree on from one frame to the next; where too
    few are seen, the camera is thought to stand still.
    """
    n_frames = len(tracks.uv)
    motion = np.tile(np.eye(3), (n_frames, 1, 1))
    for t in range(1, n_frames):
        both = tracks.visible[t] & tracks.visible[t - 1]
        step = np.eye(3)
        if both.sum() >= FEWEST:
            here, there = tracks.uv[t][both], tracks.uv[t - 1][both]
            found, _ = cv2.estimateAffinePartial2D(
                here, there, method=cv2.RANSAC, ransacReprojThreshold=STILL_PX
            )
            if found is not None:
                step[:2] = found
        motion[t] = motion[t - 1] @ step
    return motion


def moving_points(tracks: PointTracks, size_px: tuple[int, int]) -> MovingPoints:
    """The points of ``tracks`` that move against the background.

    Args:
        tracks: Points of a film.
        size_px: Width and height of the film.
    """
    camera = camera_motion(tracks)
    ones = np.ones((*tracks.uv.shape[:2], 1))
    uv = np.einsum("tij,tnj->tni", camera, np.concatenate([tracks.uv, ones], axis=2))
    uv = uv[..., :2] / uv[..., 2:]
    shown = np.where(tracks.visible[..., None], uv, np.nan)
    with np.errstate(all="ignore"):
        spread = np.nanmax(shown, axis=0, initial=-np.inf) - np.nanmin(
            shown, axis=0, initial=np.inf
        )
    moved = np.linalg.norm(np.nan_to_num(spread, posinf=0.0, neginf=0.0), axis=1)
    chosen = moved > MOVED * max(size_px)
    return MovingPoints(uv=uv[:, chosen], visible=tracks.visible[:, chosen], camera=camera)
