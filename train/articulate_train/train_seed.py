"""Train one seed: ``python -m articulate_train.train_seed RUN SEED THREADS [PARENT]``.

The process writes ``progress.jsonl`` (a line every ten updates of each member, and at the end),
TensorBoard events, ``checkpoint.pt`` and candidate checkpoints; then ``selection.json`` while these
are evaluated, ``policy.pt`` and ``done.json``. On SIGINT, SIGTERM or the end of the process PARENT
it saves a checkpoint and exits with 130.
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
    CANDIDATES,
    CheckpointScore,
    MemberScore,
    is_due,
    keep_candidate,
    score_rows,
    select_active_members,
    select_checkpoint,
)
from articulate_train.ensemble import Ensemble
from articulate_train.policy import (
    ACTIVE_MEMBER,
    CHECKPOINT,
    POLICY,
    read_checkpoint,
    reject_other_versions,
    trained_steps,
    write_state,
)
from articulate_train.run import DONE, Run, open_run
from articulate_train.target_evaluation import (
    KEY,
    TargetEvaluation,
    evaluate_target,
    is_evaluation_due,
)
from articulate_train.vecenv import Finished

log = logging.getLogger(__name__)
PROGRESS, DIVERGED, SELECTION_FILE = "progress.jsonl", "diverged.npz", "selection.json"
CRASHED, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit statuses."""
REPORT_UPDATES = 10
"""Updates between lines of progress."""


class SeedProcess:
    """Training of one seed and its files."""

    def __init__(self, run: Run, seed: int, *, threads: int, parent: int | None = None) -> None:
        """Build the ensemble; continue from the seed's checkpoint if there is one.

        Args:
            run: The run.
            seed: One of its seeds.
            threads: Threads of the engine.
            parent: Process id whose end stops the training; by default that of the parent.
        """
        self.folder = run.seed_folder(seed)
        self._run, self._seed, self._threads = run, seed, threads
        self.folder.mkdir(exist_ok=True)
        self._every = run.config.checkpoint_updates
        self._stop = False
        self._parent = os.getppid() if parent is None else parent
        self._scene = run.scene()
        self._target: TargetEvaluation | None = None
        self.ensemble = Ensemble(self._scene, run.config, seed, threads=threads)
        self._before_s = 0.0
        selects = run.config.checkpoint_selection.n_checkpoints > 1
        if (self.folder / CHECKPOINT).exists():
            content = read_checkpoint(self.folder)
            with reject_other_versions(self.folder / CHECKPOINT):
                self.ensemble.restore(content)
        elif selects and run.config.starts_from_generalist:
            keep_candidate(self.folder, self.ensemble.policy_state())
        self._updates = self.ensemble.updates
        if selects and (self.folder / POLICY).exists():
            # The policy of a shorter training stays until a better one is found.
            keep_candidate(self.folder, read_checkpoint(self.folder, POLICY))
        self._cut_progress()
        after = self.ensemble.steps + 1  # the point of the checkpoint was written before
        self._board = SummaryWriter(str(self.folder / "tensorboard"), purge_step=after)
        self._begin = time.monotonic()

    def _cut_progress(self) -> None:
        """Drop lines of progress after the restored checkpoint."""
        path = self.folder / PROGRESS
        steps = self.ensemble.steps
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
        write_text(path, "".join(f"{line}\n" for line in kept))  # others read it meanwhile

    def stop(self, *_: Any) -> None:
        """Stop after the current update."""
        self._stop = True

    def train(self) -> bool:
        """Train until done or stopped by a signal; return whether it is done."""
        try:
            self.ensemble.run(self._after_round)
        except DivergedError:
            self._write_diverged()
            raise
        reached = self._target is not None and self._target.is_reached
        done = self.ensemble.is_done or reached
        if done and self._updates % REPORT_UPDATES:
            self._report()  # the last updates
        if reached:  # a checkpoint of this step would train on if done.json were not written
            return self._finish(self.ensemble.policy_state(), [], [])
        self.ensemble.save(self.folder)
        return done and self._select()

    def _select(self) -> bool:
        """Select the policy and mark the seed as done; False if stopped."""
        keep_candidate(self.folder, self.ensemble.policy_state())
        run, seed = self._run, self._seed
        options: Any = {
            "threads": self._threads,
            "should_continue": lambda: not self._is_stopped,
            "on_progress": self._report_selection,
        }
        found = select_checkpoint(run, seed, **options)
        if found is None:
            return False
        state, scores = found
        members = select_active_members(run, seed, state, **options)
        if members is None:
            return False
        state, member_scores = members
        return self._finish(state, scores, member_scores)

    def _finish(
        self,
        state: dict[str, Any],
        scores: list[CheckpointScore],
        member_scores: list[MemberScore],
    ) -> bool:
        """Write the policy and mark the seed as done; return True."""
        write_state(self.folder / POLICY, state)
        done = {
            "steps": self.ensemble.steps,
            "selected_step": trained_steps(state),
            "selection_scores": score_rows(scores),
            "ensemble": score_rows(member_scores),
            "active_member": state.get(ACTIVE_MEMBER),
        }
        if self._target is not None and self._target.is_reached:
            done[KEY] = self._target.as_dict()
        write_json(self.folder / DONE, done)
        shutil.rmtree(self.folder / CANDIDATES, ignore_errors=True)
        (self.folder / SELECTION_FILE).unlink(missing_ok=True)
        return True

    def _report_selection(self, text: str) -> None:
        write_json(self.folder / SELECTION_FILE, {"text": text})

    @property
    def _is_stopped(self) -> bool:
        """True after a signal or the end of the parent process."""
        self._stop = self._stop or self.is_orphan
        return self._stop

    def _after_round(self, members: Ensemble) -> bool:
        self._updates += 1
        if self._updates % REPORT_UPDATES == 0:
            self._report()
        steps, config = members.steps, members.config
        if is_due(config.checkpoint_selection, config.steps, steps - members.round_steps, steps):
            keep_candidate(self.folder, members.policy_state())
        if is_evaluation_due(config, steps - members.round_steps, steps):
            self._target = evaluate_target(
                self._scene, config, self._seed, members.policy_state(), steps, self._threads
            )
            if self._target.is_reached:
                return False
            self._report_selection(f"target success not met yet: {self._target.text()}")
        if self._updates % self._every == 0:
            members.save(self.folder)
        return not self._is_stopped

    @property
    def is_orphan(self) -> bool:
        """True if the parent process has ended."""
        return os.getppid() != self._parent

    def _report(self) -> None:
        finished = self.ensemble.finished()
        if not finished:
            return
        steps = self.ensemble.steps
        row = summarize_episodes(finished) | {
            "steps": steps,
            "seconds": round(self._before_s + time.monotonic() - self._begin, 2),
            "log_std": self.ensemble.log_std(),
            "update": self.ensemble.figures(),
        }
        with (self.folder / PROGRESS).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        for name in ("success", "opened", "success_all", "log_std"):
            self._board.add_scalar(f"train/{name}", row[name], steps)
        for name, value in row["terms"].items():
            self._board.add_scalar(f"reward/{name}", value, steps)
        for name, value in row["update"].items():
            self._board.add_scalar(f"update/{name}", value, steps)

    def _write_diverged(self) -> None:
        snapshot: dict[str, Any] = self.ensemble.diverged().episodes.engine.snapshot()
        with atomic_write(self.folder / DIVERGED) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, **snapshot)

    def close(self) -> None:
        """Close files and engines."""
        self._board.close()
        self.ensemble.close()


def summarize_episodes(finished: list[Finished]) -> dict[str, Any]:
    """Return success rates and mean reward terms of ended episodes, for ``progress.jsonl``."""
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
        return INTERRUPTED  # the parent ended during the imports
    try:
        run, seed, threads = open_run(Path(argv[0])), int(argv[1]), int(argv[2])
        process = SeedProcess(run, seed, threads=threads, parent=parent)
        signal.signal(signal.SIGINT, process.stop)
        signal.signal(signal.SIGTERM, process.stop)
        done = process.train()
        process.close()
    except ArticulateError as error:
        _log_error(error)
        return BAD_INPUT if isinstance(error, UsageError) else CRASHED
    except OSError as error:
        if error.errno not in {errno.ENOSPC, errno.EDQUOT}:
            raise
        _log_error(error)
        return BAD_INPUT
    return 0 if done else INTERRUPTED


def _log_error(error: Exception) -> None:
    """Write the error to the log, unless the disk is full."""
    with suppress(OSError):
        sys.stderr.write(f"{error}\n")
        sys.stderr.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
