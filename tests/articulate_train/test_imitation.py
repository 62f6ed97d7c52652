"""Imitation of the scripted expert in the first part of a training."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from articulate.errors import ConfigError
from articulate.task.observation import ACTION
from articulate_train.action_scaling import ELBOW, MOTIONS
from articulate_train.config import ImitationConfig
from articulate_train.imitation import MIN_SCALE, ImitationData, imitate, unscale_action
from articulate_train.policy import read_checkpoint
from articulate_train.ppo import Learner, write_checkpoint

STEPS = 32


def learner_of(tiny, **show):
    config = replace(tiny.config, imitation=ImitationConfig(**show))
    return Learner(tiny.scene(), config, 0, threads=1)


def test_what_has_to_be_reported_gives_what_is_requested_as_far_as_words_reach():
    rng = np.random.default_rng(0)
    calls, left = rng.uniform(-0.3, 0.3, (50, ACTION.size)), rng.uniform(0.05, 1.0, (50, 1))
    words = unscale_action(calls, left, np.zeros((50, ELBOW)))
    assert_array_equal(words[:, MOTIONS:], calls[:, MOTIONS:])
    assert np.abs(words[:, :MOTIONS]).max() <= 1.0
    enough = left[:, 0] >= MIN_SCALE
    assert_allclose((words[:, :MOTIONS] * left)[enough], calls[enough, :MOTIONS], atol=1e-12)


def test_showing_ends_and_leads_fewer_and_fewer():
    show = ImitationConfig(until=0.2, expert_until=0.5)
    assert [show.is_active(p) for p in (0.0, 0.19, 0.2, 1.0)] == [True, True, False, False]
    assert [show.expert_share(p) for p in (0.0, 0.05, 0.1, 0.5)] == pytest.approx(
        [1.0, 0.5, 0.0, 0.0]
    )
    assert ImitationConfig(until=0.2, expert_until=0.0).expert_share(0.0) == 0.0
    assert not ImitationConfig(until=0.0).is_active(0.0)


def test_shares_of_showing_are_shares(error_line):
    error_line("ImitationConfig(until=1.5)", lambda: ImitationConfig(until=1.5))
    with pytest.raises(ConfigError, match=r"imitation\.epochs"):
        ImitationConfig(epochs=0)


def test_where_the_expert_leads_the_arm_does_what_it_reports(tiny):
    one = learner_of(tiny, until=1.0)
    env = one.envs
    env.expert, env.n_expert_envs = one._expert, 2
    env.reset()
    mine = np.full((env.num_envs, ACTION.size), -0.25, dtype=np.float32)
    env.step(mine)
    assert_allclose(env._action[:2, MOTIONS:], env.expert_actions[0][:2, MOTIONS:])
    assert_allclose(env._action[2:, MOTIONS:], -0.25)
    assert (mine == -0.25).all()
    one.close()


def test_imitation_brings_the_mean_action_to_what_was_imitated_and_the_value_to_the_returns(tiny):
    one = learner_of(tiny, until=1.0)
    one.run(lambda _: False)
    policy, buffer, values = (
        one.model.policy,
        one.model.rollout_buffer,
        np.stack(one.envs.expert_actions),
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
