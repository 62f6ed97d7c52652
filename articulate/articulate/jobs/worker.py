"""Run the job in a folder: ``python -m articulate.jobs.worker FOLDER``.

All launchers start this module. SIGTERM and SIGINT are forwarded to the command as SIGINT, so that
it can save its progress; the job can be resumed later.
"""

from __future__ import annotations

import contextlib
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
from articulate.files import reject_links
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
from articulate.jobs.process_identity import end_with_parent

RENEW_S = 10.0
"""Time between renewals of the lease [s]."""
POLL_S = 0.1
"""Time between polls of the command [s]."""
INTERRUPTED = 130
SIGNALLED = 128
"""Exit statuses above this stand for a signal, as in a shell."""
LEASED = 75
"""Exit status if another process has the job (EX_TEMPFAIL of sysexits.h)."""


def run_job(folder: Path) -> int:
    """Run the job in ``folder`` and return its exit status; 75 if another process runs it."""
    reject_links(folder)
    job = load_job(folder)
    if not take_lease(folder):
        return LEASED
    try:
        state = load_state(folder)
        if state.phase == "done":
            return job.accepted_codes[0]
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
            preexec_fn=_prepare,  # noqa: PLW1509  # there is one thread
        )
        code = _watch(process, job.folder)
    ended = dataclasses.replace(
        attempt, ended=time.time(), code=code, message=_last_line(job.folder / LOG)
    )
    phase = phase_of(job, code)
    save_state(job.folder, State(phase=phase, attempts=(*state.attempts, ended)))
    return code


def _prepare() -> None:
    """End with the parent, so that no job runs twice, and accept SIGINT.

    A shell may have started this process with SIGINT ignored.
    """
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _watch(process: subprocess.Popen[bytes], folder: Path) -> int:
    """Return the exit status of ``process``; forward signals to its process group."""

    def forward(*_: Any) -> None:
        os.killpg(process.pid, signal.SIGINT)

    before = {s: signal.signal(s, forward) for s in (signal.SIGTERM, signal.SIGINT)}
    renewed = time.monotonic()
    try:
        while process.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(POLL_S)
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
    """Return the phase after an exit status: done, stopped or killed from outside, or failed."""
    if code in job.accepted_codes:
        return "done"
    if code == INTERRUPTED:
        return "waiting"
    return "lost" if code < 0 or code > SIGNALLED else "failed"


def _last_line(path: Path) -> str:
    """Return the last line that is not empty, shortened for a table."""
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
