"""One seed in a process of its own: ``python -m articulate_train.train_seed RUN SEED THREADS [PARENT]``.

It writes ``progress.jsonl`` (a line every ten updates of each member, and at the end), TensorBoard
events, ``checkpoint.pt`` and states of the policy, and at the end the best of these as
``policy.pt``, and ``done.json``. SIGINT or SIGTERM saves and stops with 130, and so does
the end of the process PARENT, which started it.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import shutil
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter

from articulate.errors import ArticulateError, DivergedError, UsageError
from articulate.files import atomic_write, write_json, write_text
from articulate.task.episode_monitor import REASONS
from articulate_envs.rewards import TERMS
from articulate_train.checkpoint_selection import (
    STATES,
    choose_acting,
    choose_state,
    is_due,
    keep_state,
    told,
)
from articulate_train.ensemble import Members
from articulate_train.policy import (
    ACTS,
    CHECKPOINT,
    CHOSEN,
    of_this_version,
    read_checkpoint,
    trained_steps,
    write_state,
)
from articulate_train.run import DONE, Run, open_run
from articulate_train.vecenv import Finished

log = logging.getLogger(__name__)
PROGRESS, DIVERGED = "progress.jsonl", "diverged.npz"
CRASHED, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit statuses."""
REPORT_UPDATES = 10
"""Updates between lines of progress."""


class SeedProcess:
    """Trains one seed of a run and keeps its folder."""

    def __init__(self, run: Run, seed: int, *, threads: int, parent: int | None = None) -> None:
        """Continue from the seed's checkpoint if there is one.

        Args:
            run: The run.
            seed: One of its seeds.
            threads: Threads of the engine.
            parent: Number of the process without which nothing is to be trained; by default the
                one that is the parent now.
        """
        self.folder = run.seed_folder(seed)
        self._run, self._seed, self._threads = run, seed, threads
        self.folder.mkdir(exist_ok=True)
        self._every = run.config.checkpoint_updates
        self._stop = False
        self._parent = os.getppid() if parent is None else parent
        self.members = Members(run.scene(), run.config, seed, threads=threads)
        self._before_s = 0.0
        if (self.folder / CHECKPOINT).exists():
            content = read_checkpoint(self.folder)
            with of_this_version(self.folder / CHECKPOINT):
                self.members.restore(content)
        self._updates = self.members.updates
        if (self.folder / CHOSEN).exists() and run.config.select.states > 1:
            # Of a shorter training that goes on: it stays until a better one is found.
            keep_state(self.folder, read_checkpoint(self.folder, CHOSEN))
        self._cut_progress()
        after = self.members.steps + 1  # the point at the checkpoint itself is there already
        self._board = SummaryWriter(str(self.folder / "tensorboard"), purge_step=after)
        self._begin = time.monotonic()

    def _cut_progress(self) -> None:
        """Drop lines of progress after the checkpoint that is continued."""
        path = self.folder / PROGRESS
        steps = self.members.steps
        lines = path.read_text().splitlines() if path.exists() else []
        kept = []
        for line in lines:
            try:
                row = json.loads(line)
            except ValueError:  # cut off by a kill
                break
            if row["steps"] <= steps:
                kept.append(line)
                self._before_s = float(row["seconds"])
        write_text(path, "".join(f"{line}\n" for line in kept))  # it is read meanwhile

    def stop(self, *_: Any) -> None:
        """Stop after the update that runs."""
        self._stop = True

    def train(self) -> bool:
        """Train to the end, or to a signal; True if it is done."""
        try:
            self.members.run(self._after_round)
        except DivergedError:
            self._keep_states()
            raise
        done = self.members.is_done
        if done and self._updates % REPORT_UPDATES:
            self._report()  # the last updates, without which a short training has no figures
        self.members.save(self.folder)
        return done and self._choose()

    def _choose(self) -> bool:
        """Take the best state as the policy, and say that the seed is done; False if stopped."""
        keep_state(self.folder, self.members.acting())
        run, seed, threads = self._run, self._seed, self._threads
        found = choose_state(run, seed, threads=threads, goes_on=self._goes_on)
        if found is None:
            return False
        state, judged = found
        who = choose_acting(run, seed, state, threads=threads, goes_on=self._goes_on)
        if who is None:
            return False
        state, acted = who
        write_state(self.folder / CHOSEN, state)
        done = {
            "steps": self.members.steps,
            "chosen": trained_steps(state),
            "judged": told(judged),
            "members": told(acted),
            "acts": state.get(ACTS),
        }
        write_json(self.folder / DONE, done)
        shutil.rmtree(self.folder / STATES)
        return True

    def _goes_on(self) -> bool:
        return not self._is_stopped

    @property
    def _is_stopped(self) -> bool:
        """Whether it was told to stop, or its run was killed, and may be taken up again."""
        self._stop = self._stop or self.is_orphan
        return self._stop

    def _after_round(self, members: Members) -> bool:
        self._updates += 1
        if self._updates % REPORT_UPDATES == 0:
            self._report()
        steps, config = members.steps, members.config
        if is_due(config.select, config.steps, steps - members.round_steps, steps):
            keep_state(self.folder, members.acting())
        if self._updates % self._every == 0:
            members.save(self.folder)
        return not self._is_stopped

    @property
    def is_orphan(self) -> bool:
        """Whether the process that started it is gone."""
        return os.getppid() != self._parent

    def _report(self) -> None:
        finished = self.members.finished()
        if not finished:
            return
        steps = self.members.steps
        row = summarise(finished) | {
            "steps": steps,
            "seconds": round(self._before_s + time.monotonic() - self._begin, 2),
            "log_std": self.members.log_std(),
            "update": self.members.figures(),
        }
        with (self.folder / PROGRESS).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        for name in ("success", "opened", "success_all", "log_std"):
            self._board.add_scalar(f"train/{name}", row[name], steps)
        for name, value in row["terms"].items():
            self._board.add_scalar(f"reward/{name}", value, steps)
        for name, value in row["update"].items():
            self._board.add_scalar(f"update/{name}", value, steps)

    def _keep_states(self) -> None:
        snapshot: dict[str, Any] = self.members.diverged().episodes.engine.snapshot()
        with atomic_write(self.folder / DIVERGED) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, **snapshot)

    def close(self) -> None:
        """Close the files and the engine."""
        self._board.close()
        self.members.close()


def summarise(finished: list[Finished]) -> dict[str, Any]:
    """Shares and means over episodes that ended: from home, and over all starts."""
    code = np.concatenate([e.code for e in finished])
    opened = np.concatenate([e.opened for e in finished])
    home = np.concatenate([e.from_home for e in finished])
    terms = np.concatenate([e.terms for e in finished]).mean(axis=0)
    reasons = {REASONS[k]: int((code[home] == k).sum()) for k in np.unique(code[home])}
    return {
        "episodes": int(home.sum()),
        "success": float((code[home] == 0).mean()) if home.any() else 0.0,
        "opened": float(opened[home].mean()) if home.any() else 0.0,
        "success_all": float((code == 0).mean()),
        "reasons": reasons,
        "terms": dict(zip(TERMS, (float(v) for v in terms), strict=True)),
    }


def main(argv: list[str]) -> int:
    """Train seed ``argv[1]`` of run ``argv[0]`` on ``argv[2]`` threads for process ``argv[3]``."""
    torch.set_num_threads(1)
    parent = int(argv[3]) if len(argv) > 3 else None
    if parent not in (None, os.getppid()):
        return INTERRUPTED  # it ended while this process loaded its libraries
    try:
        run, seed, threads = open_run(Path(argv[0])), int(argv[1]), int(argv[2])
        process = SeedProcess(run, seed, threads=threads, parent=parent)
        signal.signal(signal.SIGINT, process.stop)
        signal.signal(signal.SIGTERM, process.stop)
        done = process.train()
        process.close()
    except ArticulateError as error:
        _complain(error)
        return BAD_INPUT if isinstance(error, UsageError) else CRASHED
    except OSError as error:
        if error.errno not in {errno.ENOSPC, errno.EDQUOT}:
            raise
        _complain(error)
        return BAD_INPUT
    return 0 if done else INTERRUPTED


def _complain(error: Exception) -> None:
    """Say in the log what went wrong; a full disk may hold no more of it."""
    with suppress(OSError):
        sys.stderr.write(f"{error}\n")
        sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
