"""Visual and collision geometry of an asset as compact triangles for a page.

Geometry comes from the compiled model, so that a page shows the hulls that the engine uses and
not the files that they were made of.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import trimesh

from articulate.checks.model import Data, ObjectModel
from articulate.simulator import mujoco
from articulate.transforms import Array, Ints, apply, inverse, pose

Layer = Literal["visual", "collision"]
Rgba = tuple[float, float, float, float]

MOST_TRIANGLES: dict[Layer, int] = {"visual": 60_000, "collision": 30_000}
"""Triangles of a page at most; finer geometry is made coarser until it fits."""
PALETTE = ((0.96, 0.62, 0.22), (0.30, 0.66, 0.93), (0.47, 0.78, 0.36), (0.93, 0.45, 0.60),
           (0.68, 0.56, 0.93), (0.27, 0.78, 0.72))  # fmt: skip
"""Colours of collision shapes, in turn, so that neighbours are distinguishable."""
SEE_THROUGH = 0.5
"""Opacity of a collision shape."""
STEPS = 65535
"""Steps into which a mesh's box is divided along each axis: 15 micrometres of a metre."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """Triangles of one colour that belong to one link, every joint at 0."""

    link: str
    layer: Layer
    rgba: Rgba
    vertices_o: Array
    """Corners (V, 3) [m]."""
    faces: Ints
    """Corners of each triangle (F, 3)."""

    def content(self) -> dict[str, Any]:
        """Return the surface as JSON: positions in 16 bits each over its box, in base64."""
        low = self.vertices_o.min(axis=0)
        step = np.maximum(self.vertices_o.max(axis=0) - low, 1e-9) / STEPS
        grid = np.round((self.vertices_o - low) / step).astype("<u2")
        _, first, index = np.unique(
            _keys(grid.astype(np.int64)), return_index=True, return_inverse=True
        )
        grid, faces = grid[first], index[self.faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        wide = len(grid) > STEPS + 1
        return {
            "link": self.link,
            "layer": self.layer,
            "rgba": [round(c, 4) for c in self.rgba],
            "low": low.tolist(),
            "step": step.tolist(),
            "wide": wide,
            "vertices": _base64(grid),
            "faces": _base64(faces.astype("<u4" if wide else "<u2")),
        }


def surfaces_of(subject: ObjectModel, most: dict[Layer, int] | None = None) -> tuple[Surface, ...]:
    """Visual and collision surfaces of the asset, by link and colour.

    Args:
        subject: The asset and its model.
        most: Triangles of each layer at most; :data:`MOST_TRIANGLES` by default.
    """
    data = mujoco.MjData(subject.model)  # every joint at 0, as the asset's own frames are given
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(subject.model, data)
    limits = most or MOST_TRIANGLES
    found = [
        *_fitting(_visual(subject, data), limits["visual"]),
        *_fitting(_collision(subject, data), limits["collision"]),
    ]
    return tuple(surface for surface in found if len(surface.faces))


def _visual(subject: ObjectModel, data: Data) -> list[Surface]:
    return _layer(
        subject, data, "visual", subject.visual_geoms, lambda geom, _: colour(subject.model, geom)
    )


def _collision(subject: ObjectModel, data: Data) -> list[Surface]:
    return _layer(
        subject,
        data,
        "collision",
        subject.collision_geoms,
        lambda _, k: (*PALETTE[k % len(PALETTE)], SEE_THROUGH),
    )


def _layer(
    subject: ObjectModel,
    data: Data,
    layer: Layer,
    geoms_of: Callable[[str], Ints],
    colour_of: Callable[[int, int], Rgba],
) -> list[Surface]:
    """Surfaces of a layer, those of equal link and colour joined."""
    groups: dict[tuple[str, Rgba], list[tuple[Array, Ints]]] = {}
    root = subject.bodies[subject.root]
    T_ow = inverse(pose(data.xpos[root], np.reshape(data.xmat[root], (3, 3))))
    count = 0
    for link in subject.asset.links:
        for geom in geoms_of(link.name):
            triangles = triangles_of(subject.model, int(geom), layer)
            if triangles is None:
                continue
            T_wg = pose(data.geom_xpos[geom], np.reshape(data.geom_xmat[geom], (3, 3)))
            key = (link.name, colour_of(int(geom), count))
            groups.setdefault(key, []).append((apply(T_ow @ T_wg, triangles[0]), triangles[1]))
            count += 1
    return [
        _joined(link, layer, rgba, members) for (link, rgba), members in groups.items() if members
    ]


def _joined(link: str, layer: Layer, rgba: Rgba, members: list[tuple[Array, Ints]]) -> Surface:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in members)])
    faces = [f + start for (_, f), start in zip(members, starts, strict=False)]
    return Surface(
        link=link,
        layer=layer,
        rgba=rgba,
        vertices_o=np.concatenate([vertices for vertices, _ in members]),
        faces=np.concatenate(faces),
    )


def triangles_of(model: Any, geom: int, layer: Layer) -> tuple[Array, Ints] | None:
    """Corners (V, 3) in the geom's own frame [m] and triangles (F, 3); None for a plane."""
    kind = int(model.geom_type[geom])
    size = np.asarray(model.geom_size[geom], dtype=np.float64)
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        return _mesh(model, int(model.geom_dataid[geom]), hull=layer == "collision")
    if kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        mesh = trimesh.creation.box(extents=2.0 * size)
    elif kind == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
        mesh = trimesh.creation.cylinder(radius=size[0], height=2.0 * size[1], sections=40)
    elif kind == int(mujoco.mjtGeom.mjGEOM_CAPSULE):
        mesh = trimesh.creation.capsule(radius=size[0], height=2.0 * size[1], count=[24, 24])
    elif kind == int(mujoco.mjtGeom.mjGEOM_SPHERE):
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    elif kind == int(mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        mesh = trimesh.creation.icosphere(subdivisions=3)
        mesh.apply_transform(np.diag([*size, 1.0]))
    else:
        return None
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def _mesh(model: Any, mesh: int, *, hull: bool) -> tuple[Array, Ints]:
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = np.array(model.mesh_vert[start : start + count], dtype=np.float64)
    graph = int(model.mesh_graphadr[mesh])
    if hull and graph >= 0:  # what the engine collides: MuJoCo's own convex hull of the mesh
        n_vertices, n_faces = (int(n) for n in model.mesh_graph[graph : graph + 2])
        first = graph + 2 + 3 * n_vertices + 3 * n_faces
        faces = model.mesh_graph[first : first + 3 * n_faces]
    else:
        begin, n_faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = model.mesh_face[begin : begin + n_faces]
    used, index = np.unique(np.asarray(faces, dtype=np.int64).reshape(-1), return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int64)


def colour(model: Any, geom: int) -> Rgba:
    """Colour of a geom: its own, or its material's times the mean of the texture."""
    material = int(model.geom_matid[geom])
    if material < 0:
        return _rgba(model.geom_rgba[geom])
    rgba = np.array(model.mat_rgba[material], dtype=np.float64)
    roles = np.atleast_1d(model.mat_texid[material])
    textures = [int(t) for t in roles if t >= 0]
    if textures:
        texture = textures[0]
        channels = int(model.tex_nchannel[texture])
        pixels = int(model.tex_width[texture]) * int(model.tex_height[texture])
        start = int(model.tex_adr[texture])
        values = np.asarray(model.tex_data[start : start + pixels * channels], dtype=np.float64)
        rgba[:3] *= values.reshape(pixels, channels).mean(axis=0)[:3] / 255.0
    return _rgba(rgba)


def _rgba(values: Sequence[float] | Array) -> Rgba:
    r, g, b, a = (round(float(v), 4) for v in values)
    return r, g, b, a


def _fitting(surfaces: list[Surface], most: int) -> list[Surface]:
    """Make the surfaces equally coarse, so that they have at most ``most`` triangles together."""
    if sum(len(s.faces) for s in surfaces) <= most:
        return surfaces
    points = np.concatenate([s.vertices_o for s in surfaces])
    size = float((points.max(axis=0) - points.min(axis=0)).max())
    finest, coarsest = size / 4096.0, size
    for _ in range(10):
        middle = float(np.sqrt(finest * coarsest))
        if sum(len(_coarser(s, middle).faces) for s in surfaces) > most:
            finest = middle
        else:
            coarsest = middle
    return [_coarser(s, coarsest) for s in surfaces]


def _coarser(surface: Surface, cell_m: float) -> Surface:
    """Merge the corners of the surface in each cell of a grid into their mean.

    J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex scenes",
    1993: crude, but it never fails and takes any triangles.
    """
    cells = np.floor((surface.vertices_o - surface.vertices_o.min(axis=0)) / cell_m)
    _, index, counts = np.unique(
        _keys(cells.astype(np.int64)), return_inverse=True, return_counts=True
    )
    means = np.zeros((len(counts), 3))
    np.add.at(means, index, surface.vertices_o)
    faces = index[surface.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _, first = np.unique(_keys(np.sort(faces, axis=1)), return_index=True)
    return Surface(
        link=surface.link,
        layer=surface.layer,
        rgba=surface.rgba,
        vertices_o=means / counts[:, None],
        faces=faces[np.sort(first)].astype(np.int64),
    )


def _keys(rows: Ints) -> Ints:
    """One number for each row of three numbers below 2**21: equal where the rows are."""
    return (rows[:, 0] << 42) | (rows[:, 1] << 21) | rows[:, 2]


def _base64(values: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
