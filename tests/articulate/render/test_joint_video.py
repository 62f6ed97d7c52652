from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from articulate.render.camera import look_at, pinhole
from articulate.render.joint_video import (
    FULL_TURN_RAD,
    Video,
    poses_of_parts,
    render_video,
    sweep_positions,
)
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene
from articulate.transforms import pose


@pytest.mark.parametrize(
    ("limits", "ends"),
    [((0.0, 1.5), (0.0, 1.5)), ((-0.4, 0.6), (0.6, -0.4)), ((-1.0, 0.0), (0.0, -1.0))],
)
def test_a_sweep_goes_from_end_to_end_and_begins_as_the_released_code_does(limits, ends):
    q = sweep_positions(limits[0], limits[1], 50)
    assert (q[0], q[-1], len(q)) == (*ends, 50)
    assert np.allclose(np.diff(q), np.diff(q)[0])


def test_a_joint_without_limits_turns_by_more_than_a_whole_turn():
    q = sweep_positions(None, None, 30)
    assert q[-1] - q[0] == pytest.approx(FULL_TURN_RAD)
    assert pytest.approx(2.0 * np.pi + 0.5) == FULL_TURN_RAD


def test_a_single_limit_is_rejected(error_line):
    error_line("sweep_positions(0.0, None, 10)", lambda: sweep_positions(0.0, None, 10))


def test_a_video_of_one_frame_is_rejected(error_line):
    error_line("sweep_positions(0.0, 1.0, 1)", lambda: sweep_positions(0.0, 1.0, 1))


def sliding_square() -> Video:
    corners = np.array([[0, -0.2, -0.2], [0, 0.2, -0.2], [0, 0.2, 0.2], [0, -0.2, 0.2]])
    scene = PartScene([plain_part("a", corners, np.array([[0, 1, 2], [0, 2, 3]]), (1, 0, 0))])
    camera = pinhole(width_px=65, height_px=48, fovy_rad=0.9, T_wc=look_at((2, 0, 0), (0, 0, 0)))
    ways = np.zeros((12, 3))
    ways[:, 1] = np.linspace(-0.5, 0.5, 12)
    return render_video(scene, camera, poses_of_parts(1, [0], pose(ways)), fps=12.0)


def test_a_video_shows_the_part_at_its_position_in_each_frame():
    clip = sliding_square()
    columns = [np.flatnonzero(frame[24, :, 1] < 100).mean() for frame in clip.frames]
    assert np.all(np.diff(columns) > 1.0)  # seen from +x, +y is to the right
    assert clip.fps == pytest.approx(12.0)


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_video_is_read_back_as_written(tmp_path, suffix):
    clip = sliding_square()
    path = clip.write(tmp_path / f"clip{suffix}")
    reader, frames = cv2.VideoCapture(str(path)), []
    while (read := reader.read())[0]:
        frames.append(read[1][..., ::-1])
    reader.release()
    back = np.stack(frames)
    assert back.shape == (12, 48, 64, 3)
    assert np.abs(back.astype(int) - clip.frames[:, :, :64]).mean() < 6.0
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_video_of_another_format_is_rejected(error_line):
    error_line('Video.write("clip.gif")', lambda: sliding_square().write(Path("clip.gif")))


def test_a_subsampled_video_keeps_its_ends():
    thin = sliding_square().subsample(4)
    assert len(thin.frames) == 4
    assert (thin.times_s[0], thin.times_s[-1]) == (0.0, pytest.approx(11.0 / 12.0))
