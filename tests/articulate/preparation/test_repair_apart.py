"""Sparing cuts along a way are taken back once, where shapes that are cut apart pass instead."""

import types

import pytest

from articulate.checks.interference import JointSweep
from articulate.checks.sweep import Violation
from articulate.preparation.repair import RepairSession


@pytest.fixture
def session():
    asset = types.SimpleNamespace(joints=())
    return RepairSession(asset=asset, bodies=(), mimics=())  # type: ignore[arg-type]  # all it asks for


SWEEP = JointSweep(free=0.5, interferences=(), ends=(0.0, 0.5), deepest_m=0.003)
VIOLATION = Violation(
    joint="lid", others={}, sweep=SWEEP, authored=(("lid", "box"),), isolated=True
)


def cuts(session, monkeypatch, *, sparing, apart):
    """Say how far each kind of cut goes; returns what was asked for."""
    asked = []

    def along(violation, *, separate):
        asked.append(separate)
        return types.SimpleNamespace(
            complete=apart if separate else sparing, ends=(0, 0), barred=False
        )

    monkeypatch.setattr(session, "_cut_along", along)
    monkeypatch.setattr(session, "_is_deep", lambda interference: False)
    monkeypatch.setattr(session, "_shorten", lambda *_, **__: False)
    return asked


@pytest.mark.parametrize("apart", [True, False])
def test_cut_that_did_not_do_is_made_again_apart_and_only_once(session, monkeypatch, apart):
    asked = cuts(session, monkeypatch, sparing=True, apart=apart)
    session._cut(VIOLATION)
    assert asked == [False]
    later = cuts(session, monkeypatch, sparing=False, apart=apart)
    monkeypatch.setattr(session, "_cut", lambda violation: False)
    assert session.repair(VIOLATION, None) is apart
    assert later == [True]
    assert session.repair(VIOLATION, None) is False
    assert later == [True]


def test_without_cuts_before_there_is_nothing_to_take_back(session, monkeypatch):
    asked = cuts(session, monkeypatch, sparing=False, apart=True)
    monkeypatch.setattr(session, "_cut", lambda violation: False)
    assert session.repair(VIOLATION, None) is False
    assert asked == []


def test_parts_are_as_they_were_where_cutting_apart_does_not_do(session, monkeypatch):
    restored: list[str] = []
    monkeypatch.setattr(session, "_states", lambda: "now")
    monkeypatch.setattr(session, "_restore", restored.append)
    asked = cuts(session, monkeypatch, sparing=True, apart=False)
    session._before_cuts["lid"] = ("before", VIOLATION)
    assert not session._cut_apart("lid")
    assert (asked, restored) == ([True], ["before", "now"])
