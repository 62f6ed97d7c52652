"""Groups of a mesh file by part and colour.

A mesh with several materials is one part: glTF has a primitive for each material, and an OBJ object
is split by its materials. A mesh that several nodes place is several parts.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.errors import AssetError
from articulate.formats.mesh_file import MAX_BYTES, Group, load_scene, read_mesh
from articulate.formats.repairs import Repairs
from articulate.reconstruct.actors.semantic.ontology import BODIES, ROLES, words_of
from articulate.untrusted import read_bounded

COLOURED = (".glb", ".gltf", ".ply")
"""Formats with vertex colours."""
MOST_COLOURS = 32
"""A mesh with more colours keeps only the most frequent one."""
PRIMITIVES = frozenset({"sphere", "disc"})
"""Words for parts that are default names of shapes as well."""


def groups_of(path: Path) -> list[Group]:
    """Read the groups of a mesh file by part and colour, each with the name of its part.

    Raises:
        AssetError: The file cannot be read, or its mesh has no area.
    """
    groups = read_mesh(path, Repairs())
    suffix = path.suffix.lower()
    if suffix == ".obj":
        names = _without_materials([name for name, _, _ in groups], path)
        return [(name, *group[1:]) for name, group in zip(names, groups, strict=True)]
    if suffix not in COLOURED:
        return groups
    scene = load_scene(path)
    split: list[Group] = []
    for part, (name, mesh, colour) in zip(_part_names(scene, groups), groups, strict=True):
        split += _by_colour(scene, name, (part, mesh, colour))
    return split


def _part_names(scene: trimesh.Scene, groups: Sequence[Group]) -> list[str]:
    """Return a name for each group, equal for the geometries of one node.

    Args:
        scene: Scene of the file.
        groups: Groups by the names of their geometries, in the order of the scene's nodes.
    """
    graph = scene.graph
    owners: dict[str, list[str]] = defaultdict(list)  # nodes that have each geometry
    meshes: dict[str, set[str]] = defaultdict(set)  # geometries of each node's mesh
    for node in graph.nodes_geometry:
        name = str(graph[node][1])
        several = scene.geometry[name].metadata.get("from_gltf_primitive", False)
        owner = str(graph.transforms.parents[node]) if several else str(node)
        owners[name].append(owner)
        meshes[owner].add(name)
    used: dict[str, int] = defaultdict(int)
    name_of: dict[str, str] = {}
    labels: set[str] = set()
    number: dict[str, int] = defaultdict(int)  # parts with each name so far
    names = []
    for name, _, _ in groups:
        nodes = owners.get(name, [name])
        owner = nodes[min(used[name], len(nodes) - 1)]
        used[name] += 1
        if owner not in name_of:
            mesh = min(meshes.get(owner, {name}), key=lambda one: (len(one), one))
            stem = _mesh_or_node(mesh, owner)
            number[stem] += 1
            label = stem if number[stem] == 1 else f"{stem} {number[stem]}"
            while label in labels:
                number[stem] += 1
                label = f"{stem} {number[stem]}"
            labels.add(label)
            name_of[owner] = label
        names.append(name_of[owner])
    return names


def _mesh_or_node(mesh: str, node: str) -> str:
    """Return the name of a mesh or of its node: the one with a word for a part."""
    words = {*words_of(mesh)} - PRIMITIVES, {*words_of(node)} - PRIMITIVES
    in_mesh, in_node = (any(word in ROLES or word in BODIES for word in own) for own in words)
    return node if in_node and not in_mesh else mesh


def _without_materials(names: Sequence[str], path: Path) -> list[str]:
    """Return the names of an OBJ's objects and groups without those of their materials."""
    lines = re.findall(
        rb"^usemtl[ \t]+(\S.*)", read_bounded(path, MAX_BYTES, error=AssetError), re.MULTILINE
    )
    materials = {line.decode("utf-8", "replace").strip() for line in lines}
    ends = sorted((f"_{material}" for material in materials), key=len, reverse=True)
    return [next((n.removesuffix(e) for e in ends if n.endswith(e) and n != e), n) for n in names]


def _by_colour(scene: trimesh.Scene, name: str, group: Group) -> list[Group]:
    """Split the group of a geometry by its vertex colours."""
    part, mesh, _ = group
    raw = scene.geometry.get(name)
    colours = None if raw is None else _face_colours(raw)
    if colours is None or len(raw.faces) != len(mesh.faces):
        return [group]
    kinds, kind_of = np.unique(colours, axis=0, return_inverse=True)
    if not 1 < len(kinds) <= MOST_COLOURS:
        return [group]
    # Vertices of the two meshes may differ; triangles are matched by their centres.
    near = cKDTree(_centres(raw, scene, name))
    kind = kind_of.ravel()[near.query(mesh.triangles_center)[1]]
    split: list[Group] = []
    for k, rgba in enumerate(kinds):
        piece = mesh.submesh([np.flatnonzero(kind == k)], append=True)
        split.append((part, piece, tuple(float(c) / 255.0 for c in rgba)))
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
