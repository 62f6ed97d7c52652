"""Mass, centre of mass and inertia of a part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceInertial, SourceLink
from articulate.geometry.presets import MASS_KG, Weight
from articulate.geometry.shapes import Shape
from articulate.transforms import Array

LEAST = 1e-9
"""Least principal inertia [kg m2]."""
LEAST_GYRATION_M = 1e-4
"""Least radius of gyration [m]: for very light shapes ``LEAST`` is larger than their extent."""


@dataclass(frozen=True, kw_only=True)
class Inertial:
    """Mass properties in the frame of a part."""

    mass_kg: float
    com_p: Array
    """Centre of mass (3,) [m]."""
    inertia_p: Array
    """About the centre of mass, axes of the part (3, 3) [kg m2]."""
    from_source: bool = False
    """True if the source gives them; otherwise they are computed from the shapes."""


def inertial_of(
    members: tuple[tuple[SourceLink, Array], ...],
    shapes: tuple[Shape, ...],
    weight: Weight,
    *,
    rescaled: bool,
    kind: Literal["slide", "hinge", "fixed"],
    repairs: Repairs,
) -> Inertial:
    """Return the mass properties in the source if every link has physical ones, else compute them.

    Args:
        members: Links of the part with their poses (4, 4) [m].
        shapes: Its collision shapes, scaled [m].
        weight: Density of computed ones.
        rescaled: The source is not metric, so that its masses are meaningless.
        kind: Kind of the joint that moves the part.
        repairs: Receives a repair if they are computed.
    """
    name = members[0][0].name
    stated = None if rescaled else _stated(members, shapes)
    if stated is not None:
        return stated
    found = from_shapes(shapes, weight)
    low, high = MASS_KG[kind]
    mass = float(np.clip(found.mass_kg, low, high))
    if any(link.inertial is not None for link, _ in members) and not rescaled:
        repairs.add(f"inertia of part {name} is missing for some links or not physical: computed")
    if mass == found.mass_kg:
        return replace(found, inertia_p=_positive(found.inertia_p))
    factor = mass / found.mass_kg if found.mass_kg > 0.0 else 1.0
    inertia = found.inertia_p * factor if found.mass_kg > 0.0 else 1e-5 * mass * np.eye(3)
    return Inertial(mass_kg=mass, com_p=found.com_p, inertia_p=_positive(inertia))


def from_shapes(shapes: tuple[Shape, ...], weight: Weight) -> Inertial:
    """Sum mass properties over ``shapes``, each of uniform density; overlaps count twice."""
    found = []
    for shape in shapes:
        mesh = shape.mesh
        volume = shape.volume
        if volume <= 0.0:
            continue
        factor = volume / abs(mesh.volume) if mesh.volume else 1.0
        unit = factor * np.asarray(mesh.moment_inertia)
        density = max(weight.density_kg_m3, weight.sheet_kg_m2 / thickness(unit, volume))
        found.append(
            Inertial(
                mass_kg=density * volume,
                com_p=np.asarray(mesh.center_mass),
                inertia_p=density * unit,
            )
        )
    if not found:
        return Inertial(mass_kg=0.0, com_p=np.zeros(3), inertia_p=LEAST * np.eye(3))
    total = combined(found)
    least = total.mass_kg * LEAST_GYRATION_M**2
    return replace(total, inertia_p=_positive(total.inertia_p, least))


def combined(bodies: Sequence[Inertial]) -> Inertial:
    """Return the mass properties of rigidly connected bodies, given in one frame."""
    mass = float(np.sum([body.mass_kg for body in bodies]))
    com = np.average(
        [body.com_p for body in bodies], axis=0, weights=[body.mass_kg for body in bodies]
    )
    inertia = np.zeros((3, 3))
    for body in bodies:
        inertia += body.inertia_p + body.mass_kg * steiner(body.com_p - com)
    is_stated = all(body.from_source for body in bodies)
    return Inertial(mass_kg=mass, com_p=com, inertia_p=inertia, from_source=is_stated)


def stated(inertial: SourceInertial, T: Array) -> Inertial | None:
    """Return mass properties of the source in the frame with the link at ``T`` (4, 4) [m].

    None if no body has them.
    """
    T = T @ inertial.T_li
    tensor = T[:3, :3] @ inertial.inertia @ T[:3, :3].T
    if not is_physical(inertial.mass, tensor):
        return None
    return Inertial(mass_kg=inertial.mass, com_p=T[:3, 3], inertia_p=tensor, from_source=True)


def thickness(inertia: Array, volume: float) -> float:
    """Return the shortest side [m] of the box with this ``inertia`` (3, 3) and ``volume`` [m3].

    The inertia is that of density 1 [m5].
    """
    a, b, c = np.linalg.eigvalsh(inertia)
    return float(max(np.sqrt(6.0 * max(a + b - c, 0.0) / volume), LEAST_GYRATION_M))


def steiner(offset: Array) -> Array:
    """Inertia (3, 3) [m2] of a unit point mass at ``offset`` (3,) [m] (Steiner)."""
    return np.asarray(np.dot(offset, offset) * np.eye(3) - np.outer(offset, offset))


def is_physical(mass: float, inertia: Array) -> bool:
    """Return whether ``mass`` [kg] and ``inertia`` (3, 3) [kg m2] belong to some body.

    The mass is positive and the principal inertias fulfil the triangle inequality.
    """
    if not (np.isfinite(mass) and mass > 0.0 and np.isfinite(inertia).all()):
        return False
    a, b, c = np.linalg.eigvalsh(inertia)
    return bool(a > 0.0 and a + b >= c * (1.0 - 1e-9))


def _stated(
    members: tuple[tuple[SourceLink, Array], ...], shapes: tuple[Shape, ...]
) -> Inertial | None:
    """Mass properties in the source, if every link with geometry has physical ones."""
    found = []
    for link, T_pl in members:
        if link.inertial is None:
            if link.visuals or link.collisions:
                return None
            continue
        body = stated(link.inertial, T_pl)
        if body is None:
            return None
        found.append(body)
    if not found:
        return None
    total = combined(found)
    com = total.com_p
    if shapes:
        low = np.min([s.bounds[0] for s in shapes], axis=0)
        high = np.max([s.bounds[1] for s in shapes], axis=0)
        if np.any(com < low - 1e-3) or np.any(com > high + 1e-3):
            return None
        squares = np.maximum(np.maximum(high - com, com - low), 1e-3) ** 2
        if np.any(np.diag(total.inertia_p) > total.mass_kg * (squares.sum() - squares)):
            return None  # more than all mass in the corners of the box has
    return total


def _positive(inertia: Array, least: float = LEAST) -> Array:
    """Return the nearest physical inertia with principal values of at least ``least``."""
    values, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
    values = np.maximum(values, least)
    values[2] = min(values[2], (values[0] + values[1]) * (1.0 - 1e-6))
    return np.asarray((axes * values) @ axes.T)
