"""Jobs of a Ray cluster: ``RAY_ADDRESS`` names it; without it Ray starts on this machine.

The folder of the jobs must be on a file system that all nodes share. Only the path of a folder is
sent; the package must be installed on every node.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path
from typing import Any

from articulate.errors import MissingError
from articulate.jobs.process_identity import end_with_parent


def work(folder: str) -> int:
    """Run the job in ``folder`` in a separate process, so that only that one receives signals."""
    worker = subprocess.Popen(
        [sys.executable, "-m", "articulate.jobs.worker", folder],
        preexec_fn=end_with_parent,  # noqa: PLW1509  # a lost task must not continue unnoticed
    )
    try:
        return worker.wait()
    except KeyboardInterrupt:  # this is how Ray cancels
        worker.terminate()
        return worker.wait()


class RayLauncher:
    """Runs each job as one task with one processor; see :class:`Launcher`."""

    def __init__(self, slots: int, folder: Path) -> None:
        """Connect to the cluster, or start one here with ``slots`` processors.

        Raises:
            MissingError: ray is not installed.
        """
        try:
            import ray
        except ModuleNotFoundError:
            raise MissingError(
                "ray is not installed; pip install 'articulate-robots[cluster]'"
            ) from None
        self._ray: Any = ray
        self._began = not ray.is_initialized()
        if self._began:
            try:
                ray.init(address="auto", log_to_driver=False)
            except ConnectionError:
                ray.init(num_cpus=slots, include_dashboard=False, log_to_driver=False)
        # After the loss of a machine the loop restarts the job, as it checks the folder first.
        self._work = ray.remote(max_retries=0, num_cpus=1)(work)

    def free_slots(self) -> int:
        """Return no limit: the cluster queues tasks."""
        return sys.maxsize

    def submit(self, folder: Path) -> Any:
        """Submit the job in ``folder`` to the cluster."""
        return self._work.remote(str(folder.absolute()))

    def has_ended(self, handle: Any) -> bool:
        """Return whether its task has ended, also if its node was lost."""
        ready, _ = self._ray.wait([handle], timeout=0.0)
        return bool(ready)

    def stop(self, handle: Any) -> None:
        """Cancel its task."""
        with contextlib.suppress(Exception):  # whatever Ray raises, the task has ended
            self._ray.cancel(handle)

    def close(self) -> None:
        """Leave the cluster."""
        if self._began:
            self._ray.shutdown()
