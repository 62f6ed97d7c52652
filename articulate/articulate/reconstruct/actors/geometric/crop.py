"""Shot: the region of a clip in which something moves, in as many pixels as one can afford."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.kernels import Floats
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, Ints, apply, axis_angle_to_matrix, pose

LEAST_CHANGE = 3.0
"""Differences up to this are never a change, 0 to 255."""
SPECK_PX = 5
"""Fewer neighbouring pixels that change are noise."""
LARGEST_ENLARGEMENT = 2.0
"""Small regions are enlarged by this at most."""


@dataclass(frozen=True, eq=False)
class Shot:
    """Some frames of a clip, cut out and made smaller."""

    frames: Floats
    """What is seen (T, H, W, 3), 0 to 255."""
    indices: Ints
    """Which frames of the clip these are (T,)."""
    pinhole: Array
    """fx, fy, cx, cy [px]."""
    T_co: Array
    """Camera from object (4, 4)."""

    @property
    def size(self) -> tuple[int, int]:
        """Height and width [px]."""
        return self.frames.shape[1], self.frames.shape[2]

    def pixel_m(self, point_o: Array) -> float:
        """Size of a pixel at a point of the object [m]."""
        depth = float((self.T_co[:3, :3] @ point_o + self.T_co[:3, 3])[2])
        return max(depth, 0.05) / float(self.pinhole[0])

    def project(self, points_o: Array) -> Array:
        """Pixels (N, 2) at which points of the object (N, 3) are seen."""
        points_c = points_o @ self.T_co[:3, :3].T + self.T_co[:3, 3]
        depth = np.maximum(points_c[:, 2:], 1e-6)
        return np.asarray(points_c[:, :2] / depth * self.pinhole[:2] + self.pinhole[2:])


def shot_of(
    clip: Pixels, camera: Camera, indices: Ints, box: tuple[int, int, int, int], most_px: int
) -> Shot:
    """The region ``box`` of some frames, at most ``most_px`` wide and high.

    Args:
        clip: (T, H, W, 3).
        camera: Of the whole picture.
        indices: Frames to take.
        box: First column, column after the last, first row, row after the last.
        most_px: Longest side [px].
    """
    left, right, top, bottom = box
    width, height = right - left, bottom - top
    factor = min(LARGEST_ENLARGEMENT, most_px / max(width, height))
    how = cv2.INTER_AREA if factor <= 1.0 else cv2.INTER_LINEAR
    new_w, new_h = max(8, round(width * factor)), max(8, round(height * factor))
    sx, sy = new_w / width, new_h / height
    frames = np.empty((len(indices), new_h, new_w, 3), dtype=np.float32)
    for k, index in enumerate(indices):
        piece = np.ascontiguousarray(clip[index, top:bottom, left:right])
        frames[k] = cv2.resize(piece, (new_w, new_h), interpolation=how)
    pinhole = np.array(
        [
            camera.fx_px * sx,
            camera.fy_px * sy,
            (camera.cx_px - left + 0.5) * sx - 0.5,
            (camera.cy_px - top + 0.5) * sy - 0.5,
        ]
    )
    return Shot(frames, np.asarray(indices), pinhole, camera.T_cw)


def change_map(clip: Pixels) -> NDArray[np.bool_]:
    """Which pixels change over a clip (H, W).

    A pixel has changed if, after a slight blur, two frames differ in it by more than frames do
    where nothing moves: a fifth of the picture at least is thought to stand still.
    """
    picks = np.unique(np.linspace(0, len(clip) - 1, min(len(clip), 24)).round().astype(int))
    soft = np.stack([cv2.GaussianBlur(clip[k], (0, 0), 0.8) for k in picks])
    spread = (soft.max(axis=0) - soft.min(axis=0)).max(axis=-1)
    low, noise = np.percentile(spread, (2, 20))
    changed = spread > noise + 4.0 * (noise - low) + LEAST_CHANGE
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8))
    small = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] < SPECK_PX]
    return np.asarray(changed & ~np.isin(labels, small))


def moved(T_co: Array, middle_o: Array, x: Array) -> Array:
    """The camera ``T_co`` (4, 4) after the object seems to turn, shift and recede by ``x`` (6,)."""
    turn = float(np.linalg.norm(x[:3]))
    R = T_co[:3, :3]
    if turn > 0.0:
        R = axis_angle_to_matrix(x[:3] / turn, turn) @ R
    middle_c = apply(T_co, middle_o)
    depth = middle_c[2] * np.exp(x[5])
    middle_c = np.array([*(middle_c[:2] / middle_c[2] + x[3:5]), 1.0]) * depth
    return pose(middle_c - R @ middle_o, R)


def object_box(camera: Camera, parts: Sequence[PartMesh]) -> tuple[int, int, int, int]:
    """First column, column after the last, first row, row after the last about the object."""
    low, high = joint_bounds(parts)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    uv, _ = camera.project(low + corners * (high - low))
    whole = (0, camera.width_px, 0, camera.height_px)
    if not np.isfinite(uv).all():
        return whole
    margin = 0.15 * float(np.ptp(uv, axis=0).max()) + 4.0
    first = np.floor(uv.min(axis=0) - margin).astype(int)
    last = np.ceil(uv.max(axis=0) + margin).astype(int) + 1
    left, top = max(0, int(first[0])), max(0, int(first[1]))
    right, bottom = min(camera.width_px, int(last[0])), min(camera.height_px, int(last[1]))
    return (left, right, top, bottom) if right - left >= 8 and bottom - top >= 8 else whole
