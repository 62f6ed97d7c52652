"""Overlaps of authored parts are warnings if the user accepts them and nothing jams."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.articulate.checks.objects import Part, make_object

from articulate.assets.check_report import Check
from articulate.checks.accepted_overlap import accept_overlaps
from articulate.checks.run_checks import run_checks
from articulate.errors import ConfigError
from articulate.formats.config import ConvertConfig

OVERLAP = Check(
    name="authored_overlap", outcome="failed", subject="a", measured=0.009, message="9 mm deep"
)
OPENS = Check(name="opening", outcome="passed", subject="a")
CLOSES = Check(name="closing", outcome="passed", subject="a")


def outcome(*checks):
    return accept_overlaps(checks)[0].outcome


def test_an_overlap_of_a_joint_that_opens_and_closes_is_a_warning():
    warning = accept_overlaps((OVERLAP, OPENS, CLOSES))[0]
    assert (warning.outcome, warning.measured) == ("warning", 0.009)
    assert warning.message == "accepted: 9 mm deep"


@pytest.mark.parametrize(
    "checks",
    [
        (OVERLAP,),  # nothing was measured
        (OVERLAP, replace(OPENS, outcome="failed")),
        (OVERLAP, OPENS, replace(CLOSES, outcome="failed")),
        (OVERLAP, replace(OPENS, subject="b")),
        (replace(OVERLAP, measured=None), OPENS, CLOSES),  # joints that block each other
    ],
)
def test_an_overlap_stays_a_failure_where_the_joint_jams_or_is_blocked(checks):
    assert outcome(*checks) == "failed"


def test_other_failures_are_not_accepted():
    assert outcome(replace(OVERLAP, name="joint_sweep"), OPENS, CLOSES) == "failed"


def blocked(folder, *, excluded):
    box = ((0.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    wall = ((0.4, 0.0, 0.0), (0.05, 0.2, 0.2))
    part = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(box,))
    return make_object(folder / "object", part, body=(wall,), excluded=excluded)


@pytest.mark.parametrize(
    ("excluded", "accepted", "expected"),
    [
        (True, ("authored_overlap",), "warning"),
        (True, (), "failed"),
        (False, ("authored_overlap",), "failed"),  # the wall stops the drawer
    ],
)
def test_acceptance_is_a_choice_and_needs_a_joint_that_opens(
    tmp_path, excluded, accepted, expected
):
    asset = replace(blocked(tmp_path, excluded=excluded), accepted=accepted)
    report = run_checks(asset)
    outcomes = {c.name: c.outcome for c in report.checks}
    assert outcomes["authored_overlap"] == expected
    assert any("authored_overlap" in reason for reason in report.reasons) == (expected == "failed")


def test_only_overlaps_can_be_accepted():
    with pytest.raises(ConfigError, match="only authored_overlap can be accepted"):
        ConvertConfig(accept=("inertia",))
