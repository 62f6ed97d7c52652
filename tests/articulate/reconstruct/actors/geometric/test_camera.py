"""The camera of a clip, sought from what does not move."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.articulate.reconstruct.actors.geometric.test_video import DOOR, PARTS, evidence_of

from articulate.reconstruct.actors.geometric.camera import (
    calibrate_evidence,
    refine_camera,
    stabilize,
)
from articulate.reconstruct.actors.geometric.compositing import perturb_camera
from articulate.render.camera import front_camera
from articulate.render.parts import joint_bounds
from articulate.transforms import apply, axis_angle_to_matrix, pose

MIDDLE = joint_bounds(PARTS).mean(axis=0)


@pytest.fixture(scope="module")
def evidence():
    return evidence_of(DOOR)


def carried(camera, axis, degrees, share):
    """``camera`` carried round the object, and ``share`` farther from it."""
    R = axis_angle_to_matrix(np.asarray(axis, dtype=float), np.radians(degrees))
    T = pose(MIDDLE - R @ MIDDLE, R) @ camera.T_wc
    T[:3, 3] += share * (T[:3, 3] - MIDDLE)
    return camera.at(T)


def off(one, other):
    """Angle [deg] and distance [m] between two cameras."""
    R = one.T_wc[:3, :3].T @ other.T_wc[:3, :3]
    turn = np.degrees(np.arccos(np.clip((np.trace(R) - 1.0) / 2.0, -1.0, 1.0)))
    return turn, np.linalg.norm(one.T_wc[:3, 3] - other.T_wc[:3, 3])


numbers = st.floats(-0.3, 0.3)


@given(st.lists(numbers, min_size=6, max_size=6).map(np.array))
@settings(max_examples=50)
def test_the_object_seems_to_turn_about_its_middle_shift_and_recede(x):
    T_co = front_camera(240, 180).T_cw
    T = perturb_camera(T_co, MIDDLE, x)
    before, after = apply(T_co, MIDDLE), apply(T, MIDDLE)
    np.testing.assert_allclose(after[2], before[2] * np.exp(x[5]))
    np.testing.assert_allclose(after[:2] / after[2], before[:2] / before[2] + x[3:5])
    turn = T[:3, :3] @ T_co[:3, :3].T
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    cosine = np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)
    assert np.arccos(cosine) == pytest.approx(np.linalg.norm(x[:3]), abs=1e-6)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.6, 0.0, -0.8)])
def test_a_camera_that_was_told_five_degrees_off_is_found(evidence, axis):
    told = carried(evidence.camera, axis, 5.0, 0.05)
    turn, away = off(told, evidence.camera)
    assert turn == pytest.approx(5.0)
    found, gain = refine_camera(evidence.video, told, evidence.parts)
    left_turn, left_away = off(found, evidence.camera)
    assert gain > 0.3
    assert left_turn < 2.5
    assert left_away < 0.4 * away


def test_the_true_camera_is_left_alone(evidence):
    found, gain = refine_camera(evidence.video, evidence.camera, evidence.parts)
    assert found is evidence.camera
    assert gain == 0.0


def test_a_clip_that_shows_nothing_but_what_moves_says_nothing_of_the_camera(evidence):
    told = carried(evidence.camera, (0.0, 0.0, 1.0), 5.0, 0.0)
    door = tuple(part for part in PARTS if part.name == "door")
    assert refine_camera(evidence.video, told, door) == (told, 0.0)


BOX = (80, 160, 60, 220)
"""Where the patch is seen."""


def shaken(n_frames=16, step_px=2.5):
    """A patch that slides over a wall before a camera that swings, and the camera's shifts."""
    rng = np.random.default_rng(3)
    wall = cv2.resize(rng.integers(0, 255, (60, 80, 3), dtype=np.uint8), (640, 480))
    patch = cv2.resize(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8), (48, 48))
    shifts = np.column_stack(
        [step_px * np.arange(n_frames), 6.0 * np.sin(0.5 * np.arange(n_frames))]
    )
    frames = []
    for t, (dx, dy) in enumerate(shifts):
        picture = wall.copy()
        picture[150 + 5 * t : 198 + 5 * t, 200:248] = patch
        frames.append(
            cv2.warpAffine(picture, np.array([[1.0, 0, -100 - dx], [0, 1.0, -80 - dy]]), (320, 240))
        )
    return np.stack(frames), shifts


def test_a_camera_that_swings_is_steadied():
    clip, shifts = shaken()
    steady, shift = stabilize(clip, BOX)
    assert shift == pytest.approx(np.linalg.norm(shifts, axis=1).max(), abs=1.5)
    inner = np.s_[:, 20:220, 160:270]  # beside the patch and what comes in at the rim
    left = np.abs(steady[inner].astype(float) - clip[0][inner[1:]]).mean()
    assert left < 0.2 * np.abs(clip[inner].astype(float) - clip[0][inner[1:]]).mean()


def test_a_camera_that_stands_still_is_left_alone(evidence):
    clip, _ = shaken(step_px=0.0)
    still = np.repeat(clip[:1], 8, axis=0)
    assert stabilize(still, BOX)[0] is still
    assert stabilize(evidence.video, (60, 180, 40, 160))[0] is evidence.video


def test_what_moves_before_a_plain_wall_is_no_motion_of_the_camera():
    clip, _ = shaken()
    clip[:, :60], clip[:, 220:], clip[:, :, :80], clip[:, :, 160:] = 200, 200, 200, 200
    assert stabilize(clip, BOX)[0] is clip


def test_what_was_done_is_told_and_nothing_is_where_nothing_was(evidence):
    same, steps = calibrate_evidence(evidence)
    assert same is evidence
    assert steps == ()
    told = replace(evidence, camera=carried(evidence.camera, (0.0, 0.0, 1.0), 5.0, 0.05))
    better, (step,) = calibrate_evidence(told)
    assert step.figures["shake_px"] == 0.0
    assert step.figures["explains_better"] > 0.3
    assert better.camera is not None
    assert off(better.camera, evidence.camera) < off(told.camera, evidence.camera)
    without = replace(evidence, video=None)
    assert calibrate_evidence(without)[0] is without
