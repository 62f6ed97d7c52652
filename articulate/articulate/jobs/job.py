"""Job: a command line and a folder that holds all of its state.

::

    job.json      command lines
    state.json    phase (waiting, running, done, failed or lost) and all attempts
    lease.json    process that runs the job; expired if it was not renewed for a while
    log.txt       output of the command
    run/          results of the command

There is no other state, so any launcher can continue what another one left.
"""

from __future__ import annotations

import dataclasses
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from filelock import FileLock

from articulate.errors import RunError, quote
from articulate.files import write_json
from articulate.jobs.process_identity import is_local, is_running, this_process

SCHEMA = "articulate.job"
SCHEMA_VERSION = 2
JOB, STATE, LOG, RUN = "job.json", "state.json", "log.txt", "run"
LEASE, LOCK = "lease.json", ".lease.lock"
LEASE_S = 60.0
"""Age above which a lease of another machine has expired [s]."""
Stamp = tuple[int, int, int]
"""Modification time, inode and size of a file."""
NEVER: Stamp = (-1, -1, -1)
"""Stamp of a file that was not read yet."""
Phase = Literal["waiting", "running", "done", "failed", "lost"]
"""``failed`` ended by itself and would fail again; ``lost`` was ended from outside."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A command line and a folder."""

    folder: Path
    """Folder of the job."""
    start_command: tuple[str, ...]
    """Begins the job; its results go into ``run/`` of the folder."""
    resume_command: tuple[str, ...]
    """Continues with what ``run/`` holds already."""
    accepted_codes: tuple[int, ...] = (0,)
    """Exit statuses of a job that is done."""

    @property
    def name(self) -> str:
        """Name of its folder."""
        return self.folder.name

    @property
    def run_folder(self) -> Path:
        """Folder of the results."""
        return self.folder / RUN

    @property
    def command(self) -> tuple[str, ...]:
        """Command for the next attempt."""
        return self.resume_command if self.run_folder.exists() else self.start_command


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One execution of the command."""

    host: str
    pid: int
    begun: float
    """Unix time [s]."""
    ended: float | None = None
    """Unix time [s]; None while it runs, or if its machine was lost."""
    code: int | None = None
    """Exit status; negative for a signal; None as above."""
    message: str = ""
    """Last line of its output."""


@dataclass(frozen=True, kw_only=True)
class State:
    """Phase of a job and its attempts."""

    phase: Phase = "waiting"
    attempts: tuple[Attempt, ...] = ()

    @property
    def message(self) -> str:
        """Last line of output of the last attempt."""
        return self.attempts[-1].message if self.attempts else ""


def save_job(job: Job) -> Job:
    """Write ``job.json``, or keep it if it already describes this job.

    Raises:
        RunError: The folder belongs to another job.
    """
    path = job.folder / JOB
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "start_command": list(job.start_command),
        "resume_command": list(job.resume_command),
        "accepted_codes": list(job.accepted_codes),
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
    """Read the job in ``folder``.

    Raises:
        RunError: There is none, or it was written by another version.
    """
    content = _read(folder / JOB)
    if content.get("schema") != SCHEMA or content.get("schema_version") != SCHEMA_VERSION:
        raise RunError(
            f"{folder / JOB}: not a job of schema {SCHEMA} {SCHEMA_VERSION}; choose a new --out"
        )
    return Job(
        folder=folder,
        start_command=tuple(content["start_command"]),
        resume_command=tuple(content["resume_command"]),
        accepted_codes=tuple(content["accepted_codes"]),
    )


def load_state(folder: Path) -> State:
    """Read the state of the job in ``folder``; it is lost if its runner has disappeared."""
    if not (folder / STATE).exists():
        return State()
    content = _read(folder / STATE)
    state = State(phase=content["phase"], attempts=tuple(Attempt(**a) for a in content["attempts"]))
    if state.phase == "running" and not is_leased(folder):
        message = f"{state.attempts[-1].host} disappeared: killed, restarted or out of memory"
        last = dataclasses.replace(state.attempts[-1], message=message)
        return State(phase="lost", attempts=(*state.attempts[:-1], last))
    return state


def state_stamp(folder: Path) -> Stamp | None:
    """Return a value that changes whenever :func:`save_state` writes; None before that."""
    try:
        stat = os.stat(f"{folder}/{STATE}")  # noqa: PTH116  ten thousand jobs are polled often
    except FileNotFoundError:
        return None
    return stat.st_mtime_ns, stat.st_ino, stat.st_size


def save_state(folder: Path, state: State) -> None:
    """Write the state of the job in ``folder``, completely or not at all."""
    write_json(folder / STATE, dataclasses.asdict(state))


def take_lease(folder: Path) -> bool:
    """Take the job in ``folder`` for this process; return False if another process has it."""
    with FileLock(folder / LOCK):
        if is_leased(folder):
            return False
        write_json(folder / LEASE, this_process())
        return True


def renew_lease(folder: Path) -> None:
    """Record that this process still runs the job in ``folder``."""
    os.utime(folder / LEASE)


def end_lease(folder: Path) -> None:
    """Release the job in ``folder``."""
    (folder / LEASE).unlink(missing_ok=True)


def is_leased(folder: Path) -> bool:
    """Return whether a process runs the job in ``folder``.

    A holder on this machine is looked up by its process; on another machine, or from before a
    restart of this one, the age of the lease decides.
    """
    path = folder / LEASE
    try:
        age_s = time.time() - path.stat().st_mtime
        holder = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return False
    return is_running(holder) if is_local(holder) else age_s < LEASE_S


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise RunError(f"{path}: cannot be read ({error})") from None
    if not isinstance(content, dict):
        raise RunError(f"{path}: must hold a JSON object, not {quote(content)}")
    return content
