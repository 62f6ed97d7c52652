import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from articulate.commands import run_command
from articulate.errors import ConfigError, MissingError, UsageError
from articulate.task.observation import OBSERVATION
from articulate_deploy.commands.deploy import main
from articulate_deploy.deploy import deploy, transfer
from articulate_deploy.report import Transfer

FORBIDDEN = (
    "torch", "stable_baselines3", "articulate_envs", "articulate_train", "robosuite", "trimesh",
    "gymnasium", "numba", "scipy", "onnx",
)  # fmt: skip


@pytest.fixture(scope="module")
def report(exported, tmp_path_factory):
    out = tmp_path_factory.mktemp("recordings") / "first"
    return deploy(exported, episodes=2, seed=5, out=out), out


def test_deploying_imports_neither_torch_nor_scenes_nor_training(exported, tmp_path):
    code = (
        "import sys; from articulate_deploy.commands.deploy import main; "
        f"code = main([{str(exported)!r}, '--episodes', '1', '--json']); "
        f"found = [m for m in {FORBIDDEN!r} if m in sys.modules]; "
        "print(found, file=sys.stderr); sys.exit(code or len(found))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["episodes"] == 1


def test_the_report_counts_what_the_episodes_show(report):
    done, _ = report
    content = done.as_dict()
    assert content["episodes"] == len(content["each"]) == 2
    assert sum(content["reasons"].values()) == 2
    assert content["success_rate"] == done.successes / 2
    assert content["clipped_steps"] == 0
    json.dumps(content, allow_nan=False)


def test_the_text_names_task_robot_and_counts(report):
    text = report[0].text()
    assert "open_drawer (drawer_2_slide) on mujoco, 2 episodes" in text
    assert "opened   " in text
    assert "size is not randomised" in text


def test_the_text_tells_of_targets_that_were_made_safe(report):
    done = report[0]
    assert "clipped" not in done.text()
    results = [dataclasses.replace(done.results[0], clipped=3), *done.results[1:]]
    assert "clipped  3 control steps" in dataclasses.replace(done, results=results).text()


def test_recordings_hold_every_tick_and_the_report(report):
    done, out = report
    names = sorted(p.name for p in out.iterdir())
    assert names == ["episode_0000.npz", "episode_0001.npz", "episodes.jsonl", "report.json"]
    with np.load(out / "episode_0001.npz", allow_pickle=False) as arrays:
        assert arrays["observation"].shape == (done.results[1].steps, OBSERVATION.size)
        assert arrays["estimate_T_wh"].shape[1:] == (4, 4)
    lines = (out / "episodes.jsonl").read_text().splitlines()
    assert [json.loads(line)["reason"] for line in lines] == [r.reason for r in done.results]
    assert json.loads((out / "report.json").read_text()) == done.as_dict()


def test_an_episode_depends_on_the_seed_and_its_number_alone(report, exported):
    again = deploy(exported, episodes=1, seed=5)
    assert again.results[0] == report[0].results[0]
    other = deploy(exported, episodes=1, seed=6)
    assert other.episode_params[0].values.tolist() != again.episode_params[0].values.tolist()


def test_without_randomisation_only_the_start_differs(exported):
    done = deploy(exported, episodes=2, randomise=False)
    first, second = (d.values[0] for d in done.episode_params)
    assert first[:11].tolist() == second[:11].tolist()
    assert not np.array_equal(done.episode_params[0]["start"], done.episode_params[1]["start"])
    assert done.notes == ()


@pytest.mark.parametrize("flags", ["--episodes 0", "--seed -1"])
def test_numbers_that_make_no_sense_are_refused(exported, flags, error_line):
    error_line(f"deploy {flags}", lambda: main([str(exported), *flags.split()]))


def test_a_folder_that_holds_something_is_not_written_into(exported, tmp_path, error_line):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "kept").write_text("")
    argv = [str(exported), "--out", str(tmp_path / "full")]
    error_line("deploy --out full", lambda: main(argv))


def test_a_changed_bundle_is_one_line_and_exit_2(folder, capsys):
    (folder / "policy.onnx").write_bytes(b"")
    assert run_command(main, [str(folder)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "changed" in captured.err


def test_without_a_seed_the_bundles_own_draws_are_run(exported, bundle):
    done = deploy(exported, episodes=1)
    assert done.from_bundle
    assert done.seed == bundle.manifest.episodes.seed
    assert np.array_equal(done.episode_params[0].values, bundle.episode_params.values[:1])
    assert "parameters of the bundle" in done.text()


def test_more_episodes_than_draws_are_refused_without_a_seed(exported, error_line):
    error_line("deploy --episodes 201", lambda: main([str(exported), "--episodes", "201"]))


def test_two_robots_run_the_same_draws_and_are_compared(exported, tmp_path, capsys):
    """A policy that learned nothing: none succeeds, so that there is no ratio, and all agree."""
    told = []
    both = transfer(
        exported,
        ("mujoco", "pybullet"),
        episodes=2,
        out=tmp_path / "out",
        on_episode=lambda robot, k, result: told.append((robot, k)),
    )
    first, second = both.reports
    for a, b in zip(first.episode_params, second.episode_params, strict=True):
        assert np.array_equal(a.values, b.values)
    assert told == [("mujoco", 0), ("mujoco", 1), ("pybullet", 0), ("pybullet", 1)]
    content = both.as_dict()
    assert content["reference"] == "mujoco"
    assert content["ratios"] == {"pybullet": None}
    assert set(content["robots"]) == {"mujoco", "pybullet"}
    assert "both ended alike in" in both.text()
    assert any("reflected inertia" in note for note in second.notes)
    assert (tmp_path / "out" / "pybullet" / "episode_0001.npz").exists()
    json.dumps(content, allow_nan=False)


def test_a_ratio_is_that_of_the_successes(report):
    done, _ = report
    won = dataclasses.replace(done.results[0], reason="success")
    lost = dataclasses.replace(done.results[0], reason="goal_not_reached")
    first = dataclasses.replace(done, robot="a", results=(won, won))
    second = dataclasses.replace(done, robot="b", results=(won, lost))
    both = Transfer((first, second))
    assert both.ratios == {"b": 0.5}
    assert both.agree == {"b": 1}


def test_a_robot_that_is_named_twice_is_refused(exported, error_line):
    argv = [str(exported), "--robot", "mujoco", "mujoco"]
    error_line("deploy --robot mujoco mujoco", lambda: main(argv))


def test_the_arm_that_comes_later_is_one_line_and_exit_2(exported, capsys):
    assert run_command(main, [str(exported), "--robot", "panda"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("second", ["pybulet", "panda"])
def test_no_robot_runs_where_a_later_one_is_not_there(exported, tmp_path, second):
    told = []
    with pytest.raises(ConfigError, match=second):
        transfer(
            exported,
            ("mujoco", second),
            episodes=1,
            out=tmp_path / "out",
            on_episode=lambda *it: told.append(it),
        )
    assert told == []
    assert not (tmp_path / "out").exists()


def test_no_robot_runs_where_a_later_one_is_not_installed(exported, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.delitem(sys.modules, "articulate_deploy.robots.pybullet", raising=False)
    with pytest.raises(MissingError, match="pybullet"):
        transfer(exported, ("mujoco", "pybullet"), episodes=1, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_no_robot_runs_where_a_later_ones_folder_is_taken(exported, tmp_path):
    (tmp_path / "out" / "pybullet").mkdir(parents=True)
    (tmp_path / "out" / "pybullet" / "kept").write_text("")
    told = []
    with pytest.raises(UsageError, match="not empty"):
        transfer(
            exported,
            ("mujoco", "pybullet"),
            episodes=1,
            out=tmp_path / "out",
            on_episode=lambda *it: told.append(it),
        )
    assert told == []
    assert not (tmp_path / "out" / "mujoco").exists()
