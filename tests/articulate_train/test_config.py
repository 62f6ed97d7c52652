"""Numbers that no training can be made with are rejected before it begins."""

import pytest

from articulate.errors import ConfigError
from articulate_train.config import ImitationConfig, PpoConfig, TrainConfig


@pytest.mark.parametrize("name", ["n_envs", "n_steps", "n_epochs"])
@pytest.mark.parametrize("value", [0, -1])
def test_counts_of_the_algorithm_below_one_are_rejected(name, value):
    with pytest.raises(ConfigError) as caught:
        PpoConfig(**{name: value})
    assert str(caught.value) == f"ppo.{name} is {value}; it must be at least 1"


def test_a_layer_without_width_is_rejected():
    with pytest.raises(ConfigError, match=r"ppo\.net_arch is 0"):
        PpoConfig(net_arch=(8, 0))
    assert PpoConfig(net_arch=()).net_arch == ()


@pytest.mark.parametrize(
    ("name", "value", "least"),
    [
        ("jobs", -1, 0),
        ("checkpoint_updates", 0, 1),
        ("episodes", 0, 1),
        ("evaluation_seed", -1, 0),
    ],
)
def test_numbers_below_what_they_count_are_rejected(name, value, least):
    with pytest.raises(ConfigError) as caught:
        TrainConfig(asset="cabinet.urdf", **{name: value})
    assert str(caught.value) == f"{name} is {value}; it must be at least {least}"
    assert getattr(TrainConfig(asset="cabinet.urdf", **{name: least}), name) == least


def test_members_that_would_only_imitate_are_rejected():
    with pytest.raises(ConfigError, match=r"ensemble_size is 10 and imitation\.until 0\.1"):
        TrainConfig(asset="cabinet.urdf", ensemble_size=10)
    assert TrainConfig(asset="cabinet.urdf", ensemble_size=9).ensemble_size == 9
    assert (
        TrainConfig(
            asset="cabinet.urdf", ensemble_size=1, imitation=ImitationConfig(until=1.0)
        ).ensemble_size
        == 1
    )


@pytest.mark.parametrize("seeds", [(), (1, 1), (-1,), (0, 2**32)])
def test_seeds_that_are_none_are_rejected(seeds):
    with pytest.raises(ConfigError, match="they must be distinct, not negative and below"):
        TrainConfig(asset="cabinet.urdf", seeds=seeds)
    assert TrainConfig(asset="cabinet.urdf", seeds=(2**32 - 1,)).seeds == (2**32 - 1,)
