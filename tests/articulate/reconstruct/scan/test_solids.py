from __future__ import annotations

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.scan.category_by_parts import category_by_parts
from articulate.reconstruct.scan.masks import skin
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.solids import build_solids, is_closed


def closed_box(size, side=0.05):
    """Return a closed box of small triangles on z = 0, centred at x = y = 0."""
    box = trimesh.creation.box(extents=size).subdivide_to_size(side)
    box.merge_vertices()
    box.apply_translation([0.0, 0.0, size[2] / 2.0])
    return ScanMesh(
        vertices=np.asarray(box.vertices, dtype=np.float64),
        faces=np.asarray(box.faces, dtype=np.int64),
        rgb=np.full((len(box.faces), 3), 0.7),
        group=np.zeros(len(box.faces), dtype=np.int64),
    )


def joint(kind, axis):
    return PredictedJoint(
        part="part", parent="body", kind=kind, axis_o=axis, pivot_o=(0.0, 0.0, 0.0), lower=0.0,
        upper=1.0, confidence=1.0,
    )  # fmt: skip


def volume(part):
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    assert mesh.is_watertight
    return float(mesh.volume)


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_a_masked_front_of_a_closed_shell_gets_a_thickness_and_a_cavity(kind):
    mesh = closed_box((0.6, 0.8, 0.5))
    centres = mesh.triangles.mean(axis=1)
    faces = np.flatnonzero((mesh.normals[:, 0] > 0.9) & (centres[:, 2] > 0.1))
    axis = (1.0, 0.0, 0.0) if kind == "prismatic" else (0.0, 0.0, 1.0)
    proposal = skin(mesh, faces, joint(kind, axis), closed=True)
    assert proposal.panel is not None
    built = build_solids(mesh, [proposal], ["front"], "body")
    assert built is not None
    assert volume(built.body) < 0.6 * 0.6 * 0.8 * 0.5
    depth = np.ptp(built.parts[0].vertices[:, 0])
    assert depth > 0.3 if kind == "prismatic" else 0.005 < depth < 0.05
    assert volume(built.parts[0]) < 0.1 * 0.6 * 0.8 * 0.5


def test_another_part_of_a_closed_shell_is_closed_along_its_border():
    mesh = closed_box((0.4, 0.4, 0.3))
    faces = np.flatnonzero(mesh.triangles.mean(axis=1)[:, 2] > 0.25)
    proposal = skin(mesh, faces, joint("revolute", (0.0, 1.0, 0.0)), closed=True)
    assert proposal.panel is None
    built = build_solids(mesh, [proposal], ["lid"], "body")
    assert built is not None
    total = 0.4 * 0.4 * 0.3
    assert volume(built.body) + volume(built.parts[0]) == pytest.approx(total, rel=1e-3)
    assert 0.1 * total < volume(built.parts[0]) < 0.4 * total


def test_an_open_surface_is_not_closed_but_a_small_hole_is_repaired():
    mesh = closed_box((0.4, 0.4, 0.3), 0.02)
    assert is_closed(mesh)
    assert is_closed(mesh.select(np.arange(len(mesh.faces) - 1)))
    assert not is_closed(mesh.select(np.flatnonzero(mesh.normals[:, 2] < 0.9)))


@pytest.mark.parametrize(
    ("size", "names", "category"),
    [
        ((1.1, 1.6, 1.0), ["lid"], "Box"),
        ((0.4, 0.4, 1.0), ["freezer door", "door"], "Refrigerator"),
        ((0.9, 1.8, 1.0), ["drawer", "drawer"], "Table"),
        ((1.4, 1.7, 1.0), ["door", "knob", "knob"], "Microwave"),
        ((0.7, 0.7, 1.0), ["door", "drawer", "knob", "knob", "knob"], "Oven"),
        ((1.1, 1.6, 1.0), ["wing"], "unknown"),
        ((0.7, 0.9, 1.0), ["drawer", "drawer", "drawer"], "StorageFurniture"),
    ],
)
def test_category_by_proportions_and_names(size, names, category):
    assert category_by_parts(closed_box(size, 1.0), names) == category
