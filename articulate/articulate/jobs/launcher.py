"""Launcher: protocol of the places where jobs run, and the loop over many jobs."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from articulate.errors import UsageError, nearest
from articulate.jobs.job import (
    NEVER,
    Job,
    Stamp,
    State,
    is_leased,
    load_state,
    save_job,
    state_stamp,
)

POLL_S, MIN_POLL_S = 0.5, 0.02
"""Time between polls while nothing changes, and after a change [s]."""
MAX_LOSSES = 3
"""A job is restarted after at most so many losses in a row."""
LAUNCHERS = {
    "local": "articulate.jobs.local:LocalLauncher",
    "slurm": "articulate.jobs.slurm:SlurmLauncher",
    "ray": "articulate.jobs.ray:RayLauncher",
}


class Launcher(Protocol):
    """Starts workers and reports which of them still run."""

    def free_slots(self) -> int:
        """Return how many more jobs it accepts now; a cluster queues them and accepts all."""
        ...

    def submit(self, folder: Path) -> Any:
        """Start ``articulate.jobs.worker`` on the job in ``folder``, or queue it on a cluster."""
        ...

    def has_ended(self, handle: Any) -> bool:
        """Return whether the worker has ended, for whatever reason."""
        ...

    def stop(self, handle: Any) -> None:
        """Request that the worker saves its progress and stops."""
        ...

    def close(self) -> None:
        """Release all resources."""
        ...


def make_launcher(name: str, slots: int, folder: Path) -> Launcher:
    """Return the launcher called ``name``.

    Args:
        name: local, slurm or ray.
        slots: Jobs in parallel.
        folder: Folder for the launcher's files.

    Raises:
        UsageError: There is no such launcher.
        MissingError: A package that it requires is not installed.
    """
    if name not in LAUNCHERS:
        raise UsageError(f"--launcher {name}: unknown{nearest(name, LAUNCHERS)}")
    module, cls = LAUNCHERS[name].split(":")
    launcher: Launcher = getattr(import_module(module), cls)(slots, folder)
    return launcher


@dataclass(frozen=True)
class Progress:
    """States of many jobs."""

    states: dict[str, State]
    """State of each job by name."""

    def count(self, phase: str) -> int:
        """Return the number of jobs in ``phase``."""
        return sum(state.phase == phase for state in self.states.values())


def run_jobs(
    jobs: Sequence[Job], launcher: Launcher, on_change: Callable[[Progress], None]
) -> Progress:
    """Run all jobs that are not done, and return their final states.

    Jobs that another launcher left are resumed; jobs that run elsewhere now are waited for. A job
    that fails by itself is not run again; one that is lost with its machine is, a few times.
    KeyboardInterrupt stops the workers, which save their progress.

    Args:
        jobs: Jobs with distinct folders.
        launcher: Place where they run.
        on_change: Called after each poll in which a job changed its phase.
    """
    for job in jobs:
        save_job(job)
    loop = _Loop(jobs, launcher)
    pause_s = MIN_POLL_S
    try:
        on_change(loop.progress())
        while True:
            if loop.poll():
                on_change(loop.progress())
                pause_s = MIN_POLL_S
            if loop.has_ended:
                return loop.progress()
            time.sleep(pause_s)
            pause_s = min(2.0 * pause_s, POLL_S)
    except BaseException:
        loop.stop()
        raise
    finally:
        launcher.close()


class _Loop:
    """State of :func:`run_jobs` between two polls, whose cost depends on the running jobs only."""

    def __init__(self, jobs: Sequence[Job], launcher: Launcher) -> None:
        self._launcher = launcher
        self._queue = deque(jobs)
        """Jobs that were not polled yet for lack of slots."""
        self._open: dict[str, Job] = {}
        """Jobs of this launcher, or run by another one."""
        self._handles: dict[str, Any] = {}
        self._losses = Counter[str]()
        self._stamps: dict[str, Stamp | None] = {}
        self._states = {job.name: load_state(job.folder) for job in jobs}
        self._failed_before = {n for n, state in self._states.items() if state.phase == "failed"}

    @property
    def has_ended(self) -> bool:
        """True if nothing runs and nothing is left to run."""
        return not self._queue and not self._open

    def progress(self) -> Progress:
        """Return the states of all jobs."""
        return Progress(dict(self._states))

    def poll(self) -> bool:
        """Start jobs that are due and drop those that have ended; return whether any changed."""
        changed = False
        for job in list(self._open.values()):
            changed |= self._poll_job(job)
        while self._queue and self._launcher.free_slots() > 0:
            job = self._queue.popleft()
            self._open[job.name] = job
            changed |= self._poll_job(job)
        return changed

    def stop(self) -> None:
        """Stop all workers and wait until they have ended."""
        for handle in self._handles.values():
            self._launcher.stop(handle)
        while not all(self._launcher.has_ended(handle) for handle in self._handles.values()):
            time.sleep(POLL_S)

    def _poll_job(self, job: Job) -> bool:
        handle = self._handles.get(job.name)
        ended = handle is not None and self._launcher.has_ended(handle)
        before = self._states[job.name]
        state = self._read(job, before)
        if ended:
            del self._handles[job.name]
            self._losses[job.name] += state.phase in ("lost", "waiting")
        if job.name not in self._handles and not is_leased(job.folder):
            if self._is_due(job.name, state):
                self._failed_before.discard(job.name)
                self._handles[job.name] = self._launcher.submit(job.folder)
            else:
                del self._open[job.name]
        self._states[job.name] = state
        return state != before

    def _read(self, job: Job, before: State) -> State:
        """Return the state of ``job``, read again if its file changed or its runner may be dead."""
        stamp = state_stamp(job.folder)
        if before.phase != "running" and self._stamps.get(job.name, NEVER) == stamp:
            return before
        self._stamps[job.name] = stamp
        return load_state(job.folder)

    def _is_due(self, name: str, state: State) -> bool:
        """Return whether to run it: not done, not failed in this call, not lost too often."""
        if self._losses[name] > MAX_LOSSES:
            return False
        return state.phase in ("waiting", "lost") or name in self._failed_before
