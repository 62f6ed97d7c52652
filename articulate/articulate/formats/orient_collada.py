"""Which way is up in COLLADA meshes.

A COLLADA file says which of its axes points up. ROS takes the coordinates as they are. The
importer Assimp, which Isaac Gym and others read meshes with, turns every scene so that y points
up, and objects assembled with it hang their meshes on links whose y axis is the upright one. Taken
as they are, the leaves of their doors then turn in their own plane.
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
"""A leaf is at most this share of its breadth thick."""
EDGE_SHARE = 0.4
"""Its axis lies at least this share of its breadth from its middle."""
UPRIGHT = math.cos(math.radians(10.0))
"""Cosine of the most by which a link's y axis leans where it is called upright."""
COLLADA = ".dae"
HINGES = ("revolute", "continuous")
TURNED = (
    "COLLADA meshes turned from z up to y up, as Assimp reads them: the y axis of their links "
    "points up, and as the files stand the leaf of {names} would turn in its own plane"
)


def make_loader(source: SourceObject, config: ConvertConfig) -> Loader:
    """What reads the geometry of an object, COLLADA meshes the way up that fits its joints.

    Args:
        source: The object; of what is found out about it only that meshes were turned is noted.
        config: Where meshes are looked for, and which way is up if that is known.

    Raises:
        AssetError: It has COLLADA meshes, and a mesh cannot be read or its links are no tree.
    """
    elements = [e for link in source.links.values() for e in (*link.visuals, *link.collisions)]
    if not any((element.filename or "").lower().endswith(COLLADA) for element in elements):
        return Loader(source, config, y_up=config.collada_up == "y")
    before = source.repairs.messages
    loader, _ = load_parts(source, build_parts(decompose_joints(source)), config)
    turned = [s for s in source.repairs.messages if s.startswith(TURNED[:40]) and s not in before]
    source.repairs.restore(before)
    for sentence in turned:
        source.repairs.add(sentence)
    return loader


def load_parts(
    source: SourceObject, parts: Sequence[Part], config: ConvertConfig
) -> tuple[Loader, dict[str, PartGeometry]]:
    """Geometry of the parts, and what read it; COLLADA meshes the way up that fits the joints.

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
    """Whether the y axis of every link that does not move points up in the root's frame."""
    root = parts[0]
    seen = [root.T_sp @ T for link, T in root.members if link.visuals or link.collisions]
    return bool(seen) and all(float(T_sl[2, 1]) >= UPRIGHT for T_sl in seen)


def leaves_in_plane(parts: Sequence[Part], geometry: Mapping[str, PartGeometry]) -> tuple[str, ...]:
    """Names of the hinges that turn a flat part in its own plane, about its edge."""
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
    """Whether ``corners`` (N, 3), in the frame of the joint, are a leaf across its ``axis``."""
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
