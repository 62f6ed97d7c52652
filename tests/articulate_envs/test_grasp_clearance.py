"""Grasps beside the middle of a handle, where the next door has one too."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.assets import make_cupboard
from tests.scenes import make_scene

from articulate.robot.config import ControlConfig
from articulate.task.object_placement import handle_in_world
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_envs.feasibility import estimate_feasibility
from articulate_envs.grasp_clearance import BESIDE_M, check_grasp, shift_beside
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import build_scene


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """A door whose handle has another one 5 cm to its right, in episodes of ten seconds."""
    asset = make_cupboard(tmp_path_factory.mktemp("crowded"), degrees=75.0, neighbour_m=0.05)
    return make_scene(asset, "door_hinge", draws=NO_RANDOMIZATION, episode_s=10.0)


def beside(scene, beside_m):
    """The scene with the grasp shifted."""
    return build_scene(
        scene.asset,
        scene.task,
        arm=scene.arm,
        control=ControlConfig(),
        physics=PhysicsConfig(),
        placement=dataclasses.replace(scene.placement, beside_m=beside_m),
    )


def handle_w(scene):
    """Pose of the closed handle in the world."""
    return handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=scene.placement.T_wo()[None],
        scale=np.ones(1),
        opened=np.zeros(1),
        flip=scene.placement.flip,
    )[0]


def test_a_handle_with_room_is_held_at_its_middle(door):
    assert shift_beside(door) == 0.0


def test_the_gripper_stays_clear_of_the_next_handle(crowded):
    shift_m = shift_beside(crowded)
    shifted = beside(crowded, shift_m)
    assert shift_m in BESIDE_M
    assert check_grasp(shifted) == 0.0
    moved = handle_w(shifted)[:3, 3] - handle_w(crowded)[:3, 3]
    assert_allclose(np.linalg.norm(moved), abs(shift_m), atol=1e-12)
    left_w = crowded.placement.T_wo()[:3, 1]  # the next handle is at the right
    assert_allclose(moved @ left_w, abs(shift_m), atol=1e-9)


def test_the_expert_opens_the_door_from_beside_the_handle(crowded):
    shifted = beside(crowded, shift_beside(crowded))
    found = estimate_feasibility(shifted, n_episodes=8, randomization=NO_RANDOMIZATION)
    assert found.success == pytest.approx(1.0)


@pytest.mark.parametrize("neighbour_m", [0.025, 0.03, 0.035, 0.04, 0.06])
def test_the_next_handle_is_never_between_the_fingers(tmp_path, neighbour_m):
    """Fingers that hold two handles open neither; a shift is away from the next one."""
    asset = make_cupboard(tmp_path, degrees=75.0, neighbour_m=neighbour_m)
    scene = make_scene(asset, "door_hinge", draws=NO_RANDOMIZATION)
    moved = handle_w(beside(scene, shift_beside(scene)))[:3, 3] - handle_w(scene)[:3, 3]
    assert moved @ scene.placement.T_wo()[:3, 1] >= 0.0
