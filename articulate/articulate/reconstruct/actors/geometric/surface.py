"""Triangles of parts at image resolution, and the slides and hinges that their shape suggests."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.parameters import SURFACE
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints, axis_angle_to_matrix, normalised, pose

TEXTURE_SAMPLES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array(
    [[3], [6], [6], [6]]
)
"""Points of a face at which its texture is sampled, in barycentric coordinates."""


@dataclass(frozen=True, eq=False)
class PartSurface:
    """Triangles of parts in the object frame."""

    points_o: Array
    """Vertices (V, 3) [m]."""
    faces: Ints
    """Indices of vertices (F, 3)."""
    albedo: Array
    """Colour of each face (F, 3), 0 to 255."""
    part_ids: Ints
    """Part of each face (F,)."""

    @property
    def normals_o(self) -> Array:
        """Unit normals (F, 3); about zero for faces without area."""
        a, b, c = (self.points_o[self.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        size = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.maximum(size, 1e-18), dtype=np.float64)

    @property
    def areas(self) -> Array:
        """Area of each face (F,) [m^2]."""
        a, b, c = (self.points_o[self.faces[:, k]] for k in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    def only(self, part_ids: Sequence[int]) -> PartSurface:
        """Return the faces of some parts."""
        chosen = np.isin(self.part_ids, list(part_ids))
        used, faces = np.unique(self.faces[chosen], return_inverse=True)
        return PartSurface(
            self.points_o[used],
            faces.reshape(-1, 3),
            self.albedo[chosen],
            self.part_ids[chosen],
        )


def build_surface(parts: Sequence[PartMesh], *, pixel_m: float) -> PartSurface:
    """Build the surface of ``parts``, part k with id k, without details smaller than a pixel.

    Args:
        parts: Parts in the object frame.
        pixel_m: Size of a pixel at the object [m].
    """
    pieces = [_piece(part, k, pixel_m) for k, part in enumerate(parts)]
    starts = np.cumsum([0, *(len(p.points_o) for p in pieces[:-1])])
    return PartSurface(
        np.concatenate([p.points_o for p in pieces]),
        np.concatenate([p.faces + start for p, start in zip(pieces, starts, strict=True)]),
        np.concatenate([p.albedo for p in pieces]),
        np.concatenate([p.part_ids for p in pieces]),
    )


def _piece(part: PartMesh, part_id: int, pixel_m: float) -> PartSurface:
    points, faces, albedo = part.vertices, part.faces, part.rgb * 255.0
    if part.uv is not None and part.texture is not None and len(faces):
        points, faces, uv = _split_large(points, faces, part.uv, SURFACE.textured_edge_px * pixel_m)
        albedo = _texture_colours(uv, part.texture)
    points, faces, albedo = _clustered(points, faces, albedo, 0.7 * pixel_m)
    ids = np.full(len(faces), part_id, dtype=np.int64)
    return PartSurface(points, faces, albedo, ids)


def _clustered(
    points: Array, faces: Ints, albedo: Array, cell_m: float
) -> tuple[Array, Ints, Array]:
    """Merge vertices that share a cell, and drop faces without area."""
    if not len(faces):
        return points, faces, albedo
    cells = np.floor(points / cell_m).astype(np.int64)
    _, first, place = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    place = place.reshape(-1)
    middle = np.zeros((len(first), 3))
    np.add.at(middle, place, points)
    middle /= np.bincount(place)[:, None]
    merged = place[faces]
    valid = (
        (merged[:, 0] != merged[:, 1])
        & (merged[:, 1] != merged[:, 2])
        & (merged[:, 2] != merged[:, 0])
    )
    if not valid.any():  # smaller than a pixel: keep unchanged
        return points, faces, albedo
    merged, albedo = merged[valid], albedo[valid]
    key = np.sort(merged, axis=1)
    _, unique = np.unique(key, axis=0, return_index=True)
    return middle, merged[unique], albedo[unique]


def _split_large(
    points: Array, faces: Ints, uv: Array, longest_m: float
) -> tuple[Array, Ints, Array]:
    """Split faces with an edge longer than ``longest_m`` in four, repeatedly."""
    corners = points[faces]
    done_c, done_uv = [], []
    for _ in range(SURFACE.max_face_splits):
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        long = edges > longest_m
        done_c.append(corners[~long])
        done_uv.append(uv[~long])
        corners, uv = _quartered(corners[long]), _quartered(uv[long])
        if not len(corners):
            break
    done_c.append(corners)
    done_uv.append(uv)
    corners, uv = np.concatenate(done_c), np.concatenate(done_uv)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), uv


def _quartered(corners: Array) -> Array:
    """Split each triangle (F, 3, D) in four, (4 F, 3, D)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(triangle, axis=1) for triangle in four])


def _texture_colours(uv: Array, texture: np.ndarray) -> Array:
    """Return the mean texture colour of each face (F, 3), 0 to 255."""
    height, width = texture.shape[:2]
    spots = np.einsum("sk,fkd->fsd", TEXTURE_SAMPLES, uv)
    u = np.floor((spots[..., 0] % 1.0) * width).astype(np.int64).clip(0, width - 1)
    v = np.floor((1.0 - spots[..., 1] % 1.0) * height).astype(np.int64).clip(0, height - 1)
    return np.asarray(texture[v, u, :3].astype(np.float64).mean(axis=1))


@dataclass(frozen=True)
class JointMotion:
    """A slide or rotation that a part may perform."""

    kind: Literal["slide", "turn"]
    axis_o: Array
    """Unit vector (3,)."""
    pivot_o: Array
    """Point on the axis (3,) [m]; for a slide the centre of the part."""
    source: str
    """Origin of the candidate, for reports."""

    def T_o(self, q: Array) -> Array:
        """Return poses (..., 4, 4) at positions ``q`` (...) [m or rad]."""
        q = np.asarray(q, dtype=np.float64)
        if self.kind == "slide":
            return pose(q[..., None] * self.axis_o)
        rot = axis_angle_to_matrix(np.broadcast_to(self.axis_o, (*q.shape, 3)), q)
        return pose(self.pivot_o - np.einsum("...ij,j->...i", rot, self.pivot_o), rot)


def candidate_axes(part: PartSurface) -> list[tuple[str, Array]]:
    """Return the unit vectors, with source, along or about which a part may move."""
    found: list[tuple[str, Array]] = [(f"frame {n}", np.eye(3)[k]) for k, n in enumerate("xyz")]
    boxes = _box_axes(part)
    _add(found, (("box", axis) for axis in boxes))
    _add(found, (("box, across", axis) for axis in _across(boxes)))
    _add(found, (("face", axis) for axis in _face_axes(part, 3)))
    return found


def candidate_motions(
    part: PartSurface, rest: PartSurface, axes: list[tuple[str, Array]]
) -> list[JointMotion]:
    """Return all candidate motions for the given axes."""
    scale = float(np.linalg.norm(np.ptp(part.points_o, axis=0)))
    middle = 0.5 * (part.points_o.min(axis=0) + part.points_o.max(axis=0))
    slides = [JointMotion("slide", axis, middle, name) for name, axis in axes]
    samples = sample_points(part)
    touching = contact_points(samples, rest, part)
    turns = []
    for name, axis in axes:
        for where, pivot in candidate_pivots(samples, touching, axis, 0.04 * scale):
            turns.append(JointMotion("turn", axis, pivot, f"{name}, {where}"))
    return slides + turns


def candidate_pivots(
    points: Array, touching: Array, axis: Array, same_m: float
) -> list[tuple[str, Array]]:
    """Return points through which an axis may pass: corners, edges and centres of bounding boxes.

    Args:
        points: Points on the part (P, 3) [m].
        touching: Points in contact with other parts (K, 3) [m].
        axis: Unit vector (3,).
        same_m: Distance below which two pivots are merged [m].
    """
    across = perpendicular_axes(axis)
    found: list[tuple[str, Array]] = []
    flat: list[Array] = []
    groups = [("part", points)]
    if len(touching) >= 3:
        groups.append(("contact", touching))
    groups.append(("weight", points.mean(axis=0)[None]))
    groups.append(("ends", _ends(points @ axis, points)[None]))
    for name, group in groups:
        low, high = _flat_box(group @ across.T)
        for i, wi in enumerate(("low", "mid", "high")):
            for j, wj in enumerate(("low", "mid", "high")):
                spot2 = (
                    np.array([low[0], 0.5 * (low[0] + high[0]), high[0]])[i],
                    np.array([low[1], 0.5 * (low[1] + high[1]), high[1]])[j],
                )
                spot = np.array(spot2)
                if any(np.linalg.norm(spot - other) < same_m for other in flat):
                    continue
                flat.append(spot)
                along = axis * float(np.mean(points @ axis))
                found.append((f"{name} {wi} {wj}", across.T @ spot + along))
    return found


def _ends(along: Array, points: Array) -> Array:
    """Return the midpoint of a part's two ends along an axis: a wire handle's pivot."""
    low, high = np.percentile(along, (SURFACE.end_percent, 100.0 - SURFACE.end_percent))
    return np.asarray(
        0.5 * (points[along <= low].mean(axis=0) + points[along >= high].mean(axis=0))
    )


def perpendicular_axes(axis: Array) -> Array:
    """Return two unit vectors (2, 3) across ``axis`` (3,), along the frame's if possible."""
    order = np.argsort(np.abs(axis))
    first = np.eye(3)[order[0]]
    first = normalised(first - axis * float(first @ axis))
    return np.stack([first, np.cross(axis, first)])


def sample_points(surface: PartSurface, n: int = SURFACE.samples, seed: int = 0) -> Array:
    """Sample points (n, 3) uniformly on a surface."""
    rng = np.random.default_rng(seed)
    areas = surface.areas
    if areas.sum() <= 0.0:
        return surface.points_o
    chosen = rng.choice(len(areas), size=n, p=areas / areas.sum())
    a, b = rng.random((2, n, 1))
    flip = a + b > 1.0
    a, b = np.where(flip, 1.0 - a, a), np.where(flip, 1.0 - b, b)
    corners = surface.points_o[surface.faces[chosen]]
    return np.asarray(
        corners[:, 0] + a * (corners[:, 1] - corners[:, 0]) + b * (corners[:, 2] - corners[:, 0])
    )


def contact_points(samples: Array, rest: PartSurface, part: PartSurface) -> Array:
    """Return the samples (K, 3) [m] of a part that are close to another part.

    Args:
        samples: Points on the part (P, 3) [m].
        rest: Surface of the other parts.
        part: Surface of the part.
    """
    if not len(rest.faces):
        return np.empty((0, 3))
    everything = np.concatenate([part.points_o, rest.points_o])
    reach = SURFACE.contact_share * float(np.linalg.norm(np.ptp(everything, axis=0)))
    distance, _ = cKDTree(sample_points(rest, 4 * SURFACE.samples)).query(
        samples, distance_upper_bound=reach
    )
    return np.asarray(samples[np.isfinite(distance)])


def _flat_box(points: Array) -> tuple[Array, Array]:
    return points.min(axis=0), points.max(axis=0)


def _add(found: list[tuple[str, Array]], more: Iterable[tuple[str, Array]]) -> None:
    for name, axis in more:
        if all(abs(float(axis @ other)) < np.cos(SURFACE.same_axis_rad) for _, other in found):
            found.append((name, axis))


def _box_axes(part: PartSurface) -> list[Array]:
    """Return the principal axes that are well defined."""
    points = sample_points(part)
    centred = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred / len(points))
    axes = []
    # If two principal moments are similar, only the third axis is defined.
    for k in range(3):
        others = [values[j] for j in range(3) if j != k]
        if min(abs(values[k] - other) for other in others) > 0.08 * values[2]:
            axes.append(vectors[:, k])
    return axes


def _across(axes: list[Array]) -> list[Array]:
    """Return directions across one of ``axes`` and a perpendicular one of the frame.

    A lever that leans is as wide as it is high, so that its box defines one direction only; usually
    it is symmetric about a plane of the frame.
    """
    return [
        normalised(np.cross(axis, frame))
        for axis in axes
        for frame in np.eye(3)
        if abs(float(axis @ frame)) < np.sin(SURFACE.same_axis_rad)
    ]


def _face_axes(part: PartSurface, n: int) -> list[Array]:
    """Return the most frequent face normals by area, up to sign."""
    normals, areas = part.normals_o, part.areas.copy()
    axes = []
    for _ in range(n):
        if areas.sum() <= 0.0:
            break
        order = np.argsort(-areas)[:60]
        near = np.abs(normals @ normals[order].T) > np.cos(SURFACE.same_axis_rad)
        score = areas @ near
        best = int(score.argmax())
        if score[best] < 0.12 * part.areas.sum():
            break
        mine = near[:, best]
        sign = np.sign(normals[mine] @ normals[order[best]])
        axes.append(normalised((normals[mine] * (sign * areas[mine])[:, None]).sum(axis=0)))
        areas[mine] = 0.0
    return axes
