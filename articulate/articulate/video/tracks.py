"""Tracks: points followed through a clip by Lucas and Kanade, forth and back, and sown again."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.render.raster import Pixels
from articulate.transforms import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class PointTracks:
    """Points followed through a clip."""

    uv: Array
    """Pixels (T, N, 2), OpenCV's coordinates."""
    visible: NDArray[np.bool_]
    """Whether the point is seen (T, N)."""

    def __post_init__(self) -> None:
        """Refuse shapes that do not belong together."""
        if self.uv.ndim != 3 or self.uv.shape[2] != 2 or self.visible.shape != self.uv.shape[:2]:
            raise UsageError(
                f"tracks of shape {self.uv.shape} with visibility {self.visible.shape}; "
                "(T, N, 2) and (T, N) were expected"
            )


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """How points are followed."""

    most_points: int = 600
    """Points that are alive at a time."""
    every: int = 5
    """Frames after which points are sown where there are none."""
    spacing_px: int = 6
    """Least distance between points when sown."""
    quality: float = 0.002
    """Least corner strength, as a share of the strongest; low, for surfaces are plain."""
    back_px: float = 0.7
    """Farthest a point may come back from where it started when followed backwards."""
    window_px: int = 15
    """Side of the window that is compared."""


def follow_points(
    frames: Pixels, tracking: Tracking | None = None, mask: NDArray[np.bool_] | None = None
) -> PointTracks:
    """Points followed from where they are sown to where they are lost.

    Args:
        frames: (T, H, W, 3).
        tracking: How.
        mask: Where points are sown (H, W); everywhere if None.
    """
    how = tracking or Tracking()
    grey = [cv2.GaussianBlur(cv2.cvtColor(f, cv2.COLOR_RGB2GRAY), (0, 0), 0.8) for f in frames]
    done: list[list[tuple[int, float, float]]] = []
    alive: list[list[tuple[int, float, float]]] = []
    for t, image in enumerate(grey):
        if t:
            alive = _followed(grey[t - 1], image, t, alive, done, how)
        if t % how.every == 0 and len(alive) < how.most_points:
            spots = np.array([track[-1][1:] for track in alive], dtype=np.float64).reshape(-1, 2)
            alive += [[(t, u, v)] for u, v in _sown(image, spots, how, mask)]
    done += alive
    done = [track for track in done if len(track) > 1]
    uv = np.zeros((len(frames), len(done), 2))
    visible = np.zeros((len(frames), len(done)), dtype=np.bool_)
    for n, track in enumerate(done):
        for t, u, v in track:
            uv[t, n], visible[t, n] = (u, v), True
    return PointTracks(uv=uv, visible=visible)


def read_tracks(path: Path, n_frames: int) -> PointTracks:
    """Tracks that another program computed: an ``.npz`` with ``tracks`` and ``visibility``.

    Raises:
        UsageError: It cannot be read, or the arrays are not those of a clip of ``n_frames``.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            missing = {"tracks", "visibility"} - set(content.files)
            if missing:
                raise UsageError(f"{path}: has no array {', '.join(sorted(missing))}")
            uv = np.asarray(content["tracks"], dtype=np.float64)
            visible = np.asarray(content["visibility"]).astype(np.bool_)
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise UsageError(
            f"{path}: cannot be read as tracks ({error}); an .npz of plain arrays tracks (T, N, 2) "
            "and visibility (T, N) can"
        ) from None
    if len(uv) != n_frames:
        raise UsageError(f"{path}: tracks of {len(uv)} frames; the clip has {n_frames}")
    return PointTracks(uv=uv, visible=visible & np.isfinite(uv).all(axis=-1))


def _followed(
    before: Pixels,
    after: Pixels,
    t: int,
    alive: list[list[tuple[int, float, float]]],
    done: list[list[tuple[int, float, float]]],
    how: Tracking,
) -> list[list[tuple[int, float, float]]]:
    """The tracks that go on; the others are moved to ``done``."""
    if not alive:
        return alive
    window = (how.window_px, how.window_px)
    old = np.array([track[-1][1:] for track in alive], dtype=np.float32).reshape(-1, 1, 2)
    flow: Any = cv2.calcOpticalFlowPyrLK  # its stub forbids the None its manual asks for
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


def _sown(
    image: Pixels, taken: Array, how: Tracking, mask: NDArray[np.bool_] | None
) -> NDArray[np.float64]:
    """New points (N, 2) away from those at ``taken`` (M, 2)."""
    free = (
        np.full(image.shape, 255, dtype=np.uint8) if mask is None else mask.astype(np.uint8) * 255
    )
    for u, v in taken:
        cv2.circle(free, (round(float(u)), round(float(v))), how.spacing_px, 0, -1)
    n = max(1, how.most_points - len(taken))
    corners: Any = cv2.goodFeaturesToTrack  # None where there are none, which its stub hides
    found = corners(image, n, how.quality, how.spacing_px, mask=free)
    if found is None:
        return np.empty((0, 2))
    return np.asarray(found.reshape(-1, 2), dtype=np.float64)
