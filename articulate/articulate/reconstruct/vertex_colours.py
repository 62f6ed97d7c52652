"""Colours of corners: a mesh of several colours becomes one group for each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.formats.mesh_file import Group, read_mesh
from articulate.formats.repairs import Repairs

COLOURED = (".glb", ".gltf", ".ply")
"""Formats whose corners may have colours."""
MOST_COLOURS = 32
"""A mesh of more colours keeps the commonest one alone."""


def groups_of(path: Path) -> list[Group]:
    """The groups of a mesh file as :func:`read_mesh` gives them, split by colours of corners.

    Raises:
        AssetError: It cannot be read, or nothing of it has an area.
    """
    groups = read_mesh(path, Repairs())
    if path.suffix.lower() not in COLOURED:
        return groups
    scene = trimesh.load_scene(path)
    split: list[Group] = []
    for name, mesh, colour in groups:
        raw = scene.geometry.get(name)
        colours = None if raw is None else _of_faces(raw)
        if colours is None or len(raw.faces) != len(mesh.faces):
            split.append((name, mesh, colour))
            continue
        kinds, kind_of = np.unique(colours, axis=0, return_inverse=True)
        if not 1 < len(kinds) <= MOST_COLOURS:
            split.append((name, mesh, colour))
            continue
        # Corners of the two may differ; triangles are found again by their middles.
        near = cKDTree(_middles(raw, scene, name))
        kind = kind_of.ravel()[near.query(mesh.triangles_center)[1]]
        for k, rgba in enumerate(kinds):
            part = mesh.submesh([np.flatnonzero(kind == k)], append=True)
            split.append((name, part, tuple(float(c) / 255.0 for c in rgba)))
    return split


def _of_faces(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Colour of each face (F, 4) of a mesh whose corners have colours; else None."""
    if getattr(mesh.visual, "kind", None) != "vertex":
        return None
    colours = np.asarray(mesh.visual.vertex_colors)
    return np.asarray(colours[np.asarray(mesh.faces)[:, 0]])


def _middles(mesh: trimesh.Trimesh, scene: trimesh.Scene, name: str) -> np.ndarray:
    """Middles of triangles where the scene has the mesh (F, 3)."""
    node = next(n for n in scene.graph.nodes_geometry if scene.graph[n][1] == name)
    return np.asarray(
        trimesh.transform_points(mesh.triangles_center, scene.graph[node][0]), dtype=np.float64
    )
