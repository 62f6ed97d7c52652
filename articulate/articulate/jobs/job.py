"""Job: a command line and a folder that holds all of its state.

::

    job.json      what is to be run
    state.json    waiting, running, done, failed or lost, and every attempt so far
    lease.json    who runs it now; old when nobody renewed it for a while
    log.txt       what the command said
    run/          what the command makes

Nothing else knows about a job, so that any launcher can go on with what another one left.
"""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from articulate.errors import RunError
from articulate.files import write_json
from articulate.jobs.process_identity import is_here, runs, this_process

SCHEMA = "articulate.job"
SCHEMA_VERSION = 1
JOB, STATE, LOG, MADE = "job.json", "state.json", "log.txt", "run"
LEASE, LOCK = "lease.json", ".lease.lock"
LEASE_S = 60.0
"""A lease that is older was left by a machine that is gone [s]."""
Stamp = tuple[int, int, int]
"""Time, number and size of a file."""
NEVER: Stamp = (-1, -1, -1)
"""The stamp of a file that was not looked at."""
Phase = Literal["waiting", "running", "done", "failed", "lost"]
"""``failed`` ended by itself and would fail again; ``lost`` was ended by something else."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A command line and a folder."""

    folder: Path
    """Folder of the job."""
    start: tuple[str, ...]
    """Begins it; what it makes goes into ``run/`` of the folder."""
    go_on: tuple[str, ...]
    """Goes on with what is in ``run/`` already."""
    accepted: tuple[int, ...] = (0,)
    """Exit statuses of a job that is done."""

    @property
    def name(self) -> str:
        """Name of its folder."""
        return self.folder.name

    @property
    def made(self) -> Path:
        """What the command makes."""
        return self.folder / MADE

    @property
    def command(self) -> tuple[str, ...]:
        """What is to be run now."""
        return self.go_on if self.made.exists() else self.start


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One time that the command ran."""

    host: str
    pid: int
    begun: float
    """Unix time [s]."""
    ended: float | None = None
    """Unix time [s]; None while it runs, or if its machine was lost."""
    code: int | None = None
    """Exit status; negative for a signal; None as above."""
    words: str = ""
    """The last line that it said."""


@dataclass(frozen=True, kw_only=True)
class State:
    """How far a job is."""

    phase: Phase = "waiting"
    attempts: tuple[Attempt, ...] = ()

    @property
    def words(self) -> str:
        """The last line of the last attempt."""
        return self.attempts[-1].words if self.attempts else ""


def save_job(job: Job) -> Job:
    """Write ``job.json``, and keep what it holds if it is there already.

    Raises:
        RunError: The folder is another job's.
    """
    path = job.folder / JOB
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "start": list(job.start),
        "go_on": list(job.go_on),
        "accepted": list(job.accepted),
    }
    if path.exists():
        if load_job(job.folder) != job:
            raise RunError(
                f"{job.folder}: holds another job; choose another --out, or give the same flags"
            )
        return job
    write_json(path, content)
    return job


def load_job(folder: Path) -> Job:
    """The job in ``folder``.

    Raises:
        RunError: There is none.
    """
    content = _read(folder / JOB)
    if content.get("schema") != SCHEMA or content.get("schema_version") != SCHEMA_VERSION:
        raise RunError(f"{folder / JOB}: not a job of schema {SCHEMA} {SCHEMA_VERSION}")
    return Job(
        folder=folder,
        start=tuple(content["start"]),
        go_on=tuple(content["go_on"]),
        accepted=tuple(content["accepted"]),
    )


def load_state(folder: Path) -> State:
    """How far the job in ``folder`` is; one whose runner is gone is lost."""
    if not (folder / STATE).exists():
        return State()
    content = _read(folder / STATE)
    state = State(phase=content["phase"], attempts=tuple(Attempt(**a) for a in content["attempts"]))
    if state.phase == "running" and not is_leased(folder):
        words = f"{state.attempts[-1].host} is gone: killed, restarted or out of memory"
        last = dataclasses.replace(state.attempts[-1], words=words)
        return State(phase="lost", attempts=(*state.attempts[:-1], last))
    return state


def state_stamp(folder: Path) -> Stamp | None:
    """What changes whenever :func:`save_state` writes; None before it did."""
    try:
        stat = os.stat(f"{folder}/{STATE}")  # noqa: PTH116  ten thousand jobs are looked at often
    except FileNotFoundError:
        return None
    return stat.st_mtime_ns, stat.st_ino, stat.st_size


def save_state(folder: Path, state: State) -> None:
    """Write how far the job in ``folder`` is, whole or not at all."""
    write_json(folder / STATE, dataclasses.asdict(state))


def take_lease(folder: Path) -> bool:
    """Take the job in ``folder`` for this process; False if another one has it.

    Looking and taking are one step under a lock that the kernel frees with its holder.
    """
    with (folder / LOCK).open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if is_leased(folder):
            return False
        write_json(folder / LEASE, this_process())
        return True


def renew_lease(folder: Path) -> None:
    """Say that this process still runs the job in ``folder``."""
    os.utime(folder / LEASE)


def end_lease(folder: Path) -> None:
    """Give the job in ``folder`` back."""
    (folder / LEASE).unlink(missing_ok=True)


def is_leased(folder: Path) -> bool:
    """Whether some process runs the job in ``folder``.

    On this machine its process is looked for; on another one, or from before this one was
    restarted, the age of the lease counts.
    """
    path = folder / LEASE
    try:
        age_s = time.time() - path.stat().st_mtime
        holder = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return False
    return runs(holder) if is_here(holder) else age_s < LEASE_S


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read ({error})") from None
    if not isinstance(content, dict):
        raise RunError(f"{path}: holds no object")
    return content
