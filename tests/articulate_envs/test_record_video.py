"""Gymnasium's video wrapper records an environment; it requires moviepy, of the extra ``sim``."""

import gymnasium
import numpy as np
import pytest

from articulate_envs.gym_env import ArticulateEnv


@pytest.mark.render
@pytest.mark.filterwarnings("ignore::SyntaxWarning:moviepy")
@pytest.mark.filterwarnings("ignore::DeprecationWarning:moviepy")
def test_gymnasium_records_a_video(drawer, tmp_path):
    env = ArticulateEnv(scene=drawer, render_mode="rgb_array", width=64, height=48)
    recorder = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "videos"), video_length=3)
    recorder.reset(seed=0)
    for _ in range(5):
        recorder.step(np.zeros(8, dtype=np.float32))
    recorder.close()
    (video,) = (tmp_path / "videos").glob("*.mp4")
    assert video.stat().st_size > 1000
