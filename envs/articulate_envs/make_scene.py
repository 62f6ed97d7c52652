"""From what a user of an environment names to a scene: an object, a task, ranges and weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from articulate.assets.asset import Asset
from articulate.cache import cache_folder, cache_in_use
from articulate.config import from_mapping, to_plain
from articulate.conversion import ConvertConfig
from articulate.errors import ConfigError, nearest
from articulate.preparation.prepare import load_checked_asset
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate.task.task import TASK_RULES
from articulate_envs.config import InitialStatesConfig, RewardConfig
from articulate_envs.engine import Engine
from articulate_envs.episodes import Episodes
from articulate_envs.joint_selection import choose_joint
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import Scene, build_scene


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """What an environment is made of; its fields are the arguments of every way to make one."""

    asset: str
    """URDF or MJCF file, a folder that holds one, or an asset folder."""
    task: str = "open_drawer"
    """What is asked."""
    joint: str | None = None
    """Joint of the asset; by default the reachable one with its handle nearest home height."""
    closed: Literal["auto", "lower", "upper", "zero"] = "auto"
    """Closed position: a joint limit, or 0 inside the range."""
    up: Literal["z", "y"] = "z"
    """Axis of the file that points up."""
    size: float | None = None
    """Longest side of the object [m]; by default its own size, or that of its category."""
    category: str | None = None
    """Category of the object, for its size and material; by default what its folder says."""
    randomise: bool = True
    """Draw anew for each episode; False: every episode is the nominal one, and ``randomization`` is not
    looked at."""
    randomization: RandomizationConfig = field(default_factory=RandomizationConfig)
    """Randomisation."""
    reward: RewardConfig = field(default_factory=RewardConfig)
    """Reward."""
    initial_states: InitialStatesConfig | None = None
    """Starts along the task, as in training; None begins every episode as the task asks."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """Plant between the policy's tick and the joints."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Physics."""

    def __post_init__(self) -> None:
        if self.task not in TASK_RULES:
            raise ConfigError(f"unknown task {self.task!r}{nearest(self.task, TASK_RULES)}")

    @property
    def active_randomization(self) -> RandomizationConfig:
        """The ranges in force."""
        return self.randomization if self.randomise else NO_RANDOMIZATION


def read_config(given: Mapping[str, Any], where: str, scene: Scene | None = None) -> EnvConfig:
    """The configuration that keyword arguments ``given`` say.

    Args:
        given: Fields of :class:`EnvConfig`; groups as mappings or as their dataclasses.
        where: Who was called, for messages.
        scene: A scene that is there already, and what it decides with it.

    Raises:
        ConfigError: A key is not known, or its value is not accepted.
    """
    for name in given:
        known = [f.name for f in fields(EnvConfig)]
        if name not in known:
            raise ConfigError(f"{where}: no argument {name!r}{nearest(name, known)}")
    if scene is not None:
        given = {"randomization": _draws_of(scene), **given, **_decided_by(scene)}
    elif given.get("asset") is None:
        raise ConfigError(f"{where}: asset is missing; give a URDF file or a folder of an asset")
    plain = to_plain(dict(given))
    if plain.get("initial_states", 0) == {}:  # all of it by default, which an empty mapping says
        plain["initial_states"] = to_plain(InitialStatesConfig())
    config = from_mapping(EnvConfig, plain, where)
    if scene is not None:
        _check_sizes(config, scene, where)
    return config


def _draws_of(scene: Scene) -> RandomizationConfig:
    sizes = scene.scales
    return RandomizationConfig(scale=(min(sizes), max(sizes)), scales=len(sizes))


def _check_sizes(config: EnvConfig, scene: Scene, where: str) -> None:
    for size in config.active_randomization.scale_values:
        if not np.isclose(size, scene.scales).any():
            known = ", ".join(f"{s:.6g}" for s in scene.scales)
            raise ConfigError(
                f"{where}: draw.scale gives the size {size:.6g}, which the scene has not; it has "
                f"{known}: set draw.scale and draw.scales to them"
            )


def _decided_by(scene: Scene) -> dict[str, Any]:
    return {
        "asset": str(scene.asset.folder),
        "task": scene.task.name,
        "joint": scene.task.joint,
        "control": scene.control,
        "physics": scene.physics,
    }


def make_scene(config: EnvConfig) -> Scene:
    """The scene of ``config``; its object is converted and proven once and kept in the cache.

    Raises:
        UsageError: The object cannot be read, was refused, or cannot be reached.
    """
    wish = ConvertConfig(
        size_m=config.size, category=config.category, closed=config.closed, up=config.up
    )
    cache = cache_folder()
    with cache_in_use(cache):
        asset = load_checked_asset(Path(config.asset), cache, wish)
        return _scene(asset, _Wish.of(config))


@dataclass(frozen=True, kw_only=True)
class _Wish:
    """What decides a scene beside its object; a key of scenes that were built."""

    task: str
    joint: str | None
    randomization: RandomizationConfig
    control: ControlConfig
    physics: PhysicsConfig

    @staticmethod
    def of(config: EnvConfig) -> _Wish:
        return _Wish(
            task=config.task,
            joint=config.joint,
            randomization=config.active_randomization,
            control=config.control,
            physics=config.physics,
        )


@lru_cache(maxsize=8)
def _scene(asset: Asset, wish: _Wish) -> Scene:
    """A scene; engines copy its models, so that many may share it.

    Folders of the cache are named by their content, so that equal assets are the same object.
    """
    task, place = choose_joint(wish, asset)
    return build_scene(
        asset,
        task,
        arm=PANDA,
        control=wish.control,
        physics=wish.physics,
        place=place,
        scales=wish.randomization.scale_values,
    )


def make_episodes(engine: Engine, config: EnvConfig, *, renew: bool) -> Episodes:
    """Episodes under the ranges, weights and starts of ``config``; reseed them before a reset."""
    return Episodes(
        engine,
        randomization=config.active_randomization,
        reward=config.reward,
        initial_states=config.initial_states,
        seed=0,
        renew=renew,
    )
