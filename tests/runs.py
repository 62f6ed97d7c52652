"""Run folders for tests: everything that a run has, with a policy that learned nothing."""

from __future__ import annotations

import itertools
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch
from tests.placements import find_placement

from articulate.assets.asset import Asset
from articulate.config import to_yaml
from articulate.files import write_text
from articulate.robot.arm import PANDA
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import make_task
from articulate_envs.config import InitialStatesConfig
from articulate_train.config import (
    ActionScalingConfig,
    CheckpointSelectionConfig,
    PpoConfig,
    TrainConfig,
)
from articulate_train.policy import CHECKPOINT
from articulate_train.run import CONFIG_END, Run, open_run, write_scene

JOINT = "drawer_2_slide"


TINY_PPO = PpoConfig(n_envs=4, n_steps=8, batch_size=16, n_epochs=2, net_arch=(8, 8))


def tiny_run(folder: Path, asset: Asset, *, updates: int = 6, **changes: Any) -> Run:
    """A run of one seed, not begun yet, of ``updates`` updates of 32 steps that take milliseconds.

    Its seed has one member, its episodes take a second, its objects come in three sizes, every
    second update is kept, and the last state is its policy.
    """
    plan: dict[str, Any] = {
        "seeds": (0,),
        "steps": 32 * updates,
        "ensemble_size": 1,
        "initial_policy": "random",
        "jobs": 1,
        "checkpoint_updates": 2,
        "episodes": 4,
        "ppo": TINY_PPO,
        "randomization": replace(RandomizationConfig(), scales=3),
        "initial_states": InitialStatesConfig(n_precomputed=16),
        "checkpoint_selection": CheckpointSelectionConfig(n_checkpoints=1, member_episodes=0),
    }
    config = TrainConfig(asset=str(asset.folder), **({"joint": JOINT} | plan | changes))
    _write_run(folder, asset, config, episode_s=1.0)
    return open_run(folder)


def make_run(
    folder: Path,
    asset: Asset,
    *,
    seeds: tuple[int, ...] = (0,),
    episode_s: float = 10.0,
    joint: str = JOINT,
    task: str = "open_drawer",
) -> Path:
    """A run of ``task`` in ``folder`` whose policies are random, from their seeds."""
    config = TrainConfig(
        asset=str(asset.folder),
        task=task,
        joint=joint,
        seeds=seeds,
        randomization=replace(RandomizationConfig(), scales=3),
    )
    _write_run(folder, asset, config, episode_s=episode_s)
    for seed in seeds:
        write_checkpoint(folder / f"seed_{seed}", seed)
    return folder


def _write_run(folder: Path, asset: Asset, config: TrainConfig, *, episode_s: float) -> None:
    assert config.joint is not None
    task = make_task(config.task, asset, config.joint, episode_s=episode_s)
    placement = find_placement(asset, task, PANDA, config.randomization)
    folder.mkdir(parents=True)
    shutil.copytree(asset.folder, folder / "asset")
    write_text(folder / "config.yaml", to_yaml(config) + CONFIG_END)
    write_scene(folder, task, placement, PANDA)


def write_checkpoint(folder: Path, seed: int, net: tuple[int, ...] = (32, 32)) -> None:
    """Write the part of a checkpoint that exporting reads: weights and normalization."""
    generator = torch.Generator().manual_seed(seed)

    def sampled(*shape: int) -> torch.Tensor:
        out: torch.Tensor = torch.randn(*shape, generator=generator) / shape[-1] ** 0.5
        return out

    widths = (OBSERVATION.size, *net)
    weights: dict[str, torch.Tensor] = {}
    for i, (a, b) in enumerate(itertools.pairwise(widths)):
        name = f"mlp_extractor.policy_net.{2 * i}"
        weights |= {f"{name}.weight": sampled(b, a), f"{name}.bias": sampled(b)}
    weights |= {
        "action_net.weight": sampled(ACTION.size, net[-1]),
        "action_net.bias": sampled(ACTION.size),
    }
    mean, var = sampled(OBSERVATION.size).double(), torch.ones(OBSERVATION.size).double() * 0.5
    folder.mkdir()
    content = {
        "policy": weights,
        "net_arch": list(net),
        "action_scaling": asdict(ActionScalingConfig()),
        "normalization": {"mean": mean, "var": var},
    }
    torch.save(content, folder / CHECKPOINT)
