"""Parts of a scan as a part set for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import fast_simplification
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.formats.load_meshes import Piece
from articulate.formats.part_names import plain_label
from articulate.reconstruct.part_set import PartSet
from articulate.reconstruct.program.program_parts import Parts, ProgramPart
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.render.parts import PartMesh

BODY = "body"
MOST_FACES, FEWEST_FACES = 12_000, 200
"""Triangles of all parts of a dense scan, and of each part, after they are simplified."""
AGGRESSION = 3.0
"""Speed of the simplification: 7 is fast, 0 keeps all details."""
MAX_COLOURS = 12
"""Most colours of a part; more are averaged."""


def distinct_names(kinds: Sequence[str]) -> list[str]:
    """Return a distinct name for each kind: ``door_1``, ``door_2``."""
    seen: dict[str, int] = {}
    names = []
    for kind in kinds:
        stem = "_".join(kind.split()) or "part"
        seen[stem] = seen.get(stem, 0) + 1
        names.append(f"{stem}_{seen[stem]}")
    return names


def names_of(labels: Sequence[str]) -> list[str]:
    """Return a distinct name for each label: ``lid``, ``door_1``, ``door_2``."""
    return [
        name.removesuffix("_1") if labels.count(label) == 1 else name
        for name, label in zip(distinct_names(labels), labels, strict=True)
    ]


def part_set_of(
    name: str, meshes: Sequence[PartMesh], source: str, category: str = "unknown"
) -> PartSet:
    """Return placed parts in the frame ``o`` as a part set.

    Args:
        name: Name of the object.
        meshes: The parts; the first is the body.
        source: Name of the file.
        category: Category of the object.
    """
    parts = {mesh.name: ProgramPart(mesh.name, partial(_pieces, mesh)) for mesh in meshes}
    return PartSet(
        name=name,
        meshes=tuple(meshes),
        parts=Parts(parts),
        labels={mesh.name: plain_label(mesh.name) for mesh in meshes},
        category=category,
        source=source,
    )


def simplified(meshes: Sequence[PartMesh]) -> list[PartMesh]:
    """Return the parts of a dense scan with fewer triangles, ``MOST_FACES`` in all.

    Quadric error metrics decide which edges are collapsed.
    """
    keep = MOST_FACES / max(sum(len(mesh.faces) for mesh in meshes), 1)
    return [_simplified(mesh, keep) if keep < 1.0 else mesh for mesh in meshes]


def _simplified(mesh: PartMesh, keep: float) -> PartMesh:
    count = max(FEWEST_FACES, round(keep * len(mesh.faces)))
    if len(mesh.faces) <= count:
        return mesh
    vertices, faces = fast_simplification.simplify(
        mesh.vertices.astype(np.float32),
        mesh.faces.astype(np.int32),
        target_count=count,
        agg=AGGRESSION,
    )
    vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    near = cKDTree(mesh.vertices[mesh.faces].mean(axis=1)).query(vertices[faces].mean(axis=1))[1]
    return PartMesh(name=mesh.name, vertices=vertices, faces=faces, rgb=mesh.rgb[near])


def parents_of(proposals: Sequence[PartProposal], names: Sequence[str]) -> Mapping[str, str]:
    """Return the parent of each proposal by name."""
    return {
        name: BODY if proposal.on is None else names[proposal.on]
        for name, proposal in zip(names, proposals, strict=True)
    }


def _pieces(mesh: PartMesh) -> tuple[Piece, ...]:
    """Return one piece for each colour of a part."""
    colours, of_face = np.unique(mesh.rgb.round(3), axis=0, return_inverse=True)
    of_face = of_face.ravel()
    if len(colours) > MAX_COLOURS:
        colours, of_face = mesh.rgb.mean(axis=0, keepdims=True), np.zeros(len(mesh.faces), int)
    found = []
    for k, rgb in enumerate(colours):
        used, corners = np.unique(mesh.faces[of_face == k], return_inverse=True)
        if not len(used):
            continue
        piece = trimesh.Trimesh(mesh.vertices[used], corners.reshape(-1, 3), process=False)
        rgba = (float(rgb[0]), float(rgb[1]), float(rgb[2]), 1.0)
        found.append(Piece(name=f"{mesh.name} {k}", mesh=piece, rgba=rgba, link=mesh.name))
    return tuple(found)
