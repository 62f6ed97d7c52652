"""The camera of a clip, sought together with what moves in it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.geometric.test_camera import carried, off
from tests.articulate.reconstruct.actors.geometric.test_video import DOOR, PARTS, box, evidence_of

from articulate.reconstruct.actors.geometric import camera
from articulate.reconstruct.actors.geometric.camera import (
    calibrate_evidence,
    camera_from_motion,
    refine_camera,
)
from articulate.reconstruct.actors.geometric.compositing import perturb_camera
from articulate.reconstruct.actors.geometric.image_pyramid import build_scene
from articulate.reconstruct.actors.geometric.parameters import JOINT_FIT
from articulate.reconstruct.actors.geometric.search import MotionFit
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.reconstruct.actors.protocol import Evidence
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video
from articulate.render.scene import PartScene
from articulate.transforms import inverse

LAPTOP = (
    box("base", (-0.4, -0.5, 0.0), (0.4, 0.5, 0.06), (0.3, 0.3, 0.35)),
    box("lid", (-0.4, -0.5, 0.06), (0.4, 0.5, 0.1), (0.7, 0.5, 0.3)),
)
LID = JointMotion("turn", np.array([0.0, 1.0, 0.0]), np.array([-0.4, 0.0, 0.06]), "truth")
LID_RAD = np.linspace(0.0, -1.9, 24)
DOOR_HINGE = JointMotion("turn", np.array(DOOR.axis_o), np.array(DOOR.pivot_o), "truth")


@pytest.fixture(scope="module")
def laptop():
    """A lid that sweeps over all of the base as it is seen."""
    camera = front_camera(240, 180)
    clip = render_video(PartScene(LAPTOP), camera, poses_of_parts(2, [1], LID.T_o(LID_RAD)))
    return Evidence(
        modality="video", parts=LAPTOP, video=clip.frames, times_s=clip.times_s, camera=camera
    )


@pytest.fixture(scope="module")
def door():
    return evidence_of(DOOR)


@pytest.mark.parametrize(
    "axis", [pytest.param((0.0, 0.0, 1.0), marks=pytest.mark.slow), (0.0, 1.0, 0.0)]
)
def test_a_camera_is_found_where_next_to_nothing_stands_still(laptop, axis):
    told = carried(laptop.camera, axis, 5.0, 0.05)
    assert refine_camera(laptop.video, told, LAPTOP) == (told, 0.0)
    found, gain = camera_from_motion(build_scene(laptop.video, told, LAPTOP))
    assert gain > JOINT_FIT.min_gain
    before, after = (off(camera, laptop.camera) for camera in (told, found))
    assert after[0] < 0.4 * before[0]
    assert after[1] < 0.4 * before[1]


def test_what_was_done_is_told(laptop):
    told = replace(laptop, camera=carried(laptop.camera, (0.0, 0.0, 1.0), 5.0, 0.05))
    better, (step,) = calibrate_evidence(told)
    assert step.figures["explains_better"] == 0.0
    assert step.figures["explains_motion_better"] > JOINT_FIT.min_gain
    assert off(better.camera, laptop.camera) < off(told.camera, laptop.camera)


def test_the_true_camera_is_left_alone(laptop, door):
    for evidence in (laptop, door):
        scene = build_scene(evidence.video, evidence.camera, evidence.parts)
        assert camera_from_motion(scene) == (evidence.camera, 0.0)


def first_level(evidence, told, fit, frames):
    scene = build_scene(evidence.video, told, evidence.parts)
    return camera._hypothesis(scene, fit, frames, JOINT_FIT.first_level, np.zeros(6))


def test_steps_lead_to_the_camera_and_the_positions_of_a_known_motion(laptop):
    told = carried(laptop.camera, (0.0, 0.0, 1.0), 5.0, 0.05)
    frames = np.array([0, 4, 8, 12, 16, 20, 23])
    fit = MotionFit(LID, LID_RAD[frames] + 0.06, 0.0, (1,))
    first = first_level(laptop, told, fit, frames)
    _, _, still = camera._optimize(first, np.zeros(6), fit.q, turned=False)
    x, q, cost = camera._optimize(first, np.zeros(6), fit.q)
    assert cost < 0.5 * still
    found = told.at(inverse(perturb_camera(told.T_cw, first.middle_o, x)))
    assert off(found, laptop.camera)[0] < 1.5
    np.testing.assert_allclose(q, LID_RAD[frames], atol=0.06)


def test_positions_alone_leave_the_camera_where_it_is(door):
    fit = MotionFit(DOOR_HINGE, np.zeros(2), 0.0, (3,))
    first = first_level(door, door.camera, fit, np.array([0, len(door.video) // 2]))
    start = np.full(6, 0.01)
    x, q, _ = camera._optimize(first, start, fit.q, turned=False)
    np.testing.assert_array_equal(x, start)
    assert np.abs(q).max() > 0.0


def test_corners_of_what_moves_alone_are_moved(door):
    fit = MotionFit(DOOR_HINGE, np.zeros(1), 0.0, (3,))
    first = first_level(door, door.camera, fit, np.array([0]))
    rest, turned = (first.seen(np.zeros(6), q).points_c for q in (0.0, -1.0))
    changed = np.flatnonzero(np.abs(turned - rest).max(axis=1) > 1e-9)
    assert len(changed) > 0
    assert set(changed) <= set(first.corners.tolist())
    assert len(first.corners) < len(rest)
    assert [PARTS[k].name for k in fit.parts] == ["door"]
