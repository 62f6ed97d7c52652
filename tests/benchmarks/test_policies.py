"""The table of policies and the summaries that it is printed from."""

import json
from pathlib import Path
from typing import Any

import pytest

from articulate_train.config import TrainConfig
from articulate_train.run import Run
from collect import WINDOW, deploy_summary, first_success, member_scores, training_times
from policies import (
    FOLDER,
    failures,
    format_share,
    object_text,
    ratio_text,
    row,
    table,
    training_time_text,
)

ROOT = Path(__file__).resolve().parents[2]


def progress_rows(*success_rates, episodes=WINDOW // 2):
    """Rows of a progress file, half a window each."""
    return [
        {"steps": 100 * (i + 1), "seconds": 10.0 * (i + 1), "episodes": episodes, "success": s}
        for i, s in enumerate(success_rates)
    ]


def test_the_results_page_has_the_figures_of_the_table():
    page = (ROOT / "docs" / "results" / "index.md").read_text(encoding="utf-8")
    rows = (line for line in page.splitlines() if line.startswith(("| open_", "| close_")))
    lines = [line for line in rows if line.count("|") == 6]  # those of policies
    for path in sorted(FOLDER.glob("*.json")):
        task, success, worst, *_, wider, ratio = row(json.loads(path.read_text()))[:7]
        cells = success.replace("°", ""), worst, wider, ratio.split(": ")[-1].replace("—", "")
        found = [line for line in lines if all(cell in line for cell in cells)]
        assert [line for line in found if line.startswith(f"| {task.split(',')[0]},")], cells
    assert len(table(FOLDER).splitlines()) == 2 + len(lines)


@pytest.mark.parametrize(
    ("success_rates", "steps"),
    [
        pytest.param((0.0, 0.8, 1.0, 1.0), 300, id="mean-of-two-rows-is-enough"),
        pytest.param((1.0,), None, id="half-a-window-is-too-short"),
        pytest.param((0.5, 0.9, 0.89, 0.9), None, id="never"),
        pytest.param((0.5, 0.9, 0.9), 300, id="exactly"),
    ],
)
def test_first_success_is_the_first_window_above_the_rate(success_rates, steps):
    found = first_success(progress_rows(*success_rates))
    assert (found and found["steps"]) == steps


def test_rows_without_finished_episodes_do_not_count():
    empty = {"steps": 150, "seconds": 15.0, "episodes": 0, "success": None}
    rows = [*progress_rows(1.0), empty]
    assert first_success(rows) is None
    assert first_success([*rows, *progress_rows(1.0)])


@pytest.mark.parametrize(("success", "steps"), [(1.0, 200), (0.5, None)])
def test_the_steps_to_first_success_are_read_from_the_progress_of_a_seed(tmp_path, success, steps):
    config = TrainConfig(asset="a.urdf", task="open_drawer")
    others: dict[str, Any] = dict.fromkeys(("asset", "task", "placement", "arm"))
    run = Run(folder=tmp_path, config=config, **others)
    run.seed_folder(0).mkdir()
    lines = [json.dumps(line) for line in progress_rows(*[success] * 8)]
    (run.seed_folder(0) / "progress.jsonl").write_text("\n".join(lines))
    assert training_times(run, [0])[0]["steps"] == steps


@pytest.mark.parametrize(
    ("asset", "path", "text"),
    [
        ("microwave", "data/assets/libero/articulated_objects/microwave.xml", "libero microwave"),
        ("partnet_9748", "data/assets/partnet/9748/mobility.urdf", "partnet 9748"),
        ("cabinet", "cabinet.urdf", "cabinet"),
    ],
)
def test_an_object_is_named_after_its_data_set(asset, path, text):
    assert object_text({"asset": asset, "command": f"train --asset {path} --seeds 0"}) == text


def test_a_share_is_bold_at_the_target_and_rounded_down_below():
    assert format_share(0.98, 0.98) == "**98.0 %**"
    assert format_share(0.9797, 0.98) == "97.9 %"


def test_failures_are_sorted_by_frequency():
    text = failures({"success": 990, "not_at_rest": 3, "goal_not_reached": 7})
    assert text == "goal not reached 7, not at rest 3 of 1,000"
    assert failures({"success": 3000}) == "none of 3,000"


def test_seeds_that_never_reach_the_rate_are_counted():
    reached = {"steps": 4e5, "seconds": 60.0}
    assert training_time_text([reached, {"steps": None, "seconds": None}]) == "1 of 2 seeds"
    assert training_time_text([reached, reached]) == "0.40M, 1.0 min"


def test_the_ratio_compares_the_same_episodes():
    assert ratio_text(None) == "—"
    robots = {"mujoco": {"successes": 198}, "pybullet": {"successes": 190}}
    deploy = {"robots": robots, "ratios": {"pybullet": 190 / 198}}
    assert ratio_text(deploy) == "190 ÷ 198: **96.0 %**"


def test_the_deploy_summary_has_no_single_episodes():
    robots = {"mujoco": {"successes": 1, "each": [{"reason": "success"}], "notes": ["size"]}}
    summary = deploy_summary({"reference": "mujoco", "robots": robots})
    assert summary == {"reference": "mujoco", "robots": {"mujoco": {"successes": 1}}}


def test_a_seed_with_one_active_member_is_marked():
    summary = json.loads((FOLDER / "close_lid_9748.json").read_text(encoding="utf-8"))
    assert "°" not in row(summary)[1]
    summary["seeds"][1]["active_member"] = 0
    second = f"{100 * summary['seeds'][1]['success']['value']:.1f}"
    assert f", {second}°, " in row(summary)[1]
    assert row(summary)[1].count("°") == 1


def test_member_scores_are_those_of_the_finished_seed(tmp_path):
    (tmp_path / "seed_3").mkdir()
    scores = [{"member": None, "episodes": 500, "successes": 498}]
    done = {"steps": 5, "ensemble": scores, "active_member": None}
    (tmp_path / "seed_3" / "done.json").write_text(json.dumps(done))
    assert member_scores(tmp_path, 3) == {"seed": 3, "scores": scores}
