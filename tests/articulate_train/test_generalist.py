"""The generalist policy of the package."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd
from tests.scenes import drawer_scene

from articulate.errors import ConfigError
from articulate.files import sha256
from articulate.task.observation import OBSERVATION
from articulate_train import generalist
from articulate_train.commands.train import TrainFlags
from articulate_train.config import ImitationConfig, TrainConfig
from articulate_train.generalist import (
    generalist_metadata,
    generalist_state,
    load_initial,
    weights_file,
    with_layers,
    write_weights,
)
from articulate_train.policy import Network, policy_of
from articulate_train.ppo import AsymmetricPolicy

SEEN = np.random.default_rng(0).normal(size=(5, OBSERVATION.size)).astype(np.float32)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))


@pytest.fixture
def config(scene):
    return TrainConfig(asset=str(scene.asset.folder), task="open_drawer")


@pytest.mark.parametrize("task", ["open_door", "close_door"])
def test_the_weights_are_small_and_their_origin_is_recorded_beside_them(task):
    file = weights_file(task)
    assert file.stat().st_size <= 2_000_000
    origin = generalist_metadata(task)
    assert origin == json.loads(file.with_suffix(".json").read_text())
    assert origin["sha256"] == sha256(file)
    assert all(name.startswith(task.partition("_")[0]) for name in origin["scenes"])
    assert origin["command"].startswith("python benchmarks/generalist.py train")
    assert all(int(name.rpartition("-")[2]) < 1000 for name in origin["objects"])
    assert {"seed", "versions", "control_steps", "licence"} <= set(origin)


def test_the_policy_acts_within_the_bounds_of_actions(scene, config):
    action = policy_of(generalist_state(config, scene)).act(SEEN.astype(np.float64))
    assert action.shape == (5, 8)
    assert np.all(np.abs(action) <= 1.0)


def test_weights_are_read_as_they_were_written(tmp_path, monkeypatch, scene, config):
    torch.manual_seed(0)
    mean = torch.arange(OBSERVATION.size) / 100.0
    network = Network(mean, torch.full((OBSERVATION.size,), 2.0), (16, 8))
    monkeypatch.setattr(generalist, "__file__", str(tmp_path / "generalist.py"))
    file = weights_file(config.task)
    write_weights(file, network)
    file.with_suffix(".json").write_text(json.dumps({"control_steps": 7}))
    state = generalist_state(config, scene)
    assert state["net_arch"] == [16, 8]
    found = policy_of(state)
    assert found.steps == 7
    seen = torch.from_numpy(SEEN)
    torch.testing.assert_close(found.networks[0](seen), network(seen))


def test_a_training_begins_with_the_same_actions(scene, config):
    state = generalist_state(config, scene)
    ppo = with_layers(config.ppo, state)
    space = np.full(OBSERVATION.size + 3, 1.0, dtype=np.float32)
    policy = AsymmetricPolicy(
        gymnasium.spaces.Box(-space, space),
        gymnasium.spaces.Box(-1.0, 1.0, (8,)),
        lambda _: 1e-3,
        net_arch=list(ppo.net_arch),
        activation_fn=torch.nn.ELU,
    )
    before = RunningMeanStd(shape=(OBSERVATION.size + 3,))
    parts: list[Any] = [SimpleNamespace(policy=policy), SimpleNamespace(obs_rms=before)]
    load_initial(parts[0], parts[1], state)
    rms, size = parts[1].obs_rms, OBSERVATION.size
    rms.update(5.0 + np.concatenate([SEEN, np.ones((5, 3))], axis=1))
    np.testing.assert_allclose(rms.mean[size:], 6.0, rtol=1e-3)
    normalized = np.clip((SEEN - rms.mean[:size]) / np.sqrt(rms.var[:size] + 1e-8), -10.0, 10.0)
    both = np.concatenate([normalized, np.zeros((5, 3))], axis=1).astype(np.float32)
    distribution: Any = policy.get_distribution(torch.from_numpy(both)).distribution
    mean = distribution.mean
    expected = policy_of(state).networks[0](torch.from_numpy(SEEN))
    torch.testing.assert_close(torch.clamp(mean, -1.0, 1.0), expected, atol=1e-4, rtol=1e-3)


def test_a_training_from_the_policy_has_the_configuration_of_fine_tuning(config):
    random = replace(config, initial_policy="random")
    assert random.effective() is random
    start = replace(config, steps=300_000)
    found, own = start.effective(), start.fine_tuning
    assert found.imitation.until * 300_000 == pytest.approx(own.imitation_steps)
    assert found.imitation.aggregate
    assert found.imitation.learning_rate == own.imitation_learning_rate
    assert found.ppo.learning_rate == own.learning_rate
    assert found.ppo.learning_rate_final == own.learning_rate_final
    assert found.ppo.log_std_init == own.log_std_init >= found.ppo.log_std_final
    assert (found.initial_states.share_first, found.initial_states.share_last) == (
        own.share_first, own.share_last,
    )  # fmt: skip
    short = replace(start, steps=20_000)
    assert short.effective().imitation.until * short.ensemble_size < 1.0


def test_tasks_of_which_it_has_no_policy_start_from_random_weights(config):
    assert config.starts_from_generalist
    assert not replace(config, task="open_joint").starts_from_generalist
    flags = TrainFlags(asset="a", from_scratch=True, imitation=ImitationConfig(until=0.0))
    assert not flags.config().starts_from_generalist


def test_values_that_a_training_from_it_does_not_use_are_rejected(error_line):
    error_line(
        "TrainFlags(imitation=ImitationConfig(until=0.0))",
        lambda: TrainFlags(asset="a", imitation=ImitationConfig(until=0.0)),
    )


def test_tasks_without_a_policy_are_rejected(scene):
    other = TrainConfig(asset=str(scene.asset.folder), task="open_joint")
    with pytest.raises(ConfigError, match="no task open_joint; it has: open_drawer"):
        generalist_state(other, scene)
