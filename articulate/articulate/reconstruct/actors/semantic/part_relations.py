"""Labelled parts as point samples: distances, neighbours, contacts and attachment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.surface import (
    PartSurface,
    candidate_axes,
    sample_points,
)
from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.semantic.embeddings import role_by_meaning
from articulate.reconstruct.actors.semantic.ontology import (
    BODIES,
    Role,
    object_words_in,
    role_of,
    words_of,
)
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, Ints, apply, normalised

POINTS, DENSE_POINTS = 800, 6000
"""Points on a part that moves, and on a part that others are compared with."""
POINT_STRIDE = 3
"""One in so many points is checked for collisions."""
MAX_NEIGHBOURS = 6
TOUCH_SHARE = 0.015
"""Points closer than this share of the object's diagonal are in contact."""
CARRIER_ROLES = frozenset({"door", "flap", "lid", "drawer", "pane", "screen", "swivel", "lift"})
"""Roles of parts to which others are attached and with which they move."""
CARRIER_SIZE_SHARE = 0.08
"""A carrier is attached to another only if its box is smaller than this share."""
FURNITURE = frozenset({"furniture", "table", "desk", "wardrobe", "dresser", "sideboard"})
APPLIANCES = frozenset({"oven", "stove", "dishwasher", "refrigerator", "fridge", "safe", "washing"})
"""Objects whose knobs are handles, and objects whose knobs turn."""
CLOSER_RATIO = 0.5
"""A part is attached to a carrier if its distance is below this share of that to the body."""


@dataclass(frozen=True, eq=False)
class PartShape:
    """A part with label, role and point samples."""

    mesh: PartMesh
    label: str
    role: Role
    guessed: bool = False
    """The role is inferred from the meaning of a name in no list."""

    @property
    def name(self) -> str:
        """Name of the part."""
        return self.mesh.name

    @cached_property
    def surface(self) -> PartSurface:
        """Triangles of the part."""
        n = len(self.mesh.faces)
        return PartSurface(
            points_o=self.mesh.vertices,
            faces=self.mesh.faces,
            albedo=self.mesh.rgb,
            part_ids=np.zeros(n, dtype=np.int64),
        )

    @cached_property
    def points(self) -> Array:
        """Uniform samples of its surface (N, 3) [m]."""
        return sample_points(self.surface, POINTS)

    @cached_property
    def dense(self) -> tuple[Array, Array]:
        """More samples and their face normals, both (N, 3)."""
        surface = self.surface
        areas = surface.areas
        if not areas.sum() > 0.0:
            return surface.points_o, np.tile([0.0, 0.0, 1.0], (len(surface.points_o), 1))
        rng = np.random.default_rng(0)
        chosen: Ints = rng.choice(len(areas), size=DENSE_POINTS, p=areas / areas.sum())
        weights = rng.dirichlet(np.ones(3), size=DENSE_POINTS)
        points = np.einsum("ni,nij->nj", weights, surface.points_o[surface.faces[chosen]])
        return points, surface.normals_o[chosen]

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree of the dense samples."""
        return cKDTree(self.dense[0])

    @cached_property
    def bounds(self) -> Array:
        """Bounding box (2, 3) [m]."""
        return self.mesh.bounds

    @property
    def centre(self) -> Array:
        """Centre of the box (3,) [m]."""
        return self.mesh.centre

    @property
    def size(self) -> Array:
        """Sides of the box (3,) [m]."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @cached_property
    def axes(self) -> list[tuple[str, Array]]:
        """Candidate directions of motion, with their source."""
        return candidate_axes(self.surface)

    def distance(self, points: Array, most: float = np.inf) -> Array:
        """Return the distance of points (..., 3) [m] (...); infinite above ``most``."""
        found, _ = self.tree.query(points, distance_upper_bound=most)
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class LabelledScene:
    """The object: parts by name, its body, and words for the object."""

    shapes: Mapping[str, PartShape]
    body: PartShape
    object_words: frozenset[str]
    middle: Array
    """Centre of the box around all parts (3,) [m]."""
    diagonal: float
    """Diagonal of that box [m]."""

    def parent_of(self, shape: PartShape) -> PartShape:
        """Return the parent of a part: the body, or a carrier that is much closer."""
        best, best_off = self.body, self._closeness(shape, self.body)
        allowed = max(best_off * CLOSER_RATIO, 1e-12)
        for other in self.shapes.values():
            if other in (shape, self.body) or other.role not in CARRIER_ROLES:
                continue
            least = CARRIER_SIZE_SHARE if shape.role in CARRIER_ROLES else 1.0
            if _volume(shape) >= least * _volume(other):
                continue
            distance = self._closeness(shape, other)
            if distance < allowed:
                best, allowed = other, distance
        return best

    def _closeness(self, shape: PartShape, other: PartShape) -> float:
        return float(np.quantile(other.distance(shape.points), 0.3)) + 1e-3 * self.diagonal

    def neighbours(self, shape: PartShape) -> list[PartShape]:
        """Return the parts next to ``shape`` that do not move along with it, the largest first."""
        room = 0.5 * float(np.linalg.norm(shape.size))
        low, high = shape.bounds[0] - room, shape.bounds[1] + room
        near = [
            s
            for s in self.shapes.values()
            if s is not shape
            and not self.is_attached(s, shape)
            and bool((s.bounds[0] < high).all() and (s.bounds[1] > low).all())
        ]
        return sorted(near, key=_volume, reverse=True)[:MAX_NEIGHBOURS]

    def is_attached(self, shape: PartShape, on: PartShape) -> bool:
        """Return whether ``shape`` is attached to ``on``."""
        return shape is not self.body and self.parent_names.get(shape.name) == on.name

    @cached_property
    def parent_names(self) -> dict[str, str]:
        """Name of the parent of each part except the body."""
        found = {s.name: self.parent_of(s).name for s in self.shapes.values() if s is not self.body}
        for name in found:  # no circles
            at, seen = name, {name}
            while at in found and found[at] not in seen:
                at = found[at]
                seen.add(at)
            if at in found:
                found[at] = self.body.name
        return found

    def attached_parts(self, shape: PartShape) -> list[PartShape]:
        """Return the parts that move along with a part."""
        return [s for s in self.shapes.values() if self.is_attached(s, shape)]

    @cached_property
    def touch_m(self) -> float:
        """Distance of points in contact [m]."""
        return TOUCH_SHARE * self.diagonal

    def contact(self, shape: PartShape, other: PartShape, share: float = 1.0) -> Array:
        """Return the points of ``shape`` in contact with ``other`` (K, 3) [m]."""
        return np.asarray(shape.points[other.distance(shape.points) < share * self.touch_m])

    def blocked_share(self, shape: PartShape, others: Iterable[PartShape], T: Array) -> float:
        """Return the share of the part's points that collide at poses ``T`` (K, 4, 4, homogeneous).

        Surfaces along which they slide, or that they touch at the start, do not count.
        """
        points = shape.points[::POINT_STRIDE]
        return self._blocked_by(np.concatenate([points[None], apply(T[:, None], points)]), others)

    def blocked_share_along(
        self, shape: PartShape, others: Iterable[PartShape], axis: Array, distances: Array
    ) -> float:
        """Return the share of the part's points that collide while it slides along ``axis``.

        Surfaces along which they slide, or that they touch at the start, do not count.

        Args:
            shape: The part that slides.
            others: Possible obstacles.
            axis: Unit vector (3,).
            distances: Distances of travel (K,) [m].
        """
        points = shape.points[::POINT_STRIDE]
        moved = points + np.concatenate([[0.0], distances])[:, None, None] * axis
        return self._blocked_by(moved, others)

    def _blocked_by(self, travel: Array, others: Iterable[PartShape]) -> float:
        """Return the share of points (K, N, 3) that meet a surface across their travel."""
        ahead = normalised(np.diff(travel, axis=0, append=travel[-1:]))
        ahead[-1] = ahead[-2]
        met = np.zeros(travel.shape[:2], dtype=np.bool_)
        for other in others:
            distance, which = other.tree.query(travel, distance_upper_bound=self.touch_m)
            near = np.isfinite(distance)
            normals = other.dense[1][np.where(near, which, 0)]
            met |= near & (np.abs((normals * ahead).sum(axis=-1)) > 0.5)
        return float((met[1:].any(axis=0) & ~met[0]).mean())


def build_labelled_scene(evidence: Evidence) -> LabelledScene:
    """Build the scene of the labelled parts of ``evidence``."""
    object_words = object_words_in(evidence.labels.values(), evidence.text)
    shapes = {}
    for mesh in evidence.parts:
        label = evidence.labels.get(mesh.name, "")
        role = role_of(label, object_words)
        inferred = role_by_meaning(label) if role == "unknown" else role
        shapes[mesh.name] = PartShape(mesh, label, inferred, guessed=inferred != role)
    body = max(shapes.values(), key=_body_score)
    low, high = joint_bounds(evidence.parts)
    diagonal = max(float(np.linalg.norm(high - low)), 1e-9)
    scene = LabelledScene(
        shapes=shapes,
        body=body,
        object_words=object_words,
        middle=0.5 * (low + high),
        diagonal=diagonal,
    )
    fixed = {shape.name: replace(shape, role="still") for shape in _furniture_knobs(scene)}
    return replace(scene, shapes={**shapes, **fixed}) if fixed else scene


def _furniture_knobs(scene: LabelledScene) -> list[PartShape]:
    """Return the knobs of drawers, and those of doors of furniture: they are handles."""
    knobs = [s for s in scene.shapes.values() if s.role == "spin" and "knob" in words_of(s.label)]
    furniture = bool(scene.object_words & FURNITURE)
    furniture |= any(shape.role == "drawer" for shape in scene.shapes.values())
    furniture &= not scene.object_words & APPLIANCES
    roles = {"drawer", "door", "flap"} if furniture else {"drawer"}
    return [knob for knob in knobs if scene.parent_of(knob).role in roles]


def _body_score(shape: PartShape) -> tuple[float, float]:
    """Return a score of a part as the body: by its name, then by its size."""
    words = words_of(shape.label)
    by_name = 0.0
    if words and words[-1] in BODIES:
        by_name = 2.0 - 0.1 * BODIES.index(words[-1])
    if shape.role in {"still", "unknown"}:
        by_name += 0.5
    return by_name, _volume(shape)


def _volume(shape: PartShape) -> float:
    return float(np.prod(shape.size + 1e-6))
