"""Lock of a run folder: one call of ``train`` works on a run at a time.

The seeds of a run inherit the descriptor, so the lock lasts until the last of them has ended. The
locks of ``filelock`` cannot be inherited.
"""

from __future__ import annotations

import fcntl
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from articulate.errors import RunError
from articulate.jobs.process_identity import is_local, is_running, this_process

LOCK = ".lock"
"""Lock file of a run; it holds the process that has the lock."""
ORPHANS_S = 120.0
"""Longest wait for the seeds of a killed ``train``; they stop after an update [s]."""
POLL_S = 0.1
"""Time between attempts to get the lock [s]."""


@contextmanager
def lock_run(folder: Path) -> Iterator[int]:
    """Lock the run in ``folder``; yield the descriptor of the lock, which children may inherit.

    The kernel releases the lock when the last process that has the descriptor ends.

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
            if _may_run(holder) or time.monotonic() > end:
                who = f"process {holder.get('pid', '?')} of {holder.get('host', '?')}"
                raise RunError(
                    f"{folder}: is being trained already, by {who}; wait for it, or stop it first"
                ) from None
        time.sleep(POLL_S)


def _holder(lock: TextIO) -> dict[str, Any]:
    lock.seek(0)
    try:
        return dict(json.load(lock))
    except ValueError:  # the process has the lock and has not written its name yet
        return {}


def _may_run(holder: dict[str, Any]) -> bool:
    """Return whether the ``train`` that took the lock runs, or may run on another machine."""
    return not is_local(holder) or is_running(holder)
