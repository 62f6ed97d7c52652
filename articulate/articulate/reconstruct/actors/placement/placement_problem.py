"""Placement problem: an image, and parts to place where it shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.compositing import Crop, crop_video
from articulate.reconstruct.actors.geometric.kernels import DEPTH_TOLERANCE, Floats
from articulate.reconstruct.actors.geometric.surface import build_surface, sample_points
from articulate.reconstruct.actors.placement.kernels import render_part, shift_costs
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

CAP = 90.0
"""Largest cost of a pixel: sum of absolute differences of three colours, 0 to 765."""
BACKGROUND_TOLERANCE = 18.0
"""Pixels that differ by less from the median of the image border are background, 0 to 255."""
MARGIN = 0.06
"""Margin around the object, as a share of its size."""
LEVELS = ((96, 1.8), (220, 0.9), (480, 0.6))
"""Longest side of the image at each level [px], and the resolution of the parts [px of it]."""
PROBE_POINTS, TREE_POINTS = 100, 6000
"""Points on a part whose distance to others is measured, and points on these."""
SMALLEST_GAP = 0.004
"""Smaller gaps count as contact [m]."""
SIMILAR, EQUAL = 0.15, 0.01
"""Parts whose boxes differ by less than these shares of the longest side are similar, or equal."""
OVERLAP_WEIGHT = 10.0
"""Weight of the overlap of similar parts, relative to a gap of the same length."""
MIN_VISIBLE_PX = 20
"""Parts visible in fewer pixels count as filled [px]."""
MAX_GAP_M = 1.0
"""Larger gaps count as this [m]."""
Placements = Mapping[int, Array]
"""Centre of each part in the camera frame [m], by index."""


@dataclass(frozen=True, eq=False)
class CameraPart:
    """Triangles of one part, rotated to the camera frame, at the resolution of a level."""

    points: Array
    faces: Ints
    albedo: Array

    @property
    def arrays(self) -> tuple[Array, Ints, Array]:
        """Arguments of the compiled kernels."""
        return self.points, self.faces, self.albedo


@dataclass(frozen=True, eq=False)
class RenderedParts:
    """Image of some placed parts and its cost."""

    nearness: Floats
    """Inverse depth (H, W) [1/m], 0 for background."""
    base: Floats
    """Cost of each pixel (H, W)."""
    part_ids: NDArray[np.int32]
    """Part of each pixel (H, W), -1 for background."""

    @property
    def total(self) -> float:
        """Cost of the image."""
        return float(self.base.sum(dtype=np.float64))

    def under(self, later: Sequence[int]) -> RenderedParts:
        """Return a copy in which the parts ``later`` win at equal depth."""
        on_top = np.isin(self.part_ids, later)
        nearness = np.where(on_top, self.nearness * DEPTH_TOLERANCE**2, self.nearness)
        return replace(self, nearness=nearness.astype(np.float32))


@dataclass(frozen=True, eq=False)
class PlacementLevel:
    """The image at one resolution."""

    crop: Crop
    background: Array
    """Background colour (3,), 0 to 255."""
    pieces: tuple[CameraPart, ...]
    px: float
    """Size of a pixel [px of the input image]."""
    outline: NDArray[np.bool_] = field(repr=False)
    """Mask of the object with a border of one pixel (H + 2, W + 2), which is true where the image
    ends on the object."""

    @property
    def frame(self) -> Floats:
        """The image (H, W, 3), 0 to 255."""
        return np.asarray(self.crop.frames[0])

    @property
    def solid_px(self) -> float:
        """Area of the object [px of the input image]."""
        off = np.abs(self.frame - self.background).max(axis=-1) > BACKGROUND_TOLERANCE
        return float(off.sum()) * self.px**2

    def pixels(self, points_c: Array) -> tuple[Ints, Ints]:
        """Return row and column of points in the camera frame (..., 3) [m].

        Points outside the image have index -1 or one past the end.
        """
        fx, fy, cx, cy = self.crop.pinhole
        depth = np.maximum(points_c[..., 2], 1e-3)
        height, width = self.crop.size
        u = np.clip(np.rint(points_c[..., 0] / depth * fx + cx), -1, width)
        v = np.clip(np.rint(points_c[..., 1] / depth * fy + cy), -1, height)
        return v.astype(np.int64), u.astype(np.int64)

    def rendered(
        self, placements: Placements, light: Array, without: Sequence[int] = ()
    ) -> RenderedParts:
        """Render all placed parts except those of ``without``."""
        height, width = self.crop.size
        nearness = np.zeros((height, width), dtype=np.float32)
        part_ids = np.full((height, width), -1, dtype=np.int32)
        image = np.broadcast_to(self.background, (height, width, 3)).astype(np.float32)
        for i, shift in placements.items():
            if i not in without:
                render_part(
                    self.pieces[i].arrays,
                    light,
                    np.asarray(shift, dtype=np.float64),
                    self.crop.pinhole,
                    i,
                    nearness,
                    image,
                    part_ids,
                )
        base = np.minimum(np.abs(self.frame - image).sum(axis=-1), CAP)
        return RenderedParts(nearness, base.astype(np.float32), part_ids)

    def costs(
        self, part: int, shifts_c: Array, rendered: RenderedParts, light: Array
    ) -> tuple[Array, Array]:
        """Return the added cost (Q,) and visible area (Q,) of each placement (Q, 3) [m].

        Both are in pixels [px] of the input image; the cost counts completely different pixels.
        """
        shifts_c = np.ascontiguousarray(shifts_c, dtype=np.float64)
        out, visible_px = np.zeros(len(shifts_c)), np.zeros(len(shifts_c))
        shift_costs(
            self.pieces[part].arrays,
            light,
            shifts_c,
            self.crop.pinhole,
            (rendered.nearness, rendered.base),
            self.frame,
            CAP,
            out,
            visible_px,
        )
        return out * (self.px**2 / CAP), visible_px * self.px**2

    def total(self, rendered: RenderedParts) -> float:
        """Return the cost of the image [px of the input image]."""
        return rendered.total * self.px**2 / CAP

    def unexplained(self, rendered: RenderedParts) -> float:
        """Return the cost of wrong regions, edges excluded [px of the input image]."""
        spots = cv2.erode(rendered.base, np.ones((3, 3)))
        return float(spots.sum(dtype=np.float64)) * self.px**2 / CAP


def background_of(image: Pixels) -> Array:
    """Return the median colour (3,) of the border of an image (H, W, 3), 0 to 255."""
    rim = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    return np.asarray(np.median(rim.astype(np.float64), axis=0))


def region_of(image: Pixels) -> tuple[int, int, int, int]:
    """Return the region of an image (H, W, 3) that is not background.

    First column, column after the last, first row, row after the last [px].
    """
    solid = np.abs(image - background_of(image)).max(axis=-1) > BACKGROUND_TOLERANCE
    height, width = solid.shape
    if not solid.any():
        return 0, width, 0, height
    rows, columns = np.nonzero(solid.any(axis=1))[0], np.nonzero(solid.any(axis=0))[0]
    room = 4 + round(MARGIN * max(np.ptp(rows), np.ptp(columns)))
    return (
        max(0, int(columns[0]) - room),
        min(width, int(columns[-1]) + 1 + room),
        max(0, int(rows[0]) - room),
        min(height, int(rows[-1]) + 1 + room),
    )


def build_level(
    parts: Sequence[PartMesh], image: Pixels, camera: Camera, max_px: int, coarse_m: float
) -> PlacementLevel:
    """Build the image at most ``max_px`` wide and high, and parts at its resolution.

    Args:
        parts: Parts with the centre of their box at the origin.
        image: The image (H, W, 3), 0 to 255.
        camera: Its camera.
        max_px: Longest side [px].
        coarse_m: Distance at which a pixel gives the resolution of the parts [m].
    """
    region = region_of(image)
    crop = crop_video(image[None], camera, np.array([0]), region, max_px)
    pixel_m = coarse_m / float(crop.pinhole[0])
    rot = camera.T_cw[:3, :3]
    pieces = []
    for part in parts:
        surface = build_surface([part], pixel_m=pixel_m)
        pieces.append(
            CameraPart(
                np.ascontiguousarray(surface.points_o @ rot.T), surface.faces, surface.albedo
            )
        )
    longest = max(region[1] - region[0], region[3] - region[2])
    background = background_of(image)
    solid = (np.abs(crop.frames[0] - background).max(axis=-1) > BACKGROUND_TOLERANCE).astype(
        np.uint8
    )
    outline = cv2.dilate(solid, np.ones((3, 3), np.uint8))
    height, width = image.shape[:2]
    at_end = (region[2] == 0, region[3] == height, region[0] == 0, region[1] == width)
    padded = np.pad(outline, 1, mode="edge").astype(np.bool_)
    for side, ends in zip(
        (padded[0], padded[-1], padded[:, 0], padded[:, -1]), at_end, strict=True
    ):
        side &= ends
    return PlacementLevel(crop, background, tuple(pieces), longest / max(crop.size), padded)


@dataclass(frozen=True, eq=False)
class PlacementProblem:
    """The image at several resolutions, and the parts."""

    levels: tuple[PlacementLevel, ...]
    camera: Camera
    parts: tuple[PartMesh, ...]
    """Parts with the centre of their box at the origin."""
    light: Array
    """Light (LIGHT_ROWS, 3)."""
    probes: tuple[Array, ...] = field(repr=False)
    """Points on each part about its centre, in the camera frame (N, 3) [m]."""
    trees: tuple[cKDTree, ...] = field(repr=False)
    """Search trees of more such points."""
    sizes: Array
    """Sides of each part's box (P, 3) [m]."""
    filled: Array
    """Share of the convex hull of its outline that each part fills (P,): small for a wire."""

    def volume(self, part: int) -> float:
        """Return the volume of a part's box with a small margin [m^3]."""
        return float(np.prod(self.sizes[part] + 0.02))

    def rendered(self, k: int, part: int, placements: Placements) -> RenderedParts:
        """Render all parts except ``part`` at level ``k``, in the order of their size.

        Larger parts come first, so that a button wins where its depth equals that of its panel.
        """
        enabled = self.levels[k].rendered(placements, self.light, without=(part,))
        later = [i for i in placements if i != part and self.volume(i) < self.volume(part)]
        return enabled.under(later) if later else enabled

    def radius(self, part: int) -> float:
        """Return half the diagonal of a part's box [m]."""
        return 0.5 * float(np.linalg.norm(self.sizes[part]))

    def is_similar(self, one: int, other: int, within: float = SIMILAR) -> bool:
        """Return whether the boxes of two parts differ by less than a share of their size."""
        a, b = self.sizes[one], self.sizes[other]
        return bool(np.abs(a - b).max() <= within * max(a.max(), b.max()))

    def share_on_object(self, k: int, part: int, shifts: Array) -> Array:
        """Return the share of a part's points on the object (Q,) at placements (Q, 3) [m]."""
        level = self.levels[k]
        rows, columns = level.pixels(shifts[:, None] + self.probes[part])
        return np.asarray(level.outline[rows + 1, columns + 1].mean(axis=1))

    def misfit(self, part: int, shift: Array, placements: Placements) -> float:
        """Return the geometric error of a placement ``shift`` (3,) as a length [m].

        The gap to the closest other part, and much more for overlap with a similar one.
        """
        crowded = 0.0
        for i, other in placements.items():
            if i != part and self.is_similar(part, i):
                apart = float(np.linalg.norm(shift - other))
                crowded += max(0.0, 0.5 * float(self.sizes[part].max()) - apart)
        return self.gap(part, shift, placements) + OVERLAP_WEIGHT * crowded

    def gap(self, part: int, shift: Array, placements: Placements) -> float:
        """Return the distance of a part at ``shift`` (3,) to the closest placed one [m].

        0 without others.
        """
        least = MAX_GAP_M
        others = [i for i in placements if i != part]
        if not others:
            return 0.0
        apart = {i: self._box_gap(part, shift, i, placements[i]) for i in others}
        for i in sorted(others, key=lambda i: apart[i]):
            if apart[i] >= least or least <= SMALLEST_GAP:
                break
            points = self.probes[part] + (shift - placements[i])
            far, _ = self.trees[i].query(points, distance_upper_bound=least)
            least = min(least, float(far.min()))
        return max(0.0, least - SMALLEST_GAP)

    def _box_gap(self, part: int, shift: Array, other: int, other_shift: Array) -> float:
        """Return the distance of two parts' boxes [m]."""
        between = self.camera.T_wc[:3, :3] @ (shift - other_shift)
        half = 0.5 * (self.sizes[part] + self.sizes[other])
        return float(np.linalg.norm(np.maximum(np.abs(between) - half, 0.0)))


def build_problem(
    parts: Sequence[PartMesh], image: Pixels, camera: Camera, light: Array
) -> PlacementProblem:
    """Build the placement problem.

    Args:
        parts: Parts with the centre of their box at the origin.
        image: The image (H, W, 3), 0 to 255.
        camera: Its camera.
        light: Light (LIGHT_ROWS, 3), in the camera frame.
    """
    distance = float(np.linalg.norm(camera.eye_w))
    rot = camera.T_cw[:3, :3]
    surfaces = [build_surface([part], pixel_m=1e-4) for part in parts]
    levels = tuple(
        build_level(parts, image, camera, px, coarse * distance) for px, coarse in LEVELS
    )
    return PlacementProblem(
        levels=levels,
        camera=camera,
        parts=tuple(parts),
        light=light,
        probes=tuple(sample_points(surface, PROBE_POINTS) @ rot.T for surface in surfaces),
        trees=tuple(cKDTree(sample_points(surface, TREE_POINTS) @ rot.T) for surface in surfaces),
        sizes=np.stack([np.ptp(part.bounds, axis=0) for part in parts]),
        filled=np.array([filled_share(levels[-1], i, distance, light) for i in range(len(parts))]),
    )


def filled_share(level: PlacementLevel, part: int, distance: float, light: Array) -> float:
    """Return the share of the convex hull of its outline that a part fills, in frontal view."""
    fx, fy = level.crop.pinhole[:2]
    height, width = level.crop.size
    points = level.pieces[part].points
    reach = float(np.abs(points[:, :2]).max()) + 1e-6
    depth = max(distance, 1.2 * float(-points[:, 2].min()), 2.0 * fx * reach / min(height, width))
    ids = np.full((height, width), -1, dtype=np.int32)
    render_part(
        level.pieces[part].arrays,
        light,
        np.array([0.0, 0.0, depth]),
        (fx, fy, 0.5 * width, 0.5 * height),
        part,
        np.zeros((height, width), dtype=np.float32),
        np.zeros((height, width, 3), dtype=np.float32),
        ids,
    )
    seen = np.argwhere(ids == part).astype(np.float32)
    if len(seen) < MIN_VISIBLE_PX:
        return 1.0
    hull = cv2.convexHull(seen)
    return float(len(seen) / (cv2.contourArea(hull) + 0.5 * cv2.arcLength(hull, True) + 1.0))
