"""Puzzle: a picture, and parts that are to be put where it shows them."""

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
from articulate.reconstruct.actors.placement.kernels import draw_part, shift_costs
from articulate.reconstruct.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

CAP = 90.0
"""Largest cost of a pixel: sum of absolute differences of three colours."""
PLAIN = 18.0
"""Pixels that differ by less from what the picture's rim mostly shows are background."""
MARGIN = 0.06
"""Room about what is not background, as a share of its size."""
LEVELS = ((96, 1.8), (220, 0.9), (480, 0.6))
"""Longest side of the picture at each level [px], and how coarse parts are in pixels of it."""
PROBES, DENSE = 100, 6000
"""Points on a part that asks how far it is from others, and on these."""
SMALLEST_GAP = 0.004
"""Smaller gaps are none [m]."""
SIMILAR, SAME = 0.15, 0.01
"""Parts whose boxes differ by less than these shares of the longest side are alike, or the same."""
CROWDED = 10.0
"""A part that lies in one like it is this much worse than one as far from all others."""
LEAST_SEEN_PX = 20
"""Parts seen in fewer pixels count as filled."""
FAR_M = 1.0
"""Larger gaps are not told apart [m]."""
Places = Mapping[int, Array]
"""Where the middle of each part is, in the camera's frame, by index."""


@dataclass(frozen=True, eq=False)
class Piece:
    """One part, turned into the camera's frame, in as much detail as a level shows."""

    points: Array
    faces: Ints
    albedo: Array

    @property
    def arrays(self) -> tuple[Array, Ints, Array]:
        """As compiled code wants it."""
        return self.points, self.faces, self.albedo


@dataclass(frozen=True, eq=False)
class Rest:
    """What is drawn of all parts but some."""

    nearness: Floats
    """1 / depth (H, W) [1/m], 0 where nothing is."""
    base: Floats
    """Cost of each pixel (H, W)."""
    part_ids: NDArray[np.int32]
    """Index of the part at each pixel (H, W), -1 where none is."""

    @property
    def total(self) -> float:
        """Cost of the picture."""
        return float(self.base.sum(dtype=np.float64))

    def under(self, later: Sequence[int]) -> Rest:
        """The same for a part that is drawn before those of ``later``: at one depth they win."""
        on_top = np.isin(self.part_ids, later)
        nearness = np.where(on_top, self.nearness * DEPTH_TOLERANCE**2, self.nearness)
        return replace(self, nearness=nearness.astype(np.float32))


@dataclass(frozen=True, eq=False)
class Level:
    """The picture in some number of pixels."""

    shot: Crop
    background: Array
    """Colour (3,) where nothing is."""
    pieces: tuple[Piece, ...]
    px: float
    """Pixels of the given picture that make one."""
    outline: NDArray[np.bool_] = field(repr=False)
    """Where the object is, with one more pixel at each side (H + 2, W + 2); these are true where
    the picture ends on the object."""

    @property
    def frame(self) -> Floats:
        """The picture (H, W, 3)."""
        return np.asarray(self.shot.frames[0])

    @property
    def solid_px(self) -> float:
        """Pixels of the given picture in which the object is seen."""
        off = np.abs(self.frame - self.background).max(axis=-1) > PLAIN
        return float(off.sum()) * self.px**2

    def pixels(self, points_c: Array) -> tuple[Ints, Ints]:
        """Row and column of each point (..., 3); -1, or one too many, outside of the picture."""
        fx, fy, cx, cy = self.shot.pinhole
        depth = np.maximum(points_c[..., 2], 1e-3)
        height, width = self.shot.size
        u = np.clip(np.rint(points_c[..., 0] / depth * fx + cx), -1, width)
        v = np.clip(np.rint(points_c[..., 1] / depth * fy + cy), -1, height)
        return v.astype(np.int64), u.astype(np.int64)

    def rest(self, places: Places, light: Array, without: Sequence[int] = ()) -> Rest:
        """All parts that have a place, but those ``without``."""
        height, width = self.shot.size
        nearness = np.zeros((height, width), dtype=np.float32)
        part_ids = np.full((height, width), -1, dtype=np.int32)
        picture = np.broadcast_to(self.background, (height, width, 3)).astype(np.float32)
        for i, shift in places.items():
            if i not in without:
                draw_part(
                    self.pieces[i].arrays,
                    light,
                    np.asarray(shift, dtype=np.float64),
                    self.shot.pinhole,
                    i,
                    nearness,
                    picture,
                    part_ids,
                )
        base = np.minimum(np.abs(self.frame - picture).sum(axis=-1), CAP)
        return Rest(nearness, base.astype(np.float32), part_ids)

    def costs(self, part: int, shifts_c: Array, rest: Rest, light: Array) -> tuple[Array, Array]:
        """What each place of a part (Q, 3) adds to the cost (Q,), and where it is seen (Q,) [px].

        Both are in pixels of the given picture, the first as if all differed wholly.
        """
        shifts_c = np.ascontiguousarray(shifts_c, dtype=np.float64)
        out, shown = np.zeros(len(shifts_c)), np.zeros(len(shifts_c))
        shift_costs(
            self.pieces[part].arrays,
            light,
            shifts_c,
            self.shot.pinhole,
            (rest.nearness, rest.base),
            self.frame,
            CAP,
            out,
            shown,
        )
        return out * (self.px**2 / CAP), shown * self.px**2

    def total(self, rest: Rest) -> float:
        """Cost of the picture, in pixels of the given one."""
        return rest.total * self.px**2 / CAP

    def unexplained(self, rest: Rest) -> float:
        """The same of what is wrong all over a spot of some pixels, which edges are not."""
        spots = cv2.erode(rest.base, np.ones((3, 3)))
        return float(spots.sum(dtype=np.float64)) * self.px**2 / CAP


def background_of(picture: Pixels) -> Array:
    """What the rim of a picture (H, W, 3) mostly shows (3,)."""
    rim = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    return np.asarray(np.median(rim.astype(np.float64), axis=0))


def region_of(picture: Pixels) -> tuple[int, int, int, int]:
    """Columns and rows that hold what is not background: first, after the last; twice."""
    solid = np.abs(picture - background_of(picture)).max(axis=-1) > PLAIN
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


def level_of(
    parts: Sequence[PartMesh], picture: Pixels, camera: Camera, most_px: int, coarse_m: float
) -> Level:
    """The picture at most ``most_px`` wide and high, and parts as coarse as that allows.

    Args:
        parts: Each with the middle of its box at the origin.
        picture: (H, W, 3).
        camera: Its camera.
        most_px: Longest side [px].
        coarse_m: Parts are as coarse as a pixel is at this distance [m].
    """
    region = region_of(picture)
    shot = crop_video(picture[None], camera, np.array([0]), region, most_px)
    pixel_m = coarse_m / float(shot.pinhole[0])
    rot = camera.T_cw[:3, :3]
    pieces = []
    for part in parts:
        surface = build_surface([part], pixel_m=pixel_m)
        pieces.append(
            Piece(np.ascontiguousarray(surface.points_o @ rot.T), surface.faces, surface.albedo)
        )
    longest = max(region[1] - region[0], region[3] - region[2])
    background = background_of(picture)
    solid = (np.abs(shot.frames[0] - background).max(axis=-1) > PLAIN).astype(np.uint8)
    outline = cv2.dilate(solid, np.ones((3, 3), np.uint8))
    height, width = picture.shape[:2]
    at_end = (region[2] == 0, region[3] == height, region[0] == 0, region[1] == width)
    padded = np.pad(outline, 1, mode="edge").astype(np.bool_)
    for side, ends in zip(
        (padded[0], padded[-1], padded[:, 0], padded[:, -1]), at_end, strict=True
    ):
        side &= ends
    return Level(shot, background, tuple(pieces), longest / max(shot.size), padded)


@dataclass(frozen=True, eq=False)
class PlacementProblem:
    """A picture in several sizes, and the parts."""

    levels: tuple[Level, ...]
    camera: Camera
    parts: tuple[PartMesh, ...]
    """Each with the middle of its box at the origin."""
    light: Array
    """(LIGHT_ROWS, 3)."""
    probes: tuple[Array, ...] = field(repr=False)
    """Points on each part about its middle, in the camera's frame (N, 3)."""
    trees: tuple[cKDTree, ...] = field(repr=False)
    """More such points."""
    sizes: Array
    """Sides of each part's box (P, 3) [m]."""
    filled: Array
    """Share of the hull of its own outline that each part fills (P,): little for a wire."""

    def volume(self, part: int) -> float:
        """Volume of a part's box, with a little in every direction."""
        return float(np.prod(self.sizes[part] + 0.02))

    def rest(self, k: int, part: int, places: Places) -> Rest:
        """What is drawn at level ``k`` of all parts but one, which is drawn in its turn.

        Larger parts come first, so that a button wins where it is as near as what it is in.
        """
        drawn = self.levels[k].rest(places, self.light, without=(part,))
        later = [i for i in places if i != part and self.volume(i) < self.volume(part)]
        return drawn.under(later) if later else drawn

    def radius(self, part: int) -> float:
        """Half the diagonal of a part's box [m]."""
        return 0.5 * float(np.linalg.norm(self.sizes[part]))

    def alike(self, one: int, other: int, within: float = SIMILAR) -> bool:
        """Whether the sides of two parts' boxes differ by less than a share of the longest."""
        a, b = self.sizes[one], self.sizes[other]
        return bool(np.abs(a - b).max() <= within * max(a.max(), b.max()))

    def share_on_object(self, k: int, part: int, shifts: Array) -> Array:
        """Share of a part's points that are seen where the object is (Q,), at places (Q, 3)."""
        level = self.levels[k]
        rows, columns = level.pixels(shifts[:, None] + self.probes[part])
        return np.asarray(level.outline[rows + 1, columns + 1].mean(axis=1))

    def misfit(self, part: int, shift: Array, places: Places) -> float:
        """What is wrong with a place apart from the picture, as a length [m].

        The gap to the nearest other part, and much more where a part lies in one like it.
        """
        crowded = 0.0
        for i, other in places.items():
            if i != part and self.alike(part, i):
                apart = float(np.linalg.norm(shift - other))
                crowded += max(0.0, 0.5 * float(self.sizes[part].max()) - apart)
        return self.gap(part, shift, places) + CROWDED * crowded

    def gap(self, part: int, shift: Array, places: Places) -> float:
        """How far a part is from the nearest that has a place [m]; 0 if there is no other."""
        least = FAR_M
        others = [i for i in places if i != part]
        if not others:
            return 0.0
        apart = {i: self._box_gap(part, shift, i, places[i]) for i in others}
        for i in sorted(others, key=lambda i: apart[i]):
            if apart[i] >= least or least <= SMALLEST_GAP:
                break
            points = self.probes[part] + (shift - places[i])
            far, _ = self.trees[i].query(points, distance_upper_bound=least)
            least = min(least, float(far.min()))
        return max(0.0, least - SMALLEST_GAP)

    def _box_gap(self, part: int, shift: Array, other: int, other_shift: Array) -> float:
        """Distance of two parts' boxes."""
        between = self.camera.T_wc[:3, :3] @ (shift - other_shift)
        half = 0.5 * (self.sizes[part] + self.sizes[other])
        return float(np.linalg.norm(np.maximum(np.abs(between) - half, 0.0)))


def puzzle_of(
    parts: Sequence[PartMesh], picture: Pixels, camera: Camera, light: Array
) -> PlacementProblem:
    """The question as a puzzle.

    Args:
        parts: Each with the middle of its box at the origin.
        picture: (H, W, 3).
        camera: Its camera.
        light: How the object is lit (LIGHT_ROWS, 3), in the camera's frame.
    """
    distance = float(np.linalg.norm(camera.eye_w))
    rot = camera.T_cw[:3, :3]
    surfaces = [build_surface([part], pixel_m=1e-4) for part in parts]
    levels = tuple(level_of(parts, picture, camera, px, coarse * distance) for px, coarse in LEVELS)
    return PlacementProblem(
        levels=levels,
        camera=camera,
        parts=tuple(parts),
        light=light,
        probes=tuple(sample_points(surface, PROBES) @ rot.T for surface in surfaces),
        trees=tuple(cKDTree(sample_points(surface, DENSE) @ rot.T) for surface in surfaces),
        sizes=np.stack([np.ptp(part.bounds, axis=0) for part in parts]),
        filled=np.array([filled_share(levels[-1], i, distance, light) for i in range(len(parts))]),
    )


def filled_share(level: Level, part: int, distance: float, light: Array) -> float:
    """Share of the hull of its outline that a part fills, seen from straight before it."""
    fx, fy = level.shot.pinhole[:2]
    height, width = level.shot.size
    points = level.pieces[part].points
    reach = float(np.abs(points[:, :2]).max()) + 1e-6
    depth = max(distance, 1.2 * float(-points[:, 2].min()), 2.0 * fx * reach / min(height, width))
    ids = np.full((height, width), -1, dtype=np.int32)
    draw_part(
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
    if len(seen) < LEAST_SEEN_PX:
        return 1.0
    hull = cv2.convexHull(seen)
    return float(len(seen) / (cv2.contourArea(hull) + 0.5 * cv2.arcLength(hull, True) + 1.0))
