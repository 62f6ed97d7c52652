"""Rules for dials and levers on doors, sashes of windows, closed cases and carts."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from tests.articulate.reconstruct.scan.scan_objects import box, carcass, merged, overlap, safe

from articulate.benchmark.dataset import LibraryDataset
from articulate.library import ProceduralLibrary
from articulate.reconstruct.scan.propose import propose_parts
from articulate.reconstruct.scan.read_scan import DENSE_FACES, _is_dense


def cylinder(radius, start, end):
    return trimesh.creation.cylinder(radius, segment=[start, end])


def found_in(fixed, parts):
    mesh, label = merged(fixed, parts)
    found = propose_parts(mesh)
    return mesh, label, found.parts


def shares(mesh, label, found, true):
    """Largest overlap of one true part with the found ones."""
    return max(overlap(mesh, part.faces, label, true) for part in found)


def test_the_rings_of_a_wheel_are_one_part():
    fixed, [[door, wheel]] = safe()
    ring = trimesh.creation.annulus(0.06, 0.09, segment=[(0.49, 0, 0.35), (0.51, 0, 0.35)])
    mesh, label, found = found_in(fixed, [[door], [wheel, ring]])
    assert [part.kind for part in found] == ["door", "knob"]
    assert shares(mesh, label, found, 1) > 0.95


def test_a_short_bar_beside_a_dial_is_a_lever():
    fixed, [[door, _]] = safe()
    dial = cylinder(0.045, (0.49, 0.05, 0.35), (0.52, 0.05, 0.35))
    lever = box((0.49, 0.14, 0.25), (0.54, 0.16, 0.37))
    mesh, label, found = found_in(fixed, [[door], [dial], [lever]])
    (bar,) = [part for part in found if part.kind == "switch"]
    assert overlap(mesh, bar.faces, label, 2) > 0.95
    np.testing.assert_allclose(bar.axis, (1, 0, 0))
    np.testing.assert_allclose(bar.pivot[1:], (0.15, 0.36), atol=0.01)
    assert found[bar.on].kind == "door"


def test_a_dial_turns_about_the_normal_of_a_door_that_is_ajar():
    turn = trimesh.transformations.rotation_matrix(np.radians(-40), (0, 0, 1), (0.5, -0.4, 0))
    door = box((0.5, -0.4, 0.02), (0.53, 0.4, 0.88)).apply_transform(turn)
    dial = cylinder(0.08, (0.53, 0.05, 0.45), (0.57, 0.05, 0.45)).apply_transform(turn)
    mesh, label, found = found_in(carcass(), [[door], [dial]])
    (knob,) = [part for part in found if part.kind == "knob"]
    assert overlap(mesh, knob.faces, label, 1) > 0.95
    normal = turn[:3, 0]
    assert abs(knob.axis @ normal) == pytest.approx(1.0, abs=1e-3)
    middle = mesh.triangles[knob.faces].reshape(-1, 3).mean(axis=0) - knob.pivot
    np.testing.assert_allclose(middle - normal * (middle @ normal), 0.0, atol=0.01)


def window():
    """A frame with a sash beside an equal pane in its plane."""
    frame = [
        box((0, -0.8, 0), (0.12, 0.8, 0.06)),
        box((0, -0.8, 1.14), (0.12, 0.8, 1.2)),
        box((0, -0.8, 0.06), (0.12, -0.74, 1.14)),
        box((0, 0.74, 0.06), (0.12, 0.8, 1.14)),
    ]
    pane = box((0.09, -0.74, 0.06), (0.1, 0.02, 1.14))
    sash = box((0.08, -0.02, 0.07), (0.1, 0.73, 1.13))
    handle = box((0.1, 0.68, 0.5), (0.14, 0.7, 0.7))
    return [*frame, pane], [[sash, handle]]


def test_a_door_that_is_ajar_is_hinged_where_its_hinges_touch_the_body():
    turn = trimesh.transformations.rotation_matrix(np.radians(-40), (0, 0, 1), (0.56, -0.4, 0))
    door = box((0.55, -0.4, 0.02), (0.58, 0.4, 0.88)).apply_transform(turn)
    latch = box((0.5, 0.38, 0.4), (0.54, 0.42, 0.5)).apply_transform(turn)  # far behind the leaf
    hinges = [box((0.5, -0.42, z), (0.56, -0.4, z + 0.06)) for z in (0.1, 0.7)]
    _, _, found = found_in([*carcass(), *hinges], [[door, latch]])
    (leaf,) = [part for part in found if part.kind == "door"]
    np.testing.assert_allclose(leaf.pivot[:2], (0.56, -0.4), atol=0.04)


def generated(name):
    """Parts of a procedural object, and those that its joint moves."""
    true = LibraryDataset("procedural", ProceduralLibrary(10)).load(name)
    moves = true.joints[0].moves
    meshes = {p.name: trimesh.Trimesh(p.vertices, p.faces, process=False) for p in true.parts}
    moved = [mesh for part, mesh in meshes.items() if part in moves]
    return [mesh for part, mesh in meshes.items() if part not in moves], [moved]


def test_a_sash_slides_past_a_pane_behind_it():
    mesh, label, found = found_in(*generated("sliding_window-0000"))
    sash = max(found, key=lambda part: overlap(mesh, part.faces, label, 0))
    assert overlap(mesh, sash.faces, label, 0) > 0.95
    assert sash.joint == "prismatic"
    np.testing.assert_allclose(sash.axis, (0, -1, 0))


def test_a_sash_beside_a_pane_in_its_plane_turns():
    mesh, label, found = found_in(*window())
    sash = max(found, key=lambda part: overlap(mesh, part.faces, label, 0))
    assert sash.joint == "revolute"


def test_the_upper_part_of_a_closed_case_is_a_lid():
    mesh, label, found = found_in(*generated("laptop-0000"))
    (lid,) = found
    assert overlap(mesh, lid.faces, label, 0) > 0.95
    assert (lid.kind, lid.joint) == ("lid", "revolute")
    np.testing.assert_allclose(lid.axis, (0, -1, 0))
    assert lid.pivot[0] == pytest.approx(mesh.bounds[0, 0], abs=0.01)  # at the rear


def test_the_plain_sides_of_a_cart_do_not_open():
    body = box((-0.4, -0.3, 0.11), (0.4, 0.3, 0.5))
    boards = [box((0.4, y, 0.13), (0.41, y + 0.28, 0.48)) for y in (-0.29, 0.01)]
    wheels = [
        [cylinder(0.05, (x, y - 0.02, 0.05), (x, y + 0.02, 0.05))]
        for x in (-0.3, 0.3)
        for y in (-0.25, 0.25)
    ]
    _, _, without = found_in([body, *boards], [])
    assert {part.kind for part in without} == {"door"}
    _, _, found = found_in([body, *boards], wheels)
    assert [part.kind for part in found] == ["wheel"] * 4


def test_a_model_of_many_surfaces_is_no_scan():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.5)
    assert len(ball.faces) > DENSE_FACES
    mesh, _ = merged([ball], [])
    assert _is_dense(mesh)
    beads = []
    for x in range(32):
        bead = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
        bead.apply_translation((0.1 * x, 0, 0))
        beads.append(bead)
    mesh, _ = merged(beads, [])
    assert len(mesh.faces) > DENSE_FACES
    assert not _is_dense(mesh)
