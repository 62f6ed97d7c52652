"""Ruckig, or one line on how to install it."""

from __future__ import annotations

from typing import Any

from articulate.errors import MissingError

try:
    import ruckig as _ruckig
except ModuleNotFoundError:
    raise MissingError(
        "real arms need ruckig, which is not installed; run: "
        'pip install "articulate-robots[deploy-arm]"'
    ) from None

ruckig: Any = _ruckig
