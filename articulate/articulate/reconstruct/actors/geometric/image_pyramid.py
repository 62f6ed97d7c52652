"""Looks: the region of a clip in which something changes, the object as coarse as it is there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.compositing import Layers, draw, layers_of
from articulate.reconstruct.actors.geometric.crop import (
    LARGEST_ENLARGEMENT,
    Shot,
    change_map,
    shot_of,
)
from articulate.reconstruct.actors.geometric.kernels import SAME_DEPTH, all_views
from articulate.reconstruct.actors.geometric.lighting import fit_light, solve_light, still_samples
from articulate.reconstruct.actors.geometric.search import (
    Fit,
)
from articulate.reconstruct.actors.geometric.surface import Surface, surface_of
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

QUICK_PX, QUICK_FRAMES = 72, 8
COARSE_PX, COARSE_FRAMES = 112, 12
FINE_PX, FINE_FRAMES = 224, 14
"""Longest side of the region [px] and number of frames: to choose the part, to choose among
candidates, and to refine."""
MOST_FRAMES = 40
"""Most frames that are looked at while searching: small regions allow more."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip and the object in it."""

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

    def look(self, most_px: int, n_frames: int, frames: Ints | None = None) -> Look:
        """The region in which something changes."""
        if frames is None:
            n_frames = max(n_frames, min(MOST_FRAMES, self._affordable(most_px, n_frames)))
            frames = np.unique(np.linspace(0, len(self.video) - 1, n_frames).round().astype(int))
        shot = shot_of(self.video, self.camera, frames, self.box, most_px)
        left, right, top, bottom = self.box
        height, width = shot.size
        piece = cv2.resize(
            self.change[top:bottom, left:right].astype(np.float32),
            (width, height),
            interpolation=cv2.INTER_AREA,
        )
        middle = np.mean([p.centre for p in self.parts], axis=0)
        surface = surface_of(self.parts, pixel_m=shot.pixel_m(middle))
        change = np.asarray(piece > 0.25)
        return Look(shot, surface, change, fit_light(shot, surface, change))

    def _affordable(self, most_px: int, n_frames: int) -> int:
        """Number of frames that take as long as ``n_frames`` of ``most_px`` squared would."""
        left, right, top, bottom = self.box
        factor = min(LARGEST_ENLARGEMENT, most_px / max(right - left, bottom - top))
        area = (right - left) * (bottom - top) * factor**2
        return int(n_frames * most_px**2 / max(area, 1.0))


@dataclass(frozen=True, eq=False)
class Look:
    """A shot with the object as coarse as it is."""

    shot: Shot
    surface: Surface
    change: NDArray[np.bool_]
    light: Array

    def layers(self, moving: Sequence[int]) -> Layers:
        """With the parts ``moving`` taken out."""
        return layers_of(self.shot, self.surface, moving, self.light, self.change)


def scene_of(clip: Pixels, camera: Camera, parts: Sequence[PartMesh]) -> Scene:
    """The scene; its box is the whole picture if nothing changes in it."""
    change = change_map(clip)
    rows, columns = np.nonzero(change)
    height, width = change.shape
    if not len(rows):
        return Scene(clip, camera, tuple(parts), change, (0, width, 0, height))
    left, right = np.percentile(columns, (0.2, 99.8))
    top, bottom = np.percentile(rows, (0.2, 99.8))
    margin = 6 + 0.12 * max(right - left, bottom - top)
    box = (
        max(0, int(left - margin)),
        min(width, int(right + margin) + 1),
        max(0, int(top - margin)),
        min(height, int(bottom + margin) + 1),
    )
    return Scene(clip, camera, tuple(parts), change, box)


def better_light(look: Look, fit: Fit, shot: Shot) -> Array:
    """The light, from what stands still and from what moves where ``fit`` says that it is."""
    layers = look.layers(fit.parts)
    still = look.surface.only([k for k in np.unique(look.surface.part_ids) if k not in fit.parts])
    q = np.interp(look.shot.indices, shot.indices, fit.q)
    groups = []
    if len(still.faces):
        groups.append(still_samples(look.shot, still, look.change))
    for t, T_o in enumerate(fit.motion.T_o(q)):
        seen = draw(layers.moving, look.shot, T_o)
        near = cv2.erode((seen.face_ids >= 0).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        mask = near & (seen.nearness * SAME_DEPTH >= layers.nearness)
        ids = seen.face_ids[mask]
        views = all_views(seen.points_c, layers.moving.faces)[ids]
        groups.append((views, layers.moving.albedo[ids], look.shot.frames[t][mask]))
    views, albedo, colours = (np.concatenate(column) for column in zip(*groups, strict=True))
    return solve_light(views, albedo, colours)
