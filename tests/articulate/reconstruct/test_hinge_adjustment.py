"""A hinge that grazes as it was said is moved a little, never far, and only for that."""

import types

import numpy as np
import pytest

from articulate.assets.check_report import Check, CheckReport
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.hinge_adjustment import (
    STEP,
    adjust_hinge,
    describe_adjustment,
    penetration_m,
)
from articulate.reconstruct.make import _ProgramChecker
from articulate.reconstruct.result import MakeRequest
from articulate.render.parts import plain_part

SIZE_M = 2.0
STEP_M = STEP * SIZE_M
FREE = np.array([0.5 + 1.2 * STEP_M, 0.2, 0.3 - 1.2 * STEP_M])
"""Where the hinge has to be."""


def part_joints(kind="revolute"):
    lid = PredictedJoint(
        part="lid", parent="box", kind=kind, axis_o=(0.0, 1.0, 0.0), pivot_o=(0.5, 0.2, 0.3)
    )
    return {"lid": lid, "foot": PredictedJoint(part="foot", parent="box", kind="fixed")}


def refused(*checks):
    return CheckReport(asset="box", verdict="rejected", reasons=("it grazes",), checks=checks)


def grazes(depth_m, part="lid"):
    return Check(
        name="authored_overlap", outcome="failed", subject=f"{part}_joint", measured=depth_m
    )


class RepairSession:
    """Proves what has its hinge near ``FREE``, and counts how often it is asked."""

    def __init__(self, reach_m):
        self.reach_m, self.pivots = reach_m, []

    def __call__(self, joints):
        self.pivots.append(joints["lid"].pivot_o)
        off = float(np.linalg.norm(np.subtract(joints["lid"].pivot_o, FREE)))
        return (
            CheckReport(asset="box", verdict="passed")
            if off < self.reach_m
            else refused(grazes(off))
        )


def first(bench):
    return refused(grazes(float(np.linalg.norm(np.subtract(part_joints()["lid"].pivot_o, FREE)))))


def test_hinge_is_moved_where_that_helps():
    bench = RepairSession(0.4 * STEP_M)
    found = adjust_hinge(part_joints(), first(bench), bench, SIZE_M)
    assert found is not None
    np.testing.assert_allclose(found["lid"].pivot_o, (0.5 + STEP_M, 0.2, 0.3 - STEP_M))
    assert found["foot"] == part_joints()["foot"]
    assert len(bench.pivots) == 5
    ((part, off),) = describe_adjustment(part_joints(), found).figures.items()
    assert part == "lid"
    assert off == pytest.approx(np.sqrt(2.0) * STEP_M)


def test_it_is_given_up_within_half_a_per_cent():
    bench = RepairSession(0.0)
    assert adjust_hinge(part_joints(), first(bench), bench, SIZE_M) is None
    far = [np.linalg.norm(np.subtract(p, part_joints()["lid"].pivot_o)) for p in bench.pivots]
    assert len(far) == 6
    assert max(far) <= 0.005 * SIZE_M


def test_what_nothing_helps_is_tried_in_four_directions_alone():
    asked = []

    def run_checks(joints):
        asked.append(joints)
        return refused(grazes(1.0))

    assert adjust_hinge(part_joints(), refused(grazes(0.2 * STEP_M)), run_checks, SIZE_M) is None
    assert len(asked) == 4


@pytest.mark.parametrize(
    ("kind", "check_report"),
    [
        ("prismatic", refused(grazes(STEP_M))),
        ("revolute", refused(grazes(STEP_M, part="drawer"))),
        ("revolute", refused()),
        ("revolute", refused(grazes(6.0 * STEP_M))),
        ("revolute", refused(grazes(STEP_M), Check(name="opening", outcome="failed", subject="x"))),
    ],
)
def test_nothing_else_is_tried(kind, check_report):
    def run_checks(joints):
        raise AssertionError

    assert adjust_hinge(part_joints(kind), check_report, run_checks, SIZE_M) is None


def test_depths_are_by_part():
    assert penetration_m(refused(grazes(0.01), grazes(0.02, "door"))) == {"lid": 0.01, "door": 0.02}


@pytest.mark.parametrize("helps", [True, False])
def test_make_takes_the_moved_hinge_only_where_it_is_proven(monkeypatch, tmp_path, helps):
    """Trials lie apart: what is handed over is made in its own place at the end."""
    said = part_joints()
    asked = []

    def check_report(self, source, work):
        asked.append((source, work.name))
        moved = source != str(said["lid"].pivot_o)
        return (
            CheckReport(asset="box", verdict="passed")
            if moved and helps
            else refused(grazes(0.001))
        )

    monkeypatch.setattr(_ProgramChecker, "check", check_report)
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]])
    meshes = [plain_part("lid", corners, np.array([[0, 1, 2]]))]
    part_set = types.SimpleNamespace(name="box", meshes=meshes)
    stages: list[str] = []
    request = MakeRequest(out=tmp_path, cache=tmp_path, progress=stages.append)
    checker = _ProgramChecker(part_set=part_set, request=request, actor="me")  # type: ignore[arg-type]  # it needs no more
    found, report = checker.check_or_adjust(
        said, lambda joints: str(joints["lid"].pivot_o), tmp_path
    )
    assert report.verdict == ("passed" if helps else "rejected")
    assert (found is said) is not helps
    assert stages[0] == "box: checking 2 joints"
    assert stages[-1].endswith(f"trial {1 if helps else 4}")
    places = [place for _, place in asked]
    trials = ["trial", tmp_path.name] if helps else ["trial"] * 4
    assert places == [tmp_path.name, *trials]
    assert asked[0][0] == str(said["lid"].pivot_o)
    assert not helps or asked[-1] == (str(found["lid"].pivot_o), tmp_path.name)
