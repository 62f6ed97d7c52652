"""Joint type and axis from images of known motion."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from articulate.commands.observe import main
from articulate.errors import UsageError
from articulate.render.joint_video import Video
from articulate.transforms import axis_angle_to_matrix
from articulate.video.joint_classifier import joint_classifier
from articulate.video.observe import observe_joint

SIDE = 240
FOCAL_RATIO = 1.1 * SIDE
LOOKING_DOWN = axis_angle_to_matrix(np.array([1.0, 0.0, 0.0]), -0.45)


def textured(seed, size=SIDE):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (size // 8, size // 8, 3)).astype(np.uint8)
    return cv2.resize(coarse, (size, size), interpolation=cv2.INTER_NEAREST)


def video_of(pose_of, n_frames=24):
    """A textured square of side 1, three away, moved by ``pose_of(share)``, before a wall."""
    wall, patch = textured(0), textured(1, 160)
    square = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]])
    source = np.array([[0, 0], [159, 0], [159, 159], [0, 159]], dtype=np.float32)
    frames = []
    for t in range(n_frames):
        points = pose_of(square, t / (n_frames - 1)) + np.array([0.0, 0.0, 3.0])
        uv = (FOCAL_RATIO * points[:, :2] / points[:, 2:] + SIDE / 2).astype(np.float32)
        H = cv2.getPerspectiveTransform(source, uv)
        warped = cv2.warpPerspective(patch, H, (SIDE, SIDE))
        mask = cv2.warpPerspective(np.full((160, 160), 255, np.uint8), H, (SIDE, SIDE))
        frames.append(np.where(mask[..., None] > 127, warped, wall))
    return Video(frames=np.stack(frames), times_s=np.arange(n_frames) / 20.0)


def hinged(square, share):
    turn = 1.3 * share
    arm = square[:, 0] + 0.5
    points = np.column_stack([arm * np.cos(turn) - 0.5, square[:, 1], -arm * np.sin(turn)])
    return points @ LOOKING_DOWN.T


def test_a_part_that_slides_across_the_image_slides_along_its_path():
    seen = observe_joint(
        video_of(lambda square, s: square + np.array([0.0, 0.7 * s - 0.3, 0.0])), "clip"
    )
    assert seen.kind == "prismatic"
    assert seen.axis_c[1] > 0.97  # down, as it goes


def test_a_part_that_approaches_slides_along_the_line_of_sight():
    seen = observe_joint(
        video_of(lambda square, s: square + np.array([0.0, 0.0, -1.2 * s])), "clip"
    )
    assert seen.kind == "prismatic"
    assert seen.axis_c[2] < -0.97


def test_a_door_turns_about_the_vertical():
    seen = observe_joint(video_of(hinged), "clip")
    assert seen.kind == "revolute"
    assert abs(np.dot(seen.axis_c, LOOKING_DOWN[:, 1])) > 0.97
    assert seen.side == "left"


def test_a_video_without_motion_is_rejected():
    with pytest.raises(UsageError, match="clip: nothing moves"):
        observe_joint(video_of(lambda square, s: square), "clip")


def test_the_command_prints_the_observation(tmp_path, capsys):
    path = video_of(lambda q, s: q + np.array([0.7 * s - 0.3, 0.0, 0.0])).write(tmp_path / "a.mp4")
    assert main([str(path)]) == 0
    assert capsys.readouterr().out.startswith("prismatic with probability ")


def test_an_uncertain_type_is_doubtful_and_exits_3(tmp_path, capsys, monkeypatch):
    path = video_of(lambda q, s: q + np.array([0.7 * s - 0.3, 0.0, 0.0])).write(tmp_path / "a.mp4")
    strict = replace(joint_classifier(), doubtful_below=1.1)
    monkeypatch.setattr("articulate.video.observe.joint_classifier", lambda: strict)
    assert main([str(path), "--json"]) == 3
    printed = capsys.readouterr()
    seen = json.loads(printed.out)
    assert seen["doubtful"] is True
    assert seen["confidence"] == max(seen["p_revolute"], 1.0 - seen["p_revolute"])
    assert "doubtful" in printed.err


def test_a_dark_video_is_rejected():
    dark = video_of(hinged)
    frames = (dark.frames // 32).astype(np.uint8)
    with pytest.raises(UsageError, match="clip: too dark"):
        observe_joint(Video(frames=frames, times_s=dark.times_s), "clip")


def test_a_short_video_is_rejected():
    with pytest.raises(UsageError, match="clip: has 4 frames, too short"):
        observe_joint(video_of(hinged, n_frames=4), "clip")
