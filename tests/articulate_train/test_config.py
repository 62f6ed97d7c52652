"""Numbers that no training can be made with are rejected before it begins."""

import dataclasses
from typing import Any

import pytest

from articulate.commands.flags import parse
from articulate.config import from_mapping
from articulate.errors import ConfigError
from articulate.task.floor_pose import FloorPose, ObjectLocation, save_location
from articulate.task.randomization_config import RandomizationConfig
from articulate_train.config import ImitationConfig, PpoConfig, TrainConfig
from articulate_train.run import with_placement


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
            asset="cabinet.urdf",
            ensemble_size=1,
            imitation=ImitationConfig(until=1.0),
            initial_policy="random",
        ).ensemble_size
        == 1
    )


@pytest.mark.parametrize("seeds", [(), (1, 1), (-1,), (0, 2**32)])
def test_seeds_that_are_none_are_rejected(seeds):
    with pytest.raises(ConfigError, match="they must be distinct, not negative and below"):
        TrainConfig(asset="cabinet.urdf", seeds=seeds)
    assert TrainConfig(asset="cabinet.urdf", seeds=(2**32 - 1,)).seeds == (2**32 - 1,)


def test_the_preset_of_the_marker_estimator_loads_and_widens():
    config = parse(TrainConfig, ["--asset", "x", "--config", "markers"])
    assert config.randomization.estimate_delay_steps == (0, 1)
    assert config.randomization.part_noise < RandomizationConfig().part_noise
    assert config.randomization.widened(1.5).estimate_delay_steps[1] <= 5
    assert config.steps == TrainConfig(asset="x").steps


def test_a_placement_is_numbers_or_a_file_and_is_kept_as_numbers(tmp_path, error_line):
    pose = FloorPose(x_m=0.7, y_m=0.1, yaw_deg=90.0)
    save_location(tmp_path / "p.json", ObjectLocation(object="cabinet", pose=pose))
    given = TrainConfig(asset="x", placement=(tmp_path / "p.json",))
    assert with_placement(given).placement == (0.7, 0.1, 90.0, 0.0)
    flags = parse(TrainConfig, ["--asset", "x", "--placement", "0.7", "-0.1", "90"])
    assert flags.placement == (0.7, -0.1, 90.0)
    assert with_placement(flags).placement == (0.7, -0.1, 90.0, 0.0)
    assert with_placement(TrainConfig(asset="x")).placement is None
    error_line(
        "with_placement(2 numbers)",
        lambda: with_placement(TrainConfig(asset="x", placement=(0.7, 0.1))),
    )


def numbers_of(config, parents=()):
    """Yield the path and value of each number and tuple of numbers."""
    for f in dataclasses.fields(config):
        value, path = getattr(config, f.name), (*parents, f.name)
        if dataclasses.is_dataclass(value):
            yield from numbers_of(value, path)
        elif type(value[0] if value and isinstance(value, tuple) else value) in (int, float):
            yield path, value


NUMBERS = dict(numbers_of(TrainConfig(asset="cabinet.urdf")))
SIGNED = ("reward", "log_std_init", "log_std_final")


def changed(path, number):
    """Return the configuration with ``number`` at ``path``."""
    value: Any = [number] * len(NUMBERS[path]) if isinstance(NUMBERS[path], tuple) else number
    for name in reversed(path):
        value = {name: value}
    return from_mapping(TrainConfig, {"asset": "cabinet.urdf"} | value, "test")


@pytest.mark.parametrize("path", NUMBERS, ids=".".join)
def test_infinite_and_impossible_negative_numbers_of_every_key_are_rejected(path):
    signed = path[0] in SIGNED or path[-1] in SIGNED
    for number in (float("inf"), *(() if signed else (-1,))):
        with pytest.raises(ConfigError) as caught:
            changed(path, number)
        assert ".".join(path) in str(caught.value)


@pytest.mark.parametrize("path", [p for p in NUMBERS if "scale" in p[-1] and p[0] == "reward"])
def test_scales_of_reward_terms_are_divisors_and_above_0(path):
    with pytest.raises(ConfigError, match="it must be above 0"):
        changed(path, 0)


@pytest.mark.parametrize("name", ["timestep_s", "iterations", "impratio"])
def test_physics_settings_without_a_step_or_an_iteration_are_rejected(name):
    with pytest.raises(ConfigError) as caught:
        changed(("physics", name), 0)
    assert f"physics.{name} is 0" in str(caught.value)
