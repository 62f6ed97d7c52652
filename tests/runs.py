"""Run folders for tests: everything that a run has, with a policy that learned nothing."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import torch

from articulate.arm import PANDA
from articulate.asset import Asset
from articulate.config import to_yaml
from articulate.draw import DrawConfig
from articulate.files import write_text
from articulate.observe import ACTION, OBSERVATION
from articulate.task import make_task
from articulate_envs.place import find_place
from articulate_train.config import TrainConfig
from articulate_train.policy import CHECKPOINT
from articulate_train.run import write_scene

JOINT = "drawer_2_slide"


def make_run(
    folder: Path,
    asset: Asset,
    *,
    seeds: tuple[int, ...] = (0,),
    episode_s: float = 10.0,
    joint: str = JOINT,
) -> Path:
    """A run of ``open_drawer`` in ``folder`` whose policies are drawn from their seeds."""
    draws = DrawConfig()
    config = TrainConfig(asset=str(asset.folder), joint=joint, seeds=seeds, draw=draws)
    task = make_task("open_drawer", asset, joint, episode_s=episode_s)
    place = find_place(asset, task, PANDA, draws)
    folder.mkdir(parents=True)
    shutil.copytree(asset.folder, folder / "asset")
    write_text(folder / "config.yaml", to_yaml(config))
    write_scene(folder, task, place, PANDA)
    for seed in seeds:
        write_checkpoint(folder / f"seed_{seed}", seed)
    return folder


def write_checkpoint(folder: Path, seed: int, net: tuple[int, ...] = (32, 32)) -> None:
    """What exporting reads of a checkpoint: weights of the policy, and the normalisation."""
    generator = torch.Generator().manual_seed(seed)

    def drawn(*shape: int) -> torch.Tensor:
        out: torch.Tensor = torch.randn(*shape, generator=generator) / shape[-1] ** 0.5
        return out

    widths = (OBSERVATION.size, *net)
    weights: dict[str, torch.Tensor] = {}
    for i, (a, b) in enumerate(itertools.pairwise(widths)):
        name = f"mlp_extractor.policy_net.{2 * i}"
        weights |= {f"{name}.weight": drawn(b, a), f"{name}.bias": drawn(b)}
    weights |= {
        "action_net.weight": drawn(ACTION.size, net[-1]),
        "action_net.bias": drawn(ACTION.size),
    }
    mean, var = drawn(OBSERVATION.size).double(), torch.ones(OBSERVATION.size).double() * 0.5
    folder.mkdir()
    content = {"policy": weights, "net": list(net), "normalise": {"mean": mean, "var": var}}
    torch.save(content, folder / CHECKPOINT)
