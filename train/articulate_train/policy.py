"""Trained policy as a torch module: normalization, networks, ensemble mean and action scaling."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from articulate.errors import RunError, shorten
from articulate.files import sha256, write_bytes
from articulate.task.observation import ACTION, OBSERVATION
from articulate.transforms import Array
from articulate.untrusted import read_bounded
from articulate_train.action_scaling import corrected_action
from articulate_train.config import ActionScalingConfig

CHECKPOINT = "checkpoint.pt"
"""File in a seed's folder with the complete state of training."""
POLICY = "policy.pt"
"""File in a seed's folder with the selected policy."""
OTHER_MEMBERS = "other_members"
"""Checkpoint key of the ensemble members after the first."""
ACTIVE_MEMBER = "active_member"
"""Key of a selected policy: index of the member that is used without the others, if one is."""
MAX_CHECKPOINT_BYTES = 2_000_000_000
"""Largest checkpoint that is read."""
MAX_REASON_CHARS = 160
"""Most characters of the reason for which a checkpoint is rejected."""


class Network(nn.Module):
    """One trained network: raw observations (N, size) to corrections (N, 8) of the expert."""

    mean: Tensor
    scale: Tensor

    def __init__(self, mean: Tensor, variance: Tensor, hidden: tuple[int, ...]) -> None:
        """Build the layers.

        Args:
            mean: Running mean of observations (size,).
            variance: Running variance of observations (size,).
            hidden: Widths of the hidden layers.
        """
        super().__init__()
        self.register_buffer("mean", mean.float())
        self.register_buffer("scale", torch.rsqrt(variance.double() + 1e-8).float())
        widths = (mean.numel(), *hidden)
        layers: list[nn.Module] = []
        for a, b in pairwise(widths):
            layers += [nn.Linear(a, b), nn.ELU()]
        self.body = nn.Sequential(*layers)
        self.head = nn.Linear(widths[-1], ACTION.size)

    def forward(self, observation: Tensor) -> Tensor:
        """Return the mean correction (N, 8), clipped to [-1, 1]."""
        normalized = torch.clamp((observation - self.mean) * self.scale, -10.0, 10.0)
        action: Tensor = torch.clamp(self.head(self.body(normalized)), -1.0, 1.0)
        return action


class Policy(nn.Module):
    """Ensemble: raw observations (N, size) to actions (N, 8) in [-1, 1], float32."""

    def __init__(self, networks: Sequence[Network], action_scaling: ActionScalingConfig) -> None:
        """Combine the networks of the active members, equally weighted."""
        super().__init__()
        self.networks = nn.ModuleList(networks)
        self.action_scaling = action_scaling
        self.steps = 0
        """Control steps of experience; 0 if unknown."""
        self.active_member: int | None = None
        """Index of the only active ensemble member; None if all are active."""

    def forward(self, observation: Tensor) -> Tensor:
        """Return the action of the expert with the mean correction of the members (N, 8)."""
        action = self.networks[0](observation)
        for network in list(self.networks)[1:]:
            action = action + network(observation)
        action = action / float(len(self.networks))
        corrected: Tensor = corrected_action(self.action_scaling, observation, action)
        return corrected

    def act(self, observation: Array) -> Array:
        """Return actions (N, 8) in [-1, 1] for raw observations (N, size)."""
        with torch.no_grad():
            out = self(torch.as_tensor(observation, dtype=torch.float32))
        return np.asarray(out.numpy(), dtype=np.float64)


def policy_file(folder: Path) -> Path:
    """Return the file with a seed's policy: the selected one, else the last checkpoint."""
    selected = folder / POLICY
    return selected if selected.exists() else folder / CHECKPOINT


def write_state(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint or a policy atomically.

    Raises:
        UsageError: It cannot be written.
    """
    stream = io.BytesIO()  # torch's error on a full disk does not name the cause
    torch.save(content, stream)
    write_bytes(path, stream.getvalue())


def read_checkpoint(folder: Path, name: str = CHECKPOINT) -> dict[str, Any]:
    """Read a checkpoint of a seed's folder; only tensors and plain values are unpickled.

    Raises:
        RunError: It is missing, damaged, not a regular file or too large.
    """
    path = folder / name
    if not path.exists():
        raise RunError(f"{folder}: no checkpoint; train first, or continue with --resume")
    stream = io.BytesIO(read_bounded(path, MAX_CHECKPOINT_BYTES, error=RunError))
    try:
        content: dict[str, Any] = torch.load(stream, map_location="cpu", weights_only=True)
    except Exception as error:  # noqa: BLE001  damaged pickles raise errors of any kind
        raise RunError(f"{path}: cannot be read ({type(error).__name__}); train again") from None
    with reject_other_versions(path):
        if not isinstance(content, dict):
            raise TypeError(f"it holds a {type(content).__name__}")
    return content


@contextmanager
def reject_other_versions(path: Path) -> Iterator[None]:
    """Turn errors about the content of a checkpoint into a RunError that names ``path``.

    Raises:
        RunError: A key is missing or a tensor has another shape than this version uses.
    """
    try:
        yield
    except (KeyError, RuntimeError, ValueError, TypeError) as error:
        reason = shorten(" ".join(f"{type(error).__name__}: {error}".split()), MAX_REASON_CHARS)
        raise RunError(f"{path}: made by another version ({reason}); train again") from error


def load_policy(folder: Path) -> Policy:
    """Load the policy of a seed's folder: the selected one, else the last checkpoint.

    Raises:
        RunError: It is missing, damaged or made by another version.
    """
    path = policy_file(folder)
    content = read_checkpoint(folder, path.name)
    with reject_other_versions(path):
        return policy_of(content)


def checkpoint_sha256(folder: Path) -> str:
    """Return the SHA-256 of a seed's policy file; empty if there is none."""
    path = policy_file(folder)
    return sha256(path) if path.exists() else ""


def ensemble_of(checkpoint: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the states of all ensemble members; the first is the checkpoint itself."""
    return [checkpoint, *checkpoint.get(OTHER_MEMBERS, [])]


def active_members(checkpoint: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the states of the active members: all, or the one that was selected."""
    members, active = ensemble_of(checkpoint), checkpoint.get(ACTIVE_MEMBER)
    if active is None:
        return members
    if not (isinstance(active, int) and 0 <= active < len(members)):
        raise ValueError(f"active member {active!r} of {len(members)}")
    return [members[active]]


def trained_steps(checkpoint: dict[str, Any]) -> int:
    """Return the control steps of experience of all members; 0 if unknown."""
    rows = [json.loads(member.get("metadata", "{}")) for member in ensemble_of(checkpoint)]
    return sum(int(row.get("num_timesteps", 0)) for row in rows)


def policy_of(checkpoint: dict[str, Any]) -> Policy:
    """Build the policy from a checkpoint's weights and normalization."""
    networks = [_network_of(member) for member in active_members(checkpoint)]
    policy = Policy(networks, ActionScalingConfig(**checkpoint["action_scaling"]))
    policy.steps = trained_steps(checkpoint)
    policy.active_member = checkpoint.get(ACTIVE_MEMBER)
    return policy.eval()


def _network_of(checkpoint: dict[str, Any]) -> Network:
    weights, mean = checkpoint["policy"], checkpoint["normalization"]["mean"]
    if mean.numel() < OBSERVATION.size:
        raise ValueError(f"observations of {mean.numel()} numbers, not {OBSERVATION.size}")
    names = [f"mlp_extractor.policy_net.{2 * i}" for i in range(len(checkpoint["net_arch"]))]
    network = Network(
        mean[: OBSERVATION.size],  # the others belong to the value function
        checkpoint["normalization"]["var"][: OBSERVATION.size],
        tuple(int(v) for v in checkpoint["net_arch"]),
    )
    state = {f"body.{2 * i}.{p}": weights[f"{n}.{p}"] for i, n in enumerate(names) for p in _PARTS}
    state |= {f"head.{p}": weights[f"action_net.{p}"] for p in _PARTS}
    network.load_state_dict(state | {"mean": network.mean, "scale": network.scale})
    return network


_PARTS = ("weight", "bias")
