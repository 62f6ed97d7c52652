"""``python -m articulate.jobs.worker FOLDER``: run the job in a folder, here and now.

Launchers start this and nothing else. SIGTERM and SIGINT are handed to the command as SIGINT, so
that it can keep what it has done; the job can then be taken up again.
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from articulate.errors import ArticulateError
from articulate.jobs.job import (
    LOG,
    Attempt,
    Job,
    Phase,
    State,
    end_lease,
    load_job,
    load_state,
    renew_lease,
    save_state,
    take_lease,
)

RENEW_S = 10.0
"""Time between signs of life [s]."""
STEP_S = 0.1
"""Time between looks at the command [s]."""
INTERRUPTED = 130
SIGNALLED = 128
"""Statuses above it: a shell, or a command that passes it on, tells of a signal so."""
PR_SET_PDEATHSIG = 1
"""From ``linux/prctl.h``."""
LEASED = 75
"""Exit status where another process has the job (EX_TEMPFAIL of sysexits.h)."""


def run_job(folder: Path) -> int:
    """Run the job in ``folder`` and return the exit status of its command; 75 if another does."""
    job = load_job(folder)
    if not take_lease(folder):
        return LEASED
    try:
        state = load_state(folder)
        if state.phase == "done":
            return job.accepted[0]
        return _attempt(job, state)
    finally:
        end_lease(folder)


def _attempt(job: Job, state: State) -> int:
    attempt = Attempt(host=socket.gethostname(), pid=os.getpid(), begun=time.time())
    save_state(job.folder, State(phase="running", attempts=(*state.attempts, attempt)))
    with (job.folder / LOG).open("ab") as log:
        process = subprocess.Popen(
            job.command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
            preexec_fn=_prepared,  # noqa: PLW1509  # one thread, and it asks for nothing
        )
        code = _watched(process, job.folder)
    ended = dataclasses.replace(
        attempt, ended=time.time(), code=code, words=_last_words(job.folder / LOG)
    )
    phase = phase_of(job, code)
    save_state(job.folder, State(phase=phase, attempts=(*state.attempts, ended)))
    return code


def die_with_parent() -> None:
    """Let the kernel kill this process with its parent, so that no job ever runs twice."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _prepared() -> None:
    """End with the parent, and hear SIGINT even if a shell started all of this to ignore it."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _watched(process: subprocess.Popen[bytes], folder: Path) -> int:
    """Exit status of ``process``; signals to this process are handed on to all of its group."""

    def hand_on(*_: Any) -> None:
        os.killpg(process.pid, signal.SIGINT)

    before = {s: signal.signal(s, hand_on) for s in (signal.SIGTERM, signal.SIGINT)}
    renewed = time.monotonic()
    try:
        while process.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(STEP_S)
            if time.monotonic() - renewed > RENEW_S:
                renew_lease(folder)
                renewed = time.monotonic()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    return process.returncode


def phase_of(job: Job, code: int) -> Phase:
    """What an exit status means: done, stopped or killed from outside, or failed by itself."""
    if code in job.accepted:
        return "done"
    if code == INTERRUPTED:
        return "waiting"
    return "lost" if code < 0 or code > SIGNALLED else "failed"


def _last_words(path: Path) -> str:
    """The last line that is not empty, cut to what a table holds."""
    with path.open("rb") as stream:
        stream.seek(max(0, path.stat().st_size - 4096))
        lines = stream.read().decode("utf-8", "replace").strip().splitlines()
    return lines[-1][:300] if lines else ""


def main(argv: list[str]) -> int:
    """Run the job in the folder ``argv[0]``."""
    try:
        return run_job(Path(argv[0]))
    except ArticulateError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
