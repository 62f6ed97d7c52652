"""Shapes are made finer only as long as that helps, and what is not done in time stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.articulate.conversion.boxes import written

from articulate.assets.check_report import Check
from articulate.conversion import ConvertConfig
from articulate.conversion.convert import Shaped, build_asset, read_input
from articulate.geometry.time_budget import UNLIMITED, Budget, OutOfTimeError
from articulate.preparation import refine_colliders
from articulate.preparation.refine_colliders import (
    MAX_REFINE_S,
    PASS_S,
    Refiner,
    refined,
    shortfalls,
    should_refine,
)


def test_two_finer_passes_are_always_worth_it_and_none_after_the_last():
    assert should_refine([0.3], 3)
    assert should_refine([0.3, 0.35], 2)
    assert not should_refine([0.3], 0)
    assert not should_refine([0.3, 0.01], 0)


def test_a_pass_that_gained_little_is_the_last():
    assert should_refine([0.40, 0.30, 0.15], 1)
    assert should_refine([0.40, 0.30, 0.19], 1)
    assert not should_refine([0.40, 0.30, 0.21], 1)
    assert should_refine([0.40, 0.30, 0.21], 2)
    assert not should_refine([0.40, 0.30, 0.30], 3)
    assert not should_refine([0.40, 0.30, 0.35], 3)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 4))
def test_what_is_worth_it_with_few_passes_left_is_so_with_more(before, now, left):
    history = [1.0, before, now]
    assert not should_refine(history, left) or should_refine(history, left + 1)


def test_a_link_lacks_what_its_worst_clause_does():
    checks = [
        Check(name=name, outcome="failed", subject="a", measured=m, allowed=a, message="")
        for name, m, a in (("cavities", 0.80, 0.85), ("collision_coverage", 0.93, 0.95))
    ]
    assert shortfalls(checks) == {"a": pytest.approx(0.05)}


def failing(monkeypatch, measured):
    """Let the coverage of the body come out as ``measured``, pass by pass; what was made finer."""
    made = []
    left = list(measured)

    def covered(_):
        value = left.pop(0)
        return (
            Check(
                name="collision_coverage",
                outcome="passed" if value >= 0.95 else "failed",
                subject="body",
                measured=value,
                allowed=0.95,
                message="",
            ),
        )

    def build(*args):
        made.append(args[1].finer)
        return build_asset(*args)

    monkeypatch.setattr(refine_colliders, "check_coverage", covered)
    monkeypatch.setattr(refine_colliders, "build_asset", build)
    return made


@pytest.mark.parametrize(
    ("measured", "times"),
    [
        ([0.96], [0]),
        ([0.80, 0.96], [0, 1]),
        ([0.80, 0.81, 0.82], [0, 1, 2]),  # and that one is kept
        ([0.80, 0.79, 0.78], [0, 1, 2, 0]),  # the usual shapes are better
        ([0.80, 0.90, 0.93, 0.94], [0, 1, 2, 3]),
    ],
)
def test_passes_go_on_while_they_gain_and_the_best_shapes_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measured: list[float], times: list[int]
):
    made = failing(monkeypatch, measured)
    reading = read_input(written(tmp_path / "in"), ConvertConfig())
    found = refined(reading, ConvertConfig(), "two")
    assert [len(finer) for finer in made] == times
    assert found.model is not None
    assert {body.name for body in found.bodies} == {"body", "drawer"}


def test_links_in_the_way_of_others_are_made_finer_unless_that_spoils_them(tmp_path, monkeypatch):
    made = failing(monkeypatch, [0.96, 0.96, 0.80, 0.96])
    reading = read_input(written(tmp_path / "in"), ConvertConfig())
    refiner = Refiner(reading=reading, config=ConvertConfig(), name="two")
    assert refiner.best().model is not None
    assert refiner.finer(["body", "drawer"]) is not None
    assert refiner.finer(["body"]) is None
    assert refiner.finer(["drawer"]) is not None  # and not of the body
    both = ("body", "drawer")
    assert made == [(), both, ("body", *both), (*both, "drawer")]


def test_finer_links_share_some_time(tmp_path, monkeypatch):
    failing(monkeypatch, [0.96, 0.96, 0.96])
    given: list[float] = []
    clock = [0.0]

    def budget(limit_s: float) -> Budget:
        given.append(limit_s)
        return UNLIMITED

    monkeypatch.setattr(refine_colliders, "spent_s", lambda: clock[0])
    monkeypatch.setattr(refine_colliders, "Budget", budget)

    def build(*args):
        clock[0] += 40.0
        return build_asset(*args)

    monkeypatch.setattr(refine_colliders, "build_asset", build)
    reading = read_input(written(tmp_path / "in"), ConvertConfig())
    refiner = Refiner(reading=reading, config=ConvertConfig(), name="two")
    for links in (["body", "drawer"], ["body"], ["body", "drawer"]):
        refiner.finer(links)
    assert given == [2.0 * PASS_S, PASS_S, MAX_REFINE_S - 80.0]


def test_a_link_that_takes_too_long_keeps_the_shapes_it_had(tmp_path: Path):
    reading = read_input(written(tmp_path / "in"), ConvertConfig())
    known = Shaped()
    _, before, _ = build_asset(reading, ConvertConfig(), known)
    finer = ConvertConfig(finer=("body",))
    with pytest.raises(OutOfTimeError):
        Budget(-1.0).check()
    _, after, _ = build_asset(reading, finer, known, None, Budget(-1.0))
    for one, other in zip(before, after, strict=True):
        assert one.shapes == other.shapes
    np.testing.assert_equal(known["body", 1][0], before[0].shapes)
    assert known.unfinished == {"body"}
