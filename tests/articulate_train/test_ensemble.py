"""Ensemble members update in turn, independently, and their mean action is used."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_array_equal
from tests.runs import tiny_run, write_checkpoint

from articulate.errors import ConfigError, RunError
from articulate.onnx_runtime import onnxruntime
from articulate.task.observation import OBSERVATION
from articulate_deploy.onnx_graph import check_graph
from articulate_train.action_scaling import corrected_action
from articulate_train.config import TrainConfig
from articulate_train.ensemble import Ensemble
from articulate_train.export import golden_pairs, to_onnx
from articulate_train.policy import (
    CHECKPOINT,
    OTHER_MEMBERS,
    POLICY,
    ensemble_of,
    load_policy,
    policy_of,
    read_checkpoint,
    trained_steps,
)
from articulate_train.ppo import Learner
from articulate_train.run import DONE
from articulate_train.train_seed import SeedProcess

STEPS = 32
"""Control steps of an update of one member."""


@pytest.fixture
def pair(cabinet, tmp_path):
    """A run whose seed has two members of three updates each."""
    return tiny_run(tmp_path / "run", cabinet, ensemble_size=2)


@pytest.fixture
def members(pair):
    """Makes the members of that run; all are closed at the end."""
    made = []

    def make(config=pair.config, seed=0):
        made.append(Ensemble(pair.scene(), config, seed, threads=1))
        return made[-1]

    yield make
    for each in made:
        each.close()


def rounds(members, count):
    """Let each make so many updates."""
    left = iter(range(1, count + 1))
    members.run(lambda _: next(left) < count)


def weights(content):
    """Weights of all members of a checkpoint, as arrays."""
    return [
        {name: value.numpy() for name, value in member["policy"].items()}
        for member in ensemble_of(content)
    ]


def same(a, b):
    """Return whether all weights of two checkpoints are equal."""
    for ours, theirs in zip(weights(a), weights(b), strict=True):
        for name, value in ours.items():
            assert_array_equal(value, theirs[name], err_msg=name)
    return True


def test_steps_are_shared_out(members):
    both = members()
    both.run(lambda _: True)
    assert both.is_done
    assert both.steps == both.config.steps == 6 * STEPS
    assert [one.model.num_timesteps for one in both.learners] == [3 * STEPS] * 2
    assert both.updates == 3


def test_what_is_no_number_is_left_out_of_the_figures(members):
    """The explained variance of equal returns is not defined."""
    both = members()
    for learner, explained in zip(both.learners, (0.5, float("nan")), strict=True):
        learner.model.logger.record("train/explained_variance", explained)
        learner.model.logger.record("train/value_loss", explained + 1.0)
    assert both.learners[0].update_figures() == {"explained_variance": 0.5, "value_loss": 1.5}
    assert both.learners[1].update_figures() == both.figures() == {}


def test_shares_are_rounded_up():
    assert TrainConfig(asset="a", steps=100_001, ensemble_size=2).member_steps == 50_001
    assert TrainConfig(asset="a", steps=100_001, ensemble_size=1).member_steps == 100_001


def test_members_that_have_no_update_each_are_rejected():
    least = 2 * TrainConfig(asset="a").ppo.n_envs * TrainConfig(asset="a").ppo.n_steps
    with pytest.raises(ConfigError, match="of each of 2 members"):
        TrainConfig(asset="a", ensemble_size=2, steps=least - 1)
    with pytest.raises(ConfigError, match="ensemble_size"):
        TrainConfig(asset="a", ensemble_size=0)


def test_they_begin_differently_and_see_other_episodes(members):
    one, other = members().learners
    ours, theirs = (m.model.policy.action_net.weight.detach().numpy() for m in (one, other))
    assert np.abs(ours - theirs).max() > 1e-4
    assert one.episodes.snapshot()["generator"] != other.episodes.snapshot()["generator"]


def test_each_goes_as_far_as_its_share_of_the_steps(members):
    both = members()
    both.run(lambda _: True)
    last = both.config.steps / 2 - STEPS  # at the beginning of the last update
    assert [one.episodes.progress for one in both.learners] == [last / both.config.steps] * 2


def test_the_first_begins_as_a_seed_with_one_member_does(members, pair):
    both = members()
    single = Learner(pair.scene(), replace(pair.config, ensemble_size=1), 0, threads=1)
    ours, theirs = (m.model.policy.state_dict() for m in (both.learners[0], single))
    for name, value in ours.items():
        assert_array_equal(value.numpy(), theirs[name].numpy())
    single.close()


@pytest.mark.parametrize("k", [1, 2])
def test_restored_members_go_on_with_the_same_bits(members, tmp_path, k):
    full = members()
    rounds(full, k)
    full.save(tmp_path)
    rounds(full, 1)
    other = members()
    torch.rand(7)  # what happens between does not matter
    other.restore(read_checkpoint(tmp_path))
    rounds(other, 1)
    assert same(full.policy_state(), other.policy_state())
    assert full.steps == other.steps == 2 * (k + 1) * STEPS


def dying(after, rounds):
    """Return a callback that kills the process after a number of rounds."""
    left = iter(range(1, rounds + 1))

    def dies(members):
        assert after(members)
        if next(left) == rounds:
            raise KeyboardInterrupt  # nothing more is saved, as by SIGKILL
        return True

    return dies


def test_a_seed_that_is_killed_goes_on_with_the_same_bits(cabinet, tmp_path, monkeypatch):
    kept = []
    for name, killed in (("whole", None), ("killed", 2)):
        run = tiny_run(tmp_path / name, cabinet, ensemble_size=2, checkpoint_updates=1)
        process = SeedProcess(run, 0, threads=1)
        if killed is not None:
            with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
                patch.setattr(process, "_after_round", dying(process._after_round, killed))
                process.train()
            process.close()
            process = SeedProcess(run, 0, threads=1)
            assert process.ensemble.steps == 2 * killed * STEPS
        assert process.train()
        process.close()
        kept.append(read_checkpoint(run.seed_folder(0)))
        done = json.loads((run.seed_folder(0) / DONE).read_text())
        assert done["steps"] == done["selected_step"] == 6 * STEPS
        assert len(read_checkpoint(run.seed_folder(0), POLICY)[OTHER_MEMBERS]) == 1
    assert same(*kept)


@pytest.fixture
def two(tmp_path):
    """A seed's folder whose checkpoint has two members, and what it holds of each."""
    folder = tmp_path / "seed_0"
    write_checkpoint(folder, 0)
    write_checkpoint(tmp_path / "other", 1)
    one, other = read_checkpoint(folder), read_checkpoint(tmp_path / "other")
    torch.save(one | {OTHER_MEMBERS: [other]}, folder / CHECKPOINT)
    return folder, one, other


def test_the_policy_is_the_mean_of_what_they_state(two):
    folder, one, other = two
    policy = load_policy(folder)
    seen = np.random.default_rng(0).normal(size=(16, OBSERVATION.size)).astype(np.float32)
    with torch.no_grad():
        text = [policy_of(c).networks[0](torch.as_tensor(seen)).numpy() for c in (one, other)]
    mean = (text[0] + text[1]) / 2.0
    assert np.abs(text[0] - text[1]).max() > 0.1
    want = corrected_action(policy.action_scaling, seen, mean)
    np.testing.assert_allclose(policy.act(seen.astype(np.float64)), want, atol=1e-6)


def test_the_network_of_a_bundle_reports_the_same(two):
    policy = load_policy(two[0])
    model = to_onnx(policy)
    check_graph(model, "policy.onnx")
    seen, actions = golden_pairs(policy, np.random.default_rng(1), 32)
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    (text,) = session.run(None, {session.get_inputs()[0].name: seen})
    np.testing.assert_allclose(text, actions, atol=1e-5)


def test_steps_are_those_of_all():
    plain = {"metadata": json.dumps({"num_timesteps": 64})}
    assert trained_steps(plain | {OTHER_MEMBERS: [plain, plain]}) == 192


def test_a_checkpoint_of_more_members_is_of_another_version(pair, cabinet, tmp_path):
    process = SeedProcess(pair, 0, threads=1)
    rounds(process.ensemble, 1)
    process.ensemble.save(pair.seed_folder(0))
    process.close()
    single = tiny_run(tmp_path / "alone", cabinet)
    single.seed_folder(0).mkdir()
    content = read_checkpoint(pair.seed_folder(0))
    torch.save(content, single.seed_folder(0) / CHECKPOINT)
    with pytest.raises(RunError, match=r"2 ensemble members, not 1.*train again"):
        SeedProcess(single, 0, threads=1)
