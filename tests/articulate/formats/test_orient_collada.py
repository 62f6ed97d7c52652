"""COLLADA meshes stand the way up that fits the joints which turn them."""

import re

import numpy as np
import pytest
import trimesh

from articulate.conversion.convert import read_input
from articulate.formats.collada import is_z_up
from articulate.formats.config import ConvertConfig
from articulate.formats.orient_collada import leaves_in_plane, make_loader
from articulate.formats.read_urdf import read_urdf
from articulate.reconstruct.part_set import read_part_set
from articulate.reconstruct.program.program_parts import parts_of

LEAF_M = (0.8, 0.04, 2.0)
"""Breadth, thickness and height as the file with z up has them."""
DOOR = """<robot name="door">
  <link name="base"/>
  <link name="frame"><visual><geometry><mesh filename="frame.dae"/></geometry></visual></link>
  <joint name="stand" type="fixed"><parent link="base"/><child link="frame"/>
    <origin rpy="{rpy}"/></joint>
  <link name="leaf"><visual><origin xyz="{shift} 0 0"/>
    <geometry><mesh filename="leaf.dae"/></geometry></visual></link>
  <joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/>
    <origin xyz="{back} 0 0"/><axis xyz="{axis}"/><limit lower="0" upper="1.5"/></joint>
</robot>"""


def write_mesh(path, mesh, up="Z_UP"):
    mesh.export(path)
    text = re.sub(r"<up_axis>.*?</up_axis>", "", path.read_text())
    path.write_text(text.replace("</asset>", f"<up_axis>{up}</up_axis></asset>", 1))


def write_door(folder, *, axis="0 -1 0", rpy="1.5707963 0 0", up="Z_UP", shift=0.4):
    write_mesh(folder / "leaf.dae", trimesh.creation.box(LEAF_M), up)
    beam = trimesh.creation.box((1.0, 0.1, 0.1))
    beam.apply_translation((0.0, 0.0, 1.2))
    write_mesh(folder / "frame.dae", beam, up)
    text = DOOR.format(axis=axis, rpy=rpy, shift=shift, back=-shift)
    (folder / "door.urdf").write_text(text)
    return folder / "door.urdf"


def leaf_of(reading):
    """Lengths of the leaf along the axes of its link (3,), and what was changed."""
    (piece,) = reading.geometry["leaf"].visible
    return piece.mesh.extents, reading.source.repairs.messages


def test_leaf_that_would_turn_in_its_own_plane_is_turned_upright(tmp_path):
    reading = read_input(write_door(tmp_path), ConvertConfig())
    sides, repairs = leaf_of(reading)
    np.testing.assert_allclose(sides, (LEAF_M[0], LEAF_M[2], LEAF_M[1]), atol=1e-6)
    assert sum("turned from z up to y up" in message for message in repairs) == 1
    (frame,) = reading.geometry[reading.parts[0].name].visible
    T_pl = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(frame.mesh.centroid, (T_pl @ (0, 1.2, 0, 1))[:3], atol=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"axis": "0 0 1"},  # an axis in the plane of the leaf
        {"rpy": "0 0 0"},  # links whose z axis points up
        {"up": "Y_UP"},  # turned already
        {"shift": 0.0},  # a sign that turns about its middle
    ],
)
def test_meshes_stay_as_they_are_without_such_evidence(tmp_path, changes):
    sides, repairs = leaf_of(read_input(write_door(tmp_path, **changes), ConvertConfig()))
    np.testing.assert_allclose(sides, LEAF_M, atol=1e-6)
    assert not any("turned from" in message for message in repairs)


@pytest.mark.parametrize(("up", "axis"), [("y", "0 0 1"), ("file", "0 -1 0")])
def test_the_configuration_decides_if_it_is_set(tmp_path, up, axis):
    reading = read_input(write_door(tmp_path, axis=axis), ConvertConfig(collada_up=up))
    turned = (LEAF_M[0], LEAF_M[2], LEAF_M[1])
    np.testing.assert_allclose(leaf_of(reading)[0], turned if up == "y" else LEAF_M, atol=1e-6)


def test_all_readers_of_links_orient_them_equally(tmp_path):
    path = write_door(tmp_path)
    source = read_urdf(path)
    before = source.repairs.messages
    loader = make_loader(source, ConvertConfig())
    upright = (LEAF_M[0], LEAF_M[2], LEAF_M[1])
    assert loader.y_up
    (message,) = set(source.repairs.messages) - set(before)
    assert "turned from z up to y up" in message
    corners = parts_of(path)["leaf"].triangles.reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(corners, axis=0), upright, atol=1e-6)
    (leaf,) = (mesh for mesh in read_part_set(path).meshes if mesh.name == "leaf")
    np.testing.assert_allclose(np.ptp(leaf.vertices, axis=0), LEAF_M, atol=1e-6)  # upright
    other = make_loader(read_urdf(path), ConvertConfig(collada_up="file"))
    assert not other.y_up


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0, 70.0])
def test_leaf_is_found_at_any_angle_about_its_axis(tmp_path, degrees):
    leaf = trimesh.creation.box(LEAF_M)
    leaf.apply_translation((0.4, 0.0, 0.0))
    leaf.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), (0, 1, 0)))
    write_door(tmp_path, shift=0.0)
    write_mesh(tmp_path / "leaf.dae", leaf)
    reading = read_input(tmp_path / "door.urdf", ConvertConfig(collada_up="file"))
    assert leaves_in_plane(reading.parts, reading.geometry) == ("hinge",)


def test_only_collada_files_declare_the_upward_axis(tmp_path):
    for up in ("X_UP", "Y_UP", "Z_UP"):
        write_mesh(tmp_path / f"{up}.dae", trimesh.creation.box(LEAF_M), up)
        assert is_z_up(tmp_path / f"{up}.dae") == (up == "Z_UP")
    trimesh.creation.box(LEAF_M).export(tmp_path / "a.obj")
    assert not is_z_up(tmp_path / "a.obj")
