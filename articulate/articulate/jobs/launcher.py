"""Launcher: where jobs run. The protocol, the loop over many jobs, and the choice by name."""

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

LOOK_S, LEAST_LOOK_S = 0.5, 0.02
"""Time between looks at the jobs while nothing happens, and after something did [s]."""
MOST_LOSSES = 3
"""A job is taken up again after so many losses in a row, and no more."""
LAUNCHERS = {
    "local": "articulate.jobs.local:LocalLauncher",
    "slurm": "articulate.jobs.slurm:SlurmLauncher",
    "ray": "articulate.jobs.ray:RayLauncher",
}


class Launcher(Protocol):
    """Starts workers and says which of them still run."""

    def room(self) -> int:
        """How many more jobs it takes now; a cluster keeps a queue of its own and takes all."""
        ...

    def submit(self, folder: Path) -> Any:
        """Start ``articulate.jobs.worker`` on the job in ``folder``, or have a cluster do it."""
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
        on_change: Called after each look at which a job changed its phase.
    """
    for job in jobs:
        save_job(job)
    loop = _Loop(jobs, launcher)
    pause_s = LEAST_LOOK_S
    try:
        on_change(loop.progress())
        while True:
            if loop.look():
                on_change(loop.progress())
                pause_s = LEAST_LOOK_S
            if loop.is_over:
                return loop.progress()
            time.sleep(pause_s)
            pause_s = min(2.0 * pause_s, LOOK_S)
    except BaseException:
        loop.stop()
        raise
    finally:
        launcher.close()


class _Loop:
    """What :func:`run_jobs` knows between two looks, each as dear as the jobs that run now."""

    def __init__(self, jobs: Sequence[Job], launcher: Launcher) -> None:
        self._launcher = launcher
        self._queue = deque(jobs)
        """Not looked at yet: there was no room."""
        self._open: dict[str, Job] = {}
        """Handed to the launcher, or run by another one."""
        self._handles: dict[str, Any] = {}
        self._losses = Counter[str]()
        self._stamps: dict[str, Stamp | None] = {}
        self._states = {job.name: load_state(job.folder) for job in jobs}
        self._failed_before = {n for n, state in self._states.items() if state.phase == "failed"}

    @property
    def is_over(self) -> bool:
        """Whether nothing runs and nothing is to be run."""
        return not self._queue and not self._open

    def progress(self) -> Progress:
        """How far all are."""
        return Progress(dict(self._states))

    def look(self) -> bool:
        """Take up what is due and drop what is over; whether any state changed."""
        changed = False
        for job in list(self._open.values()):
            changed |= self._look_at(job)
        while self._queue and self._launcher.room() > 0:
            job = self._queue.popleft()
            self._open[job.name] = job
            changed |= self._look_at(job)
        return changed

    def stop(self) -> None:
        """Stop all workers and wait until they have ended."""
        for handle in self._handles.values():
            self._launcher.stop(handle)
        while not all(self._launcher.is_over(handle) for handle in self._handles.values()):
            time.sleep(LOOK_S)

    def _look_at(self, job: Job) -> bool:
        handle = self._handles.get(job.name)
        over = handle is not None and self._launcher.is_over(handle)
        before = self._states[job.name]
        state = self._read(job, before)
        if over:
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
        """The state of ``job``, read anew if its file is another one or its runner may be gone."""
        stamp = state_stamp(job.folder)
        if before.phase != "running" and self._stamps.get(job.name, NEVER) == stamp:
            return before
        self._stamps[job.name] = stamp
        return load_state(job.folder)

    def _is_due(self, name: str, state: State) -> bool:
        """Whether it is to be run: not done, not failed in this call, not lost too often."""
        if self._losses[name] > MOST_LOSSES:
            return False
        return state.phase in ("waiting", "lost") or name in self._failed_before
