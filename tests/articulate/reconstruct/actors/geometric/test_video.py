"""The actor of clips and its critic on a small cupboard whose joints are known."""

from dataclasses import replace

import numpy as np
import pytest

from articulate.errors import UsageError
from articulate.reconstruct.actors.geometric import critic
from articulate.reconstruct.actors.geometric.critic import RATING_CAPS, VideoCritic
from articulate.reconstruct.actors.geometric.parameters import CRITIC
from articulate.reconstruct.actors.geometric.video import (
    VideoProposer,
    video_actor,
    without_calibration,
    without_critic,
    without_tracks,
)
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video
from articulate.render.parts import joint_bounds, plain_part
from articulate.render.scene import PartScene

N_FRAMES = 14
BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def box(name, low, high, rgb):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    vertices = np.asarray(low) + corners * (np.asarray(high) - np.asarray(low))
    return plain_part(name, vertices, BOX_FACES, rgb)


def disc(name, middle, radius, rgb):
    """A round knob about x."""
    turn = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ring = np.column_stack([np.zeros(48), radius * np.cos(turn), radius * np.sin(turn)])
    points = (
        np.concatenate([ring, ring + np.array([0.06, 0, 0]), [[0, 0, 0], [0.06, 0, 0]]]) + middle
    )
    faces = []
    for k in range(48):
        n = (k + 1) % 48
        faces += [[k, n, 48 + k], [n, 48 + n, 48 + k], [96, n, k], [97, 48 + k, 48 + n]]
    return plain_part(name, points, np.array(faces), rgb)


PARTS = (
    box("back", (-0.4, -0.6, 0.0), (-0.3, 0.6, 1.4), (0.7, 0.6, 0.5)),
    box("shelf", (-0.3, -0.6, 0.0), (0.3, 0.6, 0.7), (0.6, 0.6, 0.7)),
    box("drawer", (-0.2, -0.5, 0.75), (0.35, 0.0, 0.95), (0.8, 0.3, 0.2)),
    box("door", (0.3, 0.05, 0.75), (0.34, 0.6, 1.35), (0.3, 0.5, 0.8)),
    disc("knob", (0.3, -0.3, 0.5), 0.07, (0.2, 0.2, 0.2)),
)
DRAWER = PredictedJoint(
    part="drawer", parent="back", kind="prismatic", axis_o=(1.0, 0.0, 0.0), lower=0.0, upper=0.4
)
DOOR = PredictedJoint(
    part="door",
    parent="back",
    kind="revolute",
    axis_o=(0.0, 0.0, 1.0),
    pivot_o=(0.3, 0.6, 0.0),
    lower=-1.4,
    upper=0.0,
)
KNOB = PredictedJoint(
    part="knob",
    parent="shelf",
    kind="continuous",
    axis_o=(1.0, 0.0, 0.0),
    pivot_o=(0.0, -0.3, 0.5),
)


def evidence_of(joint, n_frames=N_FRAMES):
    assert joint_bounds(PARTS)[0, 2] == 0.0
    upper = 2.0 * np.pi + 0.5 if joint.upper is None else joint.upper
    # Neither begins at 0 nor goes at an even pace.
    share = np.linspace(0.0, 1.0, n_frames) ** 1.5
    q = upper + (0.0 if joint.lower is None else joint.lower - upper) * share
    moving = [i for i, part in enumerate(PARTS) if part.name == joint.part]
    camera = front_camera(240, 180)
    clip = render_video(PartScene(PARTS), camera, poses_of_parts(len(PARTS), moving, joint.T_o(q)))
    return Evidence(
        modality="video", parts=PARTS, video=clip.frames, times_s=clip.times_s, camera=camera
    )


@pytest.fixture(scope="module")
def drawer():
    return evidence_of(DRAWER)


@pytest.fixture(scope="module")
def door():
    return evidence_of(DOOR)


def only(prediction):
    (joint,) = [j for j in prediction.joints if j.kind != "fixed"]
    return joint


def test_a_drawer_is_found_with_its_range(drawer):
    found = video_actor().predict(drawer)
    joint = only(found)
    assert (joint.part, joint.kind) == ("drawer", "prismatic")
    assert abs(np.dot(joint.axis_o, DRAWER.axis_o)) > np.cos(0.05)
    assert joint.upper - joint.lower == pytest.approx(0.4, abs=0.03)
    assert found.rating > 5.0  # type: ignore[operator]
    assert found.verdict.failure == "success"  # type: ignore[union-attr]
    assert len(found.attempts) == 1


def test_a_door_is_found_with_its_pivot_and_range(door):
    joint = only(video_actor().predict(door))
    assert (joint.part, joint.kind) == ("door", "revolute")
    assert abs(np.dot(joint.axis_o, DOOR.axis_o)) > np.cos(0.05)
    assert np.linalg.norm((np.subtract(joint.pivot_o, DOOR.pivot_o))[:2]) < 0.03
    assert joint.upper - joint.lower == pytest.approx(1.4, abs=0.08)
    ends = sorted(np.sign(joint.axis_o[2]) * np.array([joint.lower, joint.upper]))
    assert ends == pytest.approx([-1.4, 0.0], abs=0.08)


@pytest.mark.slow
def test_the_same_clip_gives_the_same_bits(drawer):
    first, second = (only(VideoProposer().propose(drawer, ())) for _ in range(2))
    assert first == second


def test_a_knob_that_shows_nothing_is_said_to_turn_with_little_confidence():
    still = replace(
        evidence_of(KNOB, 2), video=np.repeat(evidence_of(KNOB, 2).video[:1], 6, axis=0)
    )
    found = video_actor().predict(still)
    joint = only(found)
    assert (joint.part, joint.kind) == ("knob", "continuous")
    assert abs(joint.axis_o[0]) > 0.99
    assert joint.confidence < 0.5
    assert found.rating <= 5.0  # type: ignore[operator]


@pytest.mark.parametrize(
    ("change", "failure"),
    [
        ({}, "success"),
        ({"kind": "revolute", "pivot_o": (0.0, 0.0, 0.8)}, "joint_type"),
        ({"axis_o": (0.0, 0.0, 1.0)}, "joint_axis"),
        ({"upper": 0.2}, "joint_limit"),
        ({"upper": 0.8}, "joint_limit"),
    ],
)
def test_the_critic_names_what_is_wrong_with_a_slide(drawer, change, failure):
    said = Prediction(joints=(replace(DRAWER, **change),))
    verdict = VideoCritic().assess(drawer, said)
    assert verdict.failure == failure
    assert (verdict.rating > 5.0) == (failure == "success")


@pytest.mark.parametrize(
    ("change", "failure"),
    [
        ({}, "success"),
        ({"kind": "prismatic", "axis_o": (0.0, 1.0, 0.0), "lower": -0.4}, "joint_type"),
        ({"axis_o": (0.0, 1.0, 0.0), "pivot_o": (0.3, 0.0, 0.75)}, "joint_axis"),
        ({"pivot_o": (0.3, 0.3, 0.0)}, "joint_origin"),
        ({"lower": -0.7}, "joint_limit"),
    ],
)
def test_the_critic_names_what_is_wrong_with_a_hinge(door, change, failure):
    said = Prediction(joints=(replace(DOOR, **change),))
    verdict = VideoCritic().assess(door, said)
    assert verdict.failure == failure
    assert (verdict.rating > 5.0) == (failure == "success")


def test_a_prediction_that_nothing_moves_is_rated_worst(drawer):
    assert VideoCritic().assess(drawer, Prediction(joints=())).rating == 0.0
    still = Prediction(joints=(replace(DRAWER, lower=0.1, upper=0.1),))
    assert VideoCritic().assess(drawer, still).rating < CRITIC.doubtful_rating


def test_a_joint_without_rivals_is_judged(drawer, monkeypatch):
    """Also one that explains less than if nothing moved."""
    monkeypatch.setattr(critic, "_rivals", lambda *_: {})
    verdict = VideoCritic().assess(drawer, Prediction(joints=(DOOR,)))
    assert verdict.figures["gain_as_predicted"] < 0.0
    assert verdict.rating <= 5.0


def test_a_joint_of_the_wrong_kind_is_rated_below_one_that_is_only_doubted(drawer):
    turn = replace(DRAWER, kind="revolute", pivot_o=(0.0, 0.0, 0.8))
    rating = VideoCritic().assess(drawer, Prediction(joints=(turn,))).rating
    assert rating <= RATING_CAPS["joint_type"] < CRITIC.doubtful_rating < RATING_CAPS["joint_axis"]


def test_without_tracks_edges_alone_are_asked(drawer):
    edges_alone = without_tracks().critic
    assert edges_alone is not None
    critics = (VideoCritic(), edges_alone)
    with_tracks, without = (one.assess(drawer, Prediction(joints=(DRAWER,))) for one in critics)
    assert with_tracks.figures["tracks"] > 0.0 == without.figures["tracks"]
    assert "track_error" not in without.figures
    assert without.failure == with_tracks.failure == "success"
    assert without.figures["edges"] == with_tracks.figures["edges"]


def test_ablations_leave_out_one_part_each():
    assert without_critic().critic is None
    assert without_critic().prepare is not None
    assert without_calibration().prepare is None
    assert without_calibration().critic == VideoCritic()


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"video": None}, "video of two frames"),
        ({"camera": None}, "needs the camera"),
        ({"placed": False}, "parts in their places"),
        ({"parts": ()}, "needs parts, one mesh"),
    ],
)
def test_incomplete_evidence_is_rejected(drawer, change, what):
    with pytest.raises(UsageError, match=what):
        VideoProposer().propose(replace(drawer, **change), ())
