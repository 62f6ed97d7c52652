"""Scenes and episodes of a configuration: an object, a task, ranges and weights."""

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
from articulate.errors import ConfigError, nearest, quote
from articulate.preparation.prepare import load_checked_asset
from articulate.robot.config import ControlConfig
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate.task.task import TASK_RULES
from articulate_envs.config import InitialStatesConfig
from articulate_envs.engine import Engine
from articulate_envs.episodes import Episodes
from articulate_envs.joint_selection import choose_scene
from articulate_envs.physics import PhysicsConfig
from articulate_envs.rewards import RewardConfig
from articulate_envs.scene import Scene


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """Configuration of an environment; its fields are the arguments of all interfaces."""

    asset: str
    """URDF or MJCF file, a folder that holds one, or an asset folder."""
    task: str = "open_drawer"
    """Name of the task."""
    joint: str | None = None
    """Joint of the asset; by default the reachable one with its handle nearest home height."""
    target_open: float | None = None
    """Share of the joint's range (at most 90 degrees) at which the part counts as open; by default
    0.8, or less where that is out of reach."""
    closed: Literal["auto", "lower", "upper", "zero"] = "auto"
    """Closed position: a joint limit, or 0 inside the range."""
    up: Literal["z", "y"] = "z"
    """Axis of the file that points up."""
    size: float | None = None
    """Longest side of the object [m]; by default that of the file, or of its category."""
    category: str | None = None
    """Category of the object, for its size and material; by default that in its folder."""
    randomise: bool = True
    """Sample each episode; False: every episode is nominal and ``randomization`` is ignored."""
    randomization: RandomizationConfig = field(default_factory=RandomizationConfig)
    """Randomization."""
    reward: RewardConfig = field(default_factory=RewardConfig)
    """Reward."""
    initial_states: InitialStatesConfig | None = None
    """Starts along the task, as in training; None begins every episode at home."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """Control stack."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Physics settings."""

    def __post_init__(self) -> None:
        if self.task not in TASK_RULES:
            raise ConfigError(f"unknown task {quote(self.task)}{nearest(self.task, TASK_RULES)}")

    @property
    def active_randomization(self) -> RandomizationConfig:
        """Ranges that apply, those of no randomization included."""
        return self.randomization if self.randomise else NO_RANDOMIZATION


def read_config(arguments: Mapping[str, Any], where: str, scene: Scene | None = None) -> EnvConfig:
    """Return the configuration of keyword arguments.

    Args:
        arguments: Fields of :class:`EnvConfig`; groups as mappings or as their dataclasses.
        where: Name of the interface, for messages.
        scene: Existing scene, which determines some of the fields.

    Raises:
        ConfigError: A key is unknown, or its value is not accepted.
    """
    for name in arguments:
        known = [f.name for f in fields(EnvConfig)]
        if name not in known:
            raise ConfigError(f"{where}: no argument {quote(name)}{nearest(name, known)}")
    if scene is not None:
        arguments = {"randomization": _scene_sizes(scene), **arguments, **_scene_fields(scene)}
    elif arguments.get("asset") is None:
        raise ConfigError(f"{where}: asset is missing; give a URDF file or a folder of an asset")
    plain = to_plain(dict(arguments))
    if plain.get("initial_states", 0) == {}:  # an empty mapping: all defaults
        plain["initial_states"] = to_plain(InitialStatesConfig())
    config = from_mapping(EnvConfig, plain, where)
    if scene is not None:
        _check_sizes(config, scene, where)
    return config


def _scene_sizes(scene: Scene) -> RandomizationConfig:
    sizes = scene.scales
    return RandomizationConfig(scale=(min(sizes), max(sizes)), scales=len(sizes))


def _check_sizes(config: EnvConfig, scene: Scene, where: str) -> None:
    for size in config.active_randomization.scale_values:
        if not np.isclose(size, scene.scales).any():
            known = ", ".join(f"{s:.6g}" for s in scene.scales)
            raise ConfigError(
                f"{where}: randomization.scale has the size {size:.6g}; the sizes of the scene are "
                f"{known}: set randomization.scale and randomization.scales to them"
            )


def _scene_fields(scene: Scene) -> dict[str, Any]:
    return {
        "asset": str(scene.asset.folder),
        "task": scene.task.name,
        "joint": scene.task.joint,
        "control": scene.control,
        "physics": scene.physics,
    }


def make_scene(config: EnvConfig) -> Scene:
    """Return the scene of ``config``; the converted and checked object is cached.

    Raises:
        UsageError: The object cannot be read, is rejected, or is out of reach.
    """
    options = ConvertConfig(
        size_m=config.size, category=config.category, closed=config.closed, up=config.up
    )
    cache = cache_folder()
    with cache_in_use(cache):
        asset = load_checked_asset(Path(config.asset), cache, options)
        return _scene(asset, _SceneKey.of(config))


@dataclass(frozen=True, kw_only=True)
class _SceneKey:
    """Fields that determine a scene of an object; key of the cached scenes."""

    task: str
    joint: str | None
    target_open: float | None
    randomization: RandomizationConfig
    placement: tuple[float | Path, ...] | None = None
    control: ControlConfig
    physics: PhysicsConfig

    @staticmethod
    def of(config: EnvConfig) -> _SceneKey:
        return _SceneKey(
            task=config.task,
            joint=config.joint,
            target_open=config.target_open,
            randomization=config.active_randomization,
            control=config.control,
            physics=config.physics,
        )


@lru_cache(maxsize=8)
def _scene(asset: Asset, key: _SceneKey) -> Scene:
    """Return a scene; engines copy its models, so that several can share it.

    Folders of the cache are named by their content, so that equal assets compare equal.
    """
    return choose_scene(key, asset)


def make_episodes(engine: Engine, config: EnvConfig, *, renew: bool) -> Episodes:
    """Return episodes with the ranges, weights and starts of ``config``; reseed them first."""
    return Episodes(
        engine,
        randomization=config.active_randomization,
        reward=config.reward,
        initial_states=config.initial_states,
        seed=0,
        renew=renew,
    )
