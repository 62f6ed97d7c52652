"""Orient COLLADA meshes by the joints that move them.

A COLLADA file declares its upward axis. ROS ignores it. The importer Assimp, which Isaac Gym and
others use, rotates every scene so that y points up, and objects assembled with it attach meshes to
links whose y axis is vertical. Read as in ROS, the leaves of their doors then rotate in their
plane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import trimesh

from articulate.formats.collada import is_z_up
from articulate.formats.config import ConvertConfig
from articulate.formats.decompose_joints import decompose_joints
from articulate.formats.link_tree import Part, build_parts
from articulate.formats.load_meshes import Loader, PartGeometry
from articulate.formats.source_object import SourceObject
from articulate.transforms import Array, normalised

LEAF_SHARE = 0.35
"""Largest thickness of a leaf, as a share of its breadth."""
EDGE_SHARE = 0.4
"""Smallest distance of its axis from its middle, as a share of its breadth."""
UPRIGHT = math.cos(math.radians(10.0))
"""Cosine of the largest tilt of a vertical y axis of a link."""
COLLADA = ".dae"
HINGES = ("revolute", "continuous")
TURNED = (
    "COLLADA meshes turned from z up to y up, as Assimp reads them: the y axis of their links "
    "points up, and without this the leaf of {names} would rotate in its plane"
)


def make_loader(source: SourceObject, config: ConvertConfig) -> Loader:
    """Return a loader whose COLLADA meshes are oriented by the joints of the object.

    Args:
        source: The object; its repairs only receive that meshes were turned.
        config: Folders of meshes, and the upward axis if it is known.

    Raises:
        AssetError: It has COLLADA meshes, and a mesh cannot be read or its links form no tree.
    """
    elements = [e for link in source.links.values() for e in (*link.visuals, *link.collisions)]
    if not any((element.filename or "").lower().endswith(COLLADA) for element in elements):
        return Loader(source, config, y_up=config.collada_up == "y")
    before = source.repairs.messages
    loader, _ = load_parts(source, build_parts(decompose_joints(source)), config)
    turned = [s for s in source.repairs.messages if s.startswith(TURNED[:40]) and s not in before]
    source.repairs.restore(before)
    for message in turned:
        source.repairs.add(message)
    return loader


def load_parts(
    source: SourceObject, parts: Sequence[Part], config: ConvertConfig
) -> tuple[Loader, dict[str, PartGeometry]]:
    """Load the geometry of the parts, COLLADA meshes oriented by the joints.

    Raises:
        AssetError: A mesh is absent or unreadable and its link has nothing else.
    """
    read = source.repairs.messages
    loader = Loader(source, config, y_up=config.collada_up == "y")
    geometry = {part.name: loader.part(part) for part in parts}
    if config.collada_up != "auto" or not any(is_z_up(path) for path in loader.files.values()):
        return loader, geometry
    flat = leaves_in_plane(parts, geometry) if config.up == "y" or has_y_up(parts) else ()
    if not flat:
        return loader, geometry
    before = source.repairs.messages
    source.repairs.restore(read)
    turned = Loader(source, config, y_up=True)
    upright = {part.name: turned.part(part) for part in parts}
    if len(leaves_in_plane(parts, upright)) < len(flat):
        source.repairs.add(TURNED.format(names=" and ".join(flat)))
        return turned, upright
    source.repairs.restore(before)
    return loader, geometry


def has_y_up(parts: Sequence[Part]) -> bool:
    """Return whether the y axis of every fixed link points up in the frame of the root."""
    root = parts[0]
    seen = [root.T_sp @ T for link, T in root.members if link.visuals or link.collisions]
    return bool(seen) and all(float(T_sl[2, 1]) >= UPRIGHT for T_sl in seen)


def leaves_in_plane(parts: Sequence[Part], geometry: Mapping[str, PartGeometry]) -> tuple[str, ...]:
    """Return the names of hinges that rotate a flat part in its plane, about its edge."""
    return tuple(
        part.joint.name
        for part in parts
        if part.joint is not None
        and part.joint.kind in HINGES
        and _turns_in_plane(part.joint.axis, _corners(geometry[part.name]))
    )


def _corners(geometry: PartGeometry) -> Array:
    found = [np.asarray(piece.mesh.vertices, dtype=np.float64) for piece in geometry.visible]
    return np.concatenate([np.zeros((0, 3)), *found])


def _turns_in_plane(axis: Sequence[float], corners: Array) -> bool:
    """Return whether ``corners`` (N, 3) in the joint's frame are a leaf across its ``axis``."""
    along = normalised(np.asarray(axis, dtype=np.float64))
    across = np.linalg.svd(along[None])[2][1:]
    flat = corners @ across.T
    if np.linalg.matrix_rank(flat - flat.mean(axis=0) if len(flat) else flat) < 2:
        return False
    T_to_middle, sides = trimesh.bounds.oriented_bounds_2D(flat)
    breadth = float(min(sides))
    middle = np.linalg.inv(T_to_middle)[:2, 2]
    thick = float(np.ptp(corners @ along))
    off = float(np.linalg.norm(middle))
    return thick <= LEAF_SHARE * breadth and off >= EDGE_SHARE * breadth
