"""Check of ``--require-success``, the required success rate of a command."""

from __future__ import annotations

from articulate.commands import console
from articulate.errors import ConfigError

MISSED = 3
"""Exit code of a command that is done but below the requirement."""


def check_share(required: float) -> None:
    """Check that a required success rate is in [0, 1].

    Raises:
        ConfigError: It is not.
    """
    if not 0.0 <= required <= 1.0:
        raise ConfigError(f"--require-success is {required:g}; it must be in [0, 1], e.g. 0.9")


def missed(success: float, required: float) -> int:
    """Return the exit code for a success rate; print an error if it is below ``required``."""
    if success >= required:
        return 0
    console.print_error(f"success is {success:.1%}, below the required {required:.1%}")
    return MISSED
