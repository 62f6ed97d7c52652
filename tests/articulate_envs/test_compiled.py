"""Compiled functions give the numbers of the same functions in plain Python."""

import copy
import subprocess
import sys
from typing import cast

import numpy as np
from numpy.testing import assert_allclose
from tests.scenes import DRAWS

from articulate_envs.compiled.post_step import post_step
from articulate_envs.compiled.step import pre_step, refresh
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.rewards import RewardConfig
from articulate_envs.threaded_engine import ThreadEngine

N = 4


def steps(scene, count=25):
    """Observations and rewards of some control steps."""
    episodes = Episodes(
        ThreadEngine(scene, N),
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=InitialStatesConfig(n_precomputed=8),
        seed=3,
    )
    episodes.progress = 0.5
    out = [episodes.reset()]
    rng = np.random.default_rng(0)
    for _ in range(count):
        result = episodes.step(rng.uniform(-1.0, 1.0, (N, 8)))
        out += [result.observation, result.reward]
    return out


def test_all_but_the_physics_gives_the_same_numbers_without_numba(drawer, monkeypatch):
    compiled = steps(drawer)
    for module, name, function in (
        ("buffered_engine", "compiled_pre_step", pre_step),
        ("buffered_engine", "compiled_refresh", refresh),
        ("episodes", "compiled_post_step", post_step),
    ):
        monkeypatch.setattr(f"articulate_envs.{module}.{name}", function)
    for ours, theirs in zip(steps(drawer), compiled, strict=True):
        assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_a_diverged_environment_is_observed_as_zeros_and_earns_nothing(
    drawer, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log file to its working folder
    episodes = Episodes(
        ThreadEngine(drawer, N),
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=None,
        seed=0,
    )
    episodes.reset()
    cast(ThreadEngine, episodes.engine).physics_state(1)[1].qvel[:] = 1e12
    result = episodes.step(np.zeros((N, 8)))
    assert result.ended is not None
    assert result.ended.rows.tolist() == [1]
    assert result.reward[1] == 0.0
    assert np.isfinite(result.ended.observation).all()


def test_a_robots_computer_needs_no_numba():
    code = (
        "import sys; sys.modules['numba'] = None; "
        "import articulate_deploy.episode, articulate_deploy.robots.simulated"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_state_copies_do_not_share_memory(drawer):
    engine = ThreadEngine(drawer, 1)
    state = engine.state()
    kept = copy.deepcopy(state.gripper.command)
    engine._buffers.gripper.command[:] = 5.0
    assert_allclose(state.gripper.command, kept)
