"""Children that are modules written for these tests."""

import os
import threading
import time
from pathlib import Path

import pytest

from articulate.jobs.process_pool import ProcessPool

ECHO = """
import json, os, signal, subprocess, sys, time
request = json.load(sys.stdin)
if request.get("write"):
    with open(request["write"] + ".part", "w") as stream:
        stream.write(str(os.getpid()))
    os.rename(request["write"] + ".part", request["write"])
if request.get("sleep"):
    time.sleep(request["sleep"])
if request.get("kill"):
    os.kill(os.getpid(), request["kill"])
print(json.dumps(request["say"]), os.environ["OMP_NUM_THREADS"])
sys.stderr.write("first\\nlast words\\n")
sys.exit(request.get("code", 0))
"""


@pytest.fixture
def children(tmp_path, monkeypatch):
    """``children(limit_s)``: they run the module above."""
    (tmp_path / "an_echo.py").write_text(ECHO)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return lambda limit_s=60.0: ProcessPool("an_echo", limit_s)


def test_a_child_is_asked_in_json_and_answers_with_words_and_a_status(children):
    answer = children().ask({"say": "ä", "code": 5})
    assert (answer.code, answer.told.split()) == (5, ['"\\u00e4"', "1"])
    assert answer.last_words == "last words"
    assert answer.signal_name == ""


def test_a_child_that_crashes_tells_by_which_signal(children):
    answer = children().ask({"kill": 11})
    assert (answer.code, answer.signal_name) == (-11, "SIGSEGV")
    assert answer.last_words == "it said nothing"


def test_a_child_that_takes_too_long_is_ended(children, tmp_path):
    answer = children(3.0).ask({"write": str(tmp_path / "pid"), "sleep": 600})
    assert answer.code is None
    pid = (tmp_path / "pid").read_text()
    assert not Path("/proc", pid).exists() or "(zombie)" in Path("/proc", pid, "status").read_text()


def test_answers_come_as_they_are_ready_and_an_error_ends_the_rest(children, tmp_path):
    group, seen = children(), threading.Event()

    def make(k):
        if k == 0:
            return group.ask({"say": 0}).told
        if k == 1:
            seen.wait(600)
            while not (tmp_path / "pid").exists():
                time.sleep(0.05)
            raise ValueError("in the middle")
        return group.ask({"write": str(tmp_path / "pid"), "sleep": 600}).code

    made = group.side_by_side([0, 1, 2], make, 3)
    assert next(made).startswith("0")
    seen.set()
    with pytest.raises(ValueError, match="in the middle"):
        next(made)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    assert threading.active_count() == 1


def test_none_is_started_after_the_stop(children):
    group = children()
    group.stop()
    with pytest.raises(KeyboardInterrupt):
        group.ask({"say": 1})
