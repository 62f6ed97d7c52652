"""A run is trained by one call of ``train`` at a time."""

from __future__ import annotations

import fcntl
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from articulate.errors import RunError
from articulate.jobs.process_identity import is_here, runs, this_process

LOCK = ".lock"
"""File of a run's folder that is locked, and says by whom."""
ORPHANS_S = 120.0
"""So long seeds are waited for whose ``train`` was killed: they stop after an update [s]."""
LOOK_S = 0.1
"""Time between looks at the lock meanwhile [s]."""


@contextmanager
def alone(folder: Path) -> Iterator[int]:
    """Have the run in ``folder`` for this process, and for children that inherit the descriptor.

    The kernel frees the lock when the last of them has ended, in whatever way.

    Raises:
        RunError: Another process has it, or the folder cannot be written.
    """
    try:
        lock = (folder / LOCK).open("a+", encoding="utf-8")
    except OSError as error:
        raise RunError(f"{folder}: cannot be written ({error.strerror}); copy the run") from None
    with lock:
        _wait_for(lock, folder)
        lock.truncate(0)
        json.dump(this_process(), lock)
        lock.flush()
        yield lock.fileno()


def _wait_for(lock: TextIO, folder: Path) -> None:
    end = time.monotonic() + ORPHANS_S
    while True:
        try:
            return fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = _holder(lock)
            if _is_led(holder) or time.monotonic() > end:
                who = f"process {holder.get('pid', '?')} of {holder.get('host', '?')}"
                raise RunError(
                    f"{folder}: is being trained already, by {who}; wait for it, or stop it first"
                ) from None
        time.sleep(LOOK_S)


def _holder(lock: TextIO) -> dict[str, Any]:
    lock.seek(0)
    try:
        return dict(json.load(lock))
    except ValueError:  # it has the lock, and has not said who it is yet
        return {}


def _is_led(holder: dict[str, Any]) -> bool:
    """Whether the ``train`` that took the lock still runs, as far as can be told from here."""
    return not is_here(holder) or runs(holder)
