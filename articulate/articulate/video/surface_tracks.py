"""Dense point tracks from optical flow, also on surfaces with little texture.

Brightness is normalised by its local mean and deviation, optical flow is estimated forwards and
backwards between successive frames (DIS: T. Kroeger et al., "Fast optical flow using dense inverse
search", ECCV 2016), and points are moved along it while both agree and the flow is smooth, as in
N. Sundaram et al., "Dense point trajectories by GPU-accelerated large displacement optical flow",
ECCV 2010.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.render.raster import Pixels
from articulate.transforms import Array
from articulate.video.tracks import PointTracks

Floats = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class SurfaceTracking:
    """Parameters of dense tracking."""

    spacing_px: int = 6
    """Distance of points on a grid [px]."""
    every: int = 3
    """Frames after which free cells of the grid get new points."""
    structure: float = 3e-4
    """Least smaller eigenvalue of the structure tensor of the normalised image."""
    neighbourhood_px: float = 10.0
    """Radius of the neighbourhood whose mean and deviation are removed [px]."""
    noise: float = 6.0
    """Deviation added to that of the neighbourhood, so that noise is not amplified, 0 to 255."""
    agreement_px2: float = 0.1
    """Largest squared difference of forward and backward flow [px²], plus a share of the motion."""
    agreement_share: float = 0.01
    boundary: float = 0.03
    """Largest squared gradient of the flow, plus a share of the squared motion: points at the
    border of a moving part are lost."""
    boundary_share: float = 0.05
    least_frames: int = 3
    """Shorter tracks are left out."""


def follow_surface(frames: Pixels, tracking: SurfaceTracking | None = None) -> PointTracks:
    """Track a grid of points from where they appear to where they are lost.

    Args:
        frames: Colours (T, H, W, 3), 0 to 255.
        tracking: Parameters.
    """
    how = tracking or SurfaceTracking()
    n_frames, height, width = frames.shape[:3]
    images = [_normalised(frame, how) for frame in frames]
    api: Any = cv2  # its stubs lack this flow and the None that remap accepts
    flow = api.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    grid = _grid(height, width, how.spacing_px)
    uv: Floats = np.zeros((0, 2), dtype=np.float32)
    ids: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    total = 0
    record: list[tuple[NDArray[np.int64], Floats]] = []
    for t in range(n_frames):
        if t % how.every == 0 and t + how.least_frames <= n_frames:
            new = _new_points(images[t], uv, grid, how)
            uv = np.concatenate([uv, new])
            ids = np.concatenate([ids, np.arange(total, total + len(new))])
            total += len(new)
        record.append((ids, uv))
        if t + 1 < n_frames and len(uv):
            ahead = np.asarray(flow.calc(images[t], images[t + 1], None))
            back = np.asarray(flow.calc(images[t + 1], images[t], None))
            there, good = _moved(uv, ahead, back, how)
            uv, ids = there[good], ids[good]
    found = np.zeros((n_frames, total, 2))
    visible = np.zeros((n_frames, total), dtype=np.bool_)
    for t, (names, at) in enumerate(record):
        found[t, names], visible[t, names] = at, True
    kept = visible.sum(axis=0) >= how.least_frames
    return PointTracks(uv=found[:, kept], visible=visible[:, kept])


def _normalised(frame: Pixels, how: SurfaceTracking) -> Pixels:
    """Return the brightness (H, W), 0 to 255, relative to its neighbourhood."""
    bright = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    grey = cv2.GaussianBlur(bright, (0, 0), 0.7)
    off = grey - cv2.GaussianBlur(grey, (0, 0), how.neighbourhood_px)
    deviation = np.sqrt(np.maximum(cv2.GaussianBlur(off * off, (0, 0), how.neighbourhood_px), 0.0))
    return np.clip(128.0 + 45.0 * off / (deviation + how.noise), 0, 255).astype(np.uint8)


def _grid(height: int, width: int, spacing: int) -> NDArray[np.int64]:
    u, v = np.meshgrid(
        np.arange(spacing // 2, width, spacing), np.arange(spacing // 2, height, spacing)
    )
    return np.stack([u.ravel(), v.ravel()], axis=1)


def _new_points(
    image: Pixels, occupied: Floats, grid: NDArray[np.int64], how: SurfaceTracking
) -> Floats:
    """Return the points of the grid (N, 2) with structure and without a tracked point."""
    cells = tuple(size // how.spacing_px + 2 for size in image.shape)
    used = np.zeros(cells, dtype=np.bool_)
    at = (occupied / how.spacing_px).astype(np.int64)
    used[at[:, 1], at[:, 0]] = True
    here = grid // how.spacing_px
    strength = cv2.cornerMinEigenVal(cv2.GaussianBlur(image, (0, 0), 1.0), 9, ksize=3)
    good = ~used[here[:, 1], here[:, 0]] & (strength[grid[:, 1], grid[:, 0]] > how.structure)
    return grid[good].astype(np.float32)


def _moved(
    uv: Floats, ahead: Floats, back: Floats, how: SurfaceTracking
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return where points (N, 2) move, and which are still tracked (N,)."""
    height, width = ahead.shape[:2]
    step = _sampled(ahead, uv)
    there = uv + step
    inside = (there >= 1).all(axis=1) & (there[:, 0] < width - 2) & (there[:, 1] < height - 2)
    returned = _sampled(back, there)
    squared = (step**2).sum(axis=1)
    off = ((step + returned) ** 2).sum(axis=1)
    agrees = off < how.agreement_share * 2.0 * squared + how.agreement_px2
    across = cv2.Sobel(ahead, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    along = cv2.Sobel(ahead, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    change = _sampled((across**2 + along**2).sum(axis=2), uv)
    smooth = change < how.boundary_share * squared + how.boundary
    return there, np.asarray(inside & agrees & smooth)


def _sampled(field: Floats, uv: Floats) -> Floats:
    """Return the values (N, ...) of a field (H, W, ...) at points (N, 2), interpolated."""
    remap: Any = cv2.remap  # its stub forbids the None that its manual requires
    found = remap(field, uv[None], None, cv2.INTER_LINEAR)[0]
    return np.asarray(found, dtype=np.float32)


def start_frames(visible: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the first and the last frame of each track (N,)."""
    first = visible.argmax(axis=0)
    last = len(visible) - 1 - visible[::-1].argmax(axis=0)
    return first.astype(np.float64), last.astype(np.float64)
