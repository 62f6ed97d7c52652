"""Stable-Baselines3 takes our gymnasium environments; torch is allowed here and not in envs."""

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.monitor import Monitor

from articulate_envs.gym_env import ArticulateEnv


@pytest.fixture
def env(drawer):
    made = ArticulateEnv(scene=drawer)
    yield made
    made.close()


@pytest.mark.render
def test_their_checker_finds_nothing(drawer):
    """Warnings are errors here."""
    env = ArticulateEnv(scene=drawer, render_mode="rgb_array", width=64, height=48)
    check_env(env, warn=True, skip_render_check=False)
    env.close()


def test_their_ppo_learns_on_it_and_counts_its_episodes(env, drawer):
    model = PPO("MlpPolicy", Monitor(env), n_steps=32, batch_size=16, n_epochs=1, device="cpu")
    model.learn(64)
    assert model.ep_info_buffer is not None
    (first, *_) = model.ep_info_buffer
    assert first["l"] == drawer.n_steps
    action, _ = model.predict(env.reset(seed=0)[0], deterministic=True)
    assert np.isfinite(env.step(action)[0]).all()
