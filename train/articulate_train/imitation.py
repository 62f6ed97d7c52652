"""DAgger: imitate the scripted expert from the policy's own observations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import torch
from stable_baselines3 import PPO
from torch import Tensor
from torch.nn import functional

from articulate.transforms import Array
from articulate_train.config import ImitationConfig


@dataclass
class ImitationData:
    """Samples of the expert on which the policy is fitted, with one row per control step."""

    observations: list[Tensor] = field(default_factory=list)
    """Normalized observations of each update (M, size)."""
    actions: list[Tensor] = field(default_factory=list)
    """Corrections to imitate (M, 8), in [-1, 1]."""

    def add(self, observations: Tensor, actions: Tensor, *, keep: bool) -> tuple[Tensor, Tensor]:
        """Add the samples of an update; return all, or only these if ``keep`` is false."""
        if not keep:
            return observations, actions
        self.observations.append(observations)
        self.actions.append(actions)
        return torch.cat(self.observations), torch.cat(self.actions)

    def clear(self) -> None:
        """Release the samples after the imitation phase."""
        self.observations.clear()
        self.actions.clear()

    def state_dict(self) -> dict[str, Tensor]:
        """Return all samples for a checkpoint; empty if there are none."""
        if not self.observations:
            return {}
        both = {"observations": self.observations, "actions": self.actions}
        return {name: torch.cat(rows) for name, rows in both.items()}

    def restore(self, content: dict[str, Tensor]) -> None:
        """Continue from the result of :meth:`state_dict`."""
        self.clear()
        if content:
            self.observations.append(content["observations"])
            self.actions.append(content["actions"])


def imitate(model: PPO, corrections: Array, config: ImitationConfig, data: ImitationData) -> None:
    """Fit the mean correction to the wanted ones, and the value function to the returns.

    Args:
        model: PPO with a full rollout buffer.
        corrections: Corrections to imitate at the observations of the rollout (T, N, 8), in
            [-1, 1].
        config: Number of epochs and learning rate.
        data: Samples of earlier updates, to which those of the rollout are added.
    """
    policy: Any = model.policy
    buffer: Any = model.rollout_buffer
    rows = [buffer.swap_and_flatten(a) for a in (buffer.observations, buffer.returns, corrections)]
    observations, returns, targets = (torch.as_tensor(row, dtype=torch.float32) for row in rows)
    for group in policy.optimizer.param_groups:
        group["lr"] = config.learning_rate
    inputs, wanted = data.add(observations, targets, keep=config.aggregate)
    for _ in range(config.epochs):
        order = torch.randperm(len(observations))
        older = torch.randint(len(inputs), order.shape) if config.aggregate else order
        for start in range(0, len(observations), model.batch_size):
            batch, sampled = (rows[start : start + model.batch_size] for rows in (order, older))
            actor = policy.mlp_extractor.forward_actor(policy.extract_features(inputs[sampled]))
            critic = policy.mlp_extractor.forward_critic(
                policy.extract_features(observations[batch])
            )
            action_loss = functional.mse_loss(policy.action_net(actor), wanted[sampled])
            value_loss = functional.mse_loss(policy.value_net(critic), returns[batch])
            policy.optimizer.zero_grad()
            loss: Any = action_loss + model.vf_coef * value_loss
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
            policy.optimizer.step()
    model._n_updates += model.n_epochs
    model.logger.record("train/imitation_loss", float(action_loss.detach()))
