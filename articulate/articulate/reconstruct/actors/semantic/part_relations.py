"""Scene: parts as points that can be asked what is near, and what hangs on what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.surface import (
    PartSurface,
    candidate_axes,
    sample_points,
)
from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.semantic.embeddings import meant_role
from articulate.reconstruct.actors.semantic.ontology import (
    BODIES,
    Role,
    role_of,
    things_in,
    words_of,
)
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, Ints, apply, normalised

POINTS, DENSE = 800, 6000
"""Points on a part that moves, and on one that others move against."""
FEWER = 3
"""One in so many points is looked at for what it runs into."""
MOST_NEIGHBOURS = 6
TOUCH = 0.015
"""Points nearer than this share of the object's diagonal touch."""
CARRIERS = frozenset({"door", "flap", "lid", "drawer", "pane", "screen", "swivel", "lift"})
"""Roles of parts on which others sit and with which they go."""
SMALL = 0.08
"""Of two carriers one sits on the other only if its box is smaller than this share."""
FAR_CLOSER = 0.5
"""A part hangs on a carrier if it is this much closer to it than to the body."""


@dataclass(frozen=True, eq=False)
class Shape:
    """One part."""

    mesh: PartMesh
    label: str
    role: Role
    guessed: bool = False
    """Whether the role is by the meaning of a name that is in no list."""

    @property
    def name(self) -> str:
        """Name of the part."""
        return self.mesh.name

    @cached_property
    def surface(self) -> PartSurface:
        """Its triangles."""
        n = len(self.mesh.faces)
        return PartSurface(
            points_o=self.mesh.vertices,
            faces=self.mesh.faces,
            albedo=self.mesh.rgb,
            part_ids=np.zeros(n, dtype=np.int64),
        )

    @cached_property
    def points(self) -> Array:
        """Points on it (N, 3), each area alike."""
        return sample_points(self.surface, POINTS)

    @cached_property
    def dense(self) -> tuple[Array, Array]:
        """More points on it, and the normal of the face of each, both (N, 3)."""
        surface = self.surface
        areas = surface.areas
        if not areas.sum() > 0.0:
            return surface.points_o, np.tile([0.0, 0.0, 1.0], (len(surface.points_o), 1))
        rng = np.random.default_rng(0)
        chosen: Ints = rng.choice(len(areas), size=DENSE, p=areas / areas.sum())
        weights = rng.dirichlet(np.ones(3), size=DENSE)
        points = np.einsum("ni,nij->nj", weights, surface.points_o[surface.faces[chosen]])
        return points, surface.normals_o[chosen]

    @cached_property
    def tree(self) -> cKDTree:
        """For asking what is near it."""
        return cKDTree(self.dense[0])

    @cached_property
    def bounds(self) -> Array:
        """Box (2, 3)."""
        return self.mesh.bounds

    @property
    def centre(self) -> Array:
        """Middle of the box (3,)."""
        return self.mesh.centre

    @property
    def size(self) -> Array:
        """Sides of the box (3,)."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @cached_property
    def axes(self) -> list[tuple[str, Array]]:
        """Directions along or about which it may move, by where they come from."""
        return candidate_axes(self.surface)

    def off(self, points: Array, most: float = np.inf) -> Array:
        """Distance of points (..., 3) from it (...); infinite where it is above ``most``."""
        found, _ = self.tree.query(points, distance_upper_bound=most)
        return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Named:
    """The object: shapes by name, its body, and what it is."""

    shapes: Mapping[str, Shape]
    body: Shape
    things: frozenset[str]
    middle: Array
    """Of the box around all parts (3,)."""
    diagonal: float
    """Of the same box."""

    def parent_of(self, shape: Shape) -> Shape:
        """What a part hangs on: the body, or a carrier that it is much closer to."""
        best, best_off = self.body, self._closeness(shape, self.body)
        allowed = max(best_off * FAR_CLOSER, 1e-12)
        for other in self.shapes.values():
            if other in (shape, self.body) or other.role not in CARRIERS:
                continue
            least = SMALL if shape.role in CARRIERS else 1.0
            if _room(shape) >= least * _room(other):
                continue
            off = self._closeness(shape, other)
            if off < allowed:
                best, allowed = other, off
        return best

    def _closeness(self, shape: Shape, other: Shape) -> float:
        return float(np.quantile(other.off(shape.points), 0.3)) + 1e-3 * self.diagonal

    def around(self, shape: Shape) -> list[Shape]:
        """The parts next to ``shape`` that do not go along with it, the largest first."""
        room = 0.5 * float(np.linalg.norm(shape.size))
        low, high = shape.bounds[0] - room, shape.bounds[1] + room
        near = [
            s
            for s in self.shapes.values()
            if s is not shape
            and not self.rides(s, shape)
            and bool((s.bounds[0] < high).all() and (s.bounds[1] > low).all())
        ]
        return sorted(near, key=_room, reverse=True)[:MOST_NEIGHBOURS]

    def rides(self, shape: Shape, on: Shape) -> bool:
        """Whether ``shape`` hangs on ``on``."""
        return shape is not self.body and self.hangs.get(shape.name) == on.name

    @cached_property
    def hangs(self) -> dict[str, str]:
        """Name of what each part but the body hangs on."""
        found = {s.name: self.parent_of(s).name for s in self.shapes.values() if s is not self.body}
        for name in found:  # no circles
            at, seen = name, {name}
            while at in found and found[at] not in seen:
                at = found[at]
                seen.add(at)
            if at in found:
                found[at] = self.body.name
        return found

    def riders(self, shape: Shape) -> list[Shape]:
        """What goes along with a part."""
        return [s for s in self.shapes.values() if self.rides(s, shape)]

    @cached_property
    def reach(self) -> float:
        """Points nearer than this touch."""
        return TOUCH * self.diagonal

    def contact(self, shape: Shape, other: Shape, share: float = 1.0) -> Array:
        """Points of ``shape`` next to ``other`` (K, 3)."""
        return np.asarray(shape.points[other.off(shape.points) < share * self.reach])

    def hits(self, shape: Shape, others: Iterable[Shape], T: Array) -> float:
        """Share of the part's points that meet a surface across their way on poses ``T`` (K, 4, 4).

        What they slide along does not stop them, nor what they touch before they move.
        """
        points = shape.points[::FEWER]
        return self._met(np.concatenate([points[None], apply(T[:, None], points)]), others)

    def stops(self, shape: Shape, others: Iterable[Shape], axis: Array, ways: Array) -> float:
        """Share of the part's points that meet a surface across their way along ``axis``.

        What they slide along does not stop them, nor what they touch before they move.

        Args:
            shape: The part that slides.
            others: What may stop it.
            axis: Unit vector (3,).
            ways: Distances (K,).
        """
        points = shape.points[::FEWER]
        moved = points + np.concatenate([[0.0], ways])[:, None, None] * axis
        return self._met(moved, others)

    def _met(self, way: Array, others: Iterable[Shape]) -> float:
        """Share of points that meet a surface across their way (K, N, 3), not at its beginning."""
        ahead = normalised(np.diff(way, axis=0, append=way[-1:]))
        ahead[-1] = ahead[-2]
        met = np.zeros(way.shape[:2], dtype=np.bool_)
        for other in others:
            off, which = other.tree.query(way, distance_upper_bound=self.reach)
            near = np.isfinite(off)
            normals = other.dense[1][np.where(near, which, 0)]
            met |= near & (np.abs((normals * ahead).sum(axis=-1)) > 0.5)
        return float((met[1:].any(axis=0) & ~met[0]).mean())


def named_scene(evidence: Evidence) -> Named:
    """The parts of ``evidence`` by what they are called."""
    things = things_in(evidence.labels.values(), evidence.text)
    shapes = {}
    for mesh in evidence.parts:
        label = evidence.labels.get(mesh.name, "")
        role = role_of(label, things)
        meant = meant_role(label) if role == "unknown" else role
        shapes[mesh.name] = Shape(mesh, label, meant, guessed=meant != role)
    body = max(shapes.values(), key=_bodily)
    low, high = joint_bounds(evidence.parts)
    diagonal = max(float(np.linalg.norm(high - low)), 1e-9)
    return Named(
        shapes=shapes, body=body, things=things, middle=0.5 * (low + high), diagonal=diagonal
    )


def _bodily(shape: Shape) -> tuple[float, float]:
    """How much a part is like a body: by its name, then by its size."""
    words = words_of(shape.label)
    by_name = 0.0
    if words and words[-1] in BODIES:
        by_name = 2.0 - 0.1 * BODIES.index(words[-1])
    if shape.role in {"still", "unknown"}:
        by_name += 0.5
    return by_name, _room(shape)


def _room(shape: Shape) -> float:
    return float(np.prod(shape.size + 1e-6))
