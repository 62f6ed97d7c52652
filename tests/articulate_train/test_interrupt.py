"""Ctrl-C during a training: once saves and names the command that continues, twice ends."""

import os
import shlex
import signal
import subprocess
import sys
import time

import pytest
from tests.runs import tiny_run

from articulate.commands.interrupt import descendants

pytestmark = pytest.mark.slow


@pytest.fixture
def process(cabinet, tmp_path):
    """A training that would take hours, at work, in a folder with a space in its name."""
    run = tiny_run(tmp_path / "a run", cabinet, updates=10**6)
    process = subprocess.Popen(
        [sys.executable, "-m", "articulate", "train", "--resume", "--out", str(run.folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 300
    while not (run.seed_folder(0) / "checkpoint.pt").exists():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.2)
    yield process, run
    process.kill()
    process.communicate()


def test_once_saves_and_prints_the_command_that_goes_on(process):
    process, run = process
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, out) == (130, "")
    line = err.splitlines()[-1]
    command = line.removeprefix("interrupted; continue with: ")
    assert shlex.split(command) == ["train", "--resume", "--out", str(run.folder)]
    again = [*shlex.split(command), "--steps", "32", "--no-evaluate"]
    done = subprocess.run(
        [sys.executable, "-m", "articulate", *again], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{run.folder}\n"
    assert (run.seed_folder(0) / "done.json").is_file()


def test_twice_ends_at_once_with_the_seeds(process):
    process, _ = process
    seeds = descendants(process.pid)
    assert seeds
    for pid in seeds:
        os.kill(pid, signal.SIGSTOP)  # it will not save in time
    process.send_signal(signal.SIGINT)
    while "once more" not in process.stderr.readline():
        pass
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=60) == 130
    for pid in seeds:
        for _ in range(100):
            if not alive(pid):
                break
            time.sleep(0.1)
        assert not alive(pid)


def alive(pid):
    """Return whether a process runs and is not a zombie."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as stream:  # noqa: PTH123
            return stream.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
