from __future__ import annotations

import json
from dataclasses import replace
from html.parser import HTMLParser

import pytest
from tests.articulate.benchmark.objects import Oracle, cupboard
from tests.articulate.benchmark.test_run import Loops

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.known_joint import KnownJoint
from articulate.benchmark.records import crashed_object
from articulate.benchmark.report import write_report
from articulate.benchmark.run import run_object
from articulate.benchmark.summary import summary

CONFIG = BenchmarkConfig(actor="oracle", width_px=320, height_px=240, n_frames=3)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    return cupboard(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module")
def right(subject):
    return run_object(subject, Oracle(subject), CONFIG)


def copied(record):
    return json.loads(json.dumps(record))


def test_joints_that_hardly_move_in_the_picture_have_a_row_of_their_own(right):
    results = summary([right], CONFIG, "small")
    assert results["protocols"]["strict"]["n"] == 3
    assert results["rows"]["low_visibility"]["strict"]["n"] == 1  # the flap behind the body
    assert results["protocols"]["strict"]["joint_success"] == 1.0
    assert results["protocols"]["paper"]["joint_success_interval"][0] == pytest.approx(
        0.4385, abs=1e-3
    )


def test_the_released_code_leaves_out_what_turns_without_end(right):
    results = summary([right], CONFIG, "small")
    assert results["protocols"]["released_code"]["n"] == results["protocols"]["paper"]["n"] - 1


def test_compound_joints_stand_apart(right):
    record = copied(right)
    record["cases"][0]["joints"][0]["status"] = "compound"
    results = summary([record], CONFIG, "small")
    assert results["rows"]["compound"]["paper"]["n"] == 1
    assert results["protocols"]["paper"]["n"] == 2


def test_invented_joints_are_failures_in_strict_alone(right):
    record = copied(right)
    record["cases"][0]["false_positives"] = 2
    results = summary([record], CONFIG, "small")
    assert results["false_positives"] == 2
    assert results["protocols"]["strict"]["n"] == 5
    assert results["protocols"]["strict"]["joint_success"] == pytest.approx(0.6)
    assert results["protocols"]["paper"]["joint_success"] == 1.0


def test_joints_invented_on_an_object_without_joints_count(right):
    still = copied(right) | {"object": "still"}
    still["cases"] = [still["cases"][0] | {"joints": [], "false_positives": 2}]
    results = summary([right, still], CONFIG, "small")
    assert results["false_positives"] == 2
    for row in (results["protocols"]["strict"], results["rows"]["visible"]["strict"]):
        assert (row["n"], row["false_positives"]) == (5, 2)
        assert row["joint_success"] == pytest.approx(0.6)
    assert results["protocols"]["paper"]["n"] == 3
    alone = summary([still], CONFIG, "small")["protocols"]["strict"]
    assert (alone["n"], alone["joint_success"]) == (2, 0.0)


def test_joints_invented_beside_a_compound_one_count_in_the_headline(right):
    record = copied(right)
    record["cases"][0]["joints"][0]["status"] = "compound"
    record["cases"][0]["false_positives"] = 1
    results = summary([record], CONFIG, "small")
    assert results["protocols"]["strict"]["n"] == 3
    assert results["rows"]["compound"]["strict"]["n"] == 1


def test_failures_are_counted_in_the_published_order(right):
    record = copied(right)
    for k, failure in enumerate(("joint_limit", "joint_axis", "joint_axis")):
        record["cases"][k]["joints"][0]["failures"]["paper"] = failure
    row = summary([record], CONFIG, "small")["protocols"]["paper"]
    assert row["failures"] == {
        "joint_type": 0,
        "joint_axis": 2,
        "joint_origin": 0,
        "joint_limit": 1,
    }
    assert row["joint_success"] == 0.0
    assert row["type_axis_origin"] == pytest.approx(1.0 / 3.0)


def lost() -> dict:
    turning = KnownJoint(
        link="l0", kind="continuous", axis_s=(0, 0, 1), origin_s=(0, 0, 0), lower=None, upper=None
    )
    known = [turning, replace(turning, link="l1", kind="prismatic")]
    return crashed_object("gone", "Box", known, "its process was ended by SIGSEGV")


def test_a_crashed_object_is_wrong_in_all_its_joints_and_worst_in_the_means():
    results = summary([lost()], CONFIG, "small")
    assert results["protocols"]["paper"] | {"joint_success_interval": 0} == results["protocols"][
        "paper"
    ] | {"joint_success_interval": 0, "joint_success": 0.0, "n": 2}
    assert results["errors"]["type"]["mean"] == 1.0
    assert results["errors"]["axis_rad"]["mean"] == pytest.approx(1.5708, abs=1e-4)
    assert results["errors"]["origin"]["mean"] == 2.0
    assert results["errors"]["origin"]["n"] == 1  # slides have none
    assert results["crashed"][0]["reason"] == "its process was ended by SIGSEGV"
    assert results["cost"]["seconds_per_case"]["median"] is None


def test_categories_are_grouped_as_published(right):
    groups = summary([right, lost()], CONFIG, "small")
    assert set(groups["categories"]) == {"StorageFurniture", "Box"}
    assert groups["groups"]["in_distribution"]["paper"]["n"] == 5
    assert groups["groups"]["out_of_distribution"]["paper"]["n"] == 0
    assert groups["groups"]["prismatic"]["paper"]["n"] == 2


def test_success_by_iteration_follows_what_the_critic_kept(subject):
    record = run_object(subject, Loops(subject), CONFIG)
    results = summary([record], CONFIG, "small")
    assert [turn["strict"]["share"] for turn in results["iterations"]] == [0.0, 1.0, 1.0, 0.0]
    assert [turn["still_running"] for turn in results["iterations"]] == [3, 3, 3, 3]


def test_the_critic_is_held_against_the_truth(subject):
    results = summary([run_object(subject, Loops(subject), CONFIG)], CONFIG, "small")
    matrix = results["critic"]["strict"]
    order = matrix["order"]
    assert matrix["n"] == 3
    assert matrix["truth_by_critic"][order.index("joint_type")][order.index("joint_axis")] == 3


def test_joints_of_an_object_put_together_wrongly_are_wrong(subject):
    config = replace(CONFIG, modality="image", task="placement")

    class Careless(Oracle):
        def predict(self, evidence):
            said = super().predict(evidence)
            kept = {k: T for k, T in said.placements.items() if k != "part_00"}
            return replace(said, placements=kept)

    good = summary([run_object(subject, Oracle(subject), config)], config, "small")
    bad = summary([run_object(subject, Careless(subject), config)], config, "small")
    assert good["placement"]["objects"]["strict"]["share"] == 1.0
    assert good["protocols"]["strict"]["joint_success"] == 1.0
    assert bad["placement"]["links_all"]["share"] == pytest.approx(0.8)
    assert bad["protocols"]["strict"]["failures"]["links"] == 4
    assert bad["protocols"]["strict"]["type_axis_origin"] == 0.0


def test_the_summary_does_not_depend_on_the_order_of_the_records(right):
    records = [right, lost()]
    assert summary(records, CONFIG, "s") == summary(records[::-1], CONFIG, "s")


class Addresses(HTMLParser):
    """Collects what a page refers to, and its text."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.text = ""

    def handle_starttag(self, tag, attrs):
        self.found += [str(value) for name, value in attrs if name in {"src", "href"}]

    def handle_data(self, data):
        self.text += data


def test_the_report_stands_alone_and_shows_every_table(subject, tmp_path):
    records = [run_object(subject, Loops(subject), CONFIG), lost()]
    results = summary(records, CONFIG, "small <b>")
    path = write_report(results, records, tmp_path / "report.html", "articulate benchmark", {})
    page = Addresses()
    page.feed(path.read_text())
    assert page.found == []
    assert "small <b>" in page.text
    for heading in (
        "Success",
        "Failures",
        "Errors",
        "Groups",
        "Iterations",
        "Critic",
        "Cost",
        "Crashed objects",
    ):
        assert heading in page.text
    assert path.read_text().count("<figure>") >= 7
    assert "SIGSEGV" in page.text
