import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from articulate.commands import run_command
from articulate.errors import UsageError
from articulate_deploy.commands.deploy import main
from articulate_deploy.comparison import DeploymentComparison, share_interval
from articulate_deploy.episode_log import EpisodeLog, read_log
from articulate_deploy.recorded_episodes import read_deployment
from articulate_deploy.recording import finish_episode

STEPS = 12


def add_steps(log, steps=STEPS, seed=0):
    rng = np.random.default_rng(seed)
    for k in range(steps):
        log.add(
            time_s=0.05 * k,
            observation=rng.normal(size=72),
            action=rng.uniform(-1, 1, 8),
            target=rng.normal(size=7),
            joint_pos=rng.normal(size=7),
            joint_vel=rng.normal(size=7),
            gripper_width_m=0.08,
            measured_force_n=rng.normal(size=3),
            estimate_open=0.1 * k,
            part_open=0.1 * k + 0.01,
            policy_s=0.002,
        )


@pytest.fixture
def folder(tmp_path):
    """A recording of two episodes, and one that was killed."""
    folder = tmp_path / "recording"
    folder.mkdir()
    for index in range(2):
        log = EpisodeLog(folder, index)
        add_steps(log, seed=index)
        finish_episode(log)
    log = EpisodeLog(folder, 2)
    add_steps(log, 5)
    log.close()
    lines = [{"reason": "success"}, {"reason": "force"}]
    (folder / "episodes.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    report = {"robot": "panda", "bundle": "b.zip", "task": "open_drawer", "bundle_sha256": "a"}
    (folder / "report.json").write_text(json.dumps(report))
    return folder


def test_a_log_is_readable_at_every_length(tmp_path):
    log = EpisodeLog(tmp_path, 0)
    add_steps(log)
    log.close()
    content = log.path.read_bytes()
    head = content.index(b"\n") + 1
    row = (len(content) - head) // STEPS
    for k in range(head, len(content) + 1, 37):
        log.path.write_bytes(content[:k])
        assert len(read_log(log.path)["target"]) == (k - head) // row
    log.path.write_bytes(content)
    found = read_log(log.path)
    for name, values in log.arrays().items():
        np.testing.assert_array_equal(found[name], values)


def test_a_changed_row_and_another_file_are_rejected(tmp_path, error_line):
    log = EpisodeLog(tmp_path, 0)
    add_steps(log, 3)
    log.close()
    content = bytearray(log.path.read_bytes())
    content[-20] ^= 1
    log.path.write_bytes(content)
    error_line("read_log(changed row)", lambda: read_log(log.path))
    log.path.write_bytes(b"{}\n")
    error_line("read_log(another file)", lambda: read_log(log.path))
    error_line("read_deployment(absent)", lambda: read_deployment(tmp_path / "absent"))
    (tmp_path / "empty").mkdir()
    error_line("read_deployment(empty)", lambda: read_deployment(tmp_path / "empty"))


def test_the_report_counts_ended_episodes(folder):
    found = DeploymentComparison(read_deployment(folder), read_deployment(folder))
    content = found.as_dict()["deployment"]
    assert (content["episodes"], content["ended"], content["successes"]) == (3, 2, 1)
    assert content["incomplete"] == 1
    assert "success: 1 of 2, 95 % interval 9.5% to 90.5%" in found.text()
    names = {m["name"] for m in content["measures"]}
    assert {"tracking error", "peak force", "estimator error", "time of the policy"} <= names
    assert share_interval(0, 0) == (0.0, 1.0)


def test_recordings_of_other_bundles_are_not_compared(folder, tmp_path, error_line):
    import shutil

    other = shutil.copytree(folder, tmp_path / "other")
    (other / "report.json").write_text(json.dumps({"bundle_sha256": "b"}))
    ours, theirs = read_deployment(folder), read_deployment(other)
    error_line("DeploymentComparison(another)", lambda: DeploymentComparison(ours, theirs))


def test_a_lerobot_dataset_has_the_layout_of_version_3(folder, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "dataset"
    code = run_command(main, ["convert", str(folder), "--out", str(out), "--task", "open it"])
    assert code == 0
    info = json.loads((out / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (3, 2 * STEPS + 5, 20)
    data = parquet.read_table(out / "data/chunk-000/file-000.parquet")
    assert set(data.column_names) == set(info["features"])
    assert data["index"].to_pylist() == list(range(2 * STEPS + 5))
    assert len(data["observation.state"][0].as_py()) == len(
        info["features"]["observation.state"]["names"]
    )
    episodes = parquet.read_table(out / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["dataset_to_index"].to_pylist() == [STEPS, 2 * STEPS, 2 * STEPS + 5]
    tasks = parquet.read_table(out / "meta/tasks.parquet").to_pydict()
    assert tasks["__index_level_0__"] == ["open it"]
    assert run_command(main, ["convert", str(folder), "--out", str(out)]) == 2


def test_a_rerun_file_is_written(folder, tmp_path):
    pytest.importorskip("rerun")
    out = tmp_path / "arm.rrd"
    words = ["convert", str(folder), "--to", "rerun", "--out", str(out)]
    assert run_command(main, words) == 0
    assert out.read_bytes()[:4] == b"RRF2"


def killed_at(tmp_path, index, delay_s):
    """Rows in the log, and steps that the killed process had reported."""
    code = (
        "import sys, time; from pathlib import Path\n"
        "from articulate_deploy.episode_log import EpisodeLog\n"
        "from tests.articulate_deploy.test_recorded_episodes import add_steps\n"
        f"log = EpisodeLog(Path({str(tmp_path)!r}), {index})\n"
        "k = 0\n"
        "while True:\n"
        "    add_steps(log, 1)\n"
        "    k += 1\n"
        "    print(k, flush=True)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    child.stdout.readline()
    time.sleep(delay_s)
    os.kill(child.pid, signal.SIGKILL)
    lines = child.stdout.read().split()
    child.wait()
    child.stdout.close()
    reported = int(lines[-1]) if lines else 1
    return len(read_log(tmp_path / f"episode_{index:04d}.log")["target"]), reported


def test_a_killed_process_loses_at_most_one_step(tmp_path):
    rows, reported = killed_at(tmp_path, 0, 0.05)
    assert reported <= rows <= reported + 1


@pytest.mark.slow
def test_two_hundred_killed_processes_lose_at_most_one_step(tmp_path):
    rng = np.random.default_rng(0)
    for index in range(200):
        rows, reported = killed_at(tmp_path, index, rng.uniform(0.0, 0.1))
        assert reported - 1 <= rows <= reported + 1


def test_an_absent_episode_is_named(folder):
    with pytest.raises(UsageError, match="no episode 9; it has 0, 1, 2"):
        read_deployment(folder).episode(9)
