"""Layers: what stands still in a shot, how it is lit, and what it costs to explain every frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.crop import Shot
from articulate.reconstruct.actors.geometric.kernels import (
    Floats,
    carried,
    face_colours,
    sweep_costs,
)
from articulate.reconstruct.actors.geometric.surface import Surface
from articulate.render.raster import fill
from articulate.transforms import Array

CAP = 110.0
"""Largest cost of a pixel: sum of absolute differences of three colours."""
TRUST = 0.35
"""Share of the cost of a still pixel that looks other than the model says."""
SLACK, LEAST_SLACK = 4.0, 3.0
"""How far from the model a still pixel may be where things move: in units of what is usual where
nothing does, and at least, 0 to 255."""
LEAST_THICKNESS_PX = 2.0
"""What is thinner is as thick as this: more positions would not meet its picture oftener."""


@dataclass(frozen=True, eq=False)
class Layers:
    """A shot, less the parts that are thought to move."""

    shot: Shot
    moving: Surface
    """What moves, in its pose at 0."""
    light: Array
    """(LIGHT_ROWS, 3)."""
    nearness: Floats
    """1 / depth of what stands still (H, W) [1/m]."""
    still: Floats
    """Picture of what stands still (H, W, 3)."""
    base: Floats
    """Cost of each pixel where nothing moves (T, H, W)."""

    def costs(self, T_o: Array) -> Array:
        """Cost of each frame with what moves in each of the poses ``T_o`` (Q, 4, 4), (Q, T)."""
        out = np.empty((len(T_o), len(self.shot.frames)))
        return self._swept(T_o, out, diagonal=False) + self.still_costs

    def path_cost(self, T_o: Array) -> Array:
        """Cost of each frame (T,), what moves being in pose ``T_o[t]`` in frame t, (T, 4, 4)."""
        out = np.empty((len(self.shot.frames), 1))
        return self._swept(T_o, out, diagonal=True)[:, 0] + self.still_costs

    @cached_property
    def still_costs(self) -> Array:
        """Cost of each frame if what moves were not there (T,)."""
        return np.asarray(self.base.sum(axis=(1, 2), dtype=np.float64))

    @cached_property
    def own_px(self) -> int:
        """Number of pixels in which what moves is seen, in its pose at 0 and alone."""
        return int(self._own.sum())

    @cached_property
    def thickness_px(self) -> float:
        """How thick what moves is there, as a strip that is as far from its edges on average.

        Two pixels at least; in pixels of the shot.
        """
        if not self._own.any():
            return LEAST_THICKNESS_PX
        if self._own.all():  # no edge is in the picture
            return float(max(self._own.shape))
        depth_px = cv2.distanceTransform(self._own.astype(np.uint8), cv2.DIST_L2, 3)
        # In a strip of w pixels it is w / 4 on average, and half a pixel more to pixels' middles.
        return max(LEAST_THICKNESS_PX, 4.0 * float(depth_px[self._own].mean()) - 2.0)

    @cached_property
    def _own(self) -> NDArray[np.bool_]:
        """Where what moves is seen (H, W), in its pose at 0 and alone."""
        return np.asarray(draw(self.moving, self.shot).face_ids >= 0)

    @cached_property
    def _by_pixel(self) -> tuple[Floats, Floats]:
        """Frames (H, W, 3, T) and base (H, W, T) as the compiled loops want them."""
        frames = np.ascontiguousarray(self.shot.frames.transpose(1, 2, 3, 0))
        return frames, np.ascontiguousarray(self.base.transpose(1, 2, 0))

    def _swept(self, T_o: Array, out: Array, *, diagonal: bool) -> Array:
        frames, base = self._by_pixel
        sweep_costs(
            (self.moving.points_o, self.moving.faces, self.moving.albedo),
            self.light,
            np.ascontiguousarray(self.shot.T_co @ T_o),
            self.shot.pinhole,
            self.nearness,
            frames,
            base,
            diagonal,
            np.float32(CAP),
            out,
        )
        return out


@dataclass(frozen=True, eq=False)
class Drawn:
    """A surface as the camera of a shot sees it."""

    nearness: Floats
    """1 / depth (H, W) [1/m], 0 where nothing is."""
    face_ids: NDArray[np.int32]
    """(H, W), -1 where nothing is."""
    points_c: Array
    """Corners in the camera's frame (V, 3)."""


def total(off: Floats) -> Floats:
    """Sum of the absolute differences of three colours (...) of ``off`` (..., 3)."""
    size = np.abs(off)
    return np.asarray(size[..., 0] + size[..., 1] + size[..., 2])  # many times faster than sum()


def draw(surface: Surface, shot: Shot, T_o: Array | None = None) -> Drawn:
    """``surface``, moved by ``T_o`` (4, 4), before the camera of ``shot``."""
    nearness = np.zeros(shot.size, dtype=np.float32)
    face_ids = np.full(shot.size, -1, dtype=np.int32)
    points_c = np.empty_like(surface.points_o)
    T_co = shot.T_co if T_o is None else shot.T_co @ T_o
    carried(surface.points_o, np.ascontiguousarray(T_co), points_c)
    drawn = np.ones(len(surface.faces), dtype=np.bool_)
    fill(points_c, surface.faces, drawn, shot.pinhole, nearness, face_ids)
    return Drawn(nearness, face_ids, points_c)


def layers_of(
    shot: Shot,
    everything: Surface,
    moving_ids: Sequence[int],
    light: Array,
    change: NDArray[np.bool_],
) -> Layers:
    """The shot, less the parts ``moving_ids`` of ``everything``.

    A still pixel has the colour that it has in the frame in which it looks most as the model
    says, what moves may cover it in the others; but not much farther from the model than pixels
    that never change.
    """
    moving = everything.only(moving_ids)
    rest = everything.only(sorted(set(np.unique(everything.part_ids)) - set(moving_ids)))
    seen = draw(rest, shot)
    solid = seen.face_ids >= 0
    model = plain_behind(shot, solid, change)
    if solid.any():
        colours = face_colours(seen.points_c, rest.faces, rest.albedo, light)
        model[solid] = colours[seen.face_ids[solid]]
    off = total(shot.frames - model)
    nearest = off.argmin(axis=0)
    rows, columns = np.indices(shot.size)
    best = shot.frames[nearest, rows, columns]
    calm = ~change if (~change).sum() > 50 else np.ones_like(change)
    slack = SLACK * float(np.median(np.abs(best - model)[calm])) + LEAST_SLACK
    still = np.where(calm[..., None], best, model + np.clip(best - model, -slack, slack))
    doubt = TRUST * np.minimum(total(still - model), CAP)
    base = np.minimum(total(shot.frames - still), CAP) + doubt
    return Layers(
        shot, moving, light, seen.nearness, still.astype(np.float32), base.astype(np.float32)
    )


def plain_behind(shot: Shot, solid: NDArray[np.bool_], change: NDArray[np.bool_]) -> Floats:
    """Colour (H, W, 3) of what lies behind the object, spread to where it is hidden."""
    middle = np.median(shot.frames, axis=0)
    near_solid = cv2.dilate(solid.astype(np.uint8), np.ones((5, 5))).astype(np.bool_)
    known = ~near_solid & ~change
    if known.sum() < 20:
        known = ~solid
    if known.sum() < 20:
        return np.full((*shot.size, 3), 255.0, dtype=np.float32)
    return spread_behind(middle, known)


def spread_behind(colours: Floats, known: NDArray[np.bool_]) -> Floats:
    """Colours (H, W, 3) where they are ``known`` (H, W), and near those elsewhere."""
    weight = known.astype(np.float32)
    total = np.zeros(colours.shape, dtype=np.float32)
    amount = np.zeros(known.shape, dtype=np.float32)
    for sigma, share in ((2.0, 1.0), (8.0, 1e-3), (40.0, 1e-6)):
        blurred = cv2.GaussianBlur(colours.astype(np.float32) * weight[..., None], (0, 0), sigma)
        total += share * blurred
        amount += share * cv2.GaussianBlur(weight, (0, 0), sigma)
    mean = colours[known].mean(axis=0)
    return np.asarray((total + 1e-12 * mean) / (amount + 1e-12)[..., None], dtype=np.float32)
