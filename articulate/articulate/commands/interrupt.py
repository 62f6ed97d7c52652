"""Ctrl-C: once stops cleanly, twice ends at once with everything that was started."""

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
STOPPING = b"\nstopping cleanly; Ctrl-C once more ends at once\n"


@contextmanager
def two_strokes() -> Iterator[None]:
    """Inside, the first SIGINT raises KeyboardInterrupt and the second ends the process."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield  # somebody else decides: a host program, or a shell that ignores it for us
        return
    count = 0

    def stroke(_signal: int, _frame: FrameType | None) -> None:
        nonlocal count
        count += 1
        if count == 1:
            with suppress(OSError):
                os.write(2, STOPPING)  # not print: it may have been interrupted itself
            raise KeyboardInterrupt
        for pid in descendants(os.getpid()):
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        os._exit(INTERRUPT_EXIT)

    signal.signal(signal.SIGINT, stroke)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def descendants(pid: int) -> list[int]:
    """Processes below ``pid``, children before theirs; none where the system does not say."""
    found: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError, ValueError):
            for child in map(int, path.read_text().split()):
                found += [child, *descendants(child)]
    return found
