"""Stable-Baselines3 PPO on articulated-object episodes, with complete checkpoints."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from articulate.errors import DivergedError
from articulate.task.observation import OBSERVATION
from articulate_envs.engines import make_engine
from articulate_envs.episodes import Episodes
from articulate_envs.scene import Scene
from articulate_train.config import PpoConfig, TrainConfig
from articulate_train.generalist import generalist_state, load_initial, with_layers
from articulate_train.imitation import ImitationData, imitate
from articulate_train.policy import CHECKPOINT, write_state
from articulate_train.vecenv import EpisodesVecEnv


class Learner:
    """Training of one ensemble member: environments, normalization and PPO."""

    def __init__(
        self, scene: Scene, config: TrainConfig, seed: int, *, threads: int, member: int = 0
    ) -> None:
        """Build everything from ``config``, ``seed`` and ``member`` without stepping."""
        self.config = config = config.effective()
        stream = np.random.SeedSequence([seed, TRAINING, member])
        path_m = scene.asset.handle_travel(scene.task.joint)
        self.action_scaling = config.action_scaling.for_path(path_m)
        start = None
        if config.starts_from_generalist:
            start = generalist_state(config, scene)
        self.ppo = config.ppo if start is None else with_layers(config.ppo, start)
        ppo = self.ppo
        engine = make_engine(config.engine, scene, ppo.n_envs, threads=threads, warp=config.warp)
        self.episodes = Episodes(
            engine,
            randomization=config.randomization,
            reward=config.reward,
            initial_states=config.initial_states,
            seed=stream,
        )
        self.envs = EpisodesVecEnv(self.episodes, self.action_scaling)
        self._imitation_data = ImitationData()
        self.normalization = VecNormalize(self.envs, gamma=ppo.gamma)
        model_seed = seed if member == 0 else int(stream.generate_state(1)[0])
        self.model = make_ppo(self.normalization, ppo, model_seed)
        if start is not None:
            load_initial(self.model, self.normalization, start)

    def run(self, on_update: Callable[[Learner], bool]) -> None:
        """Collect and update until the configured steps are done.

        Args:
            on_update: Called after each update; returning False stops.

        Raises:
            DivergedError: A weight is no longer finite.
        """
        self.begin()
        while not self.is_done:
            self.update()
            if not on_update(self):
                return

    @property
    def is_done(self) -> bool:
        """True after the control steps that the configuration gives a member."""
        return self.model.num_timesteps >= self.config.member_steps

    def begin(self) -> None:
        """Prepare updates, at the beginning or after :meth:`restore`."""
        model = self.model
        left = self.config.member_steps - model.num_timesteps
        _, self._callback = model._setup_learn(left, _Nothing(), reset_num_timesteps=False)

    def update(self) -> None:
        """Collect a rollout and update on it.

        Raises:
            DivergedError: A weight is no longer finite.
        """
        model, total = self.model, self.config.steps  # schedules count the seed's steps
        self.episodes.progress = model.num_timesteps / total
        self._prepare_imitation()
        with torch.no_grad():
            bound = self.config.ppo.log_std_bound(self.episodes.progress)
            model.policy.log_std.clamp_(max=bound)
        try:
            model.collect_rollouts(
                self.normalization,
                self._callback,
                model.rollout_buffer,
                n_rollout_steps=model.n_steps,
            )
            model._update_current_progress_remaining(model.num_timesteps, total)
            self._update()
        except ValueError:  # torch raises it for distributions with a mean that is not finite
            if self.is_finite():
                raise
        if not self.is_finite():
            raise DivergedError(f"weights are not finite after {model.num_timesteps} steps")

    def _prepare_imitation(self) -> None:
        """Begin or end the imitation phase."""
        self.envs.imitates = self.config.imitation.is_active(self.episodes.progress)
        self.envs.wanted.clear()

    def _update(self) -> None:
        """Update on the rollout: by imitation in its phase, else by PPO."""
        if not self.envs.imitates:
            self._imitation_data.clear()
            self.model.train()
        else:
            actions, config = np.stack(self.envs.wanted), self.config.imitation
            imitate(self.model, actions, config, self._imitation_data)

    def is_finite(self) -> bool:
        """Return whether all weights and the normalization are finite."""
        rms: Any = self.normalization.obs_rms  # the space is a Box, not a Dict
        finite = np.isfinite(rms.mean).all() and np.isfinite(rms.var).all()
        weights = self.model.policy.parameters()
        return bool(finite) and all(bool(torch.isfinite(p).all()) for p in weights)

    def update_figures(self) -> dict[str, float]:
        """Return the values of :data:`UPDATE_FIGURES` that Stable-Baselines3 logged last.

        The explained variance of equal returns is NaN and is left out.
        """
        recorded = self.model.logger.name_to_value
        figures = {name: float(recorded.get(f"train/{name}", "nan")) for name in UPDATE_FIGURES}
        return {name: value for name, value in figures.items() if math.isfinite(value)}

    def state_dict(self) -> dict[str, Any]:
        """Return weights, optimizer, environments and generators for a checkpoint."""
        model, norm = self.model, self.normalization
        snapshot = self.episodes.snapshot()
        generator = snapshot.pop("generator")
        # SB3 shuffles minibatches with numpy's global generator.
        state: Any = np.random.get_state()  # noqa: NPY002
        name, keys, *rest = state
        return self.policy_state() | {
            "optimizer": model.policy.optimizer.state_dict(),
            "returns_rms": _running(norm.ret_rms),
            "returns": torch.from_numpy(norm.returns.copy()),
            "episodes": {k: torch.from_numpy(np.asarray(v).copy()) for k, v in snapshot.items()},
            "imitation": self._imitation_data.state_dict(),
            "finished": {k: torch.from_numpy(v) for k, v in self.envs.pending().items()},
            "last_observation": torch.from_numpy(np.asarray(model._last_obs).copy()),
            "last_raw": torch.from_numpy(np.asarray(norm.old_obs).copy()),
            "last_starts": torch.from_numpy(np.asarray(model._last_episode_starts).copy()),
            "torch_generator": torch.get_rng_state(),
            "numpy_keys": torch.from_numpy(np.asarray(keys, dtype=np.int64)),
            "metadata": json.dumps(
                {
                    "generator": generator,
                    "numpy": [name, *(float(v) if isinstance(v, float) else int(v) for v in rest)],
                    "python": random.getstate(),
                    "num_timesteps": model.num_timesteps,
                    "n_updates": model._n_updates,
                }
            ),
        }

    def policy_state(self) -> dict[str, Any]:
        """Return the part of a checkpoint that :func:`.policy.policy_of` reads."""
        steps = self.model.num_timesteps
        return {
            "policy": {k: v.clone() for k, v in self.model.policy.state_dict().items()},
            "net_arch": list(self.ppo.net_arch),
            "action_scaling": asdict(self.action_scaling),
            "normalization": _running(self.normalization.obs_rms),
            "metadata": json.dumps({"num_timesteps": steps}),
        }

    def restore(self, content: dict[str, Any]) -> None:
        """Continue from the result of :meth:`state_dict`."""
        model, norm = self.model, self.normalization
        obs_rms: Any = norm.obs_rms  # the space is a Box, not a Dict
        metadata = json.loads(content["metadata"])
        snapshot = {k: v.numpy() for k, v in content["episodes"].items()}
        self.episodes.restore(snapshot | {"generator": metadata["generator"]})
        finished = content["finished"]
        self.envs.restore(content["last_raw"].numpy(), {k: v.numpy() for k, v in finished.items()})
        self._imitation_data.restore(content.get("imitation", {}))
        model.policy.load_state_dict(content["policy"])
        model.policy.optimizer.load_state_dict(content["optimizer"])
        for rms, key in ((obs_rms, "normalization"), (norm.ret_rms, "returns_rms")):
            rms.mean, rms.var = content[key]["mean"].numpy(), content[key]["var"].numpy()
            rms.count = float(content[key]["count"])
        norm.returns = content["returns"].numpy()
        norm.old_obs = content["last_raw"].numpy()
        model._last_obs = content["last_observation"].numpy()
        model._last_original_obs = norm.old_obs
        model._last_episode_starts = content["last_starts"].numpy()
        model.num_timesteps = int(metadata["num_timesteps"])
        model._n_updates = int(metadata["n_updates"])
        torch.set_rng_state(content["torch_generator"])
        name, *rest = metadata["numpy"]
        np.random.set_state(  # noqa: NPY002
            (name, content["numpy_keys"].numpy().astype(np.uint32), *rest)
        )
        version, words, gauss = metadata["python"]
        random.setstate((version, tuple(words), gauss))

    def close(self) -> None:
        """Release the engine."""
        self.envs.close()


def write_checkpoint(folder: Path, content: dict[str, Any]) -> None:
    """Write a seed's ``checkpoint.pt`` atomically."""
    write_state(folder / CHECKPOINT, content)


UPDATE_FIGURES = ("approx_kl", "clip_fraction", "explained_variance", "value_loss")
"""Logged statistics of an update: policy change and quality of the value function."""
TRAINING, EVALUATION, SELECTION, TARGET = 0, 1, 2, 3
"""Entries of seed sequences: training, evaluation, selection and target evaluations never share a
stream."""


def make_ppo(envs: Any, config: PpoConfig, seed: int) -> PPO:
    """Build Stable-Baselines3 PPO with the parameters of ``config`` on normalized environments."""
    last, first = config.learning_rate_final, config.learning_rate

    def learning_rate(remaining: float) -> float:
        return float(first * (last / first) ** (1.0 - remaining))

    model = PPO(
        AsymmetricPolicy,
        envs,
        n_steps=config.n_steps,
        batch_size=config.batch_size,
        n_epochs=config.n_epochs,
        learning_rate=learning_rate,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        clip_range=config.clip_range,
        ent_coef=config.ent_coef,
        vf_coef=config.vf_coef,
        max_grad_norm=config.max_grad_norm,
        seed=seed,
        device="cpu",
        policy_kwargs={
            "net_arch": list(config.net_arch),
            "activation_fn": nn.ELU,
            "log_std_init": config.log_std_init,
            "optimizer_kwargs": {"eps": 1e-5, "fused": True},  # Stable-Baselines3's eps
        },
    )
    model.set_logger(
        Logger(folder=None, output_formats=[])
    )  # the default logger makes a folder in /tmp
    return model


class AsymmetricPolicy(ActorCriticPolicy):
    """Policy on the observation; value function on the privileged observation too."""

    def _build_mlp_extractor(self) -> None:
        net: list[int] | dict[str, list[int]] = self.net_arch
        self.mlp_extractor = _Asymmetric(self.features_dim, net, self.activation_fn, "cpu")


class _Asymmetric(MlpExtractor):
    def __init__(
        self,
        feature_dim: int,
        net_arch: list[int] | dict[str, list[int]],
        activation_fn: type[nn.Module],
        device: str,
    ) -> None:
        super().__init__(feature_dim, net_arch, activation_fn, device)
        actor = MlpExtractor(OBSERVATION.size, net_arch, activation_fn, device)
        self.policy_net = actor.policy_net

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        latent: torch.Tensor = self.policy_net(features[:, : OBSERVATION.size])
        return latent


class _Nothing(BaseCallback):
    def _on_step(self) -> bool:
        return True


def _running(rms: Any) -> dict[str, Any]:
    return {
        "mean": torch.from_numpy(np.array(rms.mean, dtype=np.float64)),
        "var": torch.from_numpy(np.array(rms.var, dtype=np.float64)),
        "count": float(rms.count),
    }
