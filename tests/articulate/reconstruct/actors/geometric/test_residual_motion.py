"""Several joints that move in one clip."""

from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.geometric.test_video import (
    DOOR,
    DRAWER,
    PARTS,
    evidence_of,
)

from articulate.reconstruct.actors.geometric.parts import residual_evidence
from articulate.reconstruct.actors.geometric.video import video_actor
from articulate.reconstruct.actors.protocol import Prediction
from articulate.render.joint_video import render_video
from articulate.render.scene import PartScene

N_FRAMES = 16


@pytest.fixture(scope="module")
def both():
    """The drawer goes in while the door closes, which begins and ends later."""
    evidence = evidence_of(DRAWER, N_FRAMES)
    poses = np.tile(np.eye(4), (N_FRAMES, len(PARTS), 1, 1))
    share = np.linspace(0.0, 1.0, N_FRAMES)
    names = [part.name for part in PARTS]
    first, later = np.clip(share / 0.7, 0, 1), np.clip((share - 0.3) / 0.7, 0, 1)
    poses[:, names.index("drawer")] = DRAWER.T_o(0.4 - 0.4 * first)
    poses[:, names.index("door")] = DOOR.T_o(-1.2 + 1.2 * later)
    clip = render_video(PartScene(PARTS), evidence.camera, poses)
    return replace(evidence, video=clip.frames, times_s=clip.times_s)


def span(joint):
    """How far a joint goes [m or rad]."""
    assert joint.lower is not None
    assert joint.upper is not None
    return joint.upper - joint.lower


def test_nothing_is_left_once_the_joint_that_moves_is_known():
    evidence = evidence_of(DRAWER, N_FRAMES)
    assert residual_evidence(evidence, Prediction(joints=(DRAWER,))) is None
    assert residual_evidence(evidence, Prediction(joints=())) is None
    assert residual_evidence(replace(evidence, video=None), Prediction(joints=(DRAWER,))) is None


def test_what_else_moves_is_left_and_what_is_known_stands_still(both):
    left = residual_evidence(both, Prediction(joints=(DRAWER,)))
    assert left is not None
    assert left.video is not None
    changes = np.ptp(left.video.astype(int), axis=0).max(axis=-1) > 20
    assert changes.sum() > 500
    assert residual_evidence(left, Prediction(joints=(DOOR,))) is None


def test_a_drawer_and_a_door_that_move_in_one_clip_are_both_found(both):
    found = video_actor(calibrate=False).predict(both)
    kinds = {joint.part: joint for joint in found.joints if joint.kind != "fixed"}
    assert set(kinds) == {"drawer", "door"}
    assert kinds["drawer"].kind == "prismatic"
    assert abs(kinds["drawer"].axis_o[0]) > 0.99
    assert span(kinds["drawer"]) == pytest.approx(0.4, abs=0.05)
    assert kinds["door"].kind == "revolute"
    assert abs(kinds["door"].axis_o[2]) > 0.98
    assert span(kinds["door"]) == pytest.approx(1.2, abs=0.15)
