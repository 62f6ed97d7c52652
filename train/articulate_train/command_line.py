"""The command that repeats a run: everything that was asked for, as flags of ``train``."""

from __future__ import annotations

import shlex
from typing import Any

from articulate.commands.fields import Flag, flags_of
from articulate_train.config import TrainConfig

TOLD = ("asset", "task", "joint", "seeds", "steps")
"""Flags that are told even where they are as by default."""
SILENT = ("jobs", "checkpoint_updates")
"""Flags that change no result."""


def train_command(config: TrainConfig, joint: str) -> str:
    """The line that trains and evaluates as ``config`` says, without any file of presets.

    Args:
        config: What was asked for.
        joint: Joint that was chosen, where ``config`` leaves the choice open.
    """
    usual = {flag.path: flag.default for flag in flags_of(TrainConfig)}
    words = ["train"]
    for flag in flags_of(TrainConfig, config):
        name = flag.path[0]
        value = joint if name == "joint" else flag.default
        if name in SILENT or (name not in TOLD and value == usual[flag.path]):
            continue
        words += _words(flag, value)
    return shlex.join(words)


def _words(flag: Flag, value: Any) -> list[str]:
    """A flag with its value, as it is typed."""
    if flag.is_switch:
        return [flag.name if value else f"--no-{flag.name.removeprefix('--')}"]
    values = value if isinstance(value, tuple) else (value,)
    return [flag.name, *map(str, values)]
