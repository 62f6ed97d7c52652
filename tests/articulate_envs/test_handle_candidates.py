"""Other places to hold or to push, and what the expert does with them."""

import dataclasses

import numpy as np
import pytest

from articulate.library.procedural.build import linked, shape, slide
from articulate.library.procedural.urdf import Part, write_urdf
from articulate.preparation.prepare import load_checked_asset
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate.task.task import make_task
from articulate_envs.feasibility import estimate_feasibility
from articulate_envs.handle_candidates import handle_candidates
from articulate_envs.physics import PhysicsConfig
from articulate_envs.placement_search import find_placement
from articulate_envs.scene import build_scene


def scene_at(asset, handle, task_name):
    """A scene in which the gripper is used at ``handle``."""
    held = asset.with_handle(handle)
    task = make_task(task_name, held, handle.joint)
    placement = find_placement(held, task, PANDA, NO_RANDOMIZATION)
    return build_scene(
        held,
        task,
        arm=PANDA,
        control=ControlConfig(),
        physics=PhysicsConfig(),
        placement=dataclasses.replace(placement, handle=handle),
    )


def test_the_own_handle_comes_first_and_a_push_only_for_closing(door):
    asset, joint = door.asset, door.task.joint
    opening = list(handle_candidates(asset, joint, closes=False))
    closing = list(handle_candidates(asset, joint, closes=True))
    assert opening[0] == asset.handle_of(joint)
    assert all(handle.kind != "push" for handle in opening)
    assert closing[-1].kind == "push"
    assert [h.joint for h in closing] == [joint] * len(closing)


def test_candidates_are_different_places(door):
    found = list(handle_candidates(door.asset, door.task.joint, closes=False))
    for k, a in enumerate(found):
        for b in found[:k]:
            apart = np.linalg.norm(np.subtract(a.pos_l, b.pos_l))
            assert apart >= 0.02 or np.dot(a.normal_l, b.normal_l) < 0.95


def test_the_expert_closes_a_door_without_a_handle_by_pushing(closing_door):
    asset, joint = closing_door.asset, closing_door.task.joint
    push = list(handle_candidates(asset, joint, closes=True))[-1]
    scene = scene_at(asset, push, "close_door")
    found = estimate_feasibility(scene, n_episodes=8, randomization=NO_RANDOMIZATION)
    assert found.success == pytest.approx(1.0)


def test_the_expert_hooks_a_drawer_that_is_too_thick_to_hold(tmp_path):
    wide = (-0.15, 0.15)
    boxes = {
        "body": ((-0.297, 0.0), wide, (0.0, 0.3)),
        "front": ((-0.39, -0.3), wide, (0.0, 0.36)),  # rises above the body
    }
    shapes = {name: shape(name, "oak", {name: box}, 40.0) for name, box in boxes.items()}
    motion = slide("body", "front", (-0.3, 0.0, 0.0), (-1.0, 0.0, 0.0), 0.3)
    links = [
        Part(name="body", shapes=(shapes["body"],)),
        Part(name="front", shapes=(shapes["front"],), motion=motion),
    ]
    write_urdf("drawer", linked(links), tmp_path)
    asset = load_checked_asset(tmp_path / "drawer.urdf", tmp_path / "cache")
    hook = next(handle_candidates(asset, asset.joints[0].name, closes=False))
    assert hook.kind == "hook"
    scene = scene_at(asset, hook, "open_drawer")
    found = estimate_feasibility(scene, n_episodes=8, randomization=NO_RANDOMIZATION)
    assert found.success == pytest.approx(1.0)


def test_a_smaller_target_is_a_share_of_the_range(door):
    half = make_task("open_door", door.asset, door.task.joint, target_open=0.4)
    usual = make_task("open_door", door.asset, door.task.joint)
    assert half.target == pytest.approx(usual.target / 2.0)
