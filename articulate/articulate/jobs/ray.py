"""Jobs of a Ray cluster: ``RAY_ADDRESS`` names it; without it Ray starts on this machine.

The folder of the jobs must be on a file system that all nodes share. What is sent is the path of
a folder; the package must be installed on every node.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path
from typing import Any

from articulate.errors import MissingError
from articulate.jobs.worker import die_with_parent


def work(folder: str) -> int:
    """Run the job in ``folder`` in a process of its own, so that signals reach it alone."""
    worker = subprocess.Popen(
        [sys.executable, "-m", "articulate.jobs.worker", folder],
        preexec_fn=die_with_parent,  # noqa: PLW1509  # what is lost must not go on unseen
    )
    try:
        return worker.wait()
    except KeyboardInterrupt:  # this is how Ray cancels
        worker.terminate()
        return worker.wait()


class RayLauncher:
    """One task a job, a processor each; see :class:`Launcher`."""

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
        # A lost machine is the loop's to mend: it looks at the folder first.
        self._work = ray.remote(max_retries=0, num_cpus=1)(work)

    def room(self) -> int:
        """The cluster keeps a queue of its own."""
        return sys.maxsize

    def submit(self, folder: Path) -> Any:
        """Hand the job in ``folder`` to the cluster."""
        return self._work.remote(str(folder.absolute()))

    def is_over(self, handle: Any) -> bool:
        """Whether its task has ended, be it with its node."""
        ready, _ = self._ray.wait([handle], timeout=0.0)
        return bool(ready)

    def stop(self, handle: Any) -> None:
        """Cancel its task."""
        with contextlib.suppress(Exception):  # whatever Ray raises, it is over
            self._ray.cancel(handle)

    def close(self) -> None:
        """Leave the cluster."""
        if self._began:
            self._ray.shutdown()
