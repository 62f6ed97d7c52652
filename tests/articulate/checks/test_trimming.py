"""A part that lost more than a third of its collision volume to repairs is rejected."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.articulate.checks.objects import Part, make_object

from articulate.checks.model import load_model
from articulate.checks.run_checks import run_checks
from articulate.checks.trimming import check_trimming

PART = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0))


def trimmed(folder, share):
    asset = make_object(folder / "object", PART)
    links = tuple(replace(x, trimmed=share if x.name == "drawer" else 0.0) for x in asset.links)
    return replace(asset, links=links)


@pytest.mark.parametrize(
    ("share", "outcome"), [(0.1, "passed"), (0.33, "passed"), (0.34, "failed")]
)
def test_the_trimmed_fraction_is_measured_for_each_part(tmp_path, share, outcome):
    (check,) = check_trimming(load_model(trimmed(tmp_path, share)))
    assert (check.subject, check.measured, check.outcome) == ("drawer", share, outcome)
    assert f"{share:.1%} of the collision volume of drawer" in check.message


def test_parts_that_were_not_trimmed_are_not_listed(tmp_path):
    assert check_trimming(load_model(trimmed(tmp_path, 0.0))) == ()


def test_such_a_repair_counts_against_the_object(tmp_path):
    report = run_checks(trimmed(tmp_path, 0.4))
    assert report.verdict == "rejected"
    assert any("trimming of drawer: repairs cut away 40.0%" in r for r in report.reasons)
