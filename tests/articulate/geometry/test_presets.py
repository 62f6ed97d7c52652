from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.articulate.conversion.cabinets import CABINET, write_cabinet

from articulate.assets.asset import Asset
from articulate.conversion import ConvertConfig, convert
from articulate.conversion.metric_size import LONGEST_SIDE_M
from articulate.geometry.presets import (
    LARGE_HINGE,
    SLIDE,
    SMALL_HINGE,
    joint_dynamics,
    joint_preset,
    weight,
)
from articulate.simulator import mujoco

BODY_INERTIAL = (
    '<inertial><origin xyz="0.2 0.01 0.3"/><mass value="17.5"/>'
    '<inertia ixx="0.5" iyy="0.6" izz="0.4" ixy="0.01" ixz="-0.02" iyz="0.03"/></inertial>'
)


@pytest.mark.parametrize(
    ("damping", "friction", "expected"),
    [
        (3.0, 0.7, (3.0, 0.7)),
        (None, 0.7, (SLIDE.damping, 0.7)),
        (3.0, None, (3.0, SLIDE.frictionloss)),
        (None, None, (SLIDE.damping, SLIDE.frictionloss)),
        (0.0, 0.0, (SLIDE.damping, SLIDE.frictionloss)),
        (-1.0, -2.0, (SLIDE.damping, SLIDE.frictionloss)),
    ],
)
def test_what_the_file_says_of_a_joint_goes_before_the_preset(
    damping: float | None, friction: float | None, expected: tuple[float, float]
) -> None:
    assert joint_dynamics(SLIDE, damping, friction, rescaled=False) == expected


def test_dynamics_of_a_source_that_is_not_metric_mean_nothing() -> None:
    preset = (SMALL_HINGE.damping, SMALL_HINGE.frictionloss)
    assert joint_dynamics(SMALL_HINGE, 3.0, 0.7, rescaled=True) == preset


def test_presets_go_by_kind_and_mass() -> None:
    assert joint_preset("slide", 0.1) is SLIDE
    assert joint_preset("hinge", 0.5) is SMALL_HINGE
    assert joint_preset("hinge", 0.51) is LARGE_HINGE


def test_every_category_weighs_as_something_solid() -> None:
    assert weight("no such thing") == weight("unknown")
    for category in LONGEST_SIDE_M:
        assert 50.0 <= weight(category).density_kg_m3 <= 8000.0
        assert 0.1 <= weight(category).sheet_kg_m2 <= 40.0


def with_dynamics(folder: Path, dynamics: str, config: ConvertConfig | None = None) -> Asset:
    text = CABINET.replace('<axis xyz="0 0 1"/>', f'<axis xyz="0 0 1"/>{dynamics}')
    return convert(write_cabinet(folder, text), folder / "out", config)


def test_dynamics_of_the_file_reach_both_files_of_the_asset(tmp_path: Path) -> None:
    asset = with_dynamics(tmp_path, '<dynamics damping="0.35" friction="0.21"/>')
    door = asset.joint("door_joint")
    assert (door.damping, door.frictionloss) == (0.35, 0.21)
    model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
    address = int(model.joint("door_joint").dofadr[0])
    assert float(model.dof_damping[address]) == 0.35
    assert float(model.dof_frictionloss[address]) == 0.21
    assert 'damping="0.35" friction="0.21"' in (asset.folder / "object.urdf").read_text()
    drawer = asset.joint("drawer_joint")
    assert (drawer.damping, drawer.frictionloss) == (SLIDE.damping, SLIDE.frictionloss)


def test_dynamics_of_the_file_are_left_out_where_its_size_is_changed(tmp_path: Path) -> None:
    config = ConvertConfig(size_m=1.0)
    asset = with_dynamics(tmp_path, '<dynamics damping="0.35" friction="0.21"/>', config)
    door = asset.joint("door_joint")
    assert (door.damping, door.frictionloss) == (LARGE_HINGE.damping, LARGE_HINGE.frictionloss)


def test_the_fixed_body_weighs_what_the_file_says(tmp_path: Path) -> None:
    """Its frame moves to the ground under the middle; mass and inertia move with it."""
    text = CABINET.replace('<link name="body">', f'<link name="body">{BODY_INERTIAL}')
    asset = convert(write_cabinet(tmp_path, text), tmp_path / "out")
    assert asset.links[0].mass_kg == 17.5
    model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
    body = model.body("body")
    assert float(body.mass[0]) == 17.5
    # drawer_joint starts at (0, 0, 0.33) in the frame of the file
    shift = np.array(asset.link("drawer").pos_o) - [0.0, 0.0, 0.33]
    np.testing.assert_allclose(body.ipos, np.array([0.2, 0.01, 0.3]) + shift, atol=1e-9)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    turned = rotation.reshape(3, 3)
    given = np.array([[0.5, 0.01, -0.02], [0.01, 0.6, 0.03], [-0.02, 0.03, 0.4]])
    np.testing.assert_allclose(turned @ np.diag(body.inertia) @ turned.T, given, atol=1e-9)


def test_the_fixed_body_of_a_turned_root_keeps_its_inertia(tmp_path: Path) -> None:
    """The root's own link lies a quarter turn round z from the base that carries it."""
    text = CABINET.replace('<link name="body">', f'<link name="body">{BODY_INERTIAL}').replace(
        '<joint name="fix"',
        '<link name="base"/><joint name="turn" type="fixed"><parent link="base"/>'
        f'<child link="body"/><origin rpy="0 0 {math.pi / 2!r}"/></joint><joint name="fix"',
    )
    asset = convert(write_cabinet(tmp_path, text), tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
    body = model.body("body")
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, body.iquat)
    turned = rotation.reshape(3, 3)
    # x becomes y, y becomes -x
    expected = np.array([[0.6, -0.01, -0.03], [-0.01, 0.5, -0.02], [-0.03, -0.02, 0.4]])
    np.testing.assert_allclose(turned @ np.diag(body.inertia) @ turned.T, expected, atol=1e-9)


def test_the_fixed_body_of_a_source_that_is_not_metric_weighs_what_its_shapes_do(
    tmp_path: Path,
) -> None:
    text = CABINET.replace('<link name="body">', f'<link name="body">{BODY_INERTIAL}')
    config = ConvertConfig(size_m=1.0)
    asset = convert(write_cabinet(tmp_path / "given", text), tmp_path / "one", config)
    plain = convert(write_cabinet(tmp_path / "plain"), tmp_path / "two", config)
    assert asset.links[0].mass_kg == plain.links[0].mass_kg
