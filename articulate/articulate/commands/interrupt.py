"""Ctrl-C: the first stops cleanly, the second kills all child processes and exits."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

INTERRUPT_EXIT = 130
"""128 + SIGINT, as shells count."""
RETRY_S = 0.02
"""Time between checks whether a module is still being imported [s]."""
STOPPING = b"\nstopping cleanly; Ctrl-C once more ends at once\n"


@contextmanager
def graceful_interrupt() -> Iterator[None]:
    """Inside, the first SIGINT raises KeyboardInterrupt and the second ends the process."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield  # a host program or a shell handles the signal
        return
    count = 0

    def stroke(_signal: int, frame: FrameType | None) -> None:
        nonlocal count
        count += 1
        if count == 1:
            with suppress(OSError):
                os.write(2, STOPPING)  # not print: it may have been interrupted itself
            raise_outside_imports(frame)
            return
        for pid in descendants(os.getpid()):
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        os._exit(INTERRUPT_EXIT)

    signal.signal(signal.SIGINT, stroke)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGINT, signal.default_int_handler)


def raise_outside_imports(frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, after the import if ``frame`` imports a module.

    Modules with optional imports swallow exceptions that are raised there: trimesh does.
    """
    if _imports(frame):
        signal.signal(signal.SIGALRM, lambda _, later: raise_outside_imports(later))
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        return
    raise KeyboardInterrupt


def _imports(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def descendants(pid: int) -> list[int]:
    """Return the descendants of process ``pid``; empty if the system does not list them."""
    found: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError, ValueError):
            for child in map(int, path.read_text().split()):
                found += [child, *descendants(child)]
    return found
