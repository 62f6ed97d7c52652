"""Closed shells as from a scanner: depth images of an object, fused to one watertight surface."""

from __future__ import annotations

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.scan.front_view import front_view
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, Ints

CELLS = 110
"""Cells along the longest side of the grid."""
VIEW_PX = 256
NOISE = 0.0007
"""Standard deviation of the depth, as a share of the diagonal."""
TRUNCATION = 3.0
"""Largest distance in the field, in cells."""


def fused_shell(mesh: ScanMesh, seed: int = 0) -> ScanMesh:
    """Return the surface that is visible from 14 directions as one closed mesh.

    Args:
        mesh: Merged object.
        seed: Seed of the noise.
    """
    low, high = mesh.bounds
    cell = float((high - low).max()) / CELLS
    low, high = low - 3.0 * cell, high + 3.0 * cell
    counts = np.ceil((high - low) / cell).astype(np.int64) + 1
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1)
    points = low + cell * index.reshape(-1, 3)
    outside = np.full(len(points), -np.inf)
    rng = np.random.default_rng(seed)
    for rotation in _rotations():
        view = front_view(mesh.transformed(rotation, 1.0, np.zeros(3)), VIEW_PX)
        noise = rng.normal(0.0, NOISE * mesh.diagonal, view.depth.shape)
        turned = points @ rotation.T
        column = np.floor((turned[:, 1] - view.origin[0]) / view.pixel).astype(np.int64)
        row = np.floor((view.origin[1] - turned[:, 2]) / view.pixel).astype(np.int64)
        inside = (column >= 0) & (column < view.depth.shape[1]) & (row >= 0)
        inside &= row < view.depth.shape[0]
        depth = np.full(len(points), -np.inf)
        depth[inside] = (view.depth + noise)[row[inside], column[inside]]
        outside = np.maximum(outside, np.clip(turned[:, 0] - depth, -9.0 * cell, 9.0 * cell))
    field = np.clip(-outside, -TRUNCATION * cell, TRUNCATION * cell).reshape(counts)
    return _surface(field, low, cell, high)


def _rotations() -> list[Array]:
    """Return rotations that turn each direction of view to +x."""
    found = []
    for direction in np.array(
        [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
        + [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (0.6, -0.3)],
        dtype=np.float64,
    ):
        x = direction / np.linalg.norm(direction)
        up = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        y = np.cross(up, x)
        y /= np.linalg.norm(y)
        found.append(np.stack([x, y, np.cross(x, y)]))
    return found


def _surface(field: Array, low: Array, cell: float, high: Array) -> ScanMesh:
    """Return the zero level of a field on a grid, positive inside."""
    values = field.tolist()
    last = [n - 2 for n in field.shape]
    x0, y0, z0 = (float(value) for value in low)

    def value(x: float, y: float, z: float) -> float:
        u, v, w = (x - x0) / cell, (y - y0) / cell, (z - z0) / cell
        i, j, k = (min(max(int(a), 0), n) for a, n in zip((u, v, w), last, strict=True))
        u, v, w = u - i, v - j, w - k
        a, b = values[i], values[i + 1]
        near = (a[j][k] * (1 - w) + a[j][k + 1] * w) * (1 - v)
        near += (a[j + 1][k] * (1 - w) + a[j + 1][k + 1] * w) * v
        far = (b[j][k] * (1 - w) + b[j][k + 1] * w) * (1 - v)
        far += (b[j + 1][k] * (1 - w) + b[j + 1][k + 1] * w) * v
        return float(near * (1 - u) + far * u)

    bounds = [*low.tolist(), *high.tolist()]
    found = manifold3d.Manifold.level_set(value, bounds, 1.2 * cell).to_mesh()
    faces = np.asarray(found.tri_verts, dtype=np.int64)
    return ScanMesh(
        vertices=np.asarray(found.vert_properties, dtype=np.float64)[:, :3],
        faces=faces,
        rgb=np.full((len(faces), 3), 0.7),
        group=np.zeros(len(faces), dtype=np.int64),
    )


def nearest_part(shell: ScanMesh, mesh: ScanMesh, part: Ints) -> Ints:
    """Return the part of the nearest surface of the object for each face of a shell (F,)."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(mesh.faces), size=200_000, p=mesh.areas / mesh.areas.sum())
    weights = rng.dirichlet(np.ones(3), size=len(chosen))
    points = np.einsum("ni,nij->nj", weights, mesh.triangles[chosen])
    near = np.asarray(cKDTree(points).query(shell.triangles.mean(axis=1))[1])
    return np.asarray(part[chosen[near]])
