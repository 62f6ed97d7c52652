import errno
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_array_equal
from tests.runs import tiny_run

from articulate.errors import DivergedError, UsageError
from articulate.task.episode_monitor import WIDTH, FailureReason
from articulate.task.observation import OBSERVATION
from articulate_envs.episodes import Ended
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_envs.rewards import TERMS
from articulate_train import train_seed as seeds
from articulate_train.policy import CHECKPOINT, read_checkpoint
from articulate_train.run import DONE
from articulate_train.seed_runner import THREAD_VARIABLES
from articulate_train.train_seed import DIVERGED, PROGRESS, SeedProcess, summarize_episodes


@pytest.fixture
def process(tiny):
    """Makes a process of seed 0 in this one; all are closed at the end."""
    made = []

    def make(run=tiny):
        made.append(SeedProcess(run, 0, threads=1))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_a_full_disk_is_one_line_and_bad_input(tiny, monkeypatch, capsys):
    def full(path, content):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert seeds.main([str(tiny.folder), "0", "1"]) == 2
    line = capsys.readouterr().err
    assert "No space left on device" in line
    assert line.count("\n") == 1

    class Full(io.StringIO):
        def write(self, _):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(sys, "stderr", Full())
    assert seeds.main([str(tiny.folder), "0", "1"]) == 2


def stop_after(process, updates):
    """Let a signal come during update ``updates``."""
    after = process._after_round

    def stopping(learner):
        if process._updates + 1 == updates:
            process.stop(signal.SIGINT)
        return after(learner)

    process._after_round = stopping


def same_checkpoints(a, b):
    a, b = read_checkpoint(a), read_checkpoint(b)
    assert a.keys() == b.keys()
    assert json.loads(a["metadata"]) == json.loads(b["metadata"])
    for part in ("policy", "episodes", "normalization", "returns_rms"):
        assert a[part].keys() == b[part].keys()
        for name, value in a[part].items():
            assert_array_equal(np.asarray(value), np.asarray(b[part][name]), err_msg=name)
    moments = [x["optimizer"]["state"] for x in (a, b)]
    for k, state in moments[0].items():
        for name, value in state.items():
            assert_array_equal(np.asarray(value), np.asarray(moments[1][k][name]))
    for name in ("returns", "last_observation", "last_raw", "last_starts", "torch_generator"):
        assert_array_equal(a[name].numpy(), b[name].numpy(), err_msg=name)


@pytest.fixture(scope="module")
def complete(cabinet, tmp_path_factory):
    """Folder of a seed that was trained without interruption."""
    run = tiny_run(tmp_path_factory.mktemp("whole") / "run", cabinet)
    process = SeedProcess(run, 0, threads=1)
    assert process.train()
    process.close()
    return run.seed_folder(0)


def test_seed_that_is_done_is_marked_and_keeps_its_checkpoint(complete):
    scores = [{"steps": 192, "episodes": 0, "successes": 0}]
    assert json.loads((complete / DONE).read_text()) == {
        "steps": 192, "selected_step": 192, "selection_scores": scores, "ensemble": [],
        "active_member": None,
    }  # fmt: skip
    assert json.loads(read_checkpoint(complete)["metadata"])["num_timesteps"] == 192


@pytest.mark.parametrize("updates", [1, 3])
def test_seed_that_is_interrupted_goes_on_with_the_same_bits(tiny, process, complete, updates):
    first = process()
    stop_after(first, updates)
    assert not first.train()
    folder = tiny.seed_folder(0)
    assert not (folder / DONE).exists()
    assert json.loads(read_checkpoint(folder)["metadata"])["num_timesteps"] == 32 * updates
    assert process().train()
    same_checkpoints(folder, complete)


def test_seed_whose_run_was_killed_saves_and_stops(tiny, process, monkeypatch):
    first = process()
    monkeypatch.setattr("os.getppid", lambda: 1)
    assert not first.train()
    assert json.loads(read_checkpoint(tiny.seed_folder(0))["metadata"])["num_timesteps"] == 32


def test_seed_whose_run_was_killed_before_it_began_trains_nothing(tiny):
    ended_process = subprocess.Popen(["true"])
    ended_process.wait()
    assert seeds.main([str(tiny.folder), "0", "1", str(ended_process.pid)]) == 130
    assert not tiny.seed_folder(0).exists()


def test_seed_whose_run_was_killed_while_it_began_stops_after_an_update(tiny):
    orphan = SeedProcess(tiny, 0, threads=1, parent=1 if os.getppid() != 1 else 2)
    assert not orphan.train()
    orphan.close()
    assert json.loads(read_checkpoint(tiny.seed_folder(0))["metadata"])["num_timesteps"] == 32


def test_seed_that_is_killed_goes_on_from_its_last_checkpoint_with_the_same_bits(
    tiny, process, complete
):
    first = process()
    after, updates = first._after_round, []

    def killed(learner):
        updates.append(after(learner))
        if len(updates) == 3:
            raise KeyboardInterrupt  # nothing is saved, as by SIGKILL
        return True

    first._after_round = killed
    with pytest.raises(KeyboardInterrupt):
        first.train()
    folder = tiny.seed_folder(0)
    assert json.loads(read_checkpoint(folder)["metadata"])["num_timesteps"] == 64
    assert process().train()
    same_checkpoints(folder, complete)


def progress_of(folder):
    """Progress without the time it took."""
    rows = [json.loads(line) for line in (folder / PROGRESS).read_text().splitlines()]
    return [{k: v for k, v in row.items() if k != "seconds"} for row in rows]


@pytest.mark.parametrize("updates", [1, 2, 3, 5, 6])
def test_progress_of_a_seed_that_was_interrupted_is_that_of_one_that_was_not(
    tiny, process, complete, monkeypatch, updates
):
    """Episodes that ended since the last line are kept with the checkpoint."""
    first = process()
    stop_after(first, updates)
    first.train()
    process().train()
    rows = progress_of(tiny.seed_folder(0))
    assert rows == progress_of(complete)
    assert len(rows) == 1


def test_episodes_that_progress_has_reported_are_not_reported_again(tiny, process, monkeypatch):
    """A run that is done, and continues because it has more steps."""
    process().train()
    content = read_checkpoint(tiny.seed_folder(0))
    assert content["finished"] == {}
    assert process().ensemble.finished() == []


def test_progress_after_the_checkpoint_and_lines_cut_off_are_dropped(tiny, complete, process):
    folder = tiny.seed_folder(0)
    folder.mkdir()
    shutil.copy(complete / CHECKPOINT, folder)
    rows = [{"steps": steps, "seconds": steps / 64} for steps in (64, 192, 256)]
    text = "".join(json.dumps(row) + "\n" for row in rows)
    (folder / PROGRESS).write_text(text + '{"steps": 3')
    process()
    kept = [json.loads(line) for line in (folder / PROGRESS).read_text().splitlines()]
    assert kept == rows[:2]


def test_progress_is_written_with_each_term(tiny, process, monkeypatch):
    monkeypatch.setattr(seeds, "REPORT_UPDATES", 3)
    process().train()
    rows = [json.loads(line) for line in (tiny.seed_folder(0) / PROGRESS).read_text().splitlines()]
    assert [row["steps"] for row in rows] == [96, 192]
    for row in rows:
        assert list(row["terms"]) == list(TERMS)
        assert 0 <= row["success"] <= row["opened"] <= 1
    assert rows[0]["seconds"] < rows[1]["seconds"]
    assert list((tiny.seed_folder(0) / "tensorboard").glob("events.*"))


def test_seed_that_diverges_keeps_its_last_states(tiny, process):
    one = process()
    with torch.no_grad():
        one.ensemble.learners[0].model.policy.action_net.weight[0, 0] = float("nan")
    with pytest.raises(DivergedError, match="weights are not finite"):
        one.train()
    folder = tiny.seed_folder(0)
    with np.load(folder / DIVERGED, allow_pickle=False) as kept:
        assert len(kept["episode_params"]) == tiny.config.ppo.n_envs
    assert not (folder / DONE).exists()
    assert not (folder / CHECKPOINT).exists()  # weights that are no numbers replace no checkpoint


def test_last_states_that_cannot_be_written_leave_no_half_file(tiny, process, monkeypatch):
    def full(stream, **_):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(UsageError, match="No space left"):
        process()._write_diverged()
    assert not list(tiny.seed_folder(0).glob("*diverged*"))


def test_checkpoint_of_another_version_is_one_line_and_exit_2(tiny, process, capsys):
    first = process()
    stop_after(first, 1)
    first.train()
    path = tiny.seed_folder(0) / CHECKPOINT
    complete = read_checkpoint(path.parent)
    without = {k: v for k, v in complete.items() if k != "returns"}
    other = complete | {"net_arch": [8], "policy": {"a": torch.zeros(1)}}
    for content in (without, other):
        torch.save(content, path)
        assert seeds.main([str(tiny.folder), "0", "1"]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert "made by another version" in error


def test_seed_that_diverges_is_no_bad_input(tiny, monkeypatch, capsys):
    def diverges(_):
        raise DivergedError("weights are not finite after 64 steps")

    monkeypatch.setattr(SeedProcess, "train", diverges)
    assert seeds.main([str(tiny.folder), "0", "1"]) == 1
    assert "not finite" in capsys.readouterr().err


def test_a_run_that_is_none_is_one_line_and_exit_2(tmp_path, capsys):
    assert seeds.main([str(tmp_path / "none"), "0", "1"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "not a run" in error


def ended(codes, opened, home):
    n = len(codes)
    return Ended(
        rows=np.arange(n),
        code=np.array(codes),
        opened=np.array(opened, dtype=bool),
        from_home=np.array(home, dtype=bool),
        terms=np.tile(np.arange(len(TERMS), dtype=float), (n, 1)),
        peaks=np.zeros((n, WIDTH)),
        observation=np.zeros((n, OBSERVATION.size)),
        truncated=np.zeros(n, dtype=bool),
        privileged=np.zeros((n, PRIVILEGED.size)),
    )


def test_shares_are_of_episodes_from_home_and_the_other_starts_stand_beside():
    shut = FailureReason.GOAL_NOT_REACHED
    row = summarize_episodes(
        [ended([0, shut], [1, 0], [1, 1]), ended([0, 0, shut], [1, 1, 1], [0, 0, 1])]
    )
    assert row["episodes"] == 3
    assert row["success"] == pytest.approx(1 / 3)
    assert row["opened"] == pytest.approx(2 / 3)
    assert row["success_all"] == pytest.approx(3 / 5)
    assert row["reasons"] == {"success": 1, "goal_not_reached": 2}
    assert row["terms"][TERMS[2]] == 2.0


def test_without_an_episode_from_home_the_shares_are_nought():
    row = summarize_episodes([ended([0], [1], [0])])
    assert (row["episodes"], row["success"], row["opened"], row["reasons"]) == (0, 0.0, 0.0, {})


def start(run):
    command = [sys.executable, "-m", "articulate_train.train_seed", str(run.folder), "0", "1"]
    quiet = os.environ | dict.fromkeys(THREAD_VARIABLES, "1")
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, env=quiet)


PATIENCE_S = 600.0
"""A seed that has not begun by then never will; machines that do much else take minutes."""


def wait_for(path, process):
    end = time.monotonic() + PATIENCE_S
    while not path.exists():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_process_that_gets_a_signal_goes_on_with_the_same_bits(cabinet, tmp_path, sent, code):
    """Two processes with a signal between do the same as one."""
    runs = [tiny_run(tmp_path / name, cabinet, updates=40) for name in ("a", "b")]
    single = start(runs[0])
    assert single.wait(timeout=PATIENCE_S) == 0, single.communicate()[1]
    single.communicate()
    first = start(runs[1])
    wait_for(runs[1].seed_folder(0) / CHECKPOINT, first)
    first.send_signal(sent)
    assert first.wait(timeout=PATIENCE_S) == code
    first.communicate()
    assert not (runs[1].seed_folder(0) / DONE).exists()
    second = start(runs[1])
    assert second.wait(timeout=PATIENCE_S) == 0, second.communicate()[1]
    second.communicate()
    same_checkpoints(*(run.seed_folder(0) for run in runs))
