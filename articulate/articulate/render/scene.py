"""PartScene: parts before a camera, drawn at any poses: colour, which part is where, how far."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.errors import ConfigError
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.render.raster import NO_TEXTURE, Depths, Ids, Pixels, carry, fill, parts_of, shade
from articulate.transforms import Array, normalised

NOTHING = -1
"""Index of the part where none is seen."""
Shape = tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Light:
    """Light of a scene."""

    direction_w: tuple[float, float, float] = (0.0, 1.0, -1.0)
    """Where the light of a far lamp goes to, as in Articulate-Anything's simulator."""
    ambient: float = 0.42
    """Share of the albedo that is seen where no lamp shines."""
    directional: float = 0.36
    """Share that the far lamp adds to a face turned towards it."""
    head: float = 0.30
    """Share that a lamp at the camera adds to a face turned towards it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderBuffers:
    """What a camera sees, before any light."""

    part_ids: Ids
    """Index of the part seen at each pixel (H, W); -1 where there is none."""
    face_ids: Ids
    """Index of the face among all faces of the scene (H, W); -1 where there is none."""
    inverse_depth: Depths
    """One over the depth along the optical axis (H, W) [1/m]; 0 where nothing is."""

    @property
    def depth_m(self) -> Depths:
        """Depth along the optical axis (H, W) [m]; infinite where nothing is."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / self.inverse_depth, dtype=np.float32)


class PartScene:
    """Parts that can be drawn quickly, again and again, at poses that change."""

    def __init__(self, parts: Sequence[PartMesh], light: Light | None = None) -> None:
        """Gather the parts.

        Args:
            parts: Parts in the frame of the scene; their order gives the indices in pictures.
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
        """Index of the part of each face of the scene (F,)."""
        return self._part_of_face

    def rasterize(
        self,
        camera: Camera,
        poses_w: Array | None = None,
        *,
        only: Iterable[int] | None = None,
        onto: RenderBuffers | None = None,
    ) -> RenderBuffers:
        """What ``camera`` sees.

        Args:
            camera: Where from.
            poses_w: What is done to each part (P, 4, 4), identity if None.
            only: Indices of the parts that are drawn; all if None.
            onto: What is there already, drawn by this scene with this camera: the rest of the
                object, say, while one part is tried at many poses. It is not changed.
        """
        shape = (camera.height_px, camera.width_px)
        vertices_c = self._carried(camera, poses_w)
        inverse_depth, face_ids = self._filled(vertices_c, _intrinsics(camera), shape, only, onto)
        part_ids = parts_of(face_ids, self._part_of_face)
        return RenderBuffers(part_ids=part_ids, face_ids=face_ids, inverse_depth=inverse_depth)

    def render_image(
        self,
        camera: Camera,
        poses_w: Array | None = None,
        *,
        samples: int = 2,
        background: Sequence[float] = (1.0, 1.0, 1.0),
    ) -> Pixels:
        """A colour picture (H, W, 3).

        Args:
            camera: Where from.
            poses_w: What is done to each part (P, 4, 4), identity if None.
            samples: Each pixel is the mean of this number of points each way, so that edges are
                smooth.
            background: Colour where nothing is, each value in [0, 1].
        """
        fine = camera.scaled(samples) if samples > 1 else camera
        vertices_c = self._carried(fine, poses_w)
        intrinsics = _intrinsics(fine)
        shape = (fine.height_px, fine.width_px)
        inverse_depth, face_ids = self._filled(vertices_c, intrinsics, shape, None, None)
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

    def _carried(self, camera: Camera, poses_w: Array | None) -> Array:
        n = len(self.parts)
        poses = np.broadcast_to(np.eye(4), (n, 4, 4)) if poses_w is None else poses_w
        if poses.shape != (n, 4, 4):
            raise ConfigError(f"poses of shape {poses.shape} for {n} parts; ({n}, 4, 4) is needed")
        T_cp = np.ascontiguousarray(camera.T_cw @ poses)
        return np.asarray(carry(self._vertices, self._part_of_vertex, T_cp))

    def _filled(
        self,
        vertices_c: Array,
        intrinsics: Array,
        shape: Shape,
        only: Iterable[int] | None,
        onto: RenderBuffers | None,
    ) -> tuple[Depths, Ids]:
        if onto is None:
            inverse_depth = np.zeros(shape, dtype=np.float32)
            face_ids = np.full(shape, NOTHING, dtype=np.int32)
        else:
            inverse_depth, face_ids = onto.inverse_depth.copy(), onto.face_ids.copy()
        if only is None:
            drawn = np.ones(len(self._faces), dtype=np.bool_)
        else:
            drawn = np.isin(self._part_of_face, list(only))
        fill(vertices_c, self._faces, drawn, intrinsics, inverse_depth, face_ids)
        return inverse_depth, face_ids

    def _light_c(self, camera: Camera) -> Array:
        towards_w = -normalised(self._light.direction_w)
        strengths = (self._light.ambient, self._light.directional, self._light.head)
        return np.concatenate([camera.T_cw[:3, :3] @ towards_w, strengths])

    def _gather_textures(self) -> None:
        """Lay all textures into one array, as compiled code wants them."""
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
            # A face without coordinates of its own is NaN: it keeps its plain colour.
            self._texture_of_face[mine] = np.where(
                np.isfinite(part.uv).all(axis=(1, 2)), k, NO_TEXTURE
            )
            k += 1


def segmentation_palette(n: int) -> Pixels:
    """Colours (n, 3) that are easily told apart: hues in equal steps, as in the released code."""
    hues = [colorsys.hsv_to_rgb(i / max(n, 1), 0.9, 0.9) for i in range(n)]
    return np.rint(255.0 * np.array(hues).reshape(n, 3)).astype(np.uint8)


def segmentation_image(seen: RenderBuffers, n_parts: int) -> Pixels:
    """Picture (H, W, 3) in which each part has a colour of its own, on white."""
    palette = np.concatenate(
        [segmentation_palette(n_parts), np.full((1, 3), 255, dtype=np.uint8)]
    )  # the last one is for NOTHING, which is index -1
    return np.asarray(palette[seen.part_ids])


def _intrinsics(camera: Camera) -> Array:
    return np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px])
