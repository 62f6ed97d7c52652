"""Comparison of runs: rows, differing settings and a page."""

import contextlib
import dataclasses
import json

import numpy as np
import pytest
from tests.articulate_train.test_report import INFO, _report, _seed

from articulate.errors import RunError
from articulate.task.episode_monitor import FailureReason
from articulate_train.compare import compare, comparison_page, read_report, write_comparison
from articulate_train.report_html import write_report


def content_of(name="first", failures=2, config="steps: 2\n", **options):
    info = dataclasses.replace(INFO, name=name, config=config)
    seeds = [_seed(k, [0] * (40 - failures) + [FailureReason.FORCE] * failures) for k in (0, 1)]
    return json.loads(json.dumps(_report(info, seeds, **options).content()))


def test_rows_state_what_the_reports_state():
    comparison = compare([content_of(failures=2), content_of("second", failures=10)])
    first, second = comparison.rows
    assert (first.name, first.seeds, first.steps) == ("first", 2, INFO.steps)
    assert (first.success.value, first.success.n) == (0.95, 80)
    assert second.success.value == 0.75
    assert first.difference_to_first is None
    assert second.difference_to_first is not None
    assert second.difference_to_first.value == pytest.approx(-0.2)
    assert second.difference_to_first.high < 0.0
    assert second.reasons == {"success": 60, "force": 20}


def test_a_training_that_is_not_over_is_reported():
    one, two = content_of(), content_of("second")
    assert "not over" not in comparison_page(compare([one, two]), "evaluate …")
    two["info"]["unfinished"] = "seed 0 has 0.05 of 0.1M control steps"
    assert "seed 0 has 0.05 of 0.1M control steps" in comparison_page(
        compare([one, two]), "evaluate …"
    )


def test_settings_that_differ_are_reported_with_each_value_and_no_others():
    one = content_of(config="steps: 2\nreward:\n  open: 1.0\n  rest: 0.5\n")
    two = content_of(config="steps: 2\nreward:\n  open: 0.6\n  rest: 0.5\n  over: 0.1\n")
    assert compare([one, two]).differing == {
        "reward.open": ("1.0", "0.6"),
        "reward.over": ("–", "0.1"),
    }
    assert compare([one, one]).differing == {}


def test_curves_are_averaged_over_seeds_at_common_moments():
    curve = compare([content_of()]).rows[0].curve
    assert curve is not None
    # _curve grows linearly to 1 for every seed, so that mean, least and best are the same.
    assert curve.success == pytest.approx(curve.steps / 2e6, abs=1e-5)
    assert curve.low == pytest.approx(curve.high)
    assert compare([content_of(curves=False)]).rows[0].curve is None


def test_the_page_names_every_run_once_more_where_names_are_the_same():
    page = comparison_page(compare([content_of(), content_of()]), "articulate evaluate a b")
    assert "first (1)" in page
    assert "first (2)" in page
    assert "articulate evaluate a b" in page
    assert "The configurations are the same." in page


def test_files_are_written_and_hold_plain_numbers(tmp_path):
    comparison = compare([content_of(), content_of("second")])
    json_path, html_path = write_comparison(comparison, tmp_path, "evaluate a b")
    content = json.loads(json_path.read_text())
    assert content["schema"] == "articulate.comparison"
    assert content["rows"][0]["success"]["value"] == 0.95
    assert np.isfinite(content["rows"][0]["curve"]["success"]).all()
    assert html_path.read_text().startswith("<!doctype html>")
    assert comparison.text().splitlines()[1].startswith("first ")


def test_a_report_is_read_from_its_run_or_rejected_in_one_line(tmp_path, error_line):
    run = tmp_path / "run"
    run.mkdir()
    write_report(_report(), run)
    assert read_report(run)["info"]["name"] == "first"
    (run / "report.json").write_text('{"schema": "other"}')
    error_line("read_report(RUN)  # of another schema", lambda: read_report(run))
    (run / "report.json").unlink()
    with pytest.raises(RunError, match="make it with evaluate"):
        read_report(run)


@pytest.mark.parametrize(
    "keys",
    [
        ("info",),
        ("info", "config"),
        ("reasons",),
        ("seeds",),
        ("seeds", 0, "success"),
        ("seeds", 0, "success", "n"),
        ("worst_seed_success_rate",),
        ("curves", 0, "steps"),
    ],
)
@pytest.mark.parametrize("value", [None, [[]], -1e308, {}])
def test_a_damaged_report_is_rejected_or_compared(tmp_path, keys, value):
    content = content_of()
    inside = content
    for key in keys[:-1]:
        inside = inside[key]
    inside[keys[-1]] = value
    (tmp_path / "report.json").write_text(json.dumps(content))
    with contextlib.suppress(RunError):
        comparison_page(compare([read_report(tmp_path), content_of()]), "evaluate a b")


def test_aliases_in_the_settings_of_a_report_are_bounded(tmp_path):
    doubling = "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]\n" for k in range(1, 12))
    content = content_of(config=f"a0: &a0 [1]\n{doubling}")
    (tmp_path / "report.json").write_text(json.dumps(content))
    with pytest.raises(RunError, match="values with all aliases"):
        read_report(tmp_path)
