"""Jobs of a Slurm cluster, through submitit.

The folder of the jobs must be on a file system that all nodes share. submitit sends only the name
of a function of this package and the path of a folder.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from articulate.errors import MissingError, UsageError
from articulate.jobs.worker import run_job

TIMEOUT_MIN = 24 * 60
"""Time limit of one Slurm job [min]; a job that reaches it is resumed by the next one."""


class SlurmLauncher:
    """Submits all jobs and lets Slurm schedule them; see :class:`Launcher`."""

    def __init__(self, slots: int, folder: Path, *, cluster: str = "slurm") -> None:
        """Open the executor.

        Args:
            slots: Parallelism of a job array; each job is submitted separately.
            folder: Folder for scripts and logs of submitit.
            cluster: ``slurm``, or ``local`` for submitit's local executor.

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
                "run it on a login node, or use --launcher local"
            ) from None
        self._executor.update_parameters(
            name="articulate",
            timeout_min=TIMEOUT_MIN,
            cpus_per_task=1,
            **({"slurm_array_parallelism": slots} if cluster == "slurm" else {}),
        )

    def free_slots(self) -> int:
        """Return no limit: Slurm queues jobs."""
        return sys.maxsize

    def submit(self, folder: Path) -> Any:
        """Submit the job in ``folder``."""
        return self._executor.submit(run_job, folder.absolute())

    def has_ended(self, handle: Any) -> bool:
        """Return whether its result exists or Slurm, polled once a minute, reports its end."""
        return bool(handle.paths.result_pickle.exists() or handle.done())

    def stop(self, handle: Any) -> None:
        """Cancel it: Slurm sends SIGTERM first, on which the command saves its progress."""
        handle.cancel(check=False)

    def close(self) -> None:
        """Do nothing: no resources are held."""
