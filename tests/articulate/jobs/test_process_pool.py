"""Isolated child processes that run modules written for these tests."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from articulate.errors import UsageError
from articulate.jobs import process_pool
from articulate.jobs.process_identity import is_alive, processor_time_s
from articulate.jobs.process_pool import ChildResult, run_isolated

ECHO = """
import json, os, signal, subprocess, sys, time
from articulate.errors import ArticulateError, UsageError

def run(request):
    if request.get("start"):
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        pids = f"{os.getpid()} {child.pid}"
        with open(request["start"] + ".part", "w") as stream:
            stream.write(pids)
        os.rename(request["start"] + ".part", request["start"])
    time.sleep(request.get("sleep", 0))
    if request.get("spin"):
        code = "while True: pass"
        subprocess.run([sys.executable, "-c", code]) if request["spin"] == "child" else exec(code)
    if request.get("kill"):
        os.kill(os.getpid(), request["kill"])
    if request.get("raise"):
        errors = {"usage": UsageError, "object": ArticulateError, "bug": ValueError}
        raise errors[request["raise"]]("why")
    print("noise")
    return json.dumps(request.get("say")) + os.environ["OMP_NUM_THREADS"]
"""
PARENT = """
import sys
from articulate.jobs.process_pool import run_isolated
request = {"start": sys.argv[1], "sleep": 600}
list(run_isolated("an_echo", [("a", request)], 1, 600.0))
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    """``run(request, limit_s)``: the result of one request to the module above."""
    (tmp_path / "an_echo.py").write_text(ECHO)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def one(request, limit_s=60.0):
        ((key, result),) = run_isolated("an_echo", [("key", request)], 1, limit_s)
        assert key == "key"
        return result

    return one


def pids_in(path: Path) -> list[int]:
    end = time.monotonic() + 20.0
    while not path.exists():
        assert time.monotonic() < end
        time.sleep(0.02)
    return [int(pid) for pid in path.read_text().split()]


def test_a_request_is_json_and_the_result_the_last_line(run):
    result = run({"say": "ä"})
    assert (result.code, result.value) == (0, '"\\u00e4"1')
    assert result.failure(60.0) == ""


@pytest.mark.parametrize(
    ("request_", "code", "reason"),
    [
        ({"raise": "object"}, 3, "why"),
        ({"raise": "bug"}, 1, "its process ended with 1: ValueError: why"),
        ({"kill": 11}, -11, "a library crashed on it (SIGSEGV)"),
        ({"kill": 9}, -9, "was there enough memory?"),
    ],
)
def test_a_failure_has_a_reason(run, request_, code, reason):
    result = run(request_)
    assert result.code == code
    assert reason in result.failure(60.0)
    assert result.is_undecided == (code in (1, -9))


def test_settings_that_are_wrong_for_all_are_raised(run):
    with pytest.raises(UsageError, match="why"):
        run({"raise": "usage"}).failure(60.0)


@pytest.mark.parametrize("who", ["self", "child"])
def test_the_limit_counts_processor_time_with_that_of_descendants(run, who):
    result = run({"spin": who}, limit_s=1.0)
    assert result.code is None
    assert result.is_undecided
    assert 1.0 < result.processor_s < 10.0
    assert "more than the limit of 1 s" in result.failure(1.0)
    assert f"took {result.processor_s:.1f} s of processor time" in result.failure(1.0)


def test_waiting_costs_no_processor_time(run, monkeypatch):
    assert run({"sleep": 2.5, "say": 1}, limit_s=1.5).code == 0


def test_a_child_that_does_nothing_any_more_is_killed_with_all_that_it_started(
    run, tmp_path, monkeypatch
):
    monkeypatch.setattr(process_pool, "MIN_IDLE_S", 1.0)
    result = run({"start": str(tmp_path / "pids"), "sleep": 600}, limit_s=1.0)
    assert result.idle
    assert "got stuck after" in result.failure(1.0)
    until_dead(pids_in(tmp_path / "pids"))


def test_results_come_as_they_are_ready_and_leaving_the_loop_kills_the_rest(run, tmp_path):
    items: list[tuple[str, dict[str, object]]] = [
        ("slow", {"start": str(tmp_path / "pids"), "sleep": 600}),
        ("fast", {"say": 0}),
    ]
    results = run_isolated("an_echo", items, 2, 600.0)
    assert next(results)[0] == "fast"
    pids = pids_in(tmp_path / "pids")
    results.close()
    until_dead(pids)


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel of Linux ends children")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP, signal.SIGTERM])
def test_children_end_with_their_parent(run, tmp_path, number):
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(tmp_path / "pids")])
    child, _ = pids_in(tmp_path / "pids")
    parent.send_signal(number)
    parent.wait()
    until_dead([child], limit_s=1.0)


def until_dead(pids, limit_s=5.0):
    end = time.monotonic() + limit_s
    while any(is_alive(pid) for pid in pids):
        assert time.monotonic() < end, "a process is still alive"
        time.sleep(0.02)


def test_processor_time_of_a_process_that_ended_is_unknown():
    child = subprocess.Popen(["true"])
    child.wait()
    assert processor_time_s(child.pid) is None
    assert (processor_time_s(os.getpid()) or 0.0) > 0.0


def test_a_child_without_output_has_no_value():
    result = ChildResult(code=0)
    assert (result.value, result.last_line) == ("", "no message")
