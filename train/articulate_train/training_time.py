"""How long a run was trained, over all calls of ``train`` that worked on it."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from articulate.files import write_json
from articulate_train.run import SUMMARY

SESSIONS = "sessions.json"
"""File of a run's folder: the seconds of each call, the last one's as far as it was seen."""


class Clock:
    """The time of one call of ``train``, added to that of those before."""

    def __init__(self, folder: Path) -> None:
        """Begin to count for the run in ``folder``."""
        self._path = folder / SESSIONS
        self._before = sessions_of(folder)
        self._begin = time.monotonic()

    def note(self) -> float:
        """Write down how long it took so far; seconds of all calls."""
        seconds = [*self._before, time.monotonic() - self._begin]
        write_json(self._path, {"seconds": seconds})
        return sum(seconds)


def sessions_of(folder: Path) -> list[float]:
    """Seconds of each call of ``train`` on the run in ``folder``; empty where nothing tells.

    Runs that were made before calls were added up have a summary, which tells of the last alone.
    """
    kept = _seconds(folder / SESSIONS)
    if isinstance(kept, list):
        return [float(s) for s in kept]
    last = _seconds(folder / SUMMARY)
    return [float(last)] if isinstance(last, int | float) else []


def _seconds(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))["seconds"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def trained_s(folder: Path, seeds_s: list[float]) -> float:
    """How long the run in ``folder`` was trained [s].

    Args:
        folder: The run.
        seeds_s: How long each seed took; seeds run side by side, so that these do not add up, but
            the run took no less than the longest.
    """
    return max(sum(sessions_of(folder)), *seeds_s, 0.0)
