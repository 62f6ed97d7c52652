"""Merged meshes of simple objects with known parts, z up, the front at +x."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh

from articulate.reconstruct.scan.scan_mesh import ScanMesh, weld

TO_Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def box(low, high):
    return trimesh.creation.box(bounds=np.array([low, high], dtype=float))


def carcass(width=0.8, height=0.9, depth=0.5, wall=0.02):
    """Five boards that are open to the front."""
    w, h, d = width / 2, height, depth
    return [
        box((0, -w, 0), (wall, w, h)),
        box((0, -w, 0), (d, -w + wall, h)),
        box((0, w - wall, 0), (d, w, h)),
        box((0, -w, 0), (d, w, wall)),
        box((0, -w, h - wall), (d, w, h)),
    ]


def double_doors():
    """Two doors with upright handles in the middle of the front."""
    doors = []
    for sign in (-1, 1):
        y = sorted((sign * 0.002, sign * 0.398))
        board = box((0.5, y[0], 0.02), (0.52, y[1], 0.88))
        handle = box((0.52, sign * 0.05 - 0.01, 0.4), (0.55, sign * 0.05 + 0.01, 0.55))
        doors.append([board, handle])
    return carcass(), doors


def room_door(*handle):
    """A board of 0.8 by 2 m in a frame, with the boxes of a handle as its second part."""
    posts = [box((0, y, 0), (0.1, y + 0.04, 2.05)) for y in (-0.44, 0.4)]
    top = box((0, -0.4, 2.01), (0.1, 0.4, 2.05))
    board = box((0.03, -0.398, 0.005), (0.07, 0.398, 2.0))
    return [*posts, top], [[board], [box(*corners) for corners in handle]]


def plain_boards(*rects):
    """Boards without handles over the front, each from (y0, z0) to (y1, z1)."""
    return carcass(), [[box((0.5, y0, z0), (0.52, y1, z1))] for y0, z0, y1, z1 in rects]


def chest_of_drawers(count=3):
    """Drawers with trays, one above the other."""
    drawers = []
    for k in range(count):
        z0, z1 = 0.02 + k * 0.29, 0.29 + k * 0.29
        front = box((0.5, -0.38, z0), (0.52, 0.38, z1))
        handle = box((0.52, -0.08, z0 + 0.12), (0.55, 0.08, z0 + 0.14))
        low, high = (0.05, -0.34, z0 + 0.03), (0.5, 0.34, z1 - 0.06)
        tray = [
            box(low, (high[0], high[1], low[2] + 0.01)),
            box(low, (low[0] + 0.01, high[1], high[2])),
            box(low, (high[0], low[1] + 0.01, high[2])),
            box((low[0], high[1] - 0.01, low[2]), high),
        ]
        drawers.append([front, handle, *tray])
    return carcass(), drawers


def laptop():
    base = box((-0.12, -0.17, 0.0), (0.12, 0.17, 0.02))
    screen = trimesh.creation.box((0.24, 0.34, 0.01))
    screen.apply_translation((0.12, 0, 0))
    screen.apply_transform(trimesh.transformations.rotation_matrix(np.radians(-110), (0, 1, 0)))
    screen.apply_translation((-0.12, 0, 0.03))
    return [base], [[screen]]


def bucket():
    body = trimesh.creation.annulus(r_min=0.14, r_max=0.15, height=0.3, sections=48)
    body.apply_translation((0, 0, 0.15))
    bottom = trimesh.creation.cylinder(0.14, 0.01, sections=48)
    bottom.apply_translation((0, 0, 0.005))
    angle = np.linspace(0, np.pi, 13)
    arc = np.stack([0 * angle, 0.16 * np.cos(angle), 0.27 + 0.16 * np.sin(angle)], axis=1)
    bail = trimesh.util.concatenate(
        [trimesh.creation.cylinder(0.005, segment=s) for s in pairwise(arc)]
    )
    return [body, bottom], [[bail]]


def folded_bucket():
    """A bucket whose bail is folded down to the front, around its rim."""
    fixed, [[bail]] = bucket()
    bail.apply_translation((0, 0, -0.27))
    bail.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0)))
    bail.apply_translation((0.01, 0, 0.27))
    return fixed, [[bail]]


def side_lever_faucet():
    """A column with a high spout, and a lever on a hub at its side."""
    column = trimesh.creation.cylinder(0.02, segment=[(0, 0, 0), (0, 0, 0.1)], sections=32)
    arc = [(0, 0, 0.1), (0, 0, 0.2), (0.1, 0, 0.24), (0.16, 0, 0.2), (0.16, 0, 0.15)]
    spout = [trimesh.creation.cylinder(0.01, segment=s) for s in pairwise(arc)]
    hub = trimesh.creation.cylinder(0.012, segment=[(0, 0.021, 0.06), (0, 0.045, 0.06)])
    lever = trimesh.creation.cylinder(0.005, segment=[(0, 0.04, 0.06), (0, 0.04, 0.14)])
    return [column, *spout], [[hub, lever]]


def box_of_boards():
    """A closed box of a bottom and four walls, with a deep lid."""
    walls = [
        box((-0.3, -0.4, 0.01), (-0.28, 0.4, 0.5)),
        box((0.28, -0.4, 0.01), (0.3, 0.4, 0.5)),
        box((-0.279, -0.4, 0.01), (0.279, -0.38, 0.5)),
        box((-0.279, 0.38, 0.01), (0.279, 0.4, 0.5)),
    ]
    return [box((-0.3, -0.4, 0), (0.3, 0.4, 0.009)), *walls], [
        [box((-0.31, -0.41, 0.505), (0.31, 0.41, 0.6))]
    ]


def faucet():
    """A column with a spout to the front and a lever on top."""
    column = trimesh.creation.cylinder(0.02, segment=[(0, 0, 0), (0, 0, 0.15)], sections=32)
    spout = trimesh.creation.cylinder(0.01, segment=[(0.02, 0, 0.06), (0.18, 0, 0.08)])
    cap = trimesh.creation.cylinder(0.02, segment=[(0, 0, 0.152), (0, 0, 0.18)], sections=32)
    lever = trimesh.creation.cylinder(0.005, segment=[(0, 0, 0.17), (0.08, 0, 0.2)])
    return [column, spout], [[cap, lever]]


def lined_drawers():
    """Drawers between dividers, each in a liner that is open to the front."""
    fixed, drawers = chest_of_drawers()
    for k in range(3):
        low, high = (0.03, -0.37, 0.03 + k * 0.29), (0.48, 0.37, 0.28 + k * 0.29)
        fixed += [
            box(low, (high[0], high[1], low[2] + 0.005)),
            box((low[0], low[1], high[2] - 0.005), high),
            box(low, (high[0], low[1] + 0.005, high[2])),
            box((low[0], high[1] - 0.005, low[2]), high),
        ]
    return fixed, drawers


def safe():
    """A thick door within the rim of the body, with a wheel in its middle."""
    outer, inner = box((0, -0.3, 0), (0.5, 0.3, 0.7)), box((0.05, -0.25, 0.05), (0.6, 0.25, 0.65))
    door = box((0.44, -0.245, 0.055), (0.49, 0.245, 0.645))
    wheel = trimesh.creation.cylinder(0.05, segment=[(0.49, 0, 0.35), (0.53, 0, 0.35)])
    return [outer.difference(inner)], [[door, wheel]]


def merged(fixed, parts):
    """One welded mesh, and the part of each face, -1 for the body."""
    meshes = [*fixed, *(piece for part in parts for piece in part)]
    owner = [-1] * len(fixed) + [k for k, part in enumerate(parts) for _ in part]
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    faces = np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=False)])
    label = np.repeat(owner, [len(m.faces) for m in meshes])
    mesh = weld(
        ScanMesh(
            vertices=np.concatenate([m.vertices for m in meshes]),
            faces=faces,
            rgb=np.full((len(faces), 3), 0.7),
            group=np.zeros(len(faces), dtype=np.int64),
        )
    )
    return mesh, label[mesh.source]


def write(mesh: ScanMesh, path: Path) -> Path:
    """Write a mesh with y up and the front at +z."""
    trimesh.Trimesh(mesh.vertices @ TO_Y_UP.T, mesh.faces, process=False).export(path)
    return path


def overlap(mesh, found, label, k):
    """Area IoU of found faces and the true part ``k``."""
    own = np.zeros(len(label), dtype=bool)
    own[found] = True
    true = label == k
    return mesh.areas[own & true].sum() / mesh.areas[own | true].sum()
