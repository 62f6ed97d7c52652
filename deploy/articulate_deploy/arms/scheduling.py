"""Real-time priority of the sender, where the system permits it."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

PRIORITY = 50
"""SCHED_FIFO priority of the sender, below the kernel's own threads."""


def use_ordinary_scheduling() -> None:
    """Return this thread to SCHED_OTHER: clients raise the thread that connects to FIFO 99."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextmanager
def real_time() -> Iterator[str]:
    """Raise this thread's priority and pause garbage collection; yield the policy obtained."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
            name = f"SCHED_FIFO {PRIORITY}"
        except OSError:
            name = "SCHED_OTHER (no permission for SCHED_FIFO)"
        yield name
    finally:
        use_ordinary_scheduling()
        gc.enable()
        gc.unfreeze()
