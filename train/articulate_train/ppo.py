"""PPO of Stable-Baselines3 on our episodes, with checkpoints that hold all of its state."""

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
from articulate_envs.episodes import Episodes
from articulate_envs.scene import Scene
from articulate_envs.scripted_expert import guide_of
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.config import PpoConfig, TrainConfig
from articulate_train.imitation import imitate
from articulate_train.policy import CHECKPOINT, write_state
from articulate_train.vecenv import EpisodesVecEnv


class Learner:
    """A member's training: environments, normalisation, algorithm, and all of their state."""

    def __init__(
        self, scene: Scene, config: TrainConfig, seed: int, *, threads: int, member: int = 0
    ) -> None:
        """Build everything from ``config``, ``seed`` and ``member``; nothing is stepped yet."""
        self.config = config
        stream = np.random.SeedSequence([seed, TRAINING, member])
        way_m = scene.asset.handle_way(scene.task.joint)
        self.fine = config.fine.of(scene.task, way_m)
        ppo = config.ppo
        engine = ThreadEngine(scene, ppo.n_envs, threads=threads)
        self.episodes = Episodes(
            engine,
            draws=config.draw,
            reward=config.reward,
            starts=config.starts,
            seed=stream,
        )
        self.envs = EpisodesVecEnv(self.episodes, self.fine)
        self._guide = guide_of(scene)
        self.normalise = VecNormalize(self.envs, gamma=ppo.gamma)
        own = seed if member == 0 else int(stream.generate_state(1)[0])
        self.model = make_ppo(self.normalise, ppo, own)

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
        """Whether it has the ticks that the configuration gives a member."""
        return self.model.num_timesteps >= self.config.member_steps

    def begin(self) -> None:
        """Get ready for updates, at the beginning or after :meth:`restore`."""
        model = self.model
        left = self.config.member_steps - model.num_timesteps
        _, self._callback = model._setup_learn(left, _Nothing(), reset_num_timesteps=False)

    def update(self) -> None:
        """Collect a roll-out and learn from it.

        Raises:
            DivergedError: A weight is no longer finite.
        """
        model, total = self.model, self.config.steps  # it gets as far as its share of them
        self.episodes.progress = model.num_timesteps / total
        self._show()
        with torch.no_grad():
            bound = self.config.ppo.log_std_bound(self.episodes.progress)
            model.policy.log_std.clamp_(max=bound)
        try:
            model.collect_rollouts(
                self.normalise, self._callback, model.rollout_buffer, n_rollout_steps=model.n_steps
            )
            model._update_current_progress_remaining(model.num_timesteps, total)
            self._update()
        except ValueError:  # torch refuses distributions whose mean is not finite
            if self.is_finite():
                raise
        if not self.is_finite():
            raise DivergedError(f"weights are not finite after {model.num_timesteps} steps")

    def _show(self) -> None:
        """Let the guide show, and act where it still leads, if it does so now."""
        show, progress = self.config.show, self.episodes.progress
        shows = show.shows(progress)
        self.envs.guide = self._guide if shows else None
        self.envs.led = round(show.leads(progress) * self.config.ppo.n_envs)
        self.envs.shown.clear()

    def _update(self) -> None:
        """Learn from the roll-out: from what was shown, if it was, else what PPO does."""
        if self.envs.guide is None:
            self.model.train()
        else:
            imitate(self.model, np.stack(self.envs.shown), self.config.show)

    def is_finite(self) -> bool:
        """Whether all weights and the normalisation are numbers."""
        rms: Any = self.normalise.obs_rms  # of one space, not of a dictionary
        plain = np.isfinite(rms.mean).all() and np.isfinite(rms.var).all()
        weights = self.model.policy.parameters()
        return bool(plain) and all(bool(torch.isfinite(p).all()) for p in weights)

    def update_figures(self) -> dict[str, float]:
        """What Stable-Baselines3 recorded of the last update, of :data:`UPDATE_FIGURES`.

        Where all returns are equal their explained variance is no number, and is left out.
        """
        recorded = self.model.logger.name_to_value
        figures = {name: float(recorded.get(f"train/{name}", "nan")) for name in UPDATE_FIGURES}
        return {name: value for name, value in figures.items() if math.isfinite(value)}

    def content(self) -> dict[str, Any]:
        """What a checkpoint holds of it: weights, optimiser, environments, generators."""
        model, norm = self.model, self.normalise
        snapshot = self.episodes.snapshot()
        generator = snapshot.pop("generator")
        # SB3 shuffles minibatches with numpy's global generator.
        state: Any = np.random.get_state()  # noqa: NPY002
        name, keys, *rest = state
        return self.acting() | {
            "optimizer": model.policy.optimizer.state_dict(),
            "returns_rms": _running(norm.ret_rms),
            "returns": torch.from_numpy(norm.returns.copy()),
            "episodes": {k: torch.from_numpy(np.asarray(v).copy()) for k, v in snapshot.items()},
            "finished": {k: torch.from_numpy(v) for k, v in self.envs.pending().items()},
            "last_observation": torch.from_numpy(np.asarray(model._last_obs).copy()),
            "last_raw": torch.from_numpy(np.asarray(norm.old_obs).copy()),
            "last_starts": torch.from_numpy(np.asarray(model._last_episode_starts).copy()),
            "torch_generator": torch.get_rng_state(),
            "numpy_keys": torch.from_numpy(np.asarray(keys, dtype=np.int64)),
            "plain": json.dumps(
                {
                    "generator": generator,
                    "numpy": [name, *(float(v) if isinstance(v, float) else int(v) for v in rest)],
                    "python": random.getstate(),
                    "num_timesteps": model.num_timesteps,
                    "n_updates": model._n_updates,
                }
            ),
        }

    def acting(self) -> dict[str, Any]:
        """What a checkpoint holds of the policy alone, for :func:`.policy.policy_of`."""
        steps = self.model.num_timesteps
        return {
            "policy": {k: v.clone() for k, v in self.model.policy.state_dict().items()},
            "net": list(self.config.ppo.net),
            "fine": asdict(self.fine),
            "normalise": _running(self.normalise.obs_rms),
            "plain": json.dumps({"num_timesteps": steps}),
        }

    def restore(self, content: dict[str, Any]) -> None:
        """Continue from what :meth:`content` gave."""
        model, norm = self.model, self.normalise
        seen: Any = norm.obs_rms  # of one space, not of a dictionary
        plain = json.loads(content["plain"])
        snapshot = {k: v.numpy() for k, v in content["episodes"].items()}
        self.episodes.restore(snapshot | {"generator": plain["generator"]})
        finished = content.get("finished", {})  # older checkpoints have it not
        self.envs.restore(content["last_raw"].numpy(), {k: v.numpy() for k, v in finished.items()})
        model.policy.load_state_dict(content["policy"])
        model.policy.optimizer.load_state_dict(content["optimizer"])
        for rms, key in ((seen, "normalise"), (norm.ret_rms, "returns_rms")):
            rms.mean, rms.var = content[key]["mean"].numpy(), content[key]["var"].numpy()
            rms.count = float(content[key]["count"])
        norm.returns = content["returns"].numpy()
        norm.old_obs = content["last_raw"].numpy()
        model._last_obs = content["last_observation"].numpy()
        model._last_original_obs = norm.old_obs
        model._last_episode_starts = content["last_starts"].numpy()
        model.num_timesteps = int(plain["num_timesteps"])
        model._n_updates = int(plain["n_updates"])
        torch.set_rng_state(content["torch_generator"])
        name, *rest = plain["numpy"]
        np.random.set_state(  # noqa: NPY002
            (name, content["numpy_keys"].numpy().astype(np.uint32), *rest)
        )
        version, words, gauss = plain["python"]
        random.setstate((version, tuple(words), gauss))

    def close(self) -> None:
        """Give back the engine."""
        self.envs.close()


def write_checkpoint(folder: Path, content: dict[str, Any]) -> None:
    """Write a seed's ``checkpoint.pt``, whole or not at all."""
    write_state(folder / CHECKPOINT, content)


UPDATE_FIGURES = ("approx_kl", "clip_fraction", "explained_variance", "value_loss")
"""How far an update moved the policy, and how well the value function does."""
TRAINING, EVALUATION, SELECTION = 0, 1, 2
"""Last word of seeds: training, evaluation and the choice of a state never share a stream."""


def make_ppo(envs: Any, config: PpoConfig, seed: int) -> PPO:
    """Stable-Baselines3's PPO with our parameters on normalised environments."""
    last, first = config.learning_rate_last, config.learning_rate

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
            "net_arch": list(config.net),
            "activation_fn": nn.ELU,
            "log_std_init": config.log_std_init,
            "optimizer_kwargs": {"eps": 1e-5, "fused": True},  # Stable-Baselines3's eps
        },
    )
    model.set_logger(Logger(folder=None, output_formats=[]))  # its own makes a folder in /tmp
    return model


class AsymmetricPolicy(ActorCriticPolicy):
    """The policy sees the observation, the value function also what follows it."""

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
