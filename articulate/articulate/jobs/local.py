"""Jobs as processes of this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import deque
from dataclasses import dataclass
from pathlib import Path


@dataclass(eq=False)
class _Worker:
    """A worker that runs, waits for room, or was told to stop before it began."""

    folder: Path
    process: subprocess.Popen[bytes] | None = None
    dropped: bool = False


class LocalLauncher:
    """So many workers side by side; the others wait. See :class:`Launcher`."""

    def __init__(self, slots: int, folder: Path) -> None:
        """Start nothing yet; ``folder`` is not needed."""
        self._slots = slots
        self._waiting: deque[_Worker] = deque()
        self._running: list[_Worker] = []

    def submit(self, folder: Path) -> _Worker:
        """Start a worker on the job in ``folder`` when there is room."""
        worker = _Worker(folder)
        self._waiting.append(worker)
        self._fill()
        return worker

    def is_over(self, handle: _Worker) -> bool:
        """Whether the worker has ended."""
        self._fill()
        if handle.process is None:
            return handle.dropped
        return handle.process.poll() is not None

    def stop(self, handle: _Worker) -> None:
        """End a worker that runs, drop one that waits."""
        if handle.process is None:
            handle.dropped = True
        else:
            handle.process.terminate()

    def close(self) -> None:
        """Nothing is held."""

    def _fill(self) -> None:
        self._running = [
            w for w in self._running if w.process is not None and w.process.poll() is None
        ]
        while self._waiting and len(self._running) < self._slots:
            worker = self._waiting.popleft()
            if worker.dropped:
                continue
            worker.process = subprocess.Popen(
                [sys.executable, "-m", "articulate.jobs.worker", str(worker.folder)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=os.environ.copy(),
                start_new_session=True,
            )
            self._running.append(worker)
