"""Sparing cuts along a way are taken back once, where shapes that are cut apart pass instead."""

import types

import pytest

from articulate.checks.interference import Way
from articulate.checks.sweep import Violation
from articulate.preparation.repair import RepairSession


@pytest.fixture
def bench():
    asset = types.SimpleNamespace(joints=())
    return RepairSession(asset=asset, bodies=(), mimics=())  # type: ignore[arg-type]  # all it asks for


WAY = Way(free=0.5, meetings=(), ends=(0.0, 0.5), deepest_m=0.003)
FAULT = Violation(joint="lid", others={}, way=WAY, authored=(("lid", "box"),), alone=True)


def cuts(bench, monkeypatch, *, sparing, apart):
    """Say how far each kind of cut goes; returns what was asked for."""
    asked = []

    def along(fault, *, whole):
        asked.append(whole)
        return types.SimpleNamespace(whole=apart if whole else sparing, ends=(0, 0), barred=False)

    monkeypatch.setattr(bench, "_cut_along", along)
    monkeypatch.setattr(bench, "_is_deep", lambda meeting: False)
    monkeypatch.setattr(bench, "_shorten", lambda *_, **__: False)
    return asked


@pytest.mark.parametrize("apart", [True, False])
def test_cut_that_did_not_do_is_made_again_apart_and_only_once(bench, monkeypatch, apart):
    asked = cuts(bench, monkeypatch, sparing=True, apart=apart)
    bench._cut(FAULT)
    assert asked == [False]
    later = cuts(bench, monkeypatch, sparing=False, apart=apart)
    monkeypatch.setattr(bench, "_cut", lambda fault: False)
    assert bench.mend(FAULT, None) is apart
    assert later == [True]
    assert bench.mend(FAULT, None) is False
    assert later == [True]


def test_without_cuts_before_there_is_nothing_to_take_back(bench, monkeypatch):
    asked = cuts(bench, monkeypatch, sparing=False, apart=True)
    monkeypatch.setattr(bench, "_cut", lambda fault: False)
    assert bench.mend(FAULT, None) is False
    assert asked == []


def test_parts_are_as_they_were_where_cutting_apart_does_not_do(bench, monkeypatch):
    restored: list[str] = []
    monkeypatch.setattr(bench, "_states", lambda: "now")
    monkeypatch.setattr(bench, "_restore", restored.append)
    asked = cuts(bench, monkeypatch, sparing=True, apart=False)
    bench._sparing["lid"] = ("before", FAULT)
    assert not bench._cut_apart("lid")
    assert (asked, restored) == ([True], ["before", "now"])
