"""Mass and inertia of parts from their triangles and materials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from articulate.formats.load_meshes import Piece
from articulate.geometry.inertia import LEAST, Inertial, is_physical, steiner
from articulate.reconstruct.program.contact_distance import hull_of
from articulate.reconstruct.program.materials import PartMaterial
from articulate.transforms import Array, apply

MIN_SIDE_M = 1e-4
"""Shortest side of the box that replaces a flat piece [m]."""


def inertial_of(pieces: Sequence[Piece], material: PartMaterial, T_lp: Array) -> Inertial | None:
    """Compute mass properties in the frame of a link; None without geometry.

    The mass of a piece is that of walls with the material's thickness along its surface, at most
    that of a solid; it is distributed as in its convex hull.

    Args:
        pieces: Pieces of the part, in the part's own frame.
        material: Material of the part.
        T_lp: Pose of the part in its link (4, 4) [m].
    """
    with np.errstate(all="ignore"):  # a flat hull has no centre of mass
        bodies = [_body(piece.mesh, material, T_lp) for piece in pieces]
    mass = float(sum(body.mass_kg for body in bodies))
    if mass <= 0.0:
        return None
    com = sum((body.mass_kg * body.com_p for body in bodies), np.zeros(3)) / mass
    inertia = sum(
        (body.inertia_p + body.mass_kg * steiner(body.com_p - com) for body in bodies),
        np.zeros((3, 3)),
    )
    inertia += LEAST * np.eye(3)
    if not is_physical(mass, inertia):
        inertia = float(np.linalg.eigvalsh(inertia)[-1]) * np.eye(3)
    return Inertial(mass_kg=mass, com_p=com, inertia_p=inertia)


def scaled(inertial: Inertial, factor: float) -> Inertial:
    """Scale the mass by ``factor``."""
    return replace(
        inertial, mass_kg=factor * inertial.mass_kg, inertia_p=factor * inertial.inertia_p
    )


def _body(mesh: trimesh.Trimesh, material: PartMaterial, T_lp: Array) -> Inertial:
    points = apply(T_lp, np.asarray(mesh.vertices))
    hull = hull_of(points)
    solid = trimesh.Trimesh(hull.points, hull.faces, process=False)
    solid.fix_normals()
    walls = float(mesh.area) * material.wall_m
    filled = abs(float(solid.volume))
    solid_m3 = abs(float(mesh.volume)) if mesh.is_watertight else filled
    volume = min(walls, solid_m3) if solid_m3 > 0.0 else walls
    mass = material.density * volume
    if filled <= MIN_SIDE_M * float(solid.area):  # flat: as its box
        sides = np.maximum(np.ptp(points, axis=0), MIN_SIDE_M)
        com = (points.min(axis=0) + points.max(axis=0)) / 2.0
        squares = mass * sides**2 / 12.0
        return Inertial(mass_kg=mass, com_p=com, inertia_p=np.diag(squares.sum() - squares))
    tensor = np.asarray(solid.moment_inertia) * (mass / filled)
    return Inertial(mass_kg=mass, com_p=np.asarray(solid.center_mass), inertia_p=tensor)
