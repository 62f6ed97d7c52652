"""Train all seeds of a run, each in a separate process."""

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

from articulate.errors import ArticulateError, DivergedError, KilledError, RunError, shorten
from articulate.files import read_json_object
from articulate.untrusted import read_text
from articulate_train.run import DONE, SUMMARY, Run, is_seed_done, write_summary
from articulate_train.run_lock import lock_run
from articulate_train.target_evaluation import reached_target
from articulate_train.train_seed import (
    BAD_INPUT,
    DIVERGED,
    INTERRUPTED,
    PROGRESS,
    SELECTION_FILE,
)
from articulate_train.training_time import TrainingClock

PROGRESS_BYTES = 200_000_000
"""Largest progress of a seed that is read."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 for each seed: more threads would spin beside those of the physics."""

FROM_OUTSIDE = (signal.SIGKILL, signal.SIGTERM)
"""Signals that come from the system (out of memory) or from a user, not from a bug."""


@dataclass(frozen=True)
class SeedProgress:
    """Training progress of one seed."""

    seed: int
    steps: int
    total: int
    steps_per_s: float
    success: float
    """Success rate of recent training episodes, in [0, 1]."""
    opened: float
    """Fraction of them with the part at its target at the end, in [0, 1]."""


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def train_seeds(
    run: Run,
    on_progress: Callable[[SeedProgress], None],
    on_selection: Callable[[int, str], None] = lambda *_: None,
) -> bool:
    """Train all seeds that are not done; return True if all are done, False if interrupted.

    Args:
        run: The run.
        on_progress: Called with the progress of a seed.
        on_selection: Called with a seed and one line on the selection of its checkpoint.

    Raises:
        DivergedError: A seed produced values that are not finite.
        RunError: A seed's input was rejected, or another process trains the run.
        KilledError: A seed's process was ended by a signal from outside.
        ArticulateError: A seed's process crashed.
    """
    if not _waiting(run) and (run.folder / SUMMARY).exists():
        return True
    with lock_run(run.folder) as lock:
        return _train(run, on_progress, on_selection, lock)


def _train(
    run: Run,
    on_progress: Callable[[SeedProgress], None],
    on_selection: Callable[[int, str], None],
    lock: int,
) -> bool:
    waiting = _waiting(run)
    jobs = min(run.config.jobs or processors(), max(len(waiting), 1))
    threads = max(1, processors() // jobs)
    running: dict[int, subprocess.Popen[bytes]] = {}
    seen: dict[int, int] = {}
    selections: dict[int, str] = {}
    clock = TrainingClock(run.folder)
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                seed = waiting.pop(0)
                running[seed] = _start(run.folder, seed, threads, lock)
            time.sleep(0.2)
            for seed, process in list(running.items()):
                if _report_progress(run, seed, seen, on_progress):
                    clock.note()
                _report_selection(run, seed, selections, on_selection)
                if process.poll() is not None:
                    del running[seed]
                    if not _ended_well(run, seed, process):
                        return False
                    reached = reached_target(run.seed_folder(seed) / DONE)
                    if reached is not None:
                        on_selection(seed, f"target success met, training ends: {reached.text()}")
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
    """Return the seeds that are not done."""
    return [seed for seed in run.config.seeds if not _is_done(run, seed)]


def _is_done(run: Run, seed: int) -> bool:
    """Return whether a seed has all its control steps or met the target success."""
    return is_seed_done(run.config, run.seed_folder(seed))


def last_progress(run: Run, seed: int) -> dict[str, Any]:
    """Return the last line of a seed's progress, with its number."""
    rows = read_progress(run.seed_folder(seed))
    return {"seed": seed, **(rows[-1] if rows else {})}


def read_progress(folder: Path) -> list[dict[str, Any]]:
    """Return the lines of a seed's progress up to the first that is incomplete or damaged."""
    path = folder / PROGRESS
    rows: list[dict[str, Any]] = []
    for line in read_text(path, PROGRESS_BYTES).splitlines() if path.exists() else []:
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            break
        if not _is_progress(row):
            break
        rows.append(row)
    return rows


def _is_progress(row: Any) -> bool:
    """Return whether ``row`` has the numbers that are read from a line of progress."""
    if not isinstance(row, dict) or not isinstance(row.get("terms", {}), dict):
        return False
    numbers = [row.get(name) for name in ("steps", "seconds", "success", "opened")]
    return all(
        isinstance(value, int | float) for value in [*numbers, *row.get("terms", {}).values()]
    )


def _start(folder: Path, seed: int, threads: int, lock: int) -> subprocess.Popen[bytes]:
    """Start the process of a seed; it inherits ``lock`` and ends with this process."""
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


def _report_progress(
    run: Run, seed: int, seen: dict[int, int], on_progress: Callable[[SeedProgress], None]
) -> bool:
    """Call ``on_progress`` if a seed has a new line of progress; return whether it has."""
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


def _report_selection(
    run: Run, seed: int, seen: dict[int, str], on_selection: Callable[[int, str], None]
) -> None:
    """Call ``on_selection`` if the selection of a seed's checkpoint has a new line."""
    text = str(read_json_object(run.seed_folder(seed) / SELECTION_FILE).get("text", ""))
    if text and text != seen.get(seed):
        seen[seed] = text
        on_selection(seed, text)


def _ended_well(run: Run, seed: int, process: subprocess.Popen[bytes]) -> bool:
    """Return True if the seed is done, False if it was interrupted."""
    code = process.returncode
    if code in (0, INTERRUPTED):
        return code == 0
    log = run.folder / f"seed_{seed}.log"
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    reason = shorten(lines[-1]) if lines else ""
    if code > 0 and "not finite" in reason:
        states = run.seed_folder(seed) / DIVERGED
        raise DivergedError(f"seed {seed} diverged: {reason}; last states: {states}")
    if code == BAD_INPUT:
        reason = reason or "no message; check that the disk is not full"
        raise RunError(f"seed {seed} failed: {reason}; log: {log}")
    if -code in FROM_OUTSIDE:
        raise KilledError(
            f"seed {seed} was ended by {signal_name(-code)}; check that there is enough "
            f"memory, and continue with `train --resume --out {run.folder}`; log: {log}",
            -code,
        )
    how = f"was ended by {signal_name(-code)}" if code < 0 else f"crashed with exit {code}"
    raise ArticulateError(f"seed {seed} {how}{reason and f': {reason}'}; log: {log}")


def signal_name(number: int) -> str:
    """Return the name of a signal, e.g. ``SIGKILL`` for 9; the number of a real-time signal."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
