import dataclasses
import shlex

import pytest

from articulate.commands.flags import parse
from articulate_train.command_line import train_command
from articulate_train.commands.train import TrainFlags
from articulate_train.config import TrainConfig

PLAIN = TrainConfig(asset="my cabinet/ä.urdf", joint="drawer_0_slide")
OTHER = dataclasses.replace(
    PLAIN,
    task="close_joint",
    closed="upper",
    size=0.7,
    category="Toilet",
    seeds=(3, 5),
    steps=10_000,
    episodes=8,
    evaluation_seed=7,
    ppo=dataclasses.replace(PLAIN.ppo, net_arch=(32, 16, 8), learning_rate=1e-05),
    randomization=dataclasses.replace(PLAIN.randomization, mass=(0.5, 2.0), scales=3),
    reward=dataclasses.replace(
        PLAIN.reward,
        premature_close=dataclasses.replace(PLAIN.reward.premature_close, weight=-0.5),
    ),
    physics=dataclasses.replace(PLAIN.physics, cone="pyramidal"),
)


@pytest.mark.parametrize("config", [PLAIN, OTHER], ids=["defaults", "all kinds of flags"])
def test_the_command_of_a_report_gives_the_same_configuration(config):
    _, *words = shlex.split(train_command(config, "drawer_0_slide"))
    assert parse(TrainFlags, words, prog="train").config() == config


def test_defaults_and_keys_without_influence_are_left_out():
    config = dataclasses.replace(PLAIN, jobs=2, checkpoint_updates=5)
    assert train_command(config, "drawer_0_slide") == (
        "train --asset 'my cabinet/ä.urdf' --task open_drawer --joint drawer_0_slide "
        "--seeds 0 1 2 --steps 2000000"
    )


def test_a_selected_joint_is_named():
    config = dataclasses.replace(PLAIN, joint=None)
    assert "--joint lid" in train_command(config, "lid")
