"""Training time of a run, summed over all calls of ``train`` that worked on it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from articulate.errors import UsageError
from articulate.files import write_json
from articulate.untrusted import load_json_object

SESSIONS = "sessions.json"
"""File of a run with the seconds of each call of ``train``; the last entry is updated."""


class TrainingClock:
    """Time of one call of ``train``, added to that of earlier calls."""

    def __init__(self, folder: Path) -> None:
        """Start the clock for the run in ``folder``."""
        self._path = folder / SESSIONS
        self._before = sessions_s(folder)
        self._begin = time.monotonic()

    def note(self) -> float:
        """Write the elapsed time to the run folder; return the time of all calls [s]."""
        seconds = [*self._before, time.monotonic() - self._begin]
        write_json(self._path, {"seconds": seconds})
        return sum(seconds)


def sessions_s(folder: Path) -> list[float]:
    """Return the time of each call of ``train`` on the run in ``folder`` [s]; empty if unknown."""
    seconds = _seconds(folder / SESSIONS)
    return [float(s) for s in seconds] if isinstance(seconds, list) else []


def _seconds(path: Path) -> Any:
    try:
        return load_json_object(path)["seconds"]
    except (UsageError, KeyError):
        return None


def training_s(folder: Path, seeds_s: list[float]) -> float:
    """Return the training time of the run in ``folder`` [s].

    Args:
        folder: The run.
        seeds_s: Time of each seed [s]. Seeds run in parallel, so the run took at least as long as
            the longest.
    """
    return max(sum(sessions_s(folder)), *seeds_s, 0.0)
