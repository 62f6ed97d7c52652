"""Command line that repeats a run: all settings as flags of ``train``."""

from __future__ import annotations

import shlex
from typing import Any

from articulate.commands.fields import Flag, flags_of
from articulate_train.config import TrainConfig

ALWAYS = ("asset", "task", "joint", "seeds", "steps")
"""Keys that are written even if they have the default value."""
NEVER = ("jobs", "checkpoint_updates")
"""Keys that do not change results."""


def train_command(config: TrainConfig, joint: str) -> str:
    """Return the command that trains and evaluates under ``config``, without YAML files.

    Args:
        config: Configuration.
        joint: Joint that was selected, if ``config`` names none.
    """
    defaults = {flag.path: flag.default for flag in flags_of(TrainConfig)}
    words = ["train"]
    for flag in flags_of(TrainConfig, config):
        name = flag.path[0]
        value = joint if name == "joint" else flag.default
        if name in NEVER or (name not in ALWAYS and value == defaults[flag.path]):
            continue
        words += _words(flag, value)
    return shlex.join(words)


def _words(flag: Flag, value: Any) -> list[str]:
    """Return a flag with its value as on the command line."""
    if len(flag.path) > 1:
        values = value if isinstance(value, tuple) else (value,)
        text = ",".join(map(str, values))
        return ["--set", f"{flag.key}={text.lower() if flag.is_switch else text}"]
    if flag.is_switch:
        return [flag.name if value else f"--no-{flag.name.removeprefix('--')}"]
    values = value if isinstance(value, tuple) else (value,)
    return [flag.name, *map(str, values)]
