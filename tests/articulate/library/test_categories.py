"""Every category: what is written, what is true of it, and what the proof says."""

import re

import numpy as np
import pytest
import trimesh
import yourdfpy

from articulate.assets.asset import load_asset
from articulate.conversion.convert import convert, placement_of, read_input
from articulate.formats.config import ConvertConfig
from articulate.formats.mesh_file import read_mesh
from articulate.formats.repairs import Repairs, is_note
from articulate.library.procedural.categories import CATEGORIES, write_object
from articulate.library.procedural.meshes import mass_properties
from articulate.library.procedural.truth import bounds, joints_of, origins
from articulate.preparation.prepare import check_asset
from articulate.simulator import mujoco
from articulate.transforms import axis_angle_to_matrix, pose

QUICK = ("box_with_lid", "bucket", "kitchen_pot")
SEEDS = (0, 1, 2, 3, 4)


def _agrees(parts, asset):
    """The joints of an asset are those that the generator says."""
    true = {joint.name: joint for joint in joints_of(parts)}
    assert [joint.name for joint in asset.joints] == list(true)
    for joint in asset.joints:
        own = true[joint.name]
        assert (joint.kind, joint.link, joint.parent) == (own.kind, own.link, own.parent)
        np.testing.assert_allclose(joint.axis_o, own.axis_o, atol=1e-9)
        np.testing.assert_allclose(joint.pivot_o, own.pivot_o, atol=1e-6)
        assert joint.closed == 0.0
        for limit, said in ((joint.lower, own.lower), (joint.upper, own.upper)):
            assert (limit is None) == (said is None)
            assert limit == pytest.approx(said, abs=1e-8)


@pytest.mark.parametrize("name", CATEGORIES)
@pytest.mark.parametrize("seed", SEEDS)
def test_sizes_masses_and_names_are_those_of_a_thing_in_a_house(name, seed):
    parts = CATEGORIES[name].parts(seed)
    low, high = bounds(parts)
    assert low[2] == pytest.approx(0.0, abs=1e-9)
    assert 0.08 < (high - low).max() < 2.4
    names = [part.name for part in parts]
    shapes = [shape.name for part in parts for shape in part.shapes]
    pieces = [f"{shape.name}_{s.name}" for p in parts for shape in p.shapes for s in shape.solids]
    for words in (names, shapes, pieces):
        assert len(set(words)) == len(words)
        assert all(re.fullmatch(r"[a-z][a-z0-9_]*", word) for word in words)
    assert parts[0].motion is None
    assert all(part.motion is not None for part in parts[1:])


@pytest.mark.parametrize("name", CATEGORIES)
def test_kinematics_are_the_closed_form(name, tmp_path):
    """yourdfpy reads the URDF; each link is turned or shifted about its axis by hand."""
    parts = CATEGORIES[name].parts(1)
    urdf = yourdfpy.URDF.load(str(write_object(name, 1, tmp_path)), load_meshes=False)
    rng = np.random.default_rng(1)
    q = {p.motion.name: rng.uniform(0.0, p.motion.upper or 1.0) for p in parts[1:]}  # type: ignore[union-attr]
    urdf.update_cfg(q)
    expected = {parts[0].name: np.eye(4)}
    for part in parts[1:]:
        motion = part.motion
        axis, by = np.asarray(motion.axis), q[motion.name]  # type: ignore[union-attr]
        assert np.linalg.norm(axis) == pytest.approx(1.0)
        turned = pose(np.zeros(3), axis_angle_to_matrix(axis, by))
        moved = pose(by * axis) if motion.kind == "prismatic" else turned  # type: ignore[union-attr]
        expected[part.name] = expected[motion.parent] @ pose(np.asarray(motion.origin_p)) @ moved  # type: ignore[union-attr]
        found = urdf.get_transform(part.name, parts[0].name)
        np.testing.assert_allclose(found, expected[part.name], atol=1e-9)


@pytest.mark.parametrize("name", CATEGORIES)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_part_reaches_into_another_when_everything_is_closed(name, seed):
    """By the convex pieces of both, in MuJoCo, which measures how far they are apart."""
    parts = CATEGORIES[name].parts(seed)
    at = origins(parts)
    spec = mujoco.MjSpec()
    body = {}
    for part in parts:
        body[part.name] = spec.worldbody.add_body(name=part.name, pos=at[part.name])
        body[part.name].add_freejoint()
        for k, piece in enumerate(p for s in part.solids for p in s.colliders()):
            _add(spec, body[part.name], f"{part.name}_{k}", piece)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    deepest: dict[tuple[str, ...], float] = {}
    for contact in data.contact:
        one, two = (model.body(model.geom_bodyid[g]).name for g in contact.geom)
        if one != two:
            pair = tuple(sorted((one, two)))
            deepest[pair] = min(deepest.get(pair, 0.0), contact.dist)
    allowed = _joined(parts)
    assert {pair: d for pair, d in deepest.items() if d < -0.0035 and pair not in allowed} == {}


def _joined(parts):
    """A part that turns on an axle may stand in its bearing."""
    return {
        tuple(sorted((part.name, part.motion.parent)))
        for part in parts[1:]
        if part.motion.kind != "prismatic"
    }


def _add(spec, body, name, piece):
    geom = body.add_geom(name=name)
    if piece.kind == "mesh":
        mesh = spec.add_mesh(name=name)
        mesh.uservert = piece.mesh[0].ravel()
        mesh.userface = piece.mesh[1].ravel()
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, name
        return
    geom.pos = piece.centre
    roll, pitch, yaw = piece.rpy
    geom.quat = trimesh.transformations.quaternion_from_euler(roll, pitch, yaw)
    if piece.kind == "box":
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, np.array(piece.size) / 2.0
    else:
        geom.type = mujoco.mjtGeom.mjGEOM_CYLINDER
        geom.size = [piece.size[0], piece.size[1] / 2.0, 0.0]


@pytest.mark.parametrize("name", CATEGORIES)
def test_masses_are_those_of_things_and_inertias_physical(name):
    for seed in SEEDS:
        for part in CATEGORIES[name].parts(seed)[1:]:
            what = mass_properties(part.solids)
            assert 0.002 < what.mass_kg < 40.0, (seed, part.name)
            moments = np.linalg.eigvalsh(what.inertia_l)
            assert moments[0] > 0.0
            assert moments[2] <= moments[0] + moments[1]


@pytest.mark.parametrize("name", CATEGORIES)
def test_the_converter_reads_the_true_joints(name, tmp_path):
    """Without shapes, which take seconds; a slow test makes the whole asset."""
    parts = CATEGORIES[name].parts(2)
    reading = read_input(write_object(name, 2, tmp_path), ConvertConfig())
    place = placement_of(reading, ConvertConfig())
    assert place.scale == 1.0
    true = {joint.link: joint for joint in joints_of(parts)}
    assert {part.name for part in reading.parts[1:]} == set(true)
    for part in reading.parts[1:]:
        own, travel = true[part.name], reading.travels[part.name]
        T_ol = place.T_os @ part.T_sp
        assert (travel.kind, part.joint.name, part.parent) == (own.kind, own.name, own.parent)  # type: ignore[union-attr]
        np.testing.assert_allclose(T_ol[:3, :3] @ travel.axis, own.axis_o, atol=1e-9)
        np.testing.assert_allclose(T_ol[:3, 3], own.pivot_o, atol=1e-6)
        assert (travel.lower, travel.upper) == (own.lower, pytest.approx(own.upper, abs=1e-8))  # type: ignore[comparison-overlap]
        assert travel.closed == 0.0
    assert all(is_note(sentence) for sentence in reading.source.repairs.messages)


@pytest.mark.parametrize("name", CATEGORIES)
def test_what_moves_carries_something_to_hold_by_name_or_stands_out(name):
    """Most parts have a piece that says handle, knob or grip; these few are held elsewhere."""
    elsewhere = {"spout", "leaf", "seat", "pedal", "door"}
    for part in CATEGORIES[name].parts(0)[1:]:
        words = " ".join(shape.name for shape in part.shapes)
        assert re.search("handle|knob|grip", words) or part.name in elsewhere, part.name


def test_pictures_come_with_the_materials_and_the_converter_reads_their_mean(tmp_path):
    write_object("box_with_lid", 0, tmp_path)
    assert (tmp_path / "meshes" / "oak.png").is_file()
    repairs = Repairs()
    ((_, mesh, colour),) = read_mesh(tmp_path / "meshes" / "lid_board.obj", repairs)
    assert mesh.is_watertight
    np.testing.assert_allclose(colour[:3], [0.72, 0.55, 0.36], atol=0.02)  # type: ignore[index]
    reading = read_input(tmp_path / "box_with_lid.urdf", ConvertConfig())
    np.testing.assert_allclose(reading.geometry["lid"].visible[0].rgba, [0.72, 0.55, 0.36, 1.0])


@pytest.mark.parametrize("name", QUICK)
def test_quick_categories_are_proven_and_true(name, tmp_path):
    write_object(name, 0, tmp_path / "object")
    check_report = check_asset(tmp_path / "object", tmp_path / "out")
    assert (check_report.verdict, check_report.reasons) == ("passed", ())
    assert all(joint.opened > 0.9 for joint in check_report.joints)  # type: ignore[operator]
    asset = load_asset(tmp_path / "out")
    assert asset.category == CATEGORIES[name].partnet
    assert all(handle.source == "name" for handle in asset.handles)
    _agrees(CATEGORIES[name].parts(0), asset)


@pytest.mark.slow
@pytest.mark.parametrize("name", CATEGORIES)
def test_every_category_is_proven_and_true(name, tmp_path):
    write_object(name, 0, tmp_path / "object")
    check_report = check_asset(tmp_path / "object", tmp_path / "out")
    assert (check_report.verdict, check_report.reasons) == ("passed", ())
    assert all(joint.opened > 0.9 for joint in check_report.joints)  # type: ignore[operator]
    _agrees(CATEGORIES[name].parts(0), load_asset(tmp_path / "out"))


@pytest.mark.slow
@pytest.mark.parametrize("name", CATEGORIES)
@pytest.mark.parametrize("seed", SEEDS)
def test_converted_joints_are_the_true_ones(name, seed, tmp_path):
    write_object(name, seed, tmp_path / "object")
    _agrees(CATEGORIES[name].parts(seed), convert(tmp_path / "object", tmp_path / "out"))
