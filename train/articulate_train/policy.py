"""The policy as it is used: normalisation, networks and clipping in one module."""

from __future__ import annotations

import io
import json
import pickle  # noqa: TID251  # its error alone, which torch lets through
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from articulate.errors import RunError
from articulate.files import sha256, write_bytes
from articulate.task.observation import ACTION, OBSERVATION
from articulate.transforms import Array
from articulate_train.action_scaling import ELBOW, MOTIONS, shares, taken_back
from articulate_train.config import ActionScalingConfig

CHECKPOINT = "checkpoint.pt"
"""File of a seed's folder that holds all of its state."""
CHOSEN = "policy.pt"
"""File of a seed's folder that holds the policy which was chosen at the end of its training."""
FURTHER = "further"
"""Key of a checkpoint under which it holds a seed's further members."""
ACTS = "acts"
"""Key of a chosen policy under which it holds the number of the member that acts alone, if one."""
MOST_LETTERS = 160
"""Letters that are told of why a checkpoint does not fit."""


class Network(nn.Module):
    """Raw observations (N, size of OBSERVATION) to what one trained network says (N, 8)."""

    mean: Tensor
    scale: Tensor

    def __init__(self, mean: Tensor, variance: Tensor, hidden: tuple[int, ...]) -> None:
        """With the running mean and variance of observations and the widths of hidden layers."""
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
        """The mean of its distribution, clipped to [-1, 1]."""
        seen = torch.clamp((observation - self.mean) * self.scale, -10.0, 10.0)
        said: Tensor = torch.clamp(self.head(self.body(seen)), -1.0, 1.0)
        return said


class Policy(nn.Module):
    """Raw observations (N, size of OBSERVATION) to actions (N, 8) in [-1, 1], float32."""

    def __init__(self, networks: Sequence[Network], fine: ActionScalingConfig) -> None:
        """With the networks of a seed's members, of which each says as much as the others."""
        super().__init__()
        self.networks = nn.ModuleList(networks)
        self.fine = fine
        self.steps = 0
        """Ticks of experience it was made after; 0 where that is not known."""
        self.alone: int | None = None
        """Number of the seed's member that acts alone; None where all do."""

    def forward(self, observation: Tensor) -> Tensor:
        """The mean of what the members say, its motions finer near the handle."""
        said = self.networks[0](observation)
        for network in list(self.networks)[1:]:
            said = said + network(observation)
        said = said / float(len(self.networks))
        motions = said[:, :MOTIONS] * shares(self.fine, observation)
        tool = motions[:, :ELBOW] - taken_back(self.fine, observation)
        tool = torch.clamp(tool, -1.0, 1.0)
        return torch.cat([tool, motions[:, ELBOW:], said[:, MOTIONS:]], dim=1)

    def act(self, observation: Array) -> Array:
        """Actions (N, 8) for observations (N, size) as arrays."""
        with torch.no_grad():
            out = self(torch.as_tensor(observation, dtype=torch.float32))
        return np.asarray(out.numpy(), dtype=np.float64)


def judged_file(folder: Path) -> Path:
    """File that holds the policy of a seed's folder: the chosen one, else the last checkpoint."""
    chosen = folder / CHOSEN
    return chosen if chosen.exists() else folder / CHECKPOINT


def write_state(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint or a state of a policy, whole or not at all.

    Raises:
        UsageError: It cannot be written.
    """
    stream = io.BytesIO()  # on a full disk torch raises what tells nobody that it is full
    torch.save(content, stream)
    write_bytes(path, stream.getvalue())


def read_checkpoint(folder: Path, name: str = CHECKPOINT) -> dict[str, Any]:
    """A checkpoint of a seed's folder; only tensors and plain values are read from the file.

    Raises:
        RunError: There is none, or it is not whole.
    """
    path = folder / name
    try:
        content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise RunError(f"{folder}: no checkpoint; train first, or go on with --resume") from None
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        raise RunError(f"{path}: cannot be read ({type(error).__name__}); train again") from None
    with of_this_version(path):
        if not isinstance(content, dict):
            raise TypeError(f"it holds a {type(content).__name__}")
    return content


@contextmanager
def of_this_version(path: Path) -> Iterator[None]:
    """Inside, a checkpoint that lacks something, or has another size, is a RunError of its path.

    Raises:
        RunError: What was read does not fit what this version trains.
    """
    try:
        yield
    except (KeyError, RuntimeError, ValueError, TypeError) as error:
        said = " ".join(f"{type(error).__name__}: {error}".split())
        why = said if len(said) <= MOST_LETTERS else f"{said[:MOST_LETTERS]}..."
        raise RunError(f"{path}: made by another version ({why}); train again") from error


def load_policy(folder: Path) -> Policy:
    """The policy of a seed's folder: the one chosen, else that of its last checkpoint.

    Raises:
        RunError: There is none, it is not whole, or another version made it.
    """
    path = judged_file(folder)
    content = read_checkpoint(folder, path.name)
    with of_this_version(path):
        return policy_of(content)


def checkpoint_sha256(folder: Path) -> str:
    """Sum of the file in a seed's folder that holds its policy; empty if there is none."""
    path = judged_file(folder)
    return sha256(path) if path.exists() else ""


def members_of(checkpoint: dict[str, Any]) -> list[dict[str, Any]]:
    """What a checkpoint holds of each of a seed's members, the first being the file itself."""
    return [checkpoint, *checkpoint.get(FURTHER, [])]


def acting_members(checkpoint: dict[str, Any]) -> list[dict[str, Any]]:
    """Those of a checkpoint's members that act: all, or the one that was chosen to act alone."""
    members, alone = members_of(checkpoint), checkpoint.get(ACTS)
    if alone is None:
        return members
    if not (isinstance(alone, int) and 0 <= alone < len(members)):
        raise ValueError(f"member {alone!r} of {len(members)} acts")
    return [members[alone]]


def trained_steps(checkpoint: dict[str, Any]) -> int:
    """Ticks of experience that a checkpoint was made after; 0 where it does not say.

    Those of all members together.
    """
    told = [json.loads(member.get("plain", "{}")) for member in members_of(checkpoint)]
    return sum(int(plain.get("num_timesteps", 0)) for plain in told)


def policy_of(checkpoint: dict[str, Any]) -> Policy:
    """The policy held in a checkpoint's weights and normalisation."""
    members = acting_members(checkpoint)
    policy = Policy(
        [_network_of(member) for member in members], ActionScalingConfig(**checkpoint["fine"])
    )
    policy.steps, policy.alone = trained_steps(checkpoint), checkpoint.get(ACTS)
    return policy.eval()


def _network_of(checkpoint: dict[str, Any]) -> Network:
    weights, mean = checkpoint["policy"], checkpoint["normalise"]["mean"]
    if mean.numel() < OBSERVATION.size:
        raise ValueError(f"observations of {mean.numel()} numbers, not {OBSERVATION.size}")
    names = [f"mlp_extractor.policy_net.{2 * i}" for i in range(len(checkpoint["net"]))]
    network = Network(
        mean[: OBSERVATION.size],  # the rest is the value function's
        checkpoint["normalise"]["var"][: OBSERVATION.size],
        tuple(int(v) for v in checkpoint["net"]),
    )
    state = {f"body.{2 * i}.{p}": weights[f"{n}.{p}"] for i, n in enumerate(names) for p in _PARTS}
    state |= {f"head.{p}": weights[f"action_net.{p}"] for p in _PARTS}
    network.load_state_dict(state | {"mean": network.mean, "scale": network.scale})
    return network


_PARTS = ("weight", "bias")
