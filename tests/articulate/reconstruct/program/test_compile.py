"""The URDF says what the data say, for three readers and for check-asset."""

import json
import math

import numpy as np
import pytest
import trimesh
import yourdfpy
from tests.articulate.reconstruct.program import scenes

from articulate.errors import AssetError, UsageError
from articulate.geometry.presets import LARGE_HINGE, MASS_KG, SLIDE
from articulate.preparation.prepare import check_asset
from articulate.reconstruct.program.compile import link_plans, write_object
from articulate.reconstruct.program.mass import inertial_of
from articulate.reconstruct.program.materials import DEFAULT, MATERIALS, PartMaterial
from articulate.reconstruct.program.program_parts import parts_of
from articulate.reconstruct.program.result import (
    ObjectJoint,
    ObjectPart,
    ProgramError,
    ProgramObject,
)
from articulate.reconstruct.program.run import compile_program


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compiled")
    return scenes.compiled(scenes.PROGRAM, scenes.parts(), folder, name="cabinet")


@pytest.fixture(scope="module")
def robot(compiled):
    return yourdfpy.URDF.load(str(compiled), load_meshes=True, build_scene_graph=True)


def corners(robot, link):
    """Corners of a link's mesh in the frame of the root, as yourdfpy places them."""
    names = [n for n in robot.scene.graph.nodes_geometry if robot.link_map[link].visuals]
    found = []
    for visual in robot.link_map[link].visuals:
        mesh = trimesh.load_mesh(robot._filename_handler(visual.geometry.mesh.filename))
        T = robot.get_transform(link, "body") @ visual.origin
        found.append(trimesh.transform_points(mesh.vertices, T))
    assert names
    return np.concatenate(found)


def test_files_are_beside_each_other(compiled):
    assert compiled.name == "cabinet.urdf"
    names = {path.name for path in compiled.parent.iterdir()}
    assert names == {"cabinet.urdf", "meshes", "built.json", "program.py"}
    assert json.loads((compiled.parent / "built.json").read_text())["root"] == "body"
    assert (compiled.parent / "program.py").read_text() == scenes.PROGRAM


def test_compiling_twice_gives_the_same_bytes(compiled, tmp_path):
    again = scenes.compiled(scenes.PROGRAM, scenes.parts(), tmp_path, name="cabinet")
    for path in sorted(p for p in compiled.parent.rglob("*") if p.is_file()):
        assert (tmp_path / path.relative_to(compiled.parent)).read_bytes() == path.read_bytes()
    assert again.name == compiled.name


def test_at_zero_everything_lies_where_the_program_put_it(robot):
    built = scenes.built(scenes.PROGRAM, parts_of(scenes.parts()))
    robot.update_cfg(dict.fromkeys(robot.actuated_joint_names, 0.0))
    for part in built.parts:
        expected = np.asarray(scenes.parts()[part.name].vertices) + part.pos_w
        found = corners(robot, part.name)
        np.testing.assert_allclose(found.min(axis=0), expected.min(axis=0), atol=1e-8)
        np.testing.assert_allclose(found.max(axis=0), expected.max(axis=0), atol=1e-8)


def test_the_door_turns_about_its_pivot_and_takes_its_handle_along(robot):
    robot.update_cfg({"door_hinge": math.pi / 2, "drawer_joint": 0.0})
    door = corners(robot, "door")
    pivot = np.array([0.2, -0.25, 0.55])
    low, high = np.array([0.2, -0.25, 0.4]) - pivot, np.array([0.22, 0.25, 0.7]) - pivot
    # A quarter turn about -z takes (x, y) to (y, -x): the door opens to the front.
    expected = [[low[1], -high[0], low[2]], [high[1], -low[0], high[2]]]
    np.testing.assert_allclose(door.min(axis=0), pivot + expected[0], atol=1e-8)
    np.testing.assert_allclose(door.max(axis=0), pivot + expected[1], atol=1e-8)
    handle = corners(robot, "handle").mean(axis=0) - pivot
    np.testing.assert_allclose(handle, [0.2 + 0.25, -0.035, 0.0], atol=1e-6)


def test_the_drawer_slides_along_the_worlds_axis(robot):
    robot.update_cfg({"door_hinge": 0.0, "drawer_joint": 0.0})
    closed = corners(robot, "drawer")
    robot.update_cfg({"door_hinge": 0.0, "drawer_joint": 0.25})
    np.testing.assert_allclose(corners(robot, "drawer") - closed, [[0.25, 0, 0]] * 8, atol=1e-9)


def test_damping_friction_and_mass_come_from_the_tables(robot):
    drawer, hinge = robot.joint_map["drawer_joint"], robot.joint_map["door_hinge"]
    assert (float(drawer.dynamics.damping), float(drawer.dynamics.friction)) == (
        SLIDE.damping, SLIDE.frictionloss,
    )  # fmt: skip
    assert float(hinge.dynamics.damping) == LARGE_HINGE.damping
    door = robot.link_map["door"].inertial
    walls = 2 * (0.02 * 0.5 + 0.02 * 0.3 + 0.5 * 0.3) * MATERIALS["glass"].wall_m
    handle = robot.link_map["handle"].inertial
    glass = MATERIALS["glass"].density * min(walls, 0.02 * 0.5 * 0.3)
    wood = MATERIALS[DEFAULT].density * 0.03 * 0.12 * 0.02
    assert float(door.mass) + float(handle.mass) == pytest.approx(
        min(glass + wood, MASS_KG["hinge"][1]), rel=1e-6
    )


def test_a_solid_box_has_the_inertia_of_the_closed_form():
    stuff = PartMaterial(density=1000.0, wall_m=10.0)
    found = inertial_of(parts_of({"a": scenes.box((0.1, 0.2, 0.3))})["a"].pieces, stuff, np.eye(4))
    assert found is not None
    assert found.mass_kg == pytest.approx(6.0)
    x, y, z = 0.01, 0.04, 0.09
    expected = np.diag([y + z, x + z, x + y]) * 6.0 / 12.0
    np.testing.assert_allclose(found.inertia_p, expected, atol=1e-7)


def test_a_single_sheet_has_mass_and_a_physical_inertia():
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    found = inertial_of(parts_of({"a": sheet})["a"].pieces, MATERIALS["metal"], np.eye(4))
    assert found is not None
    assert found.mass_kg == pytest.approx(7.8)
    a, b, c = np.linalg.eigvalsh(found.inertia_p)
    assert a > 0
    assert a + b >= c * (1 - 1e-9)


def test_a_moving_helper_without_geometry_has_some_mass(tmp_path):
    source = (
        "frame('helper')\nroot('body')\n"
        "prismatic('helper', 'body', (0, 0, 1), 0, 0.1, name='slide')\n"
        "continuous('door', 'helper', (0, 0, 1), (0, 0, 0), name='turn', damping=0.5)\n"
        "mimic('turn', 'slide', 20)\n"
    )
    path = scenes.compiled(source, scenes.parts(), tmp_path)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert float(robot.link_map["helper"].inertial.mass) > 0.0
    assert robot.joint_map["turn"].mimic.joint == "slide"
    assert float(robot.joint_map["turn"].dynamics.damping) == 0.5


@pytest.mark.parametrize("axis", [(0, 1, 0), (0, 0, 1)])
def test_a_lid_is_no_heavier_than_a_hand_lifts_at_its_far_edge(axis, tmp_path):
    parts = {"body": scenes.box((0.1, 0.1, 0.1)), "lid": scenes.box((0.8, 0.8, 0.4))}
    source = f"root('body')\nrevolute('lid', 'body', {axis}, (-0.4, 0, 0), 0, 1.5)\n"
    path = scenes.compiled(source, parts, tmp_path)
    lid = yourdfpy.URDF.load(str(path), load_meshes=False).link_map["lid"]
    liftable = 0.7 * 30.0 * np.hypot(0.8, 0.2) / (9.81 * 0.4)
    expected = liftable if axis[1] else MASS_KG["hinge"][1]
    assert float(lid.inertial.mass) == pytest.approx(expected, rel=1e-6)


def test_names_of_parts_cannot_leave_their_attributes_or_folders(tmp_path):
    name = '../../a"><x>&'
    parts = parts_of({name: scenes.cabinet(), "door": scenes.box((0.1, 0.1, 0.1))})
    path = scenes.compiled("fixed('door', parts()[0])", parts, tmp_path / "out")
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert set(robot.link_map) == {name, "door"}
    assert {p.name for p in tmp_path.iterdir()} == {"out"}


def test_a_urdf_is_never_beside_meshes_of_another_object(tmp_path, monkeypatch):
    parts = parts_of(scenes.parts())
    path = write_object(scenes.built(scenes.PROGRAM, parts), parts, tmp_path, name="cabinet")
    seen = []

    def killed(file, content):
        seen.append(path.exists())
        raise KeyboardInterrupt

    monkeypatch.setattr("articulate.reconstruct.program.elements.write_bytes", killed)
    with pytest.raises(KeyboardInterrupt):
        write_object(scenes.built(scenes.PROGRAM, parts), parts, tmp_path, name="cabinet")
    assert seen == [False]
    assert not path.exists()


def test_a_urdf_that_cannot_be_removed_is_refused_in_one_line(tmp_path):
    parts = parts_of(scenes.parts())
    (tmp_path / "cabinet.urdf").mkdir()
    with pytest.raises(UsageError, match=r"cabinet\.urdf: cannot be written"):
        write_object(scenes.built(scenes.PROGRAM, parts), parts, tmp_path, name="cabinet")


def test_an_error_of_a_program_writes_nothing(tmp_path):
    found = compile_program("import os", scenes.parts(), tmp_path / "out")
    assert isinstance(found, ProgramError)
    assert not (tmp_path / "out").exists()


def test_data_that_are_no_tree_are_refused(tmp_path):
    at, turned = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    parts = tuple(ObjectPart(name=n, pos_w=at, quat_w=turned, material=DEFAULT) for n in "abc")
    joints = tuple(
        ObjectJoint(name=c, kind="fixed", child=c, parent=p) for c, p in (("b", "c"), ("c", "b"))
    )
    with pytest.raises(AssetError, match="2 parts have no parent"):
        link_plans(ProgramObject(root="a", parts=parts, joints=joints))


@pytest.mark.slow
def test_check_asset_proves_what_a_program_makes(compiled, tmp_path):
    check_report = check_asset(compiled, tmp_path / "asset")
    assert check_report.verdict in {"passed", "repaired"}, [
        c for c in check_report.checks if c.outcome == "failed"
    ]


def test_the_data_can_be_written_again_without_a_program(tmp_path):
    parts = parts_of(scenes.parts())
    built = scenes.built(scenes.PROGRAM, parts)
    path = write_object(built, parts, tmp_path, name="again")
    assert path.is_file()
    assert not (tmp_path / "program.py").exists()
