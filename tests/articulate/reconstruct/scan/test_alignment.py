from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.articulate.reconstruct.scan.scan_objects import (
    box,
    bucket,
    chest_of_drawers,
    double_doors,
    merged,
    write,
)

from articulate.reconstruct.scan.alignment import aligned
from articulate.reconstruct.scan.make_scan import find_parts, scan_parts
from articulate.reconstruct.scan.read_scan import ScanHints, read_scan


def placed(mesh, yaw_deg, tilt_deg=0.0, direction_deg=0.0):
    """Return a mesh turned about z, then tilted about a horizontal axis."""
    axis = np.array([np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg)), 0.0])
    tilt = Rotation.from_rotvec(np.radians(tilt_deg) * axis)
    rotation = (tilt * Rotation.from_euler("z", yaw_deg, degrees=True)).as_matrix()
    return mesh.transformed(rotation, 1.0, np.zeros(3))


@given(yaw_deg=st.floats(-180, 180), tilt_deg=st.floats(0, 15), direction_deg=st.floats(-180, 180))
def test_the_sides_of_a_box_are_turned_along_the_axes(yaw_deg, tilt_deg, direction_deg):
    mesh, _ = merged([], [[box((0, 0, 0), (0.4, 0.9, 1.2))]])
    found, note = aligned(placed(mesh, yaw_deg, tilt_deg, direction_deg))
    largest = np.abs(found.normals).max(axis=1)
    assert largest.min() > np.cos(np.radians(0.75))
    np.testing.assert_allclose(np.sort(found.size), (0.4, 0.9, 1.2), atol=0.02)
    assert found.size[2] == pytest.approx(1.2, abs=0.02)
    if tilt_deg > 0.6:
        assert "upright" in note


@pytest.mark.parametrize("objects", [double_doors(), chest_of_drawers(), bucket()])
def test_an_object_along_the_axes_is_left_as_it_is(objects):
    mesh, _ = merged(*objects)
    found, note = aligned(mesh)
    assert note == ""
    np.testing.assert_array_equal(found.vertices, mesh.vertices)


@pytest.mark.parametrize("yaw_deg", [-39.5, 15.5, 26.5, 100.0])
def test_a_round_object_is_turned_along_its_plane_of_symmetry(yaw_deg):
    mesh, label = merged(*bucket())
    found, _ = aligned(placed(mesh, yaw_deg))
    bail = found.triangles[label == 0].reshape(-1, 3)
    assert np.ptp(bail[:, :2], axis=0).min() < 0.015


def test_a_cylinder_is_made_upright():
    mesh, _ = merged([], [[trimesh.creation.cylinder(0.2, 0.5, sections=64)]])
    _, note = aligned(mesh)
    assert note == ""
    _, note = aligned(placed(mesh, 13.0, 5.0))
    assert "5.0 degrees upright" in note


def test_a_tilted_flat_surface_is_left_as_it_is():
    sheet = trimesh.Trimesh(
        [(0, 0, 0), (1, 0, 0.7), (1, 1, 0.7), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    )
    mesh, _ = merged([], [[sheet.subdivide().subdivide()]])
    found, _ = aligned(mesh)
    np.testing.assert_allclose(found.size, mesh.size, atol=0.01)


@pytest.mark.parametrize(("yaw_deg", "tilt_deg"), [(25.0, 0.0), (-70.0, 4.0), (160.0, 8.0)])
@pytest.mark.parametrize(
    ("objects", "kinds"),
    [(double_doors(), ["door", "door"]), (chest_of_drawers(), ["drawer"] * 3)],
)
def test_parts_are_found_at_any_angle(objects, kinds, yaw_deg, tilt_deg, tmp_path):
    mesh, _ = merged(*objects)
    hints = ScanHints()
    path = write(placed(mesh, yaw_deg, tilt_deg, 30.0), tmp_path / "scan.glb")
    scan, found = find_parts(read_scan(path, hints), hints)
    assert [part.kind for part in found] == kinds
    assert any("along its own sides" in note for note in scan.assumptions)
    np.testing.assert_allclose(scan.mesh.size, mesh.size, atol=0.01)


@pytest.mark.parametrize("yaw_deg", [0.0, 60.0, 150.0, -110.0])
def test_named_drawers_open_towards_the_side_where_they_are(yaw_deg, tmp_path):
    fixed, drawers = chest_of_drawers()
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(np.radians(yaw_deg), (0, 0, 1))
    upright = trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0))
    for name, boxes in (("body", fixed), *((f"drawer{k}", d) for k, d in enumerate(drawers))):
        part = trimesh.util.concatenate(boxes)
        scene.add_geometry(part.apply_transform(upright @ turn), node_name=name, geom_name=name)
    path = tmp_path / "chest.glb"
    scene.export(path)
    scan = read_scan(path, ScanHints())
    found = scan_parts(scan, path, ScanHints())
    meshes = {mesh.name: mesh.vertices for mesh in found.part_set.meshes}
    opened = [joint for joint in found.joints if joint.kind == "prismatic"]
    assert len(opened) == 3
    for joint in opened:
        axis = np.asarray(joint.axis_o)
        assert np.abs(axis).max() == pytest.approx(1.0)  # along its own sides
        assert (meshes[joint.part] @ axis).max() > (meshes["body"] @ axis).max() + 0.02
