"""Cavities behind doors and trays behind drawer fronts, for surfaces without an interior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from articulate.reconstruct.scan.front_view import front_view
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

WALL = 0.012
"""Thickness of walls, as a share of the diagonal of the object."""
SHALLOW = 0.2
"""A surface nearer behind a panel than this share of the depth closes the body."""
DEPTH = 0.85
"""Depth of a cavity, as a share of the depth of the object behind the panel."""
TRAY_DEPTH = 0.9
"""Depth of a tray, as a share of that of its cavity."""
SIDES = 2.5
"""Gap between a tray and the outline of its front, in walls."""
SHEET = 0.5
"""A panel thinner than this, in walls, is a sheet and gets a back."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Built:
    """Meshes of the body and of each part, with what was added to them."""

    body: PartMesh
    parts: tuple[PartMesh, ...]
    notes: tuple[str, ...]


def build_parts(
    mesh: ScanMesh, proposals: Sequence[PartProposal], names: Sequence[str], body: str
) -> Built:
    """Return the meshes of body and parts; hollow the body behind fronts and add trays.

    Args:
        mesh: The object.
        proposals: Its parts, whose faces do not overlap.
        names: Name of each part.
        body: Name of the body.
    """
    moving = np.zeros(len(mesh.faces), dtype=bool)
    for proposal in proposals:
        moving[proposal.faces] = True
    rest = np.flatnonzero(~moving)
    parts = [mesh.part(name, p.faces) for name, p in zip(names, proposals, strict=True)]
    body_mesh = mesh.part(body, rest)
    notes = []
    for k, proposal in enumerate(proposals):
        if proposal.panel is None or not proposal.hollow or proposal.kind == "lid":
            continue
        depth = _closed_depth(mesh, rest, proposal)
        back = float(mesh.bounds[0, 0])
        wall = WALL * mesh.diagonal
        if proposal.front - back < 4.0 * wall:
            continue
        deep = DEPTH * (proposal.front - back)
        if depth is not None:
            body_mesh = _with(_cut(body_mesh, proposal, depth, wall), _cavity(proposal, deep, wall))
            notes.append(f"a cavity was built behind {names[k]}")
        if np.ptp(parts[k].vertices[:, 0]) < SHEET * wall:
            parts[k] = _with(parts[k], [_backing(proposal, wall)])
            notes.append(f"{names[k]} was thickened")
        if proposal.kind == "drawer":
            parts[k] = _with(parts[k], tray_walls(proposal, TRAY_DEPTH * deep, wall))
            notes.append(f"a tray was built behind {names[k]}")
    return Built(body=body_mesh, parts=tuple(parts), notes=tuple(notes))


def _closed_depth(mesh: ScanMesh, rest: Ints, proposal: PartProposal) -> float | None:
    """Return x of the body's surface right behind a panel [m]; None if the body is open."""
    assert proposal.panel is not None
    view = front_view(mesh.select(rest), 160)
    y0, z0, y1, z1 = proposal.panel
    margin = 0.15 * np.array([y1 - y0, z1 - z0])
    inner = np.array([y0 + margin[0], z0 + margin[1], y1 - margin[0], z1 - margin[1]])
    depth = view.depth[view.window(inner)]
    shallow = depth > proposal.front - SHALLOW * mesh.size[0]
    shallow &= depth < proposal.front + 0.01 * mesh.diagonal
    if not depth.size or shallow.mean() < 0.6:
        return None
    return float(np.median(depth[shallow]))


def _cut(body: PartMesh, proposal: PartProposal, depth: float, wall: float) -> PartMesh:
    """Return the body without the faces that close it behind a panel."""
    assert proposal.panel is not None
    y0, z0, y1, z1 = proposal.panel
    corners = body.vertices[body.faces]
    low = np.array([depth - 2.0 * wall, y0 + wall, z0 + wall])
    high = np.array([proposal.front + wall, y1 - wall, z1 - wall])
    near = (corners.max(axis=1)[:, 0] < high[0]) & (corners.min(axis=1)[:, 0] > low[0])
    near &= (corners.min(axis=1)[:, 1:] < high[1:]).all(axis=1)
    near &= (corners.max(axis=1)[:, 1:] > low[1:]).all(axis=1)
    kept = [_part_of(body, np.flatnonzero(~near))]
    piece = _part_of(body, np.flatnonzero(near))
    # The rest around the opening is kept: cut along its four sides, one after the other.
    planes = [
        (np.array([0.0, low[1], 0.0]), np.array([0.0, -1.0, 0.0])),
        (np.array([0.0, high[1], 0.0]), np.array([0.0, 1.0, 0.0])),
        (np.array([0.0, 0.0, low[2]]), np.array([0.0, 0.0, -1.0])),
        (np.array([0.0, 0.0, high[2]]), np.array([0.0, 0.0, 1.0])),
    ]
    for origin, normal in planes:
        if not len(piece.faces):
            break
        kept.append(_sliced(piece, origin, normal))
        piece = _sliced(piece, origin, -normal)
    return _joined(body.name, kept)


def _sliced(part: PartMesh, origin: Array, normal: Array) -> PartMesh:
    """Return the part of a mesh on the positive side of a plane, in its mean colour."""
    if not len(part.faces):
        return part
    cut = trimesh.intersections.slice_mesh_plane(
        trimesh.Trimesh(part.vertices, part.faces, process=False), normal, origin
    )
    faces = np.asarray(cut.faces, dtype=np.int64).reshape(-1, 3)
    rgb = np.tile(part.rgb.mean(axis=0), (len(faces), 1))
    vertices = np.asarray(cut.vertices, dtype=np.float64).reshape(-1, 3)
    return PartMesh(name=part.name, vertices=vertices, faces=faces, rgb=rgb)


def _part_of(part: PartMesh, faces: Ints) -> PartMesh:
    return PartMesh(
        name=part.name, vertices=part.vertices, faces=part.faces[faces], rgb=part.rgb[faces]
    )


def _joined(name: str, parts: Sequence[PartMesh]) -> PartMesh:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=False)])
    vertices = np.concatenate([part.vertices for part in parts])
    used, corners = np.unique(faces, return_inverse=True)
    return PartMesh(
        name=name,
        vertices=vertices[used],
        faces=corners.reshape(-1, 3).astype(np.int64),
        rgb=np.concatenate([part.rgb for part in parts]),
    )


def _with(part: PartMesh, boxes: Sequence[Array]) -> PartMesh:
    """Return a part with solid boxes (2, 3) added, in its mean colour."""
    colour = part.rgb.mean(axis=0)
    found = [part]
    for low, high in boxes:
        box = trimesh.creation.box(bounds=np.stack([low, high]))
        found.append(
            PartMesh(
                name=part.name,
                vertices=np.asarray(box.vertices, dtype=np.float64),
                faces=np.asarray(box.faces, dtype=np.int64),
                rgb=np.tile(colour, (len(box.faces), 1)),
            )
        )
    return _joined(part.name, found)


def _five_sides(low: Array, high: Array, wall: float, *, ceiling: bool) -> list[Array]:
    """Return the walls of a box that is open at +x, and with ``ceiling=False`` at the top."""
    found = [
        np.array([[low[0], low[1], low[2]], [low[0] + wall, high[1], high[2]]]),
        np.array([[low[0], low[1], low[2]], [high[0], low[1] + wall, high[2]]]),
        np.array([[low[0], high[1] - wall, low[2]], [high[0], high[1], high[2]]]),
        np.array([[low[0], low[1], low[2]], [high[0], high[1], low[2] + wall]]),
    ]
    if ceiling:
        found.append(np.array([[low[0], low[1], high[2] - wall], [high[0], high[1], high[2]]]))
    return found


def _cavity(proposal: PartProposal, depth: float, wall: float) -> list[Array]:
    """Return the walls of a cavity behind a panel."""
    assert proposal.panel is not None
    y0, z0, y1, z1 = proposal.panel
    high = np.array([proposal.front - 2.0 * wall, y1 - 0.2 * wall, z1 - 0.2 * wall])
    low = np.array([proposal.front - depth, y0 + 0.2 * wall, z0 + 0.2 * wall])
    return _five_sides(low, high, 0.8 * wall, ceiling=True)


def tray_walls(proposal: PartProposal, depth: float, wall: float) -> list[Array]:
    """Return the walls of a tray behind a front."""
    assert proposal.panel is not None
    y0, z0, y1, z1 = proposal.panel
    gap = min(SIDES * wall, 0.2 * (y1 - y0), 0.2 * (z1 - z0))
    high = np.array([proposal.front - 0.1 * wall, y1 - gap, z1 - 2.0 * gap])
    low = np.array([proposal.front - depth, y0 + gap, z0 + gap])
    thin = min(0.8 * wall, 0.25 * float((high - low)[1:].min()))
    return _five_sides(low, high, thin, ceiling=False)


def _backing(proposal: PartProposal, wall: float) -> Array:
    """Return the solid box of a panel that is a sheet."""
    assert proposal.panel is not None
    y0, z0, y1, z1 = proposal.panel
    inset = 0.1 * wall
    return np.array(
        [
            [proposal.front - wall, y0 + inset, z0 + inset],
            [proposal.front, y1 - inset, z1 - inset],
        ]
    )
