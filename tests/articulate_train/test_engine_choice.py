"""The engine of a training: a key of the configuration and a flag."""

import dataclasses
import sys

import pytest
from tests.scenes import drawer_scene

from articulate.commands import main
from articulate.config import load_config
from articulate.errors import ConfigError
from articulate_envs.threaded_engine import ThreadEngine
from articulate_envs.warp_engine import WarpEngine
from articulate_train.config import TrainConfig
from articulate_train.ppo import Learner

TINY = TrainConfig(
    asset="",
    task="open_joint",
    steps=64,
    ensemble_size=1,
    ppo=dataclasses.replace(TrainConfig(asset="").ppo, n_envs=4, n_steps=4, batch_size=16),
    initial_states=dataclasses.replace(TrainConfig(asset="").initial_states, n_precomputed=8),
)


@pytest.fixture(scope="module")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))


def test_a_training_uses_the_processors_by_default(drawer):
    learner = Learner(drawer, TINY, 0, threads=1)
    assert isinstance(learner.episodes.engine, ThreadEngine)
    learner.close()


def test_an_unknown_engine_is_rejected():
    with pytest.raises(ConfigError, match=r"engine.*cpu.*warp"):
        load_config(TrainConfig, {"asset": "", "engine": "gpu"})


def test_a_missing_package_is_reported_before_the_object_is_read(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "warp", None)
    assert main(["train", "--asset", str(tmp_path / "no.urdf"), "--engine", "warp"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith('pip install "articulate-robots[warp]"')


@pytest.mark.slow  # kernels compile for minutes
def test_a_training_on_warp_continues_from_its_checkpoint(drawer):
    pytest.importorskip("mujoco_warp", reason="mujoco-warp is not installed (extra warp)")
    config = dataclasses.replace(TINY, engine="warp")
    learner, other = (Learner(drawer, config, 0, threads=1) for _ in range(2))
    assert isinstance(learner.episodes.engine, WarpEngine)
    learner.begin()
    learner.update()
    assert learner.model.num_timesteps == 16
    other.restore(learner.state_dict())
    other.begin()
    for one in (learner, other):
        one.update()
        assert one.is_finite()
        assert one.model.num_timesteps == 32
        one.close()
