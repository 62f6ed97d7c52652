"""Image pyramid: the changing region of a video at several resolutions, with a matching model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.compositing import (
    Compositing,
    Crop,
    build_compositing,
    change_map,
    crop_video,
    fit_light,
    model_image,
    rasterize,
    solve_light,
    still_samples,
)
from articulate.reconstruct.actors.geometric.kernels import face_views
from articulate.reconstruct.actors.geometric.parameters import COMPOSITING, IMAGE
from articulate.reconstruct.actors.geometric.search import MotionFit
from articulate.reconstruct.actors.geometric.surface import PartSurface, build_surface
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints


@dataclass(frozen=True, eq=False)
class VideoScene:
    """A video, its camera and the object in it."""

    video: Pixels
    camera: Camera
    parts: tuple[PartMesh, ...]
    change: NDArray[np.bool_]
    box: tuple[int, int, int, int]

    @property
    def size_m(self) -> float:
        """Diagonal of the object [m]."""
        points = np.concatenate([p.bounds for p in self.parts])
        return float(np.linalg.norm(np.ptp(points, axis=0)))

    def level(self, max_px: int, n_frames: int, frames: Ints | None = None) -> PyramidLevel:
        """Return the changing region at a resolution.

        Args:
            max_px: Longest side of the region [px].
            n_frames: Frames at least.
            frames: Indices of the frames instead (K,).
        """
        if frames is None:
            n_frames = max(n_frames, min(IMAGE.max_frames, self._affordable(max_px, n_frames)))
            frames = np.unique(np.linspace(0, len(self.video) - 1, n_frames).round().astype(int))
        crop = crop_video(self.video, self.camera, frames, self.box, max_px)
        left, right, top, bottom = self.box
        height, width = crop.size
        piece = cv2.resize(
            self.change[top:bottom, left:right].astype(np.float32),
            (width, height),
            interpolation=cv2.INTER_AREA,
        )
        middle = np.mean([p.centre for p in self.parts], axis=0)
        surface = build_surface(self.parts, pixel_m=crop.pixel_m(middle))
        change = np.asarray(piece > 0.25)
        return PyramidLevel(crop, surface, change, fit_light(crop, surface, change))

    def _affordable(self, max_px: int, n_frames: int) -> int:
        """Return the number of frames that cost as much as ``n_frames`` of ``max_px`` squared."""
        left, right, top, bottom = self.box
        factor = min(IMAGE.max_enlargement, max_px / max(right - left, bottom - top))
        area = (right - left) * (bottom - top) * factor**2
        return int(n_frames * max_px**2 / max(area, 1.0))


@dataclass(frozen=True, eq=False)
class PyramidLevel:
    """A crop of the video, and the object at the same resolution."""

    crop: Crop
    surface: PartSurface
    change: NDArray[np.bool_]
    light: Array

    def compositing(self, moving: Sequence[int]) -> Compositing:
        """Separate the parts ``moving`` from the static background."""
        return build_compositing(self.crop, self.surface, moving, self.light, self.change)


def build_scene(video: Pixels, camera: Camera, parts: Sequence[PartMesh]) -> VideoScene:
    """Build the scene of a video; its region is the full frame if nothing changes.

    Args:
        video: Frames (T, H, W, 3), 0 to 255.
        camera: Camera of the video.
        parts: The object, all joints at 0.
    """
    change = change_map(video)
    rows, columns = np.nonzero(change)
    height, width = change.shape
    if not len(rows):
        return VideoScene(video, camera, tuple(parts), change, (0, width, 0, height))
    left, right = np.percentile(columns, (0.2, 99.8))
    top, bottom = np.percentile(rows, (0.2, 99.8))
    margin = 6 + 0.12 * max(right - left, bottom - top)
    box = (
        max(0, int(left - margin)),
        min(width, int(right + margin) + 1),
        max(0, int(top - margin)),
        min(height, int(bottom + margin) + 1),
    )
    return VideoScene(video, camera, tuple(parts), change, box)


def refit_light(level: PyramidLevel, fit: MotionFit, crop: Crop) -> Array:
    """Estimate the light from static parts, and moving ones where ``fit`` places them."""
    layers = level.compositing(fit.parts)
    still = level.surface.only([k for k in np.unique(level.surface.part_ids) if k not in fit.parts])
    q = np.interp(level.crop.indices, crop.indices, fit.q)
    groups = []
    if len(still.faces):
        groups.append(still_samples(level.crop, still, level.change))
    for t, T_o in enumerate(fit.motion.T_o(q)):
        seen = rasterize(layers.moving, level.crop, T_o)
        near = cv2.erode((seen.face_ids >= 0).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        mask = near & (seen.nearness * COMPOSITING.depth_tolerance >= layers.nearness)
        ids = seen.face_ids[mask]
        views = face_views(seen.points_c, layers.moving.faces)[ids]
        groups.append((views, layers.moving.albedo[ids], level.crop.frames[t][mask]))
    views, albedo, colours = (np.concatenate(column) for column in zip(*groups, strict=True))
    return solve_light(views, albedo, colours)


def comparison_image(scene: VideoScene, fit: MotionFit) -> bytes:
    """Return a PNG: some frames of the video, and the expected image below each."""
    frames = np.unique(
        np.linspace(0, len(scene.video) - 1, IMAGE.report_frames).round().astype(int)
    )
    level = scene.level(IMAGE.report_px, 0, frames)
    layers = level.compositing(fit.parts)
    return frames_above_model(layers, fit.motion.T_o(fit.q[frames]))


def frames_above_model(layers: Compositing, T_o: Array) -> bytes:
    """Return a PNG: frames above, the model at poses ``T_o`` (T, 4, 4) [m] below."""
    above = np.concatenate(list(layers.crop.frames), axis=1)
    below = np.concatenate([model_image(pose, layers) for pose in T_o], axis=1)
    both = np.concatenate([above, below]).clip(0, 255).astype(np.uint8)
    good, data = cv2.imencode(".png", cv2.cvtColor(both, cv2.COLOR_RGB2BGR))
    assert good
    return bytes(data.tobytes())
