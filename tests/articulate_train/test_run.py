import dataclasses
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.assets import make_cabinet, make_cupboard
from tests.runs import JOINT, TINY_PPO, write_checkpoint

from articulate.config import load_config
from articulate.errors import AssetError, ReachError, RunError, UsageError
from articulate.task.object_placement import handle_poses
from articulate.task.randomization_config import RandomizationConfig
from articulate_envs import joint_selection
from articulate_envs.joint_selection import HOME_HEIGHT_M, choose_joint
from articulate_train import run as runs
from articulate_train.config import CheckpointSelectionConfig, PpoConfig, TrainConfig
from articulate_train.policy import load_policy
from articulate_train.run import DONE, create_run, open_run, prepare_asset, resume_run, run_bytes

RANGES = dataclasses.replace(RandomizationConfig(), scales=3)


def config_of(asset, **changes):
    return TrainConfig(
        asset=str(asset.folder),
        randomization=RANGES,
        ppo=TINY_PPO,
        steps=64,
        initial_policy="random",
        **changes,
    )


def without_handles(asset, *links):
    kept = tuple(h for h in asset.handles if h.link not in links)
    return dataclasses.replace(asset, handles=kept)


def test_a_named_joint_is_selected(cabinet):
    task, placement = choose_joint(config_of(cabinet, joint="drawer_1_slide"), cabinet)
    assert task.joint == "drawer_1_slide"
    assert placement.reachable_share > 0.99


def test_of_several_joints_the_one_with_its_handle_nearest_home_height_is_used(cabinet):
    heights = {
        joint.name: float(handle_poses(cabinet, joint.name, np.zeros(()))[2, 3])
        for joint in cabinet.joints
    }
    nearest = min(heights, key=lambda name: abs(heights[name] - HOME_HEIGHT_M))
    task, _ = choose_joint(config_of(cabinet), cabinet)
    assert task.joint == nearest == JOINT


def test_of_several_joints_those_that_cannot_be_reached_are_passed_over(cabinet, monkeypatch):
    reached = joint_selection._reached

    def picky(config, asset, task, handle):
        if task.joint == JOINT:
            raise ReachError(f"{asset.name}: too far")
        return reached(config, asset, task, handle)

    monkeypatch.setattr(joint_selection, "_reached", picky)
    assert choose_joint(config_of(cabinet), cabinet)[0].joint == "drawer_1_slide"


def test_of_several_joints_those_without_a_handle_are_passed_over(cabinet):
    bare = without_handles(cabinet, "drawer_2", "drawer_0")
    assert choose_joint(config_of(cabinet), bare)[0].joint == "drawer_1_slide"


def test_joint_that_is_not_there_is_answered_with_those_that_match(cabinet, error_line):
    error_line(
        "choose_joint(--joint drawer_9_slide)",
        lambda: choose_joint(config_of(cabinet, joint="drawer_9_slide"), cabinet),
    )


def test_no_joint_for_the_task_is_answered_with_what_there_is(cabinet, error_line, tmp_path):

    cupboard = make_cupboard(tmp_path / "cupboard")
    error_line("choose_joint(cupboard)", lambda: choose_joint(config_of(cupboard), cupboard))
    named = config_of(cupboard, joint="lid")
    error_line("choose_joint(cupboard, --joint lid)", lambda: choose_joint(named, cupboard))


@pytest.mark.usefixtures("short_search")
def test_no_joint_that_can_be_reached_is_answered_with_the_reason_once(tmp_path, error_line):
    far = make_cabinet(tmp_path / "far", travel_m=2.0)
    line = error_line("choose_joint(drawers of 2 m)", lambda: choose_joint(config_of(far), far))
    assert line.count("cabinet:") == 1


def test_an_object_without_listed_handles_is_held_where_its_shape_allows(cabinet):
    bare = without_handles(cabinet, "drawer_0", "drawer_1", "drawer_2")
    task, placement = choose_joint(config_of(bare), bare)
    found, listed = placement.handle, cabinet.handle_of(task.joint)
    assert found is not None
    assert listed is not None
    assert found.joint == task.joint
    assert np.linalg.norm(np.subtract(found.pos_l, listed.pos_l)) < 0.02


@pytest.mark.usefixtures("short_search")
def test_sampled_poses_out_of_reach_are_rejected(cabinet, error_line):
    wide = dataclasses.replace(
        config_of(cabinet), randomization=dataclasses.replace(RANGES, position_m=0.4)
    )
    named = dataclasses.replace(wide, joint=JOINT)
    with pytest.raises(ReachError, match="sampled poses"):
        choose_joint(named, cabinet)


@pytest.fixture
def checked(cabinet, monkeypatch):
    """The cabinet is not checked, which takes a while."""
    monkeypatch.setattr(runs, "prepare_asset", lambda *_: cabinet)
    return cabinet


def test_a_rejected_object_is_not_trained_on(tmp_path):
    far = make_cabinet(tmp_path / "far")
    (far.folder / "object.urdf").unlink()  # it belongs to an asset
    with pytest.raises(
        AssetError, match="rejected: forward_kinematics: yourdfpy does not read the canonical URDF"
    ):
        create_run(config_of(far), tmp_path / "run", tmp_path / "cache")
    assert not (tmp_path / "run").exists()


def test_run_that_is_made_is_the_run_that_is_opened(checked, tmp_path):
    cabinet = checked
    config = config_of(cabinet, joint=JOINT, seeds=(3, 5))
    made = create_run(config, tmp_path / "runs" / "one", tmp_path / "cache")
    assert made == open_run(made.folder)
    assert made.config == config
    assert made.task.joint == JOINT
    assert made.asset.folder == made.folder / "asset"
    assert made.seed_folder(5) == made.folder / "seed_5"
    assert made.scene().n_steps == round(made.task.episode_s * config.control.rate_hz)
    assert [p.name for p in (tmp_path / "runs").iterdir()] == ["one"]


def test_folder_in_the_place_is_left_only(cabinet, tmp_path, error_line):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "kept.txt").write_text("mine")
    error_line(
        "create_run(out that exists)",
        lambda: create_run(config_of(cabinet), tmp_path / "out", tmp_path / "cache"),
    )
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["kept.txt"]


def test_an_empty_folder_is_used(checked, tmp_path):
    folder = tmp_path / "empty"
    folder.mkdir()
    create_run(config_of(checked, joint=JOINT), folder, tmp_path / "cache")
    assert open_run(folder).task.joint == JOINT


def test_a_run_that_another_call_made_meanwhile_is_in_the_place(checked, tmp_path, monkeypatch):
    folder = tmp_path / "race"
    config = config_of(checked, joint=JOINT)
    create_run(config, folder, tmp_path / "cache")
    monkeypatch.setattr(runs, "_check_free", lambda _: None)
    with pytest.raises(RunError, match="exists; continue with --resume"):
        create_run(config, folder, tmp_path / "cache")


def test_a_category_that_no_table_has_is_rejected(cabinet, error_line):
    config = config_of(cabinet, category="Storagefurnitur")
    error_line("prepare_asset(category)", lambda: prepare_asset(config, Path("cache")))


def test_file_above_the_run_is_an_error_before_any_work(cabinet, tmp_path, error_line, monkeypatch):
    (tmp_path / "file").write_text("mine")
    monkeypatch.setattr(runs, "prepare_asset", lambda *_: pytest.fail("worked in vain"))
    error_line(
        "create_run(below a file)",
        lambda: create_run(config_of(cabinet), tmp_path / "file" / "run", tmp_path / "cache"),
    )


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RunError("no")])
def test_run_that_cannot_be_written_leaves_nothing(checked, tmp_path, monkeypatch, error):
    def full(*_):
        raise error

    monkeypatch.setattr(runs, "write_scene", full)
    config = config_of(checked, joint=JOINT)
    with pytest.raises(UsageError):
        create_run(config, tmp_path / "runs" / "one", tmp_path / "cache")
    assert list((tmp_path / "runs").iterdir()) == []


def test_folder_that_is_no_run_is_an_error(tmp_path, error_line):
    (tmp_path / "photos").mkdir()
    error_line("open_run(photos)", lambda: open_run(tmp_path / "photos"))
    error_line("open_run(none)", lambda: open_run(tmp_path / "none"))


def test_folder_of_many_runs_is_an_error(tmp_path, error_line):
    (tmp_path / "many").mkdir()
    (tmp_path / "many" / "config.yaml").write_text("steps: 64\n")
    error_line("open_run(many runs)", lambda: open_run(tmp_path / "many"))


def test_run_of_another_version_is_rejected_with_the_command_that_makes_it_again(tiny, error_line):
    path = tiny.folder / "scene.json"
    content = json.loads(path.read_text())
    del content["schema"], content["schema_version"]
    path.write_text(json.dumps(content))
    line = error_line("open_run(schema version 1)", lambda: open_run(tiny.folder))
    assert f"--task open_drawer --joint {tiny.task.joint}" in line


def test_run_that_is_damaged_is_an_error(tiny, error_line):
    (tiny.folder / "scene.json").write_text("{}")
    error_line("open_run(scene.json of {})", lambda: open_run(tiny.folder))
    (tiny.folder / "scene.json").write_text('{"task"')
    error_line("open_run(scene.json cut off)", lambda: open_run(tiny.folder))


def test_resuming_changes_nothing_of_the_run(tiny):
    before = (tiny.folder / "config.yaml").read_bytes()
    assert resume_run(tiny.folder, tiny.config) == tiny
    assert (tiny.folder / "config.yaml").read_bytes() == before


def test_resuming_may_have_more_steps_and_keeps_them(tiny):
    more = dataclasses.replace(tiny.config, steps=640, jobs=2, episodes=9)
    assert resume_run(tiny.folder, more).config == more
    assert open_run(tiny.folder).config == more
    assert load_config(TrainConfig, tiny.folder / "config.yaml") == more


def test_resuming_needs_at_least_the_trained_steps(tiny, error_line):
    ppo = tiny.config.ppo
    a_round = ppo.n_envs * ppo.n_steps * tiny.config.ensemble_size
    trained = 640 + a_round - 1  # updates are not cut
    tiny.seed_folder(0).mkdir()
    (tiny.seed_folder(0) / DONE).write_text(json.dumps({"steps": trained}))
    longer = dataclasses.replace(tiny.config, steps=1280)
    assert resume_run(tiny.folder, longer).config.steps == 1280
    back = dataclasses.replace(tiny.config, steps=640)
    assert resume_run(tiny.folder, back).config.steps == 640
    less = dataclasses.replace(tiny.config, steps=256)
    error_line("resume_run(fewer steps)", lambda: resume_run(tiny.folder, less))
    assert open_run(tiny.folder).config.steps == 640


@pytest.mark.parametrize(
    ("net", "envs", "states", "seed_mb"),
    [((128, 128), 64, 10, 9.9), ((512, 512), 64, 10, 87), ((128, 128), 64, 100, 53)],
)
def test_disk_that_a_run_takes_is_no_less_than_it_was_measured_to(
    cabinet, net, envs, states, seed_mb
):
    """The seed has two ensemble members."""
    ppo, select = (
        PpoConfig(net_arch=net, n_envs=envs),
        CheckpointSelectionConfig(n_checkpoints=states),
    )
    config = TrainConfig(
        asset="a", seeds=(0,), ppo=ppo, checkpoint_selection=select, initial_policy="random"
    )
    two = dataclasses.replace(config, seeds=(0, 1))
    assert seed_mb < (run_bytes(two, cabinet) - run_bytes(config, cabinet)) / 1e6 < 1.5 * seed_mb


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("ppo.gamma", lambda c: {"ppo": dataclasses.replace(c.ppo, gamma=0.9)}),
        ("seeds", lambda _: {"seeds": (0, 1)}),
        ("joint", lambda _: {"joint": "drawer_0_slide"}),
    ],
)
def test_resuming_may_change_nothing_else(tiny, error_line, name, change):
    other = dataclasses.replace(tiny.config, **change(tiny.config))
    before = (tiny.folder / "config.yaml").read_bytes()
    error_line(f"resume_run(other {name})", lambda: resume_run(tiny.folder, other))
    assert (tiny.folder / "config.yaml").read_bytes() == before


def test_asset_of_a_run_is_its_own(tiny, cabinet, tmp_path):
    """Later changes of the source have no effect."""
    moved = tmp_path / "moved"
    shutil.copytree(tiny.folder, moved)
    again = open_run(moved)
    assert again.asset.folder == moved / "asset"
    assert dataclasses.replace(again.asset, folder=cabinet.folder) == cabinet
    shutil.rmtree(moved / "asset")
    with pytest.raises(AssetError):
        open_run(moved)


def test_versions_are_recorded_where_there_are_any(monkeypatch):
    monkeypatch.setattr(runs, "PACKAGES", ("numpy", "no-such-package"))
    found = runs.versions()
    assert found["numpy"] == np.__version__
    assert found["no-such-package"] == "not installed"


@pytest.mark.parametrize("name", ["scene.json", "config.yaml", "seed_0/policy.pt"])
@pytest.mark.parametrize("kind", ["fifo", "device", "large"])
def test_files_of_a_run_must_be_regular_and_bounded(tiny, name, kind, monkeypatch):
    write_checkpoint(tiny.seed_folder(0), 0)
    path = tiny.folder / name
    path.unlink(missing_ok=True)
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as stream:
            stream.truncate(3_000_000_000)
    with pytest.raises(UsageError, match=r"not a regular file|larger than|a link"):
        load_policy(open_run(tiny.folder).seed_folder(0))


def test_a_configuration_without_its_end_is_rejected(tiny, error_line):
    path = tiny.folder / "config.yaml"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-20]))  # still valid YAML, with defaults for what is lost
    error_line("open_run(config.yaml without its end)", lambda: open_run(tiny.folder))


@pytest.mark.parametrize("name", [".lock", "videos", "seed_0", "config.yaml"])
def test_a_link_in_a_run_is_rejected_and_its_target_stays(tiny, tmp_path, name):
    target = tmp_path / "target"
    if name == "videos":
        target.mkdir()
    else:
        target.write_text("mine")
    (tiny.folder / name).unlink(missing_ok=True)
    (tiny.folder / name).symlink_to(target)
    with pytest.raises(UsageError, match="a link; remove it"):
        resume_run(tiny.folder, dataclasses.replace(tiny.config, steps=10**6))
    assert target.is_dir() or target.read_text() == "mine"
