"""The table of policies is what the kept summaries say."""

import json
from pathlib import Path

import pytest

from collect import WINDOW, compared, when_learnt, who_acts
from policies import FOLDER, failures, learnt_text, object_text, ratio_text, row, share, table

ROOT = Path(__file__).resolve().parents[2]


def rows(*shares, episodes=WINDOW // 2):
    """Rows of a progress file, half a window each."""
    return [
        {"steps": 100 * (i + 1), "seconds": 10.0 * (i + 1), "episodes": episodes, "success": s}
        for i, s in enumerate(shares)
    ]


def test_the_page_of_results_has_the_figures_that_the_command_prints():
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
    ("shares", "steps"),
    [
        pytest.param((0.0, 0.8, 1.0, 1.0), 300, id="mean-of-two-rows-is-enough"),
        pytest.param((1.0,), None, id="half-a-window-tells-nothing"),
        pytest.param((0.5, 0.9, 0.89, 0.9), None, id="never"),
        pytest.param((0.5, 0.9, 0.9), 300, id="exactly"),
    ],
)
def test_learnt_is_when_the_last_window_of_episodes_succeeds(shares, steps):
    found = when_learnt(rows(*shares))
    assert (found and found["steps"]) == steps


def test_rows_without_an_end_of_an_episode_do_not_count():
    told = [*rows(1.0), {"steps": 150, "seconds": 15.0, "episodes": 0, "success": None}]
    assert when_learnt(told) is None
    assert when_learnt([*told, *rows(1.0)])


@pytest.mark.parametrize(
    ("asset", "path", "told"),
    [
        ("microwave", "data/assets/libero/articulated_objects/microwave.xml", "libero microwave"),
        ("partnet_9748", "data/assets/partnet/9748/mobility.urdf", "partnet 9748"),
        ("cabinet", "cabinet.urdf", "cabinet"),
    ],
)
def test_an_object_is_told_with_its_data_set(asset, path, told):
    assert object_text({"asset": asset, "command": f"train --asset {path} --seeds 0"}) == told


def test_a_cell_is_bold_where_it_reaches_what_is_asked_and_rounded_down_where_not():
    assert share(0.98, 0.98) == "**98.0 %**"
    assert share(0.9797, 0.98) == "97.9 %"


def test_failures_are_in_the_order_of_their_number():
    told = failures({"success": 990, "not_at_rest": 3, "goal_not_reached": 7})
    assert told == "goal not reached 7, not at rest 3 of 1,000"
    assert failures({"success": 3000}) == "none of 3,000"


def test_seeds_that_never_learn_are_told():
    seen = {"steps": 4e5, "seconds": 60.0}
    assert learnt_text([seen, {"steps": None, "seconds": None}]) == "1 of 2 seeds"
    assert learnt_text([seen, seen]) == "0.40M, 1.0 min"


def test_the_ratio_is_of_the_same_draws():
    assert ratio_text(None) == "—"
    robots = {"mujoco": {"successes": 198}, "pybullet": {"successes": 190}}
    deploy = {"robots": robots, "ratios": {"pybullet": 190 / 198}}
    assert ratio_text(deploy) == "190 ÷ 198: **96.0 %**"


def test_single_episodes_of_another_engine_are_not_kept():
    robots = {"mujoco": {"successes": 1, "each": [{"reason": "success"}]}}
    told = compared({"reference": "mujoco", "robots": robots})
    assert told == {"reference": "mujoco", "robots": {"mujoco": {"successes": 1}}}


def test_a_seed_of_which_one_member_acts_is_marked():
    summary = json.loads((FOLDER / "close_lid_9748.json").read_text(encoding="utf-8"))
    summary["members"] = [{"seed": k, "acts": 0 if k == 1 else None} for k in range(3)]
    second = f"{100 * summary['seeds'][1]['success']['value']:.1f}"
    assert f", {second}°, " in row(summary)[1]
    assert row(summary)[1].count("°") == 1


def test_who_acts_is_taken_along_and_all_do_in_runs_of_before(tmp_path):
    for seed, done in enumerate([{"acts": 1, "members": [{"alone": 1}]}, {"steps": 5}]):
        folder = tmp_path / f"seed_{seed}"
        folder.mkdir()
        (folder / "done.json").write_text(json.dumps(done))
    assert who_acts(tmp_path, 0) == {"seed": 0, "acts": 1, "judged": [{"alone": 1}]}
    assert who_acts(tmp_path, 1) == {"seed": 1, "acts": None, "judged": []}
