"""The fuzzing tells verdicts from what must never happen."""

import importlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from articulate.errors import AssetError


@pytest.fixture
def fuzz(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    yield importlib.import_module("fuzz")
    for name in ("fuzz", "mutants"):
        sys.modules.pop(name, None)


@pytest.fixture
def mutant(fuzz):
    return fuzz.Mutant((), (), None, ".obj", ())


def test_mutants_are_refused_or_proven_and_nothing_else_happens():
    script = Path(__file__).parents[2] / "benchmarks" / "fuzz.py"
    command = [sys.executable, str(script), "--count", "8", "--only", "0", "2", "--jobs", "1"]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    assert told["kinds"] == {"refused": 1, "repaired": 1}
    assert told["bad"] == []


def test_an_exception_that_is_not_ours_is_a_traceback(fuzz, mutant, monkeypatch):
    monkeypatch.setattr(fuzz, "check", lambda *_: 1 / 0)
    outcome = fuzz.outcome_of(3, mutant)
    assert (outcome.index, outcome.kind) == (3, "traceback")
    assert "ZeroDivisionError" in outcome.text


def test_one_line_of_ours_is_an_error_and_two_are_not(fuzz, mutant, monkeypatch):
    def say(text):
        def check(*_):
            raise AssetError(text)

        monkeypatch.setattr(fuzz, "check", check)
        return fuzz.outcome_of(0, mutant).kind

    assert say("one line") == "error"
    assert say("two\nlines") == "traceback"


def test_a_process_that_dies_is_a_crash_and_one_that_waits_hangs(fuzz, mutant, monkeypatch):
    monkeypatch.setattr(fuzz, "check", lambda *_: fuzz.os._exit(9))
    assert fuzz.outcome_of(0, mutant).kind == "crash"
    monkeypatch.setattr(fuzz, "LIMIT_S", 0.3)
    monkeypatch.setattr(fuzz, "check", lambda *_: fuzz.time.sleep(60))
    assert fuzz.outcome_of(0, mutant).kind == "hang"


def test_a_file_outside_the_output_is_told(fuzz, mutant, monkeypatch):
    monkeypatch.setattr(
        fuzz, "check", lambda urdf, _: [Path("here.txt").write_text("x"), raised(AssetError("no"))]
    )
    outcome = fuzz.outcome_of(0, mutant)
    assert (outcome.kind, outcome.text) == ("stray", "cwd/here.txt")


def raised(error):
    raise error


def test_mutants_are_the_same_for_the_same_seed(fuzz):
    first = [fuzz.drawn(np.random.default_rng(4)) for _ in range(3)]
    again = [fuzz.drawn(np.random.default_rng(4)) for _ in range(3)]
    assert first == again
    rng = np.random.default_rng(4)
    assert len({fuzz.drawn(rng) for _ in range(20)}) > 15
