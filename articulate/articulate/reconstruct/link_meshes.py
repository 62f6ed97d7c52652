"""Visual meshes of the links of a URDF, placed in the frame of its root with every joint at 0."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from articulate.errors import AssetError
from articulate.formats.link_tree import Part
from articulate.formats.load_meshes import Loader, Piece
from articulate.formats.source_object import SourceObject
from articulate.render.parts import PartMesh
from articulate.transforms import Array, pose

HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Rotation that turns a front that faces -x, as in PartNet-Mobility, to +x."""


def link_poses(source: SourceObject) -> dict[str, Array]:
    """Compute the pose ``T_sl`` (4, 4) of every link in the root's frame, every joint at 0.

    Raises:
        AssetError: The links form no tree.
    """
    parent_of = {joint.child: joint for joint in source.joints}
    poses: dict[str, Array] = {}
    for link in source.links:
        chain, name = [], link
        while name not in poses and name in parent_of:
            chain.append(parent_of[name])
            if len(chain) > len(source.links) + 1:
                raise AssetError(f"{source.path}: the joints form a cycle; a tree is needed")
            name = parent_of[name].parent
        T = poses.setdefault(name, pose(np.zeros(3)))
        for joint in reversed(chain):
            T = poses[joint.child] = T @ joint.T_pc
    return poses


def link_pieces(loader: Loader, source: SourceObject, link: str, T_sl: Array) -> tuple[Piece, ...]:
    """Load the visual pieces of one link, moved by its pose ``T_sl`` (4, 4) [m]."""
    part = Part(
        name=link,
        parent=None,
        joint=None,
        T_sp=np.eye(4),
        T_pc=np.eye(4),
        members=((source.links[link], T_sl),),
    )
    return loader.part(part).visible


def merge_pieces(name: str, pieces: Sequence[Piece]) -> PartMesh:
    """Merge pieces into one mesh with a colour for each face."""
    starts = np.cumsum([0, *(len(p.mesh.vertices) for p in pieces)])
    faces = [np.asarray(p.mesh.faces) + s for p, s in zip(pieces, starts, strict=False)]
    rgb = [np.tile(np.array(p.rgba[:3]), (len(p.mesh.faces), 1)) for p in pieces]
    return PartMesh(
        name=name,
        vertices=np.concatenate([np.asarray(p.mesh.vertices, dtype=np.float64) for p in pieces]),
        faces=np.concatenate(faces).astype(np.int64),
        rgb=np.concatenate(rgb),
    )
