"""Results on stdout and nothing else, independent of libraries."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from articulate.commands import console, run_command

NOISY = """
import ctypes, os, sys
from articulate.commands import console, run_command

def verb(argv):
    print("a library prints")
    os.write(1, b"a native library writes\\n")
    ctypes.CDLL(None).puts(b"and one by way of C")
    ctypes.CDLL(None).fflush(None)
    os.system("echo a child echoes")
    console.show_progress("progress")
    console.detail("details")
    console.emit_json({"answer": 42})
    return 0

sys.exit(run_command(verb, []))
"""
SLOW = """
import subprocess, sys, time
from articulate.commands import console, run_command

def verb(argv):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"],
                             start_new_session=True, stderr=subprocess.DEVNULL)
    console.hint_after_interrupt("go on with: train --resume")
    try:
        print(child.pid, file=sys.stderr, flush=True)
        time.sleep(60)
    except KeyboardInterrupt:
        if argv == ["stubborn"]:
            time.sleep(60)
        child.kill()
        raise

sys.exit(run_command(verb, sys.argv[1:]))
"""


def python(code, *words, **more):
    return subprocess.Popen(
        [sys.executable, "-c", code, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **more,
    )


def test_nothing_but_results_reaches_stdout():
    out, err = python(NOISY).communicate(timeout=60)
    assert json.loads(out) == {"answer": 42}
    for line in [
        "a library prints",
        "a native library writes",
        "and one by way of C",
        "a child echoes",
        "progress",
    ]:
        assert f"{line}\n" in err
    assert "details" not in err


def test_standard_output_is_as_before_after_a_command(capfd):
    def verb(_):
        console.emit("result")
        return 0

    assert run_command(verb, []) == 0
    print("still here")
    os.write(1, b"and here\n")
    out, err = capfd.readouterr()
    assert out == "result\nstill here\nand here\n"
    assert err == ""


def test_text_printed_without_emit_is_no_result(capsys):
    assert run_command(lambda _: bool(print("a remark")), []) == 0
    assert capsys.readouterr() == ("", "a remark\n")


@pytest.mark.parametrize(
    ("level", "printed"),
    [(console.QUIET, "E"), (console.NORMAL, "ES"), (console.VERBOSE, "ESD")],
)
def test_levels_print_less_and_more(level, printed, capsys):
    def verb(_):
        console.set_level(level)
        console.print_error("E")
        console.show_progress("S")
        console.detail("D")
        return 0

    assert run_command(verb, []) == 0
    assert "".join(capsys.readouterr().err.split()) == printed


def test_no_line_is_rewritten_where_there_is_no_terminal(monkeypatch):
    assert not console.is_live()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert console.is_live()
    monkeypatch.setenv("TERM", "dumb")
    assert not console.is_live()


def test_no_command_prints_in_colour(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    from articulate.commands import main

    assert main(["trian"]) == 2
    with pytest.raises(SystemExit):
        main(["check", "--help"])
    assert "\x1b" not in "".join(capsys.readouterr())


def test_interrupted_once_stops_cleanly_and_names_the_command_that_continues():
    process = python(SLOW)
    child = int(process.stderr.readline())
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    last = err.splitlines()[-1]
    assert last == "interrupted; go on with: train --resume"
    assert "Ctrl-C once more ends at once" in err
    assert ended(child)


def test_interrupted_twice_ends_at_once_with_all_children():
    process = python(SLOW, "stubborn")
    child = int(process.stderr.readline())
    process.send_signal(signal.SIGINT)
    while "once more" not in process.stderr.readline():
        pass
    begin = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait(timeout=30)
    assert process.returncode == 130
    assert time.monotonic() - begin < 20
    process.communicate()
    assert ended(child)


def ended(pid):
    """Return whether a child process ends within some seconds."""
    for _ in range(200):
        try:
            os.kill(pid, 0)
            with Path(f"/proc/{pid}/stat").open() as stream:
                if stream.read().rsplit(")", 1)[1].split()[0] == "Z":
                    return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.05)
    return False


def test_signals_are_left_to_a_host_that_has_its_own_handler():
    mine = lambda *_: None  # noqa: E731
    before = signal.signal(signal.SIGINT, mine)
    try:
        assert run_command(lambda _: 0 if signal.getsignal(signal.SIGINT) is mine else 1, []) == 0
        assert signal.getsignal(signal.SIGINT) is mine
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("live", [True, False])
def test_what_is_waited_for_is_reported_at_a_terminal_only(live, monkeypatch, capsys):
    monkeypatch.setattr(console, "is_live", lambda: live)
    console.show_waiting("proving")
    assert capsys.readouterr() == ("", "proving\n" if live else "")
