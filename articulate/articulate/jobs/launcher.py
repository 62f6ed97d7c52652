"""Launcher: where jobs run. The protocol, the loop over many jobs, and the choice by name."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from articulate.errors import UsageError, nearest
from articulate.jobs.job import Job, State, is_leased, load_state, save_job

LOOK_S = 0.5
"""Time between looks at the jobs [s]."""
MOST_LOSSES = 3
"""A job is taken up again after so many losses in a row, and no more."""
LAUNCHERS = {
    "local": "articulate.jobs.local:LocalLauncher",
    "slurm": "articulate.jobs.slurm:SlurmLauncher",
    "ray": "articulate.jobs.ray:RayLauncher",
}


class Launcher(Protocol):
    """Starts workers and says which of them still run."""

    def submit(self, folder: Path) -> Any:
        """Start ``articulate.jobs.worker`` on the job in ``folder``, now or when there is room."""
        ...

    def is_over(self, handle: Any) -> bool:
        """Whether the worker has ended, in whatever way."""
        ...

    def stop(self, handle: Any) -> None:
        """Ask the worker to keep what it has done and stop."""
        ...

    def close(self) -> None:
        """Give back what was taken."""
        ...


def make_launcher(name: str, slots: int, folder: Path) -> Launcher:
    """The launcher called ``name``.

    Args:
        name: local, slurm or ray.
        slots: Jobs side by side.
        folder: Where it may keep files of its own.

    Raises:
        UsageError: There is no such launcher.
        MissingError: What it needs is not installed.
    """
    if name not in LAUNCHERS:
        raise UsageError(f"--launcher {name}: unknown{nearest(name, LAUNCHERS)}")
    module, cls = LAUNCHERS[name].split(":")
    launcher: Launcher = getattr(import_module(module), cls)(slots, folder)
    return launcher


@dataclass(frozen=True)
class Progress:
    """How far many jobs are."""

    states: dict[str, State]
    """State of each job by name."""

    def count(self, phase: str) -> int:
        """Number of jobs in ``phase``."""
        return sum(state.phase == phase for state in self.states.values())


def run_jobs(
    jobs: Sequence[Job], launcher: Launcher, on_change: Callable[[Progress], None]
) -> Progress:
    """Run all jobs that are not done, and return how they ended.

    Jobs that another launcher left are taken up where they stand; those that run elsewhere now
    are waited for. A job that fails by itself is not run again; one that is lost with its machine
    is, a few times. KeyboardInterrupt stops the workers, which keep what they have done.

    Args:
        jobs: With distinct folders.
        launcher: Where they run.
        on_change: Called whenever a job changes its phase.
    """
    for job in jobs:
        save_job(job)
    handles: dict[str, Any] = {}
    losses = {job.name: 0 for job in jobs}
    seen: dict[str, State] = {}
    failed_before = {j.name for j in jobs if load_state(j.folder).phase == "failed"}
    try:
        while True:
            for job in jobs:
                if job.name in handles and launcher.is_over(handles[job.name]):
                    del handles[job.name]
                    losses[job.name] += load_state(job.folder).phase in ("lost", "waiting")
                if job.name not in handles and _is_due(job, losses[job.name], failed_before):
                    failed_before.discard(job.name)
                    handles[job.name] = launcher.submit(job.folder)
            states = {job.name: load_state(job.folder) for job in jobs}
            if states != seen:
                on_change(Progress(states))
                seen = states
            if not handles and not any(is_leased(job.folder) for job in jobs):
                return Progress(states)
            time.sleep(LOOK_S)
    except BaseException:
        for handle in handles.values():
            launcher.stop(handle)
        while not all(launcher.is_over(handle) for handle in handles.values()):
            time.sleep(LOOK_S)
        raise
    finally:
        launcher.close()


def _is_due(job: Job, losses: int, failed_before: set[str]) -> bool:
    """Whether the job is to be submitted: not done, not failed in this call, not lost too often."""
    if losses > MOST_LOSSES or is_leased(job.folder):
        return False
    phase = load_state(job.folder).phase
    return phase in ("waiting", "lost") or job.name in failed_before
