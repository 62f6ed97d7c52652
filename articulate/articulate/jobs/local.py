"""Jobs as processes of this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

Worker = subprocess.Popen[bytes]


class LocalLauncher:
    """Runs a fixed number of workers in parallel. See :class:`Launcher`."""

    def __init__(self, slots: int, folder: Path) -> None:
        """Start nothing yet; ``folder`` is not used."""
        self._slots = slots
        self._running: list[Worker] = []

    def free_slots(self) -> int:
        """Return the number of free slots."""
        self._running = [worker for worker in self._running if worker.poll() is None]
        return self._slots - len(self._running)

    def submit(self, folder: Path) -> Worker:
        """Start a worker on the job in ``folder``."""
        worker = subprocess.Popen(
            [sys.executable, "-m", "articulate.jobs.worker", str(folder)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=os.environ.copy(),
            start_new_session=True,
        )
        self._running.append(worker)
        return worker

    def has_ended(self, handle: Worker) -> bool:
        """Return whether the worker has ended."""
        return handle.poll() is not None

    def stop(self, handle: Worker) -> None:
        """Send SIGTERM to a worker."""
        handle.terminate()

    def close(self) -> None:
        """Do nothing: no resources are held."""
