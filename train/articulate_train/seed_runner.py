"""All seeds of a run, each in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from articulate.errors import ArticulateError, DivergedError, KilledError, RunError
from articulate_train.run import DONE, SUMMARY, Run, done_steps, write_summary
from articulate_train.run_lock import alone
from articulate_train.train_seed import BAD_INPUT, DIVERGED, INTERRUPTED, PROGRESS
from articulate_train.training_time import Clock

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 for each seed: more threads fight with the physics (they spin)."""

FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM)
"""Signals that say nothing against a seed: the system ran out of memory, or someone sent them."""


@dataclass(frozen=True)
class SeedProgress:
    """How far one seed has come."""

    seed: int
    steps: int
    total: int
    steps_per_s: float
    success: float
    opened: float


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def train_seeds(run: Run, on_progress: Callable[[SeedProgress], None]) -> bool:
    """Train all seeds that are not done; True if all are done, False if interrupted.

    Raises:
        DivergedError: A seed produced values that are not finite.
        RunError: A seed was refused what it is to train with, or another process trains the run.
        KilledError: A seed's process was ended from outside.
        ArticulateError: A seed's process crashed.
    """
    if not _waiting(run) and (run.folder / SUMMARY).exists():
        return True
    with alone(run.folder) as lock:
        return _train(run, on_progress, lock)


def _train(run: Run, on_progress: Callable[[SeedProgress], None], lock: int) -> bool:
    waiting = _waiting(run)
    jobs = min(run.config.jobs or processors(), max(len(waiting), 1))
    threads = max(1, processors() // jobs)
    running: dict[int, subprocess.Popen[bytes]] = {}
    seen: dict[int, int] = {}
    clock = Clock(run.folder)
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                seed = waiting.pop(0)
                running[seed] = _start(run.folder, seed, threads, lock)
            time.sleep(0.2)
            for seed, process in list(running.items()):
                if _tell(run, seed, seen, on_progress):
                    clock.note()
                if process.poll() is not None:
                    del running[seed]
                    if not _ended_well(run, seed, process):
                        return False
    except KeyboardInterrupt:
        return False
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.wait()
        seconds = clock.note()
    write_summary(run, [last_progress(run, s) for s in run.config.seeds], seconds)
    return True


def _waiting(run: Run) -> list[int]:
    """Seeds that are to be trained."""
    return [seed for seed in run.config.seeds if not _is_done(run, seed)]


def _is_done(run: Run, seed: int) -> bool:
    """Whether a seed has all the steps that are asked for."""
    return done_steps(run.seed_folder(seed) / DONE) >= run.config.steps


def last_progress(run: Run, seed: int) -> dict[str, Any]:
    """The last line of a seed's progress, with its number."""
    rows = read_progress(run.seed_folder(seed))
    return {"seed": seed, **(rows[-1] if rows else {})}


def read_progress(folder: Path) -> list[dict[str, Any]]:
    """All lines of a seed's progress; a line cut off by a kill is left out."""
    path = folder / PROGRESS
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(line))
        except ValueError:
            break
    return rows


def _start(folder: Path, seed: int, threads: int, lock: int) -> subprocess.Popen[bytes]:
    """Start the process of a seed; it keeps ``lock``, and ends if this process is gone."""
    environment = os.environ | dict.fromkeys(THREAD_VARIABLES, "1")
    numbers = (seed, threads, os.getpid())
    command = [sys.executable, "-m", "articulate_train.train_seed", str(folder), *map(str, numbers)]
    log = (folder / f"seed_{seed}.log").open("wb")
    with log:
        return subprocess.Popen(
            command,
            stdout=log,
            stderr=log,
            stdin=subprocess.DEVNULL,
            env=environment,
            pass_fds=(lock,),
        )


def _tell(
    run: Run, seed: int, seen: dict[int, int], on_progress: Callable[[SeedProgress], None]
) -> bool:
    """Tell how far a seed has come, if that is news; whether it was."""
    rows = read_progress(run.seed_folder(seed))
    if not rows or len(rows) == seen.get(seed, 0):
        return False
    seen[seed] = len(rows)
    row = rows[-1]
    on_progress(
        SeedProgress(
            seed=seed,
            steps=row["steps"],
            total=run.config.steps,
            steps_per_s=row["steps"] / max(row["seconds"], 1e-9),
            success=row["success"],
            opened=row["opened"],
        )
    )
    return True


def _ended_well(run: Run, seed: int, process: subprocess.Popen[bytes]) -> bool:
    """True if the seed is done, False if it was interrupted."""
    code = process.returncode
    if code in (0, INTERRUPTED):
        return code == 0
    log = run.folder / f"seed_{seed}.log"
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    said = lines[-1] if lines else ""
    if code > 0 and "not finite" in said:
        states = run.seed_folder(seed) / DIVERGED
        raise DivergedError(f"seed {seed} diverged: {said}; its last states lie in {states}")
    if code == BAD_INPUT:
        said = said or "it said nothing: is the disk full?"
        raise RunError(f"seed {seed} failed: {said}; its log is {log}")
    if -code in FROM_OUTSIDE:
        raise KilledError(
            f"seed {seed} was ended by {signal_name(-code)}; was there enough memory? "
            f"`train --resume --out {run.folder}` goes on; its log is {log}",
            -code,
        )
    how = f"was ended by {signal_name(-code)}" if code < 0 else f"crashed with exit {code}"
    raise ArticulateError(f"seed {seed} {how}{said and f': {said}'}; its log is {log}")


def signal_name(number: int) -> str:
    """``SIGKILL`` for 9; real-time signals have numbers alone."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
