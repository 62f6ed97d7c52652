"""Hostile inputs of all readers end with one short line, exit 2 or 3, within limits of cost.

The default tests call some commands in this process; the slow ones start every command as users do.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from tests.hostile.cases import CASES, DEFAULT
from tests.hostile.harness import (
    Outcome,
    arguments,
    prepare,
    problems,
    run_process,
    snapshot,
)
from tests.hostile.reader import Case
from tests.hostile.writers import HonestInputs

from articulate.commands import main
from articulate.errors import ArticulateError, UsageError
from articulate.jobs import child, process_pool


@pytest.fixture(scope="session")
def honest(tmp_path_factory: pytest.TempPathFactory) -> HonestInputs:
    """Honest inputs of all readers; not to be changed."""
    return HonestInputs(tmp_path_factory.mktemp("honest"))


def test_there_are_two_hundred_cases_with_distinct_names() -> None:
    names = [case.name for case in CASES]
    assert len(names) >= 200
    assert len(set(names)) == len(names)
    assert set(names) >= DEFAULT


@pytest.mark.parametrize("case", [case for case in CASES if case.is_default], ids=str)
def test_it_is_rejected_in_one_line(
    case: Case,
    honest: HonestInputs,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    for name, value in prepare(case, tmp_path, honest).items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(process_pool._Children, "handle", handle_here)
    before = snapshot(tmp_path)
    code = main(arguments(case))
    stdout, stderr = capfd.readouterr()
    assert problems(Outcome(code=code, stdout=stdout, stderr=stderr), tmp_path, before) == []


def handle_here(children: Any, request: Mapping[str, Any]) -> process_pool.ChildResult:
    """Handle the request of a child process in this one, which has imported all that it needs."""
    try:
        value = import_module(children.module).run(dict(request))
    except ArticulateError as error:
        code = child.USAGE_EXIT if isinstance(error, UsageError) else child.REQUEST_EXIT
        return process_pool.ChildResult(code=code, stderr=str(error))
    return process_pool.ChildResult(code=0, stdout=value)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
def test_its_process_stays_within_its_limits(
    case: Case, honest: HonestInputs, tmp_path: Path
) -> None:
    environment = prepare(case, tmp_path, honest)
    before = snapshot(tmp_path)
    outcome = run_process(case, tmp_path, environment)
    assert problems(outcome, tmp_path, before) == [], outcome.stderr[-600:]
