"""Imitation of the scripted expert in the first part of a training."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from articulate.errors import ConfigError
from articulate.task.observation import ACTION, expert_action
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_train.action_scaling import corrected_action
from articulate_train.config import ImitationConfig
from articulate_train.imitation import ImitationData, imitate
from articulate_train.policy import read_checkpoint
from articulate_train.ppo import Learner, write_checkpoint

STEPS = 32


def learner_of(tiny, **show):
    config = replace(tiny.config, imitation=ImitationConfig(**show))
    return Learner(tiny.scene(), config, 0, threads=1)


def test_imitation_ends():
    config = ImitationConfig(until=0.2)
    assert [config.is_active(p) for p in (0.0, 0.19, 0.2, 1.0)] == [True, True, False, False]
    assert not ImitationConfig(until=0.0).is_active(0.0)


def test_shares_of_showing_are_shares(error_line):
    error_line("ImitationConfig(until=1.5)", lambda: ImitationConfig(until=1.5))
    with pytest.raises(ConfigError, match=r"imitation\.epochs"):
        ImitationConfig(epochs=0)


@pytest.mark.parametrize("noise_m", [0.0, 0.003])
def test_corrections_that_are_imitated_lead_to_the_experts_mean_action_under_noise(
    tiny, noise_m, monkeypatch
):
    config = replace(tiny.config, randomization=replace(NO_RANDOMIZATION, estimate_noise_m=noise_m))
    one = Learner(tiny.scene(), config, 0, threads=1)
    env, runs, targets = one.envs, one.envs.episodes, []
    observe_again = runs.observe_again

    def observed():
        targets.append(observe_again())
        return targets[-1]

    monkeypatch.setattr(runs, "observe_again", observed)
    env.imitates = True
    env.reset()
    for _ in range(50):
        env.step_async(np.zeros((env.num_envs, ACTION.size), dtype=np.float32))
    wanted, actions = np.array(env.wanted), np.array([expert_action(row) for row in targets])
    assert (np.ptp(actions, axis=0).max() > 0.01) == (noise_m > 0.0)
    reached = np.all(np.abs(wanted) < 1.0, axis=0)
    corrected = corrected_action(env.action_scaling, env._seen, wanted.mean(axis=0))
    assert reached.mean() > 0.5
    assert_allclose(corrected[reached], actions.mean(axis=0)[reached], atol=1e-5)
    one.close()


def test_imitation_brings_the_mean_action_to_what_was_imitated_and_the_value_to_the_returns(tiny):
    one = learner_of(tiny, until=1.0)
    one.run(lambda _: False)
    policy, buffer, values = (
        one.model.policy,
        one.model.rollout_buffer,
        np.stack(one.envs.wanted),
    )
    rows = [buffer.swap_and_flatten(a) for a in (buffer.observations, buffer.returns, values)]
    seen, returns, wanted = (torch.as_tensor(row, dtype=torch.float32) for row in rows)

    def off():
        with torch.no_grad():
            action = policy.get_distribution(seen).distribution.mean
            value = policy.predict_values(seen)
        return float(((action - wanted) ** 2).mean()), float(((value - returns) ** 2).mean())

    before = off()
    imitate(one.model, values, ImitationConfig(epochs=40), ImitationData())
    after = off()
    assert after[0] < 0.5 * before[0]
    assert after[1] < 0.9 * before[1]
    one.close()


def test_noise_is_not_learnt_from_what_is_imitated(tiny):
    one = learner_of(tiny, until=1.0)
    before = one.model.policy.log_std.detach().clone()
    one.run(lambda _: False)
    assert torch.equal(before, one.model.policy.log_std)
    one.close()


@pytest.mark.parametrize(("k", "aggregate"), [(1, False), (2, False), (3, False), (2, True)])
def test_training_restored_while_it_is_imitated_goes_on_with_the_same_bits(
    tiny, tmp_path, k, aggregate
):
    """Six updates, the first three with imitation; saved after k, three more are the same."""

    def train(learner, updates):
        left = iter(range(updates - 1, -1, -1))
        learner.run(lambda _: next(left) > 0)

    complete = learner_of(tiny, until=0.5, aggregate=aggregate)
    train(complete, k)
    write_checkpoint(tmp_path, complete.state_dict())
    train(complete, 3)
    other = learner_of(tiny, until=0.5, aggregate=aggregate)
    other.restore(read_checkpoint(tmp_path))
    train(other, 3)
    for ours, theirs in zip(
        complete.model.policy.parameters(), other.model.policy.parameters(), strict=True
    ):
        assert torch.equal(ours, theirs)
    assert complete.model.num_timesteps == other.model.num_timesteps == (k + 3) * STEPS
    complete.close()
    other.close()


def test_samples_of_all_updates_are_kept_until_the_phase_ends(tiny):
    one = learner_of(tiny, until=0.5, aggregate=True)
    kept = []

    def count(learner):
        kept.append(sum(map(len, learner._imitation_data.actions)))
        return True

    one.run(count)
    assert kept == [STEPS, 2 * STEPS, 3 * STEPS, 0, 0, 0]
    one.close()
