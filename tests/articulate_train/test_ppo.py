import itertools

import numpy as np
import pytest
import torch
from numpy.testing import assert_array_equal

from articulate.errors import ConfigError, DivergedError
from articulate.task.observation import OBSERVATION
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_train.action_scaling import corrected_action
from articulate_train.config import PpoConfig
from articulate_train.policy import policy_of, read_checkpoint
from articulate_train.ppo import Learner, write_checkpoint

STEPS = 32
"""Steps of an update."""


@pytest.fixture
def learner(tiny):
    """Makes learners of the tiny run; all are closed at the end."""
    made = []

    def make(seed=0, threads=1):
        made.append(Learner(tiny.scene(), tiny.config, seed, threads=threads))
        return made[-1]

    yield make
    for each in made:
        each.close()


def train(learner, updates):
    """Train so many updates; the rewards and observations seen, and then the parameters."""
    count = itertools.count(1)
    seen = []

    def on_update(learner):
        buffer = learner.model.rollout_buffer
        seen.append((buffer.rewards.copy(), buffer.observations.copy()))
        return next(count) < updates

    learner.run(on_update)
    return seen


def bits(learner):
    """Everything that training changes, as arrays."""
    norm, model = learner.normalization, learner.model
    out = {f"policy.{k}": v.numpy().copy() for k, v in model.policy.state_dict().items()}
    for k, state in model.policy.optimizer.state_dict()["state"].items():
        out |= {f"adam.{k}.{name}": np.asarray(v).copy() for name, v in state.items()}
    for name, rms in (("seen", norm.obs_rms), ("returns", norm.ret_rms)):
        out |= {f"{name}.{k}": np.array(getattr(rms, k)) for k in ("mean", "var", "count")}
    return out | {"steps": np.array(model.num_timesteps), "updates": np.array(model._n_updates)}


def assert_same_bits(a, b):
    assert a.keys() == b.keys()
    for name, value in a.items():
        assert value.dtype == b[name].dtype, name
        assert_array_equal(value, b[name], err_msg=name)


def test_training_changes_the_weights_and_counts_steps(learner):
    one = learner()
    before = bits(one)
    train(one, 2)
    after = bits(one)
    assert after["steps"] == 2 * STEPS
    assert np.abs(after["policy.action_net.weight"] - before["policy.action_net.weight"]).max() > 0


def test_training_ends_at_the_configured_steps(learner, tiny):
    one = learner()
    assert len(train(one, 10**6)) == tiny.config.steps // STEPS
    assert one.model.num_timesteps == tiny.config.steps


def test_same_seed_gives_the_same_bits_whatever_the_threads_and_another_does_not(learner):
    """One after another: a learner seeds the generators that torch and numpy have but once."""
    a = learner()
    a_seen = train(a, 2)
    b = learner(threads=3)
    b_seen = train(b, 2)
    c = learner(seed=1)
    train(c, 2)
    assert_same_bits(bits(a), bits(b))
    for x, y in zip(a_seen, b_seen, strict=True):
        assert_array_equal(x[1], y[1])
    ours, theirs = bits(a)["policy.action_net.weight"], bits(c)["policy.action_net.weight"]
    assert np.abs(ours - theirs).max() > 1e-3


@pytest.mark.parametrize("k", [1, 2, 3])
def test_restored_training_goes_on_with_the_same_bits(learner, tmp_path, k):
    """Saved after k updates and read into a fresh learner, it is the uninterrupted one."""
    full = learner()
    train(full, k)
    write_checkpoint(tmp_path, full.state_dict())
    at_save = bits(full)
    going_on = train(full, 3)
    other = learner()
    np.random.default_rng(9)
    torch.rand(7)  # what happens between does not matter
    other.restore(read_checkpoint(tmp_path))
    assert_same_bits(bits(other), at_save)
    again = train(other, 3)
    for ours, theirs in zip(going_on, again, strict=True):
        assert_array_equal(ours[0], theirs[0])
        assert_array_equal(ours[1], theirs[1])
    assert_same_bits(bits(full), bits(other))


def test_saving_changes_nothing(learner, tmp_path):
    a = learner()
    train(a, 2)
    write_checkpoint(tmp_path, a.state_dict())
    train(a, 2)
    b = learner()
    train(b, 2)
    train(b, 2)
    assert_same_bits(bits(a), bits(b))


def test_saved_policy_acts_as_the_mean_of_the_trained_one(learner, tmp_path):
    one = learner()
    train(one, 3)
    write_checkpoint(tmp_path, one.state_dict())
    raw = one.normalization.old_obs
    policy = policy_of(read_checkpoint(tmp_path))
    seen_raw = raw[:, : OBSERVATION.size]
    seen = torch.from_numpy(
        one.normalization.normalize_obs(raw.astype(np.float64)).astype(np.float32)
    )
    with torch.no_grad():
        mean = one.model.policy.get_distribution(seen).distribution.mean
    correction = np.clip(mean.numpy(), -1, 1)
    expected = corrected_action(policy.action_scaling, seen_raw, correction)
    np.testing.assert_allclose(policy.act(seen_raw), expected, atol=1e-5)


def test_policy_does_not_see_what_only_the_value_function_may(learner):
    """Changing the privileged columns changes the value and leaves the action unchanged."""
    policy = learner().model.policy
    seen = torch.zeros(3, OBSERVATION.size + PRIVILEGED.size)
    other = seen.clone()
    other[:, OBSERVATION.size :] = 1.0
    with torch.no_grad():
        means = [policy.get_distribution(x).distribution.mean for x in (seen, other)]
        values = [policy.predict_values(x) for x in (seen, other)]
    assert torch.equal(*means)
    assert not torch.isclose(*values).any()


def test_learning_rate_and_curriculum_follow_the_share_of_all_steps(learner, tiny):
    one = learner()
    train(one, 3)
    ppo, share = tiny.config.ppo, 3 * STEPS / tiny.config.steps
    expected = ppo.learning_rate ** (1.0 - share) * ppo.learning_rate_final**share
    assert one.model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(expected)
    assert one.episodes.progress == pytest.approx(2 * STEPS / tiny.config.steps)


@pytest.mark.parametrize("what", ["weight", "gradient", "normalisation"])
def test_training_that_diverges_reports_after_how_many_steps(learner, what):
    one = learner()
    train(one, 1)
    if what == "weight":
        with torch.no_grad():
            one.model.policy.action_net.weight[0, 0] = float("nan")
    elif what == "gradient":
        one.model.policy.value_net.weight.register_hook(lambda g: g * float("inf"))
    else:
        one.normalization.obs_rms.mean[0] = np.nan
    with pytest.raises(DivergedError, match=r"not finite after \d+ steps"):
        train(one, 3)
    assert not one.is_finite()


def test_other_mistakes_are_not_reported_as_divergence(learner, monkeypatch):
    one = learner()
    train(one, 1)  # the first is of the imitation

    def broken():
        raise ValueError("a bug")

    monkeypatch.setattr(one.model, "train", broken)
    with pytest.raises(ValueError, match="a bug"):
        train(one, 1)


def test_minibatches_that_do_not_divide_the_rollout_are_rejected(error_line):
    error_line(
        "PpoConfig(n_envs=4, n_steps=8, batch_size=12)",
        lambda: PpoConfig(n_envs=4, n_steps=8, batch_size=12),
    )
    with pytest.raises(ConfigError):
        PpoConfig(batch_size=1)


def test_the_bound_on_noise_falls_from_the_first_to_the_last_between_two_shares():
    ppo = PpoConfig(log_std_init=-0.8, log_std_final=-1.8, log_std_between=(0.4, 0.9))
    assert ppo.log_std_bound(0.39) == float("inf")
    outputs = [ppo.log_std_bound(share) for share in (0.4, 0.65, 0.9, 1.0)]
    assert outputs == pytest.approx([-0.8, -1.3, -1.8, -1.8])


@pytest.mark.parametrize("between", [(0.9, 0.4), (0.4, 0.4), (-0.1, 0.5), (0.5, 1.1)])
def test_shares_that_do_not_grow_within_the_training_are_rejected(between):
    with pytest.raises(ConfigError, match="log_std_between"):
        PpoConfig(log_std_between=between)


def test_an_update_late_in_a_training_is_of_actions_with_little_noise(learner):
    late = learner()
    ppo = late.config.ppo
    late.model.num_timesteps = late.config.steps - STEPS
    train(late, 1)
    assert late.model.policy.log_std.max() < ppo.log_std_init - 0.1
