from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from articulate.transforms import pose
from articulate_envs.video import SceneRenderer, render_png, write_episode_video

SMALL = (160, 120)


def _positions(scene, opened=0.0):
    q = np.zeros(scene.nominal.nq)
    q[scene.at.arm_q : scene.at.arm_q + 7] = scene.placement.start_q
    q[scene.at.finger_q : scene.at.finger_q + 2] = (0.04, -0.04)
    joint = scene.asset.joint(scene.task.joint)
    q[scene.at.part_q] = joint.closed + opened * joint.span
    return q


@pytest.mark.render
def test_frames_show_the_same_for_the_same_positions_and_another_for_others(drawer):
    qpos = np.stack([_positions(drawer), _positions(drawer), _positions(drawer, 0.8)])
    with SceneRenderer(drawer, size=SMALL) as film:
        first, again, opened = film.frames(qpos)
    assert first.shape == (120, 160, 3)
    np.testing.assert_array_equal(first, again)
    assert np.mean(np.any(first != opened, axis=2)) > 0.01
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 100


@pytest.mark.render
def test_size_and_pose_of_the_episodes_object_are_shown(drawer):
    q, T_wo = _positions(drawer), drawer.placement.T_wo()
    with SceneRenderer(drawer, size=SMALL) as film:
        view = film.choose_view(q[None])
        nominal = film.frame(q)
    for scale, shift in ((1.1, (0.0, 0.0, 0.0)), (1.0, (0.0, 0.05, 0.0))):
        with SceneRenderer(drawer, scale=scale, T_wo=pose(shift) @ T_wo, size=SMALL) as film:
            assert np.mean(np.any(film.frame(q, view) != nominal, axis=2)) > 0.02


@pytest.mark.render
def test_hand_and_handle_are_in_the_picture_from_a_side_that_the_arm_does_not_hide(door):
    qpos = np.stack([_positions(door, opened) for opened in (0.0, 0.4, 0.8)])
    with SceneRenderer(door, size=SMALL) as film:
        view = film.choose_view(qpos)
    assert 30.0 < abs(view.azimuth_deg) < 120.0
    assert 0.5 < view.distance_m < 6.0
    assert 0.0 < view.lookat_w[0] < 1.0


@pytest.mark.render
def test_a_clip_has_a_frame_for_each_tick_at_their_rate(drawer, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    qpos = np.stack([_positions(drawer, opened) for opened in np.linspace(0.0, 0.8, 12)])
    path = write_episode_video(
        tmp_path / "videos" / "success.mp4", drawer, qpos, step_s=0.05, size=SMALL
    )
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == 12
    assert seconds == pytest.approx(0.6, abs=0.02)
    assert path.read_bytes()[4:8] == b"ftyp"
    assert path.stat().st_size < 60_000
    assert [p.name for p in path.parent.iterdir()] == ["success.mp4"]


@pytest.mark.render
def test_a_picture_is_a_png_of_the_asked_size(drawer):
    image = Image.open(BytesIO(render_png(drawer, _positions(drawer), size=SMALL)))
    assert (image.format, image.size) == ("PNG", SMALL)
