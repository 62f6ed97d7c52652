"""Mass, inertia and files of solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.library.procedural.solids import Box, Mesh, Solid
from articulate.transforms import Array, Ints, normalised

CREASE = 0.8
"""Cosine of the angle up to which neighbouring triangles shade as one surface."""


@dataclass(frozen=True, kw_only=True)
class MassProperties:
    """Mass, centre of mass and inertia of a rigid part."""

    mass_kg: float
    """Mass [kg]."""
    com_l: Array
    """Centre of mass in the part's frame [m], shape (3,)."""
    inertia_l: Array
    """Inertia about the centre of mass, axes of the part's frame [kg m^2], shape (3, 3)."""


def mass_properties(solids: Sequence[Solid]) -> MassProperties:
    """Sum the mass properties of solids without overlap over tetrahedra of their surfaces."""
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for solid in solids:
        corners, triangles = solid.mesh()
        middle = corners.mean(axis=0)
        a, b, c = (corners[triangles[:, k]] - middle for k in range(3))
        six = np.einsum("ij,ij->i", a, np.cross(b, c)) * solid.density_kg_m3
        total = a + b + c
        own = float(six.sum()) / 6.0
        offset = six @ total / 24.0
        squares = sum(np.einsum("i,ij,ik->jk", six, v, v) for v in (a, b, c, total)) / 120.0
        mass += own
        first += offset + own * middle
        second += squares + np.outer(offset, middle) + np.outer(middle, offset)
        second += own * np.outer(middle, middle)
    com = first / mass
    about = second - mass * np.outer(com, com)
    return MassProperties(
        mass_kg=mass, com_l=com, inertia_l=np.asarray(np.trace(about) * np.eye(3) - about)
    )


def obj_text(solids: Sequence[Solid], material: str = "", tile_m: float = 1.0) -> str:
    """Return the solids as a Wavefront OBJ.

    All are one object of the file, because MuJoCo renders only the first object.

    Args:
        solids: Visual geometry.
        material: Name in ``materials.mtl`` beside the file; boxes without one have
            only corners and triangles.
        tile_m: Length of the material's image on the surface [m].
    """
    lines = [f"mtllib materials.mtl\nusemtl {material}"] if material else []
    plain = not material and all(isinstance(solid, Box) for solid in solids)
    first, seen = 1, 1
    for solid in solids:
        corners, triangles = solid.mesh()
        lines.append(f"# {solid.name}")
        lines += [_row("v", corner) for corner in corners]
        if plain:
            lines += ["f " + " ".join(str(first + v) for v in t) for t in triangles]
        else:
            uv = texture_coordinates(corners, triangles) / tile_m
            lines += [_row("vt", row) for row in uv.reshape(-1, 2)]
            lines += [_row("vn", v) for v in smooth_normals(corners, triangles).reshape(-1, 3)]
            for k, t in enumerate(triangles):
                at = (seen + 3 * k + i for i in range(3))
                words = (f"{first + v}/{n}/{n}" for v, n in zip(t, at, strict=True))
                lines.append("f " + " ".join(words))
            seen += 3 * len(triangles)
        first += len(corners)
    return "\n".join(lines) + "\n"


def texture_coordinates(corners: Array, triangles: Ints) -> Array:
    """Return the texture coordinates of the corners of each triangle (F, 3, 2) [m].

    Each triangle is projected along the axis that it faces most; the image runs along the longer
    side of the solid, as grain does.

    Args:
        corners: Corners of the solid (V, 3) [m].
        triangles: Indices of corners (F, 3).
    """
    extent = np.ptp(corners, axis=0)
    faces = corners[triangles]
    normal = np.abs(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]))
    out = np.empty((len(triangles), 3, 2))
    for axis in range(3):
        own = normal.argmax(axis=1) == axis
        across = sorted({0, 1, 2} - {axis}, key=lambda k: -extent[k])
        out[own] = faces[own][:, :, across]
    return out


def smooth_normals(corners: Array, triangles: Ints) -> Array:
    """Return unit normals (F, 3, 3) at each triangle's corners, smooth on round surfaces.

    Args:
        corners: Corners of the solid (V, 3) [m].
        triangles: Indices of corners (F, 3).
    """
    faces = corners[triangles]
    area = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    flat = normalised(area)
    out = np.empty_like(faces)
    for v in range(len(corners)):
        at, which = np.nonzero(triangles == v)
        alike = flat[at] @ flat[at].T >= CREASE
        out[at, which] = normalised(alike @ area[at])
    return out


def hull_text(mesh: Mesh) -> str:
    """Return a surface as a Wavefront OBJ with corners and triangles only."""
    corners, triangles = mesh
    lines = [_row("v", corner) for corner in corners]
    lines += ["f " + " ".join(str(v + 1) for v in t) for t in triangles]
    return "\n".join(lines) + "\n"


def _row(word: str, values: Array) -> str:
    return f"{word} {' '.join(number(value) for value in values)}"


def number(value: float) -> str:
    """Format ``value`` with at most nine digits, without rounding noise below 1e-12 and -0."""
    return f"{round(float(value), 12) + 0.0:.9g}"
