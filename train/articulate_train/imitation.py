"""Shown: a policy learns to say what the guide would say, from what it sees itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from torch.nn import functional

from articulate.transforms import Array
from articulate_train.action_scaling import ELBOW, MOTIONS
from articulate_train.config import ImitationConfig

LEAST_SHARE = 0.3
"""What is left of a motion counts as at least this when the guide's is turned into what a policy
says: a hand that waits is not to make up for millimetres with all it has."""


def said(asked: Array, shares: Array, back: Array) -> Array:
    """What a policy has to say (N, 8) so that ``asked`` (N, 8) comes of it.

    Args:
        asked: What the arm and the hand are to do.
        shares: What is left of motions (N, 1); see :func:`articulate_train.action_scaling.shares`.
        back: What is taken off again (N, 6); see :func:`articulate_train.action_scaling.taken_back`.
    """
    motions = asked[:, :MOTIONS].copy()
    motions[:, :ELBOW] += back
    motions = np.clip(motions / np.maximum(shares, LEAST_SHARE), -1.0, 1.0)
    return np.concatenate([motions, asked[:, MOTIONS:]], axis=1)


def imitate(model: PPO, shown: Array, config: ImitationConfig) -> None:
    """Bring the mean action near what was ``shown``, and the value near the returns.

    Args:
        model: With a full roll-out.
        shown: What the guide would have said at each of its observations (T, N, 8).
        config: Passes and learning rate.
    """
    policy: Any = model.policy
    buffer: Any = model.rollout_buffer
    rows = [buffer.swap_and_flatten(a) for a in (buffer.observations, buffer.returns, shown)]
    seen, returns, wanted = (torch.as_tensor(row, dtype=torch.float32) for row in rows)
    for group in policy.optimizer.param_groups:
        group["lr"] = config.learning_rate
    for _ in range(config.epochs):
        order = torch.randperm(len(seen))
        for start in range(0, len(seen), model.batch_size):
            some = order[start : start + model.batch_size]
            features = policy.extract_features(seen[some])
            actor, critic = policy.mlp_extractor(features)
            off = functional.mse_loss(policy.action_net(actor), wanted[some])
            value = functional.mse_loss(policy.value_net(critic), returns[some])
            policy.optimizer.zero_grad()
            loss: Any = off + model.vf_coef * value
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
            policy.optimizer.step()
    model._n_updates += model.n_epochs
    model.logger.record("train/shown", float(off.detach()))
