"""Point tracks: Lucas-Kanade optical flow with a forward-backward check, and regular reseeding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.render.raster import Pixels
from articulate.transforms import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class PointTracks:
    """Points tracked through a video."""

    uv: Array
    """Pixels (T, N, 2), OpenCV's coordinates."""
    visible: NDArray[np.bool_]
    """Visibility (T, N), boolean."""

    def __post_init__(self) -> None:
        """Check that the shapes match."""
        if self.uv.ndim != 3 or self.uv.shape[2] != 2 or self.visible.shape != self.uv.shape[:2]:
            raise UsageError(
                f"tracks of shape {self.uv.shape} with visibility {self.visible.shape}; "
                "(T, N, 2) and (T, N) were expected"
            )


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """Parameters of point tracking."""

    most_points: int = 600
    """Points tracked at a time."""
    every: int = 5
    """Frames after which new points are added."""
    spacing_px: int = 6
    """Least distance of new points to others [px]."""
    quality: float = 0.002
    """Least corner strength, as a share of the strongest; low, since surfaces are plain."""
    back_px: float = 0.7
    """Largest forward-backward error [px]."""
    window_px: int = 15
    """Side of the window that is compared [px]."""


def follow_points(
    frames: Pixels, tracking: Tracking | None = None, mask: NDArray[np.bool_] | None = None
) -> PointTracks:
    """Track points from where they are added to where they are lost.

    Args:
        frames: Colours (T, H, W, 3), 0 to 255.
        tracking: Parameters.
        mask: Where points are added (H, W), boolean; everywhere if None.
    """
    how = tracking or Tracking()
    grey = [cv2.GaussianBlur(cv2.cvtColor(f, cv2.COLOR_RGB2GRAY), (0, 0), 0.8) for f in frames]
    done: list[list[tuple[int, float, float]]] = []
    alive: list[list[tuple[int, float, float]]] = []
    for t, image in enumerate(grey):
        if t:
            alive = _track_points(grey[t - 1], image, t, alive, done, how)
        if t % how.every == 0 and len(alive) < how.most_points:
            spots = np.array([track[-1][1:] for track in alive], dtype=np.float64).reshape(-1, 2)
            alive += [[(t, u, v)] for u, v in _new_points(image, spots, how, mask)]
    done += alive
    done = [track for track in done if len(track) > 1]
    uv = np.zeros((len(frames), len(done), 2))
    visible = np.zeros((len(frames), len(done)), dtype=np.bool_)
    for n, track in enumerate(done):
        for t, u, v in track:
            uv[t, n], visible[t, n] = (u, v), True
    return PointTracks(uv=uv, visible=visible)


def _track_points(
    before: Pixels,
    after: Pixels,
    t: int,
    alive: list[list[tuple[int, float, float]]],
    done: list[list[tuple[int, float, float]]],
    how: Tracking,
) -> list[list[tuple[int, float, float]]]:
    """Return the tracks that continue; the others are moved to ``done``."""
    if not alive:
        return alive
    window = (how.window_px, how.window_px)
    old = np.array([track[-1][1:] for track in alive], dtype=np.float32).reshape(-1, 1, 2)
    flow: Any = cv2.calcOpticalFlowPyrLK  # its stub forbids the None that its manual requires
    new, good, _ = flow(before, after, old, None, winSize=window, maxLevel=3)
    back, again, _ = flow(after, before, new, None, winSize=window, maxLevel=3)
    off = np.linalg.norm((back - old).reshape(-1, 2), axis=1)
    height, width = after.shape
    spots = new.reshape(-1, 2)
    inside = (spots >= 0).all(axis=1) & (spots[:, 0] < width) & (spots[:, 1] < height)
    fine = (good.reshape(-1) == 1) & (again.reshape(-1) == 1) & (off < how.back_px) & inside
    kept = []
    for track, spot, ok in zip(alive, spots, fine, strict=True):
        if ok:
            track.append((t, float(spot[0]), float(spot[1])))
            kept.append(track)
        else:
            done.append(track)
    return kept


def _new_points(
    image: Pixels, occupied: Array, how: Tracking, mask: NDArray[np.bool_] | None
) -> NDArray[np.float64]:
    """Return new points (N, 2) away from those at ``occupied`` (M, 2)."""
    free = (
        np.full(image.shape, 255, dtype=np.uint8) if mask is None else mask.astype(np.uint8) * 255
    )
    for u, v in occupied:
        cv2.circle(free, (round(float(u)), round(float(v))), how.spacing_px, 0, -1)
    n = max(1, how.most_points - len(occupied))
    corners: Any = cv2.goodFeaturesToTrack  # returns None without corners, which its stub hides
    found = corners(image, n, how.quality, how.spacing_px, mask=free)
    if found is None:
        return np.empty((0, 2))
    return np.asarray(found.reshape(-1, 2), dtype=np.float64)
