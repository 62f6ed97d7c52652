"""Many runs: objects times seeds become jobs, and what they leave becomes one comparison."""

from __future__ import annotations

import json
import sys

import pytest
from tests.articulate_train.test_compare import content_of
from tests.assets import make_cabinet

from articulate.commands import main
from articulate.errors import MissingError
from articulate.jobs.job import Attempt, State
from articulate.jobs.launcher import Progress
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate_train.asset_patterns import is_many, objects_of
from articulate_train.compare import compare
from articulate_train.config import PpoConfig, TrainConfig
from articulate_train.sweep import describe_progress, folder_names, jobs_of, merged, train_many


@pytest.fixture
def folder(tmp_path):
    """A folder with two objects, in a path with a space and a letter that is not ASCII."""
    root = tmp_path / "my öbjects"
    for name in ("a", "b"):
        make_cabinet(root / name)
    return root


def test_a_folder_or_a_pattern_names_many_objects_and_a_file_one(folder):
    assert [item.name for item in objects_of(str(folder))] == ["a", "b"]
    assert [item.name for item in objects_of(str(folder / "*"))] == ["a", "b"]
    assert [item.name for item in objects_of(str(folder / "b"))] == ["b"]
    assert is_many(str(folder))
    assert is_many(str(folder / "[ab]"))
    assert not is_many(str(folder / "a"))


def test_files_of_one_name_are_reported_apart_by_their_folders(folder):
    """As those of PartNet-Mobility are, ``ID/mobility.urdf``; whatever else is there."""
    urdf = next((folder / "a").glob("*.urdf")).name
    assert [item.name for item in objects_of(str(folder / "*" / urdf))] == ["a", "b"]
    make_cabinet(folder / "aa")
    assert [item.name for item in objects_of(str(folder / "*" / urdf))] == ["a", "aa", "b"]


@pytest.mark.parametrize("flag", ["--dry-run", "--no-evaluate"])
def test_what_is_for_one_object_is_rejected_for_many(folder, flag, capsys):
    assert main(["train", "--asset", str(folder), flag]) == 2
    assert f"{flag} is for one object" in capsys.readouterr().err


def test_a_pattern_that_fits_nothing_is_an_error_in_one_line(error_line):
    error_line("objects_of('nothing/*.urdf')", lambda: objects_of("nothing/*.urdf"))


def test_every_object_and_seed_is_a_command_line_of_its_own(folder, tmp_path):
    config = TrainConfig(asset=str(folder), seeds=(3, 5))
    cells = jobs_of(config, objects_of(config.asset), tmp_path / "out")
    names = [cell.job.name for cell in cells]
    assert names == ["a-seed-3", "a-seed-5", "b-seed-3", "b-seed-5"]
    job = cells[1].job
    made = str(tmp_path / "out" / "a-seed-5" / "run")
    assert job.start_command[:4] == (sys.executable, "-m", "articulate", "train")
    assert job.start_command[job.start_command.index("--seeds") + 1] == "5"
    assert job.start_command[job.start_command.index("--asset") + 1] == str(folder / "a")
    assert job.start_command[-1] == made
    assert job.resume_command[4:] == ("--resume", "--out", made)
    assert str(job.run_folder) == made


def test_no_two_objects_share_a_folder():
    names = folder_names(["a/b", "a-b", "a/c", "d", "e/f-g", "e-f/g"])
    assert names["a-b"] == "a-b"
    assert names["a/c"] == "a-c"
    assert len(set(names.values())) == len(names)
    assert names == folder_names(["e-f/g", "d", "a/c", "e/f-g", "a-b", "a/b"])


def test_where_the_launcher_is_missing_nothing_is_written(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    config = TrainConfig(asset=str(folder))
    with pytest.raises(MissingError, match="submitit is not installed"):
        train_many(config, tmp_path / "out", "slurm", "train …", lambda _: None)
    assert not (tmp_path / "out").exists()


def test_reports_of_seeds_become_one(tmp_path):
    one, two = content_of("x", failures=2), content_of("y", failures=10)
    one["info"] |= {"seconds": 100.0, "steps_per_s": 2000.0}
    two["info"] |= {"seconds": 300.0, "steps_per_s": 1000.0}
    both = merged("cabinet", [one, two])
    assert both["info"]["seconds"] == pytest.approx(400.0)
    assert both["info"]["steps_per_s"] == pytest.approx(1250.0)
    row = compare([both]).rows[0]
    assert (row.name, row.seeds, row.success.n) == ("cabinet", 4, 160)
    assert row.success.value == pytest.approx(0.85)
    assert row.reasons == {"success": 136, "force": 24}
    assert row.worst_seed == min(one["worst_seed_success_rate"], two["worst_seed_success_rate"])


def test_progress_is_one_line():
    attempt = Attempt(host="here", pid=1, begun=0.0)
    states = {
        "a": State(phase="done"),
        "b": State(phase="running", attempts=(attempt,)),
        "c": State(),
    }
    assert describe_progress(Progress(states)) == "1 done, 1 running, 1 waiting of 3; now b"


def tiny(asset):
    return TrainConfig(
        asset=str(asset),
        task="open_drawer",
        joint="drawer_0_slide",
        seeds=(0, 1),
        steps=64,
        jobs=1,
        episodes=2,
        initial_policy="random",
        ppo=PpoConfig(n_envs=4, n_steps=8, batch_size=16, n_epochs=1, net_arch=(8, 8)),
    )


@pytest.mark.slow
def test_objects_and_seeds_are_trained_compared_and_not_trained_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    embedded_cabinet(tmp_path / "objects" / "one")
    (tmp_path / "objects" / "bad").mkdir()
    (tmp_path / "objects" / "bad" / "bad.urdf").write_text("<robot/>")
    printed: list[str] = []
    config = tiny(tmp_path / "objects")
    outcome = train_many(config, tmp_path / "out", "local", "train …", printed.append)
    assert not outcome.complete
    assert outcome.comparison is not None
    assert [(r.name, r.seeds) for r in outcome.comparison.rows] == [("one", 2)]
    assert outcome.progress.states["bad-seed-0"].phase == "failed"
    assert "bad.urdf" in outcome.progress.states["bad-seed-0"].message
    assert printed[-1].startswith("2 done, 2 failed of 4")
    assert "bad-seed-1: failed after 1 attempts" in outcome.text()
    content = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert len(content["rows"]) == 1
    again = train_many(config, tmp_path / "out", "local", "train …", printed.append)
    attempts = {name: len(s.attempts) for name, s in again.progress.states.items()}
    assert attempts["one-seed-0"] == 1
    assert attempts["bad-seed-0"] == 2
