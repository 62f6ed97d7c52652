"""Jobs of a Slurm cluster, through submitit.

The folder of the jobs must be on a file system that all nodes share. What submitit sends is the
name of a function of this package and the path of a folder.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from articulate.errors import MissingError, UsageError
from articulate.jobs.worker import run_job

TIMEOUT_MIN = 24 * 60
"""Longest time of a job in the queue's terms [min]; a job that is cut off goes on in the next."""


class SlurmLauncher:
    """Submits every job at once and lets Slurm decide; see :class:`Launcher`."""

    def __init__(self, slots: int, folder: Path, *, cluster: str = "slurm") -> None:
        """Open the executor.

        Args:
            slots: Not heeded: each job is submitted by itself, Slurm decides how many run.
            folder: Where submitit keeps its scripts and logs.
            cluster: ``slurm``, or ``local`` for submitit's own stand-in.

        Raises:
            MissingError: submitit is not installed.
            UsageError: There is no Slurm on this machine.
        """
        try:
            import submitit
        except ModuleNotFoundError:
            raise MissingError(
                "submitit is not installed; pip install 'articulate-robots[cluster]'"
            ) from None
        try:
            self._executor: Any = submitit.AutoExecutor(folder / "submitit", cluster=cluster)
        except RuntimeError:
            raise UsageError(
                "--launcher slurm: srun is not found on this machine; "
                "run it on a node that submits, or take --launcher local"
            ) from None
        self._executor.update_parameters(
            name="articulate",
            timeout_min=TIMEOUT_MIN,
            cpus_per_task=1,
            **({"slurm_array_parallelism": slots} if cluster == "slurm" else {}),
        )

    def room(self) -> int:
        """The cluster keeps a queue of its own."""
        return sys.maxsize

    def submit(self, folder: Path) -> Any:
        """Put the job in ``folder`` into the queue."""
        return self._executor.submit(run_job, folder.absolute())

    def is_over(self, handle: Any) -> bool:
        """Whether it left its result, or Slurm, asked once a minute, says that it ended."""
        return bool(handle.paths.result_pickle.exists() or handle.done())

    def stop(self, handle: Any) -> None:
        """Cancel it: Slurm sends SIGTERM first, on which the command keeps what it has done."""
        handle.cancel(check=False)

    def close(self) -> None:
        """Nothing is held."""
