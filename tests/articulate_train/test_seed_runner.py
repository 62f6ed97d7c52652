import dataclasses
import json
import os
import signal
import subprocess
import sys
import threading
from typing import Any

import pytest
from tests.runs import write_checkpoint

from articulate.commands import run_command
from articulate.errors import ArticulateError, DivergedError, RunError, UsageError
from articulate.files import write_json
from articulate_train import run_lock as locks
from articulate_train import seed_runner
from articulate_train.run import DONE, resume_run
from articulate_train.run_lock import lock_run
from articulate_train.seed_runner import SeedProgress, last_progress, read_progress, train_seeds
from articulate_train.train_seed import DIVERGED, PROGRESS, SELECTION_FILE


def row(steps, success=0.5, opened=0.75):
    return {"steps": steps, "seconds": steps / 100, "success": success, "opened": opened}


class FakeProcess:
    """Process of a seed that ends when it starts."""

    def __init__(self, run, seed, code, log=""):
        folder = run.seed_folder(seed)
        folder.mkdir(exist_ok=True)
        (run.folder / f"seed_{seed}.log").write_text(log)
        (folder / PROGRESS).write_text(json.dumps(row(192)) + "\n")
        if code == 0:
            (folder / DONE).write_text(json.dumps({"steps": run.config.steps}))
        self.returncode = code
        self.terminated = False

    def poll(self):
        return self.returncode

    def terminate(self):
        self.terminated = True

    def wait(self):
        return self.returncode


@pytest.fixture
def fake(tiny, monkeypatch):
    """Lets seeds end with a code and a log; the seeds that were started."""
    started = []

    def set_up(code=0, log=""):
        def start(folder, seed, threads, lock):
            started.append((seed, threads))
            return FakeProcess(tiny, seed, code, log)

        monkeypatch.setattr(seed_runner, "_start", start)
        return started

    return set_up


def test_seeds_that_are_not_done_are_trained_and_summed_up(tiny, fake):
    started = fake()
    reports: list[SeedProgress] = []
    assert train_seeds(tiny, reports.append)
    assert [seed for seed, _ in started] == [0]
    assert (reports[0].seed, reports[0].steps, reports[0].total) == (0, 192, tiny.config.steps)
    assert (reports[0].success, reports[0].opened, reports[0].steps_per_s) == (0.5, 0.75, 100.0)
    summary = json.loads((tiny.folder / "summary.json").read_text())
    assert summary["seeds"] == [{"seed": 0, **row(192)}]
    assert summary["joint"] == tiny.task.joint


def test_run_that_is_done_starts_nothing_and_keeps_its_summary(tiny, fake):
    started = fake()
    assert train_seeds(tiny, lambda _: None)
    before = (tiny.folder / "summary.json").read_bytes()
    assert train_seeds(tiny, lambda _: pytest.fail("reported"))
    assert len(started) == 1
    assert (tiny.folder / "summary.json").read_bytes() == before


def test_seed_that_has_too_few_steps_goes_on(tiny, fake):
    started = fake()
    (tiny.seed_folder(0)).mkdir()
    (tiny.seed_folder(0) / DONE).write_text('{"steps": 64}')
    assert train_seeds(tiny, lambda _: None)
    assert [seed for seed, _ in started] == [0]


def test_interrupted_seed_ends_the_run_without_an_error(tiny, fake):
    fake(code=130)
    assert not train_seeds(tiny, lambda _: None)
    assert not (tiny.folder / "summary.json").exists()


def test_seed_that_diverges_names_the_file_of_its_states(tiny, fake):
    fake(code=2, log="weights are not finite after 64 steps\n")
    with pytest.raises(DivergedError, match="seed 0 diverged: weights are not finite after 64"):
        train_seeds(tiny, lambda _: None)
    with pytest.raises(DivergedError, match=f"last states: .*seed_0/{DIVERGED}"):
        train_seeds(tiny, lambda _: None)


@pytest.mark.parametrize(
    ("log", "what"),
    [("run: no scene.json in it\n", "run: no scene.json in it"), ("", "no message")],
)
def test_seed_that_is_rejected_is_bad_input_with_its_last_line_and_its_log(tiny, fake, log, what):
    fake(code=2, log=log)
    with pytest.raises(RunError) as caught:
        train_seeds(tiny, lambda _: None)
    line = str(caught.value)
    assert line.startswith(f"seed 0 failed: {what}")
    assert line.endswith(f"; log: {tiny.folder / 'seed_0.log'}")


@pytest.mark.parametrize(
    ("code", "log", "what"),
    [
        (1, "Traceback\nKeyError: 'x'\n", "crashed with exit 1: KeyError: 'x'"),
        (1, "", "crashed with exit 1"),
        (-11, "half a line", "was ended by SIGSEGV: half a line"),
        (-99, "", "was ended by signal 99"),
    ],
)
def test_seed_that_crashes_or_is_killed_is_no_bad_input(tiny, fake, code, log, what):
    fake(code=code, log=log)
    with pytest.raises(ArticulateError) as caught:
        train_seeds(tiny, lambda _: None)
    assert not isinstance(caught.value, UsageError)
    assert str(caught.value) == f"seed 0 {what}; log: {tiny.folder / 'seed_0.log'}"


@pytest.mark.parametrize(("code", "name"), [(-9, "SIGKILL"), (-15, "SIGTERM")])
def test_seed_that_is_killed_from_outside_names_the_command_that_continues(
    tiny, fake, code, name, capsys
):
    """With the exit status of a shell, so that a launcher retries the job."""
    fake(code=code)
    assert run_command(lambda _: train_seeds(tiny, lambda _: None) or 0, []) == 128 - code
    assert capsys.readouterr().err == (
        f"seed 0 was ended by {name}; check that there is enough memory, and "
        f"continue with `train --resume --out {tiny.folder}`; log: {tiny.folder / 'seed_0.log'}\n"
    )


def test_seconds_of_all_calls_add_up(tiny, fake):
    fake(code=130)
    assert not train_seeds(tiny, lambda _: None)
    sessions = json.loads((tiny.folder / "sessions.json").read_text())["seconds"]
    assert len(sessions) == 1
    write_json(tiny.folder / "sessions.json", {"seconds": [1000.0]})
    fake()
    assert train_seeds(tiny, lambda _: None)
    seconds = json.loads((tiny.folder / "summary.json").read_text())["seconds"]
    assert 1000.0 < seconds < 1010.0


def test_run_that_is_being_trained_is_locked_and_free_again_afterwards(tiny, fake):
    started = fake()
    config = dataclasses.replace(tiny.config, steps=640)
    before = (tiny.folder / "config.yaml").read_bytes()
    with lock_run(tiny.folder):
        for call in (train_seeds, lambda run, _: resume_run(run.folder, config)):
            with pytest.raises(RunError, match=f"trained already, by process {os.getpid()} of "):
                call(tiny, lambda _: None)
    assert not started
    assert (tiny.folder / "config.yaml").read_bytes() == before
    assert train_seeds(tiny, lambda _: None)


def test_seeds_of_a_call_that_was_killed_hold_the_run_until_they_end(tiny, tmp_path, monkeypatch):
    """They inherit the lock; a new call waits for them."""
    code = (
        "import subprocess, sys, time\n"
        "from pathlib import Path\n"
        "from articulate_train.run_lock import lock_run\n"
        "with lock_run(Path(sys.argv[1])) as lock:\n"
        "    seed = [sys.executable, '-c', 'import time; time.sleep(60)']\n"
        "    child = subprocess.Popen(seed, pass_fds=(lock,), stdout=subprocess.DEVNULL)\n"
        "    print(child.pid, flush=True)\n"
        "    time.sleep(60)\n"
    )
    command = [sys.executable, "-c", code, str(tiny.folder)]
    train = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert train.stdout is not None
    orphan = int(train.stdout.readline())
    with pytest.raises(RunError, match=f"process {train.pid}"), lock_run(tiny.folder):
        pass
    train.kill()
    train.communicate()
    monkeypatch.setattr(locks, "ORPHANS_S", 0.3)
    with pytest.raises(RunError, match="is being trained"), lock_run(tiny.folder):
        pass
    monkeypatch.setattr(locks, "ORPHANS_S", 60.0)
    threading.Timer(0.3, os.kill, (orphan, signal.SIGKILL)).start()
    with lock_run(tiny.folder):
        assert json.loads((tiny.folder / locks.LOCK).read_text())["pid"] == os.getpid()


def test_seed_gets_its_parent_and_keeps_the_lock(tiny, monkeypatch):
    passed: dict[str, Any] = {}
    monkeypatch.setattr(subprocess, "Popen", lambda command, **how: passed.update(how, c=command))
    with lock_run(tiny.folder) as lock:
        seed_runner._start(tiny.folder, 3, 2, lock)
    assert passed["c"][-4:] == [str(tiny.folder), "3", "2", str(os.getpid())]
    assert passed["pass_fds"] == (lock,)


def test_interrupt_stops_all_seeds_and_is_no_error(tiny, fake, monkeypatch):
    fake()
    monkeypatch.setattr(
        seed_runner, "_report_progress", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)
    )
    assert not train_seeds(tiny, lambda _: None)


def test_progress_is_read_up_to_a_line_that_is_cut_off(tmp_path):
    assert read_progress(tmp_path) == []
    lines = [json.dumps(row(k)) for k in (10, 20)]
    (tmp_path / PROGRESS).write_text("\n".join([*lines, '{"steps": 3']))
    assert read_progress(tmp_path) == [row(10), row(20)]


def test_seed_without_progress_has_only_its_number(tiny):
    write_checkpoint(tiny.seed_folder(0), 0)
    assert last_progress(tiny, 0) == {"seed": 0}


def test_progress_that_is_rewritten_is_not_reported(tiny):
    """A seed that is resumed drops the lines after its checkpoint."""
    tiny.seed_folder(0).mkdir()
    (tiny.seed_folder(0) / PROGRESS).write_text("")
    seen = {0: 5}
    seed_runner._report_progress(tiny, 0, seen, lambda _: pytest.fail("reported"))
    assert seen == {0: 5}


def test_selection_of_a_checkpoint_is_reported_once_for_each_line(tiny):
    folder = tiny.seed_folder(0)
    folder.mkdir()
    seen: dict[int, str] = {}
    lines: list[tuple[int, str]] = []
    for text in (None, "candidate 1 of 2", "candidate 1 of 2", "candidate 2 of 2"):
        if text is not None:
            write_json(folder / SELECTION_FILE, {"text": text})
        seed_runner._report_selection(tiny, 0, seen, lambda *line: lines.append(line))
    assert lines == [(0, "candidate 1 of 2"), (0, "candidate 2 of 2")]
