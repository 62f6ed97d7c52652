"""Mass, centre of mass and inertia of a part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceLink
from articulate.geometry.presets import MASS_KG, Weight
from articulate.geometry.shapes import Shape
from articulate.transforms import Array

LEAST = 1e-9
"""Least principal inertia [kg m2]."""
LEAST_GYRATION_M = 1e-4
"""Least radius of gyration [m]: shapes are so light that ``LEAST`` would be more than fits them."""


@dataclass(frozen=True, kw_only=True)
class Inertial:
    """Mass properties in the frame of a part."""

    mass_kg: float
    com_p: Array
    """Centre of mass (3,) [m]."""
    inertia_p: Array
    """About the centre of mass, axes of the part (3, 3) [kg m2]."""
    given: bool = False
    """Whether they stand in the source; computed from its shapes otherwise."""


def inertial_of(
    members: tuple[tuple[SourceLink, Array], ...],
    shapes: tuple[Shape, ...],
    weight: Weight,
    *,
    rescaled: bool,
    kind: Literal["slide", "hinge", "fixed"],
    repairs: Repairs,
) -> Inertial:
    """Mass properties of a part: as given where every link gives physical ones, else computed.

    Args:
        members: Links of the part with their poses.
        shapes: Its collision shapes, scaled.
        weight: Used where they are computed.
        rescaled: The source is not metric, so that its masses mean nothing.
        kind: What moves the part.
        repairs: Takes a note where they are computed.
    """
    name = members[0][0].name
    given = None if rescaled else _given(members, shapes)
    if given is not None:
        return given
    found = from_shapes(shapes, weight)
    low, high = MASS_KG[kind]
    mass = float(np.clip(found.mass_kg, low, high))
    if any(link.inertial is not None for link, _ in members) and not rescaled:
        repairs.add(f"inertia of part {name} was absent in part or not physical: computed")
    if mass == found.mass_kg:
        return replace(found, inertia_p=_positive(found.inertia_p))
    factor = mass / found.mass_kg if found.mass_kg > 0.0 else 1.0
    inertia = found.inertia_p * factor if found.mass_kg > 0.0 else 1e-5 * mass * np.eye(3)
    return Inertial(mass_kg=mass, com_p=found.com_p, inertia_p=_positive(inertia))


def from_shapes(shapes: tuple[Shape, ...], weight: Weight) -> Inertial:
    """Sum over ``shapes``, each of one density; overlaps count twice."""
    masses, centres, tensors = [], [], []
    for shape in shapes:
        mesh = shape.mesh
        volume = shape.volume
        if volume <= 0.0:
            continue
        factor = volume / abs(mesh.volume) if mesh.volume else 1.0
        unit = factor * np.asarray(mesh.moment_inertia)
        density = max(weight.density_kg_m3, weight.sheet_kg_m2 / thickness(unit, volume))
        masses.append(density * volume)
        centres.append(np.asarray(mesh.center_mass))
        tensors.append(density * unit)
    if not masses:
        return Inertial(mass_kg=0.0, com_p=np.zeros(3), inertia_p=LEAST * np.eye(3))
    mass = float(np.sum(masses))
    com = np.average(centres, axis=0, weights=masses)
    inertia = np.zeros((3, 3))
    for m, centre, tensor in zip(masses, centres, tensors, strict=True):
        inertia += tensor + m * steiner(centre - com)
    least = mass * LEAST_GYRATION_M**2
    return Inertial(mass_kg=mass, com_p=com, inertia_p=_positive(inertia, least))


def thickness(inertia: Array, volume: float) -> float:
    """Shortest side [m] of the box with this ``inertia`` (3, 3) and ``volume``, at density 1."""
    a, b, c = np.linalg.eigvalsh(inertia)
    return float(max(np.sqrt(6.0 * max(a + b - c, 0.0) / volume), LEAST_GYRATION_M))


def steiner(offset: Array) -> Array:
    """Inertia (3, 3) of a unit point mass at ``offset`` (3,)."""
    return np.asarray(np.dot(offset, offset) * np.eye(3) - np.outer(offset, offset))


def is_physical(mass: float, inertia: Array) -> bool:
    """Whether the mass is positive and the inertia that of some distribution of mass."""
    if not (np.isfinite(mass) and mass > 0.0 and np.isfinite(inertia).all()):
        return False
    a, b, c = np.linalg.eigvalsh(inertia)
    return bool(a > 0.0 and a + b >= c * (1.0 - 1e-9))


def _given(
    members: tuple[tuple[SourceLink, Array], ...], shapes: tuple[Shape, ...]
) -> Inertial | None:
    """Mass properties from the file, if every link with geometry has physical ones."""
    masses, centres, tensors = [], [], []
    for link, T_pl in members:
        if link.inertial is None:
            if link.visuals or link.collisions:
                return None
            continue
        T = T_pl @ link.inertial.T_li
        tensor = T[:3, :3] @ link.inertial.inertia @ T[:3, :3].T
        if not is_physical(link.inertial.mass, tensor):
            return None
        masses.append(link.inertial.mass)
        centres.append(T[:3, 3])
        tensors.append(tensor)
    if not masses:
        return None
    mass = float(np.sum(masses))
    com = np.average(centres, axis=0, weights=masses)
    inertia = sum(
        (t + m * steiner(c - com) for m, c, t in zip(masses, centres, tensors, strict=True)),
        np.zeros((3, 3)),
    )
    if shapes:
        low = np.min([s.bounds[0] for s in shapes], axis=0)
        high = np.max([s.bounds[1] for s in shapes], axis=0)
        if np.any(com < low - 1e-3) or np.any(com > high + 1e-3):
            return None
        squares = np.maximum(np.maximum(high - com, com - low), 1e-3) ** 2
        if np.any(np.diag(inertia) > mass * (squares.sum() - squares)):
            return None  # even with all of it in the corners of its box it would be less
    return Inertial(mass_kg=mass, com_p=com, inertia_p=inertia, given=True)


def _positive(inertia: Array, least: float = LEAST) -> Array:
    """The nearest inertia with principal values of at least ``least`` that some body has."""
    values, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
    values = np.maximum(values, least)
    values[2] = min(values[2], (values[0] + values[1]) * (1.0 - 1e-6))
    return np.asarray((axes * values) @ axes.T)
