"""Render parts at any poses: colour images, part masks and depth."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.errors import ConfigError
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.render.raster import (
    NO_TEXTURE,
    Depths,
    Ids,
    Pixels,
    fill,
    parts_of_faces,
    shade,
    transform_vertices,
)
from articulate.transforms import Array, normalised

NO_PART = -1
"""Part index of background pixels."""
Shape = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Light:
    """Light of a scene."""

    direction_w: tuple[float, float, float] = (0.0, 1.0, -1.0)
    """Direction of the directional light, as in Articulate-Anything's simulator."""
    ambient: float = 0.42
    """Ambient light, as a share of the albedo."""
    directional: float = 0.36
    """Directional light on a face that is perpendicular to it."""
    head: float = 0.30
    """Light from the camera on a face that is perpendicular to it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderBuffers:
    """Part, face and depth of every pixel."""

    part_ids: Ids
    """Part of each pixel (H, W); -1 for background."""
    face_ids: Ids
    """Face of the scene at each pixel (H, W); -1 for background."""
    inverse_depth: Depths
    """Inverse depth along the optical axis (H, W) [1/m]; 0 for background."""

    @property
    def depth_m(self) -> Depths:
        """Depth along the optical axis (H, W) [m]; infinite for background."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.inverse_depth, dtype=np.float32)


class PartScene:
    """Parts that are rendered repeatedly at changing poses."""

    def __init__(self, parts: Sequence[PartMesh], light: Light | None = None) -> None:
        """Collect the parts.

        Args:
            parts: Parts in the scene frame; their order gives the part indices.
            light: Light of the scene.

        Raises:
            ConfigError: There is no part.
        """
        if not parts:
            raise ConfigError("a scene without parts; give at least one")
        self.parts = tuple(parts)
        self._light = light or Light()
        n_vertices = [len(part.vertices) for part in parts]
        n_faces = [len(part.faces) for part in parts]
        first = np.cumsum([0, *n_vertices[:-1]])
        self._vertices = np.ascontiguousarray(np.concatenate([p.vertices for p in parts]))
        self._faces = np.concatenate(
            [part.faces + start for part, start in zip(parts, first, strict=True)]
        ).astype(np.int64)
        self._part_of_vertex = np.repeat(np.arange(len(parts)), n_vertices)
        self._part_of_face = np.repeat(np.arange(len(parts)), n_faces)
        self._rgb = np.concatenate([part.rgb for part in parts])
        self._gather_textures()

    @property
    def part_of_face(self) -> NDArray[np.int64]:
        """Part of each face of the scene (F,)."""
        return self._part_of_face

    def rasterize(
        self,
        camera: Camera,
        poses_w: Array | None = None,
        *,
        only: Iterable[int] | None = None,
        onto: RenderBuffers | None = None,
    ) -> RenderBuffers:
        """Rasterize the scene for ``camera``.

        Args:
            camera: The camera.
            poses_w: Motion of each part (P, 4, 4), homogeneous; identity if None.
            only: Indices of the parts to rasterize; all if None.
            onto: Buffers of this scene and camera to add to, for example those of the other parts
                while one part is tried at many poses. They are not changed.
        """
        shape = (camera.height_px, camera.width_px)
        vertices_c = self._camera_vertices(camera, poses_w)
        inverse_depth, face_ids = self._fill_buffers(
            vertices_c, _intrinsics(camera), shape, only, onto
        )
        part_ids = parts_of_faces(face_ids, self._part_of_face)
        return RenderBuffers(part_ids=part_ids, face_ids=face_ids, inverse_depth=inverse_depth)

    def render_image(
        self,
        camera: Camera,
        poses_w: Array | None = None,
        *,
        samples: int = 2,
        background: Sequence[float] = (1.0, 1.0, 1.0),
    ) -> Pixels:
        """Render a colour image (H, W, 3), 0 to 255.

        Args:
            camera: The camera.
            poses_w: Motion of each part (P, 4, 4), homogeneous; identity if None.
            samples: Samples per pixel in each direction, for smooth edges.
            background: Background colour, in [0, 1].
        """
        fine = camera.scaled(samples) if samples > 1 else camera
        vertices_c = self._camera_vertices(fine, poses_w)
        intrinsics = _intrinsics(fine)
        shape = (fine.height_px, fine.width_px)
        inverse_depth, face_ids = self._fill_buffers(vertices_c, intrinsics, shape, None, None)
        pixels: Pixels = shade(
            vertices_c,
            self._faces,
            self._rgb,
            self._uv,
            self._texture_of_face,
            self._textures,
            self._texture_sizes,
            intrinsics,
            self._light_c(fine),
            np.asarray(background, dtype=np.float64),
            inverse_depth,
            face_ids,
            samples,
        )
        return pixels

    def _camera_vertices(self, camera: Camera, poses_w: Array | None) -> Array:
        n = len(self.parts)
        poses = np.broadcast_to(np.eye(4), (n, 4, 4)) if poses_w is None else poses_w
        if poses.shape != (n, 4, 4):
            raise ConfigError(f"poses of shape {poses.shape} for {n} parts; ({n}, 4, 4) is needed")
        T_cp = np.ascontiguousarray(camera.T_cw @ poses)
        return np.asarray(transform_vertices(self._vertices, self._part_of_vertex, T_cp))

    def _fill_buffers(
        self,
        vertices_c: Array,
        intrinsics: Array,
        shape: Shape,
        only: Iterable[int] | None,
        onto: RenderBuffers | None,
    ) -> tuple[Depths, Ids]:
        if onto is None:
            inverse_depth = np.zeros(shape, dtype=np.float32)
            face_ids = np.full(shape, NO_PART, dtype=np.int32)
        else:
            inverse_depth, face_ids = onto.inverse_depth.copy(), onto.face_ids.copy()
        if only is None:
            enabled = np.ones(len(self._faces), dtype=np.bool_)
        else:
            enabled = np.isin(self._part_of_face, list(only))
        fill(vertices_c, self._faces, enabled, intrinsics, inverse_depth, face_ids)
        return inverse_depth, face_ids

    def _light_c(self, camera: Camera) -> Array:
        towards_w = -normalised(self._light.direction_w)
        strengths = (self._light.ambient, self._light.directional, self._light.head)
        return np.concatenate([camera.T_cw[:3, :3] @ towards_w, strengths])

    def _gather_textures(self) -> None:
        """Pack all textures into one array for the compiled code."""
        found = [p.texture for p in self.parts if p.texture is not None and p.uv is not None]
        height = max([1, *(t.shape[0] for t in found)])
        width = max([1, *(t.shape[1] for t in found)])
        self._textures = np.zeros((max(1, len(found)), height, width, 3), dtype=np.uint8)
        self._texture_sizes = np.ones((max(1, len(found)), 2), dtype=np.int64)
        self._texture_of_face = np.full(len(self._faces), NO_TEXTURE, dtype=np.int64)
        self._uv = np.zeros((len(self._faces), 3, 2))
        k = 0
        for i, part in enumerate(self.parts):
            if part.texture is None or part.uv is None:
                continue
            h, w = part.texture.shape[:2]
            self._textures[k, :h, :w] = part.texture
            self._texture_sizes[k] = (h, w)
            mine = self._part_of_face == i
            self._uv[mine] = part.uv
            # Faces without texture coordinates are NaN: they keep their plain colour.
            self._texture_of_face[mine] = np.where(
                np.isfinite(part.uv).all(axis=(1, 2)), k, NO_TEXTURE
            )
            k += 1


def segmentation_palette(n: int) -> Pixels:
    """Return distinct colours (n, 3): hues in equal steps, as in Articulate-Anything."""
    hues = [colorsys.hsv_to_rgb(i / max(n, 1), 0.9, 0.9) for i in range(n)]
    return np.rint(255.0 * np.array(hues).reshape(n, 3)).astype(np.uint8)


def segmentation_image(seen: RenderBuffers, n_parts: int) -> Pixels:
    """Return an image (H, W, 3) with one colour per part, on white."""
    palette = np.concatenate(
        [segmentation_palette(n_parts), np.full((1, 3), 255, dtype=np.uint8)]
    )  # the last one is for NOTHING, which is index -1
    return np.asarray(palette[seen.part_ids])


def _intrinsics(camera: Camera) -> Array:
    return np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px])
