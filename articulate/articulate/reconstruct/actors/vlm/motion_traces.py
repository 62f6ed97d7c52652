"""Traces of moving points on frames of the video and on renderings of a prediction."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from articulate.reconstruct.actors.protocol import Evidence, Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array
from articulate.video.tracks import follow_points

MAX_TRACES = 40
"""Most traces in one image."""
POINTS_PER_PART = 8
"""Traced points of each moving part in a rendering."""
MIN_TRAVEL = 0.01
"""Least travel of a moving point, as a share of the image's diagonal."""
MIN_FRAMES = 3
MOVED_M = 1e-6


@lru_cache(maxsize=2)
def video_traces(evidence: Evidence) -> tuple[Array, ...]:
    """Return the traces of moving points of a video, each as (T, 2) pixels with NaN if unseen.

    The longest traces that start far from each other are returned.
    """
    assert evidence.video is not None
    tracks = follow_points(evidence.video)
    uv = np.where(tracks.visible[..., None], tracks.uv, np.nan)
    diagonal = float(np.hypot(*evidence.video.shape[1:3]))
    seen = tracks.visible.sum(axis=0) >= MIN_FRAMES
    uv = uv[:, seen]
    if not uv.shape[1]:
        return ()
    travel = np.linalg.norm(np.nanmax(uv, axis=0) - np.nanmin(uv, axis=0), axis=-1)
    least = MIN_TRAVEL * diagonal
    order = [int(k) for k in np.argsort(-travel, kind="stable") if travel[k] > least]
    first = [uv[np.flatnonzero(np.isfinite(uv[:, k, 0]))[0], k] for k in range(uv.shape[1])]
    kept: list[int] = []
    for k in order:
        far = all(np.linalg.norm(first[k] - first[j]) > 2.0 * least for j in kept)
        if far and len(kept) < MAX_TRACES:
            kept.append(k)
    return tuple(uv[:, k] for k in kept)


def part_traces(
    parts: Sequence[PartMesh], poses: Sequence[Array], camera: Camera
) -> tuple[Array, ...]:
    """Return the traces of points on moving parts, each as (T, 2) pixels.

    Args:
        parts: All parts.
        poses: Motion (P, 4, 4) of each part at each position.
        camera: Camera of the rendering.
    """
    motion = np.stack(list(poses))
    traces = []
    for k, part in enumerate(parts):
        if np.abs(motion[:, k] - motion[:1, k]).max() < MOVED_M:
            continue
        n = min(POINTS_PER_PART, len(part.vertices))
        chosen = part.vertices[np.linspace(0, len(part.vertices) - 1, n).round().astype(int)]
        for point in chosen:
            uv, depth = camera.project(motion[:, k, :3, :3] @ point + motion[:, k, :3, 3])
            traces.append(np.where((depth > 0.0)[:, None], uv, np.nan))
    return tuple(traces[:MAX_TRACES])


def with_traces(image: Pixels, traces: Sequence[Array], end: int) -> Pixels:
    """Return an image with the traces up to the index ``end``, and a dot at each end."""
    out = np.ascontiguousarray(image).copy()
    for k, trace in enumerate(traces):
        points = trace[: end + 1]
        points = points[np.isfinite(points).all(axis=1)]
        points = points[np.abs(points).max(axis=1, initial=0.0) < 1e5]
        if not len(points):
            continue
        r, g, b = (int(c) for c in np.random.default_rng(k).integers(60, 256, 3))
        line = np.rint(points).astype(np.int32)
        cv2.polylines(out, [line[:, None]], False, (r, g, b), 1, cv2.LINE_AA)
        u, v = (int(x) for x in line[-1])
        cv2.circle(out, (u, v), 2, (r, g, b), -1, cv2.LINE_AA)
    return out
