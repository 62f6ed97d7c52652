"""Vertex colours: split a mesh with several colours into one group for each colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.formats.mesh_file import Group, load_scene, read_mesh
from articulate.formats.repairs import Repairs

COLOURED = (".glb", ".gltf", ".ply")
"""Formats with vertex colours."""
MOST_COLOURS = 32
"""A mesh with more colours keeps only the most frequent one."""


def groups_of(path: Path) -> list[Group]:
    """Read the groups of a mesh file as :func:`read_mesh` does, split by vertex colours.

    Raises:
        AssetError: The file cannot be read, or its mesh has no area.
    """
    groups = read_mesh(path, Repairs())
    if path.suffix.lower() not in COLOURED:
        return groups
    scene = load_scene(path)
    split: list[Group] = []
    for name, mesh, colour in groups:
        raw = scene.geometry.get(name)
        colours = None if raw is None else _face_colours(raw)
        if colours is None or len(raw.faces) != len(mesh.faces):
            split.append((name, mesh, colour))
            continue
        kinds, kind_of = np.unique(colours, axis=0, return_inverse=True)
        if not 1 < len(kinds) <= MOST_COLOURS:
            split.append((name, mesh, colour))
            continue
        # Vertices of the two meshes may differ; triangles are matched by their centres.
        near = cKDTree(_centres(raw, scene, name))
        kind = kind_of.ravel()[near.query(mesh.triangles_center)[1]]
        for k, rgba in enumerate(kinds):
            part = mesh.submesh([np.flatnonzero(kind == k)], append=True)
            split.append((name, part, tuple(float(c) / 255.0 for c in rgba)))
    return split


def _face_colours(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Return the colour of each face (F, 4); None without vertex colours."""
    if getattr(mesh.visual, "kind", None) != "vertex":
        return None
    colours = np.asarray(mesh.visual.vertex_colors)
    return np.asarray(colours[np.asarray(mesh.faces)[:, 0]])


def _centres(mesh: trimesh.Trimesh, scene: trimesh.Scene, name: str) -> np.ndarray:
    """Compute the centres of the triangles in the frame of the scene (F, 3)."""
    node = next(n for n in scene.graph.nodes_geometry if scene.graph[n][1] == name)
    return np.asarray(
        trimesh.transform_points(mesh.triangles_center, scene.graph[node][0]), dtype=np.float64
    )
