"""Generalist policy for drawers, doors and lids that it has never seen.

One network opens, another closes. They were trained by imitation on generated objects only
(``benchmarks/generalist.py``) and are part of the package. They act without any training on an
object (zero-shot), or are the starting point of a training.
"""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.running_mean_std import RunningMeanStd

from articulate.errors import ConfigError, MissingError
from articulate.files import write_bytes, write_json
from articulate.task.observation import OBSERVATION
from articulate.transforms import Array
from articulate.untrusted import read_bounded
from articulate_envs.scene import Scene
from articulate_train.config import GENERALIST_TASKS, PpoConfig, TrainConfig
from articulate_train.policy import POLICY, Network, write_state
from articulate_train.run import DONE, Run, create_run

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

MAX_BYTES = 2_000_000
"""Largest file of weights."""


def weights_file(task: str) -> Path:
    """Return the file of the weights for ``task``; the JSON file beside it has their origin."""
    return Path(__file__).with_name(f"generalist_{task.partition('_')[0]}.npz")


def write_weights(path: Path, network: Network) -> None:
    """Write the weights and the normalization of ``network`` atomically."""
    state = {name: value.detach().numpy() for name, value in network.state_dict().items()}
    stream = io.BytesIO()
    np.savez(stream, **state)
    write_bytes(path, stream.getvalue())


def generalist_state(config: TrainConfig, scene: Scene) -> dict[str, Any]:
    """Return the generalist as the content of a policy file, for the task of ``scene``.

    Raises:
        ConfigError: The policy was not trained for the task.
        MissingError: The weights are not installed.
    """
    check_task(config.task)
    path = weights_file(config.task)
    if not path.exists():
        raise MissingError(f"{path}: the weights are missing; install the package again")
    content = np.load(io.BytesIO(read_bounded(path, MAX_BYTES)), allow_pickle=False)
    weights = {name: torch.from_numpy(np.array(content[name])) for name in content.files}
    hidden = [len(weights[n]) for n in sorted(weights) if n.startswith("body.") and "bias" in n]
    policy = {
        f"mlp_extractor.policy_net.{name.removeprefix('body.')}": value
        for name, value in weights.items()
        if name.startswith("body.")
    }
    policy |= {
        f"action_net.{name.removeprefix('head.')}": value
        for name, value in weights.items()
        if name.startswith("head.")
    }
    if len(weights["mean"]) != OBSERVATION.size:
        raise ConfigError(f"{path}: made for another version of the observations")
    path_m = scene.asset.handle_travel(scene.task.joint)
    scaling = config.action_scaling.for_path(path_m)
    return {
        "policy": policy,
        "net_arch": hidden,
        "action_scaling": vars(scaling).copy(),
        "normalization": {
            "mean": weights["mean"].double(),
            "var": weights["scale"].double() ** -2,
            "count": 1.0,
        },
        "metadata": json.dumps(
            {"num_timesteps": generalist_metadata(config.task)["control_steps"]}
        ),
    }


def generalist_metadata(task: str) -> dict[str, Any]:
    """Return the origin of the weights for ``task``: command, objects, seed and versions."""
    text = weights_file(task).with_suffix(".json").read_text(encoding="utf-8")
    content: dict[str, Any] = json.loads(text)
    return content


def check_task(task: str) -> None:
    """Raise ConfigError if the policy was not trained for ``task``."""
    if task not in GENERALIST_TASKS:
        known = ", ".join(GENERALIST_TASKS)
        raise ConfigError(f"the generalist policy has no task {task}; it has: {known}")


def with_layers(config: PpoConfig, state: dict[str, Any]) -> PpoConfig:
    """Return ``config`` with the hidden layers of the policy in ``state``."""
    return replace(config, net_arch=tuple(state["net_arch"]))


class PartlyFixedMeanStd(RunningMeanStd):
    """Running mean and variance whose first entries do not change.

    With other statistics the same weights are another policy: one object has a fraction of the
    variation of many.
    """

    def __init__(self, mean: Array, var: Array, size: int) -> None:
        """Fix the entries of ``mean`` and ``var`` (n,), the first of ``size``."""
        super().__init__(shape=(size,))
        self._fixed = mean.copy(), var.copy()
        self._restore()

    def _restore(self) -> None:
        mean, var = self._fixed
        self.mean[: len(mean)], self.var[: len(var)] = mean, var

    def update_from_moments(self, batch_mean: Array, batch_var: Array, batch_count: float) -> None:
        """Update the other entries."""
        super().update_from_moments(batch_mean, batch_var, batch_count)
        self._restore()


def load_initial(model: PPO, normalization: VecNormalize, state: dict[str, Any]) -> None:
    """Begin a training with the policy in ``state``; the value function stays random.

    The normalization of the policy's observations stays that of ``state``.

    Args:
        model: PPO whose policy has the layers of ``state``.
        normalization: Normalization of its environments.
        state: Content of :func:`generalist_state`.
    """
    model.policy.load_state_dict(state["policy"], strict=False)
    own: Any = normalization  # the space is a Box, not a Dict
    mean, var = (state["normalization"][name].numpy() for name in ("mean", "var"))
    own.obs_rms = PartlyFixedMeanStd(mean, var, len(own.obs_rms.mean))


def generalist_run(config: TrainConfig, folder: Path, cache: Path, **options: Any) -> Run:
    """Create a run whose only seed has the generalist policy, without training.

    Args:
        config: Configuration; its first seed is used.
        folder: Folder to create.
        cache: Cache folder.
        options: Callbacks of :func:`articulate_train.run.create_run`.

    Raises:
        UsageError: The folder exists, or the object cannot be read or reached.
    """
    check_task(config.task)
    run = create_run(config, folder, cache, **options)
    state = generalist_state(config, run.scene((1.0,)))
    for seed in config.seeds:
        run.seed_folder(seed).mkdir(exist_ok=True)
        write_state(run.seed_folder(seed) / POLICY, state)
        write_json(
            run.seed_folder(seed) / DONE,
            {"steps": config.steps, "policy": "generalist"} | generalist_metadata(config.task),
        )
    return run
