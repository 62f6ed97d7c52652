"""Limit of processor time within a process."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Iterator

SHORTEST_S = 1e-3
"""Shortest time for which a timer is set [s]; 0 would switch it off."""


class ProcessorLimitReached(BaseException):
    """A block took more than its processor time; no ``except Exception`` catches it."""

    def __init__(self, seconds: float) -> None:
        """Store the limit.

        Args:
            seconds: The limit that was reached [s].
        """
        super().__init__(f"more than {seconds:g} s of processor time")
        self.seconds = seconds


@contextlib.contextmanager
def processor_limit(seconds: float) -> Iterator[None]:
    """Raise :class:`ProcessorLimitReached` after ``seconds`` of this process's processor time [s].

    Without effect outside the main thread, where Python runs no signal handlers. A block within
    another one ends at the shorter limit.
    """
    if not math.isfinite(seconds) or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_signal: int, _frame: object) -> None:
        raise ProcessorLimitReached(seconds)

    left_s, _ = signal.getitimer(signal.ITIMER_VIRTUAL)
    if 0.0 < left_s <= seconds:  # the outer limit ends first
        yield
        return
    before, start = signal.signal(signal.SIGVTALRM, stop), time.process_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
        if left_s > 0.0:
            rest = left_s - (time.process_time() - start)
            signal.setitimer(signal.ITIMER_VIRTUAL, max(rest, SHORTEST_S))
