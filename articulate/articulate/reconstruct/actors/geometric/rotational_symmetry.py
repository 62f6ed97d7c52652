"""Round parts such as knobs and wheels: axis of symmetry, rotation from surface marks.

A part that rotates within its own image shows no moving edge, and errors of the model's colours may
exceed the change. So the image is compared with itself: the temporal mean of each pixel, which is
shape and light, is removed, and the rest are marks that rotate. Unwrapped around the axis and
rotated back by the right motion, they coincide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.compositing import rasterize
from articulate.reconstruct.actors.geometric.image_pyramid import PyramidLevel, VideoScene
from articulate.reconstruct.actors.geometric.parameters import IMAGE, SYMMETRY
from articulate.reconstruct.actors.geometric.surface import (
    JointMotion,
    PartSurface,
    perpendicular_axes,
    sample_points,
)
from articulate.transforms import Array, Ints, axis_angle_to_matrix


def symmetry_axis(part: PartSurface, axes: list[tuple[str, Array]]) -> JointMotion | None:
    """Return the rotation about the axis of symmetry of ``part``; None if it has none.

    Args:
        part: Its surface.
        axes: Directions to try, with their source.
    """
    points = sample_points(part, 1500)
    low, high = points.min(axis=0), points.max(axis=0)
    best, best_off = None, SYMMETRY.max_deviation
    tree = cKDTree(points)
    for name, axis in axes:
        for where, middle in (("middle", 0.5 * (low + high)), ("weight", points.mean(axis=0))):
            off = symmetry_deviation(points, tree, axis, middle)
            if off < best_off:
                best, best_off = JointMotion("turn", axis, middle, f"{name}, round, {where}"), off
    return best


def symmetry_deviation(points: Array, tree: cKDTree, axis: Array, middle: Array) -> float:
    """Return the deviation of a surface from itself after rotations, in radii (80th percentile).

    Args:
        points: Points on the surface (P, 3) [m].
        tree: Search tree of the same points.
        axis: Unit vector (3,).
        middle: Point on the axis (3,) [m].
    """
    arm = points - middle
    across = arm - np.outer(arm @ axis, axis)
    radius = float(np.percentile(np.linalg.norm(across, axis=1), 90)) + 1e-12
    offs = []
    for turn in SYMMETRY.test_turns_rad:
        turned = arm @ axis_angle_to_matrix(axis, turn).T + middle
        distance, _ = tree.query(turned)
        offs.append(float(np.percentile(distance, 80)))
    own, _ = tree.query(points, k=2)  # distance due to sampling
    return (max(offs) - float(np.percentile(own[:, 1], 80))) / radius


@dataclass(frozen=True, eq=False)
class SurfaceMarks:
    """Colour changes in the image of a part, in coordinates around an axis."""

    angle: Array
    """Angle of each pixel around the axis (P,) [rad]."""
    ring: Ints
    """Index of the ring of each pixel (P,)."""
    change: Array
    """Colour in each frame less the mean over frames (T, P, 3), 0 to 255."""

    @property
    def strength(self) -> float:
        """Standard deviation of the changes, 0 to 255."""
        return float(self.change.std())

    def explained(self, end_rad: float) -> float:
        """Return the share of the changes that a uniform rotation by ``end_rad`` explains."""
        frames, pixels, _ = self.change.shape
        turned = self.angle - np.linspace(0.0, end_rad, frames)[:, None]
        place = (
            np.floor(turned / (2.0 * np.pi) * SYMMETRY.angle_bins).astype(np.int64)
            % SYMMETRY.angle_bins
        )
        key = (self.ring * SYMMETRY.angle_bins + place).ravel()
        count = np.maximum(np.bincount(key), 1)
        sums = [
            np.bincount(key, weights=self.change[..., k].reshape(frames * pixels)) for k in range(3)
        ]
        return float(sum(((s * s) / count).sum() for s in sums) / (self.change**2).sum())


@dataclass(frozen=True)
class SpinEstimate:
    """The uniform rotation that explains the marks best."""

    end_rad: float
    """Angle in the video, positive about the axis [rad]."""
    clear: bool
    """It explains them much better than other rotations do."""
    sharp: bool
    """Its angle is well defined, or it is a full turn."""

    @property
    def full_turn(self) -> bool:
        """The rotation is a full turn or more."""
        return abs(self.end_rad) >= SYMMETRY.full_turn_rad


def extract_marks(scene: VideoScene, part: int, motion: JointMotion) -> SurfaceMarks | None:
    """Return the colour changes in the image of ``part`` around the axis of ``motion``.

    None if too little of the part is visible at rest.
    """
    level = scene.level(IMAGE.fine_px, 0, np.arange(len(scene.video)))
    mask, points_o = _seen(level, part)
    if len(points_o) < SYMMETRY.min_pixels:
        return None
    kept = np.unique(np.linspace(0, len(points_o) - 1, SYMMETRY.max_pixels).astype(np.int64))
    rows, columns = (index[kept] for index in np.nonzero(mask))
    arm = points_o[kept] - motion.pivot_o
    x, y = perpendicular_axes(motion.axis_o) @ arm.T
    width = SYMMETRY.ring_px * level.crop.pixel_m(points_o.mean(axis=0))
    profile = np.stack([arm @ motion.axis_o, np.hypot(x, y)], axis=1)
    _, ring = np.unique(np.round(profile / width), axis=0, return_inverse=True)
    colours = level.crop.frames[:, rows, columns].astype(np.float64)
    return SurfaceMarks(np.arctan2(y, x), ring.reshape(-1), colours - colours.mean(axis=0))


def estimate_spin(marks: SurfaceMarks) -> SpinEstimate | None:
    """Return the uniform rotation that explains ``marks`` best; None if nothing changes."""
    if marks.strength == 0.0:
        return None
    positive = np.arange(SYMMETRY.min_turn_rad, SYMMETRY.max_turn_rad, SYMMETRY.turn_step_rad)
    ends = np.concatenate([-positive[::-1], positive])
    shares = np.array([marks.explained(float(end)) for end in ends])
    usual = float(np.median(shares))
    best = _refined(marks, float(ends[np.argmax(shares)]))
    advantage = marks.explained(best) - usual
    full_turn = np.abs(ends) >= SYMMETRY.full_turn_rad
    near = (
        float(shares[full_turn].max()) >= usual + (1.0 - SYMMETRY.full_turn_tolerance) * advantage
    )
    end = float(ends[full_turn][np.argmax(shares[full_turn])]) if near else best
    beside = max(
        marks.explained(best - SYMMETRY.beside_rad), marks.explained(best + SYMMETRY.beside_rad)
    )
    return SpinEstimate(
        end_rad=end,
        clear=advantage >= SYMMETRY.clear_share * (1.0 - usual),
        sharp=near
        or beside <= usual + SYMMETRY.max_beside_share * advantage
        or usual + advantage >= SYMMETRY.nearly_all_share,
    )


def clear_spin(
    scene: VideoScene, level: PyramidLevel, part: int, motion: JointMotion
) -> SpinEstimate | None:
    """Return the rotation of ``part`` about the axis of ``motion``; None if its marks are unclear.

    Args:
        scene: The video and the object.
        level: One of its levels.
        part: Index of the part.
        motion: Rotation about its axis of symmetry.
    """
    marks = extract_marks(scene_around(scene, level, part), part, motion)
    spin = None if marks is None else estimate_spin(marks)
    return spin if spin is not None and spin.clear else None


def _refined(marks: SurfaceMarks, end_rad: float) -> float:
    near = end_rad + np.arange(
        -SYMMETRY.turn_step_rad,
        SYMMETRY.turn_step_rad + SYMMETRY.fine_turn_step_rad / 2.0,
        SYMMETRY.fine_turn_step_rad,
    )
    return float(max(near, key=lambda end: marks.explained(float(end))))


def _seen(level: PyramidLevel, part: int) -> tuple[NDArray[np.bool_], Array]:
    """Return the mask of ``part`` at rest (H, W) and its points at these pixels (P, 3) [m]."""
    seen = rasterize(level.surface, level.crop)
    ids = np.where(seen.face_ids >= 0, level.surface.part_ids[seen.face_ids], -1)
    mask = ids == part
    rows, columns = np.nonzero(mask)
    depth = 1.0 / seen.nearness[mask].astype(np.float64)
    spots = np.stack([columns, rows], axis=1)
    rays = (spots - level.crop.pinhole[2:]) / level.crop.pinhole[:2]
    points_c = np.column_stack([rays * depth[:, None], depth])
    R, t = level.crop.T_co[:3, :3], level.crop.T_co[:3, 3]
    return mask, (points_c - t) @ R


def scene_around(scene: VideoScene, level: PyramidLevel, part: int) -> VideoScene:
    """Return ``scene`` cropped around ``part`` at rest; ``level`` is one of its levels."""
    left, right, top, bottom = scene.box
    enlarged = level.crop.size[1] / (right - left)
    spots = level.crop.project(level.surface.only([part]).points_o) / enlarged + (left, top)
    low = np.floor(spots.min(axis=0)).astype(int) - SYMMETRY.margin_px
    high = np.ceil(spots.max(axis=0)).astype(int) + SYMMETRY.margin_px
    height, width = scene.video.shape[1:3]
    (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, (width, height))
    return replace(scene, box=(int(left), int(right), int(top), int(bottom)))
