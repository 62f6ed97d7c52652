"""The fuzzing separates verdicts from tracebacks, crashes, hangs and stray files."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import fuzz
from articulate.errors import AssetError
from mutants import Mutant, sample_mutant


@pytest.fixture
def mutant():
    return Mutant((), (), None, ".obj", ())


def test_mutants_are_rejected_or_usable_and_nothing_else_happens():
    script = Path(__file__).parents[2] / "benchmarks" / "fuzz.py"
    command = [sys.executable, str(script), "--count", "8", "--only", "0", "2", "--jobs", "1"]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    assert result["kinds"] == {"rejected": 1, "repaired": 1}
    assert result["bad"] == []


def test_an_unexpected_exception_is_a_traceback(mutant, monkeypatch):
    monkeypatch.setattr(fuzz, "check_asset", lambda *_: 1 / 0)
    outcome = fuzz.outcome_of(3, mutant)
    assert (outcome.index, outcome.kind) == (3, "traceback")
    assert "ZeroDivisionError" in outcome.text


def test_an_error_of_one_line_is_expected_and_one_of_two_lines_is_not(mutant, monkeypatch):
    def outcome_for(text):
        def check(*_):
            raise AssetError(text)

        monkeypatch.setattr(fuzz, "check_asset", check)
        return fuzz.outcome_of(0, mutant).kind

    assert outcome_for("one line") == "error"
    assert outcome_for("two\nlines") == "traceback"


def test_a_process_that_dies_is_a_crash_and_one_that_waits_hangs(mutant, monkeypatch):
    monkeypatch.setattr(fuzz, "check_asset", lambda *_: os._exit(9))
    assert fuzz.outcome_of(0, mutant).kind == "crash"
    monkeypatch.setattr(fuzz, "LIMIT_S", 0.3)
    monkeypatch.setattr(fuzz, "check_asset", lambda *_: time.sleep(60))
    assert fuzz.outcome_of(0, mutant).kind == "hang"


def test_a_file_outside_the_output_is_reported(mutant, monkeypatch):
    monkeypatch.setattr(
        fuzz,
        "check_asset",
        lambda urdf, _: [Path("here.txt").write_text("x"), raised(AssetError("no"))],
    )
    outcome = fuzz.outcome_of(0, mutant)
    assert (outcome.kind, outcome.text) == ("stray", "cwd/here.txt")


def raised(error):
    raise error


def test_mutants_are_the_same_for_the_same_seed():
    first = [sample_mutant(np.random.default_rng(4)) for _ in range(3)]
    again = [sample_mutant(np.random.default_rng(4)) for _ in range(3)]
    assert first == again
    rng = np.random.default_rng(4)
    assert len({sample_mutant(rng) for _ in range(20)}) > 15
