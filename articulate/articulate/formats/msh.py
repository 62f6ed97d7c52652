"""MuJoCo's old binary mesh format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

HEADER = 4
"""Counts of vertices, normals, texture coordinates and faces, each a little-endian int32."""


def read_msh(path: Path) -> trimesh.Trimesh:
    """The triangles of an ``.msh`` file; the convex hull of its vertices where it has none.

    After the header stand vertices (3 float32 each), normals (3), texture coordinates (2) and
    faces (3 int32).

    Raises:
        ValueError: The counts do not agree with the size of the file, or with each other.
    """
    content = path.read_bytes()
    if len(content) < 4 * HEADER:
        raise ValueError("too short for an .msh header")
    vertices, normals, coordinates, faces = np.frombuffer(content, "<i4", HEADER).tolist()
    size = 4 * (HEADER + 3 * vertices + 3 * normals + 2 * coordinates + 3 * faces)
    if min(vertices, normals, coordinates, faces) < 0 or size != len(content):
        raise ValueError(f"the header speaks of {size} bytes, the file has {len(content)}")
    corners = np.frombuffer(content, "<f4", 3 * vertices, 4 * HEADER).astype(np.float64)
    index = np.frombuffer(content, "<i4", 3 * faces, size - 12 * faces).astype(np.int64)
    if faces and not 0 <= index.min() <= index.max() < vertices:
        raise ValueError("a face names a vertex that does not exist")
    if not faces:
        return trimesh.PointCloud(corners.reshape(-1, 3)).convex_hull
    return trimesh.Trimesh(corners.reshape(-1, 3), index.reshape(-1, 3), process=False)
