from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.benchmark.objects import Oracle, attempt, cupboard

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.run import run_object
from articulate.errors import UsageError
from articulate.files import write_json
from articulate.reconstruct.actors.protocol import PredictedJoint, Prediction, Verdict
from articulate.transforms import pose

SMALL = BenchmarkConfig(actor="oracle", width_px=64, height_px=48, n_frames=3)


def settings(modality="text", **changes) -> BenchmarkConfig:
    return replace(SMALL, modality=modality, **changes)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    return cupboard(tmp_path_factory.mktemp("data"))


def outcomes(record, protocol="strict"):
    return {
        joint["joint"]: joint["failures"][protocol]
        for case in record["cases"]
        for joint in case["joints"]
    }


@pytest.mark.parametrize("modality", ["text", "image", "video"])
def test_who_knows_the_truth_is_right_everywhere(subject, modality):
    record = run_object(subject, Oracle(subject), settings(modality))
    for protocol in ("paper", "strict"):
        assert set(outcomes(record, protocol).values()) == {"success"}
    assert len(record["cases"]) == (4 if modality == "video" else 1)
    assert all(case["false_positives"] == 0 for case in record["cases"])


@pytest.mark.parametrize("modality", ["text", "image"])
def test_who_knows_the_truth_places_everything(subject, modality):
    record = run_object(subject, Oracle(subject), settings(modality, task="placement"))
    placement = record["cases"][0]["placement"]
    assert placement["success"] == {"paper": True, "strict": True, "released_code": True}
    assert set(outcomes(record).values()) == {"success"}


def test_a_frame_of_the_actors_own_is_no_error_without_a_camera(subject):
    class Elsewhere(Oracle):
        def predict(self, evidence):
            said = super().predict(evidence)
            away = np.array([3.0, -1.0, 0.5])
            return replace(
                said,
                joints=tuple(
                    replace(j, pivot_o=tuple(np.add(j.pivot_o, away))) for j in said.joints
                ),
                placements={k: pose(away) @ T for k, T in said.placements.items()},
            )

    record = run_object(subject, Elsewhere(subject), settings("text", task="placement"))
    assert record["cases"][0]["placement"]["success"]["strict"]
    assert set(outcomes(record).values()) == {"success"}
    seen = run_object(subject, Elsewhere(subject), settings("image", task="placement"))
    assert not seen["cases"][0]["placement"]["success"]["strict"]


def test_joints_on_parts_that_never_move_are_counted(subject):
    class Inventive(Oracle):
        def predict(self, evidence):
            said = super().predict(evidence)
            body = self.names(evidence)["link_0"]
            return replace(
                said,
                joints=(*said.joints, PredictedJoint(part=body, parent=None, kind="prismatic")),
            )

    record = run_object(subject, Inventive(subject), settings())
    assert record["cases"][0]["false_positives"] == 1


def test_who_says_that_a_part_moves_which_follows_another_invents_nothing(subject):
    following = replace(
        subject,
        joints=tuple(j for j in subject.joints if j.joint.part != "link_4"),
        carried=frozenset({"link_4"}),
    )
    everything = run_object(following, Oracle(subject), settings())
    assert everything["cases"][0]["false_positives"] == 0


@pytest.fixture
def drawers(subject):
    """Two drawers that differ in nothing but number and place, in a body."""
    low, body = subject.part("link_1"), subject.part("link_0")
    high = low.renamed("high").moved(pose([0.0, 0.0, 0.4]))
    known = next(j for j in subject.joints if j.joint.part == "link_1")
    along = replace(known.joint, part="high", pivot_o=tuple(high.centre), upper=0.3)
    return replace(
        subject,
        parts=(body, low, high),
        labels={"link_0": "body", "link_1": "drawer_0", "high": "drawer_1"},
        joints=(known, replace(known, joint=along, moves=("high",), rigid=("high",))),
    )


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_parts_that_are_called_and_look_alike_may_stand_for_each_other(drawers, order):
    room = np.ptp(drawers.part("link_0").bounds, axis=0)

    class Exchanges(Oracle):
        def predict(self, evidence):
            at = {p.name: pose(p.centre) for p in drawers.parts}
            free = [p.name for p in evidence.parts if not np.allclose(np.ptp(p.bounds, 0), room)]
            (body,) = {p.name for p in evidence.parts} - set(free)
            told = {free[k]: j.joint for k, j in zip(order, drawers.joints, strict=True)}
            return Prediction(
                joints=tuple(replace(j, part=name, parent=body) for name, j in told.items()),
                placements={body: at["link_0"]} | {name: at[j.part] for name, j in told.items()},
            )

    record = run_object(drawers, Exchanges(drawers), settings("image", task="placement"))
    assert record["cases"][0]["placement"]["success"]["strict"]
    assert outcomes(record) == {"link_1": "success", "high": "success"}


def test_a_fixed_joint_says_that_nothing_moves(subject):
    class Fixed(Oracle):
        def predict(self, evidence):
            said = super().predict(evidence)
            return replace(said, joints=tuple(replace(j, kind="fixed") for j in said.joints))

    record = run_object(subject, Fixed(subject), settings())
    assert set(outcomes(record).values()) == {"joint_type"}
    assert record["cases"][0]["false_positives"] == 0


class Loops(Oracle):
    """Four turns: wrong, right, right, wrong; its critic likes the last best."""

    def predict(self, evidence):
        said = super().predict(evidence)
        wrong = [replace(j, kind="fixed") for j in said.joints]
        turns = ((wrong, 1.0), (said.joints, 3.0), (said.joints, 3.0), (wrong, 4.0))
        return Prediction(
            joints=tuple(wrong),
            rating=4.0,
            verdict=Verdict(failure="joint_axis", rating=4.0),
            attempts=tuple(attempt(joints, rating) for joints, rating in turns),
            calls=4,
        )


def test_the_actors_critic_decides_except_in_the_released_code(subject):
    record = run_object(subject, Loops(subject), settings())
    assert set(outcomes(record, "strict").values()) == {"joint_type"}
    assert outcomes(record, "released_code")["link_1"] == "success"
    first = record["cases"][0]["joints"][0]
    assert [turn["best"] for turn in first["attempts"]] == [0, 1, 1, 3]
    strict = [turn["failures"]["strict"] for turn in first["attempts"]]
    assert strict == ["joint_type", "success", "success", "joint_type"]
    assert record["cases"][0]["critic"] == "joint_axis"
    assert record["cases"][0]["calls"] == 4


PROBLEMS = (UsageError("busy"), ConnectionError("reset"), ZeroDivisionError("division by zero"))


@pytest.mark.parametrize("error", PROBLEMS)
def test_an_error_of_the_actor_costs_it_the_question(subject, error):
    class Fails(Oracle):
        def predict(self, evidence):
            raise error

    record = run_object(subject, Fails(subject), settings("video"))
    passing = isinstance(error, (UsageError, OSError))
    assert all(case["no_answer"] == passing for case in record["cases"])
    assert len(record["cases"]) == 4
    assert str(error) in record["cases"][0]["rejection"]
    assert set(outcomes(record).values()) == {"joint_type"}


def test_numbers_that_are_none_do_not_break_a_record(subject, tmp_path):
    class Broken(Oracle):
        def predict(self, evidence):
            said = super().predict(evidence)
            nan = float("nan")
            bad = tuple(replace(j, axis_o=(nan, nan, nan), upper=nan) for j in said.joints)
            return replace(said, joints=bad, rating=nan)

    record = run_object(subject, Broken(subject), settings())
    assert "success" not in outcomes(record).values()
    write_json(tmp_path / "record.json", record)  # refuses NaN


def test_what_is_predicted_for_a_part_fixed_to_the_moving_one_counts(subject):
    fixed_along = replace(
        subject,
        joints=tuple(
            replace(j, rigid=("link_2", "link_3")) if j.joint.part == "link_2" else j
            for j in subject.joints
            if j.joint.part != "link_3"
        ),
    )

    class Knob(Oracle):
        def predict(self, evidence):
            said = super().predict(evidence)
            names = self.names(evidence)
            on_knob = tuple(
                replace(j, part=names["link_3"]) if j.part == names["link_2"] else j
                for j in said.joints
            )
            return replace(said, joints=on_knob)

    assert outcomes(run_object(fixed_along, Knob(fixed_along), settings()))["link_2"] == "success"


def test_a_query_that_takes_too_long_has_no_answer(subject):
    class Endless(Oracle):
        def predict(self, evidence):
            while True:
                pass

    record = run_object(subject, Endless(subject), settings(query_limit_s=0.2))
    assert record["cases"][0]["rejection"] == "more than 0.2 s of processor time"
    assert set(outcomes(record).values()) == {"joint_type"}
