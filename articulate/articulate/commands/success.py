"""``--require-success``: a share that commands are asked to reach."""

from __future__ import annotations

from articulate.commands import console
from articulate.errors import ConfigError

MISSED = 3
"""Exit code of what is done but missed what was asked."""


def check_share(required: float) -> None:
    """Refuse a share that nothing can reach, or that everything does.

    Raises:
        ConfigError: It is no share.
    """
    if not 0.0 <= required <= 1.0:
        raise ConfigError(f"--require-success is {required:g}; it must lie in [0, 1], e.g. 0.9")


def missed(success: float, required: float) -> int:
    """Exit code of a result with that share of successes; says so where it is too low."""
    if success >= required:
        return 0
    console.print_error(f"success is {success:.1%}, below the {required:.1%} required")
    return MISSED
