"""Solid body and parts of a closed shell: panels with thickness, cavities and trays behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Error, Manifold, Mesh64
from scipy.spatial import cKDTree

from articulate.reconstruct.scan.cavity import DEPTH, TRAY_DEPTH, WALL, Built, tray_walls
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

CLEARANCE = 0.15
"""Gap between a panel and the body, in walls."""
PANEL = 0.7
"""Thickness of a panel of which only the outer surface is known, in walls."""
RING = 0.6
"""Least volume of a part with caps, over what is in its convex hull; less is a ring of surface."""
FLAT = 0.15
"""Height above a panel up to which it is flat, in walls; handles are higher."""
FACING = 0.7
"""Least component of a normal to the front of the outer surface of a panel."""
BACK = 0.5
"""Least area of faces that are the inner side of a panel, as a share of its outline."""
NOISE = 0.001
"""Height of noise that is flattened, as a share of the diagonal."""
SLICES, NARROW = 16, 0.35
"""Horizontal sections of a part, and the share of the largest one below which it is a knob."""
MOST_IRREGULAR = 0.01
"""Largest share of corners on edges without two faces of a closed shell: artefacts of welding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Panel:
    """Outline of a panel, along x."""

    outline: Array
    """Corners (N, 2): y and z [m]."""
    back: float
    """Coordinate x of the inner side [m]."""

    def prism(self, gap: float, front: float, back: float | None = None) -> Manifold:
        """Return the outline, larger by ``gap``, from its back or ``back`` to ``front`` [m]."""
        middle = self.outline.mean(axis=0)
        half = np.ptp(self.outline, axis=0) / 2.0
        yz = middle + (self.outline - middle) * np.maximum(1.0 + gap / half, 0.1)
        first = self.back - max(gap, 0.0) if back is None else back
        ends = [np.c_[np.full(len(yz), x), yz] for x in (first, front)]
        return Manifold.hull_points(np.concatenate(ends))


def is_closed(mesh: ScanMesh) -> bool:
    """Return whether the surface of a mesh encloses a volume."""
    return _of_mesh(mesh) is not None


def build_solids(
    mesh: ScanMesh, proposals: Sequence[PartProposal], names: Sequence[str], body: str
) -> Built | None:
    """Return the meshes of body and parts of a closed shell; None if it is not closed.

    A panel is cut out of the shell with a thickness, and the body behind it is hollowed. Other
    parts are closed along their border.

    Args:
        mesh: The object.
        proposals: Its parts, whose faces do not overlap.
        names: Name of each part.
        body: Name of the body.
    """
    rest = _of_mesh(mesh)
    if rest is None:
        return None
    wall, far = WALL * mesh.diagonal, float(mesh.bounds[1, 0]) + mesh.diagonal
    solids: dict[int, list[Manifold]] = {}
    notes = []
    # Small parts first: a knob in the outline of a door is not of the door.
    for k in sorted(range(len(proposals)), key=lambda k: float(_area(mesh, proposals[k]))):
        proposal = proposals[k]
        if proposal.panel is None or not proposal.hollow:
            solid = _closed(mesh, proposal.faces, rest, convex=proposal.kind == "knob")
            solids[k] = _with_knob(solid, wall)
            rest = rest - solid
            continue
        panel = _panel(mesh, proposal, wall)
        surface = proposal.front + FLAT * wall
        ahead = rest ^ panel.prism(CLEARANCE * wall, far, surface)
        handles = [one for one in ahead.decompose() if _reach(one) > surface + wall / 2.0]
        solids[k] = [panel.prism(-CLEARANCE * wall, surface), *handles]
        rest = rest - panel.prism(CLEARANCE * wall, far)
        notes.append(f"{names[k]} was given a thickness")
        deep = DEPTH * (proposal.front - float(mesh.bounds[0, 0]))
        if proposal.front - panel.back + 3.0 * wall > deep:
            continue
        rest = rest - _cavity(proposal, panel, deep, wall)
        notes.append(f"a cavity was built behind {names[k]}")
        if proposal.kind == "drawer":
            walls = tray_walls(replace(proposal, front=panel.back), TRAY_DEPTH * deep, wall)
            solids[k] += [_box(low, high) for low, high in walls]
            notes.append(f"a tray was built behind {names[k]}")
    if rest.is_empty() or any(one.is_empty() for found in solids.values() for one in found):
        return None
    moving = np.concatenate([np.zeros(0, dtype=np.int64), *(p.faces for p in proposals)])
    fixed = np.setdiff1d(np.arange(len(mesh.faces)), moving)
    parts = [_mesh(names[k], solids[k], mesh, proposals[k].faces) for k in range(len(proposals))]
    return Built(body=_mesh(body, [rest], mesh, fixed), parts=tuple(parts), notes=tuple(notes))


def _reach(solid: Manifold) -> float:
    """Return the largest coordinate x of a solid [m]."""
    return float(solid.bounding_box()[3])


def _area(mesh: ScanMesh, proposal: PartProposal) -> float:
    return float(mesh.areas[proposal.faces].sum())


def _panel(mesh: ScanMesh, proposal: PartProposal, wall: float) -> _Panel:
    """Return the outline of a panel's outer surface, and where the panel ends."""
    faces = proposal.faces
    x, normals = mesh.triangles[faces].mean(axis=1)[:, 0], mesh.normals[faces, 0]
    facing, inner = normals > FACING, normals < -FACING
    flat = facing & (np.abs(x - proposal.front) < wall)
    corners = mesh.triangles[faces[flat if flat.any() else facing]].reshape(-1, 3)
    back = proposal.front - PANEL * wall
    if mesh.areas[faces[inner]].sum() > BACK * float(np.prod(np.ptp(corners[:, 1:], axis=0))):
        back = min(back, float(np.median(x[inner])))
    return _Panel(outline=corners[:, 1:], back=back)


def _cavity(proposal: PartProposal, panel: _Panel, deep: float, wall: float) -> Manifold:
    """Return the space behind a panel."""
    assert proposal.panel is not None
    y0, z0, y1, z1 = proposal.panel
    rim = min(wall, 0.2 * (y1 - y0), 0.2 * (z1 - z0))
    low = np.array([proposal.front - deep, y0 + rim, z0 + rim])
    return _box(low, np.array([panel.back, y1 - rim, z1 - rim]))


def _box(low: Array, high: Array) -> Manifold:
    return Manifold.cube((high - low).tolist()).translate(low.tolist())


def _of_mesh(mesh: ScanMesh) -> Manifold | None:
    """Return the mesh as a solid, with a few irregular edges repaired; None if it is open."""
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, which, counts = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    irregular = np.unique(edges[counts[which.ravel()] != 2])
    if len(irregular) > MOST_IRREGULAR * len(mesh.vertices):
        return None
    kept = np.flatnonzero(~np.isin(mesh.faces, irregular).any(axis=1))
    found = _solid(mesh.vertices, mesh.faces)
    return _solid(*_capped(mesh, kept)) if found is None else found


def _solid(vertices: Array, faces: Ints) -> Manifold | None:
    """Return a closed surface as a solid; None if it is not closed."""
    used, corners = np.unique(faces, return_inverse=True)
    solid = Manifold(
        Mesh64(np.ascontiguousarray(vertices[used]), corners.reshape(-1, 3).astype(np.uint64))
    )
    closed = solid.status() == Error.NoError and not solid.is_empty()
    return solid if closed and solid.volume() > 0.0 else None


def _closed(mesh: ScanMesh, faces: Ints, rest: Manifold, *, convex: bool) -> Manifold:
    """Return a part of the surface as a solid: with caps on its borders, or filled.

    A convex part is its convex hull: its surface may have holes.
    """
    hull = Manifold.hull_points(mesh.triangles[faces].reshape(-1, 3))
    if convex:
        return hull
    filled = rest ^ hull
    capped = _solid(*_capped(mesh, faces))
    ring = capped is None or capped.volume() < RING * filled.volume()
    return filled if ring or capped is None else capped


def _with_knob(solid: Manifold, wall: float) -> list[Manifold]:
    """Cut the narrow top off a part, the knob of a lid, so that both are nearly convex."""
    box = solid.bounding_box()
    heights = np.linspace(box[2], box[5], SLICES + 1)[1:-1]
    areas = np.array([solid.slice(float(z)).area() for z in heights])
    if not areas.any():
        return [solid]
    widest = int(np.flatnonzero(areas > NARROW * areas.max())[-1])
    cut = float(heights[widest] + 0.5 * (heights[1] - heights[0]))
    if box[5] - cut < wall / 2.0:
        return [solid]
    return [one for one in solid.split_by_plane((0.0, 0.0, 1.0), cut) if not one.is_empty()]


def _capped(mesh: ScanMesh, faces: Ints) -> tuple[Array, Ints]:
    """Return faces (K,) with each closed border joined to its centre: vertices and faces."""
    corners = mesh.faces[faces]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    count = len(mesh.vertices)
    key = edges[:, 0] * count + edges[:, 1]
    border = edges[~np.isin(key, edges[:, 1] * count + edges[:, 0])]
    after: dict[int, list[int]] = {}
    for start, end in border.tolist():
        after.setdefault(start, []).append(end)
    vertices, caps = [mesh.vertices], []
    while after:
        first = next(iter(after))
        loop = [first]
        while (step := _take(after, loop[-1])) is not None and step != first:
            loop.append(step)
        centre = count + len(vertices) - 1
        vertices.append(mesh.vertices[loop].mean(axis=0, keepdims=True))
        caps += [(b, a, centre) for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
    cap = np.array(caps, dtype=np.int64).reshape(-1, 3)
    return np.concatenate(vertices), np.concatenate([corners, cap])


def _take(after: dict[int, list[int]], vertex: int) -> int | None:
    """Remove and return the end of a border edge that starts at a vertex."""
    ends = after.get(vertex)
    if not ends:
        return None
    end = ends.pop()
    if not ends:
        del after[vertex]
    return end


def _mesh(name: str, solids: Sequence[Manifold], mesh: ScanMesh, faces: Ints) -> PartMesh:
    """Return solids as a part, with the colours of the nearest of some faces (K,)."""
    tolerance = NOISE * mesh.diagonal
    meshes = [solid.simplify(tolerance).to_mesh64() for solid in solids]
    vertices = [np.asarray(m.vert_properties, dtype=np.float64)[:, :3] for m in meshes]
    starts = np.cumsum([0, *map(len, vertices)])
    corners = [
        np.asarray(m.tri_verts, dtype=np.int64) + s for m, s in zip(meshes, starts, strict=False)
    ]
    points, index = np.concatenate(vertices), np.concatenate(corners)
    near = cKDTree(mesh.triangles[faces].mean(axis=1)).query(points[index].mean(axis=1))[1]
    return PartMesh(name=name, vertices=points, faces=index, rgb=mesh.rgb[faces[near]])
