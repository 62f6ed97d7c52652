"""Commands where users run them: no network, odd paths, no rights, and beside each other."""

import json
import os
import shutil
import stat
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.articulate.conversion.cabinets import write_cabinet
from tests.test_bad_input import load_unchecked

from articulate.commands import main
from articulate.errors import RunError
from articulate.files import require_space
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate_train import run as runs
from articulate_train.commands import train
from articulate_train.config import TrainConfig

OFFLINE = """
import socket, sys
def offline(*_, **__):
    sys.stderr.write("network was used\\n")
    raise OSError("no network")
socket.socket.connect = socket.socket.connect_ex = offline
socket.getaddrinfo = offline
"""
TINY = """
ppo: {n_envs: 4, n_steps: 8, batch_size: 16, n_epochs: 2, net: [8, 8]}
randomization: {scales: 3}
starts: {bank: 16}
seeds: [0]
steps: 64
jobs: 1
episodes: 2
"""


@pytest.fixture
def place(tmp_path):
    """A folder with spaces and letters of several scripts, and the environment to use it in."""
    folder = tmp_path / "Möbel & Träger 箪笥"
    (folder / "site").mkdir(parents=True)
    (folder / "site" / "sitecustomize.py").write_text(OFFLINE)
    return folder


def environment(place):
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(place / "site"), *sys.path[1:]]),
        "XDG_CACHE_HOME": str(place / "Zwischen lager"),
        "HOME": str(place),
        "TMPDIR": str(place),
    }


def call(place, *words, before=()):
    """``articulate words`` run in ``place``, with ``before`` in front."""
    done = subprocess.run(
        [*before, sys.executable, "-m", "articulate", *map(str, words)],
        cwd=place,
        env=environment(place),
        capture_output=True,
        text=True,
        timeout=500,
    )
    assert "network was used" not in done.stderr
    return done


def read_only(folder):
    for path in [folder, *folder.rglob("*")]:
        path.chmod(path.stat().st_mode & ~(stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH))


def test_rights_count_in_these_tests(place, unprivileged):
    (place / "locked").mkdir(mode=0o555)
    done = subprocess.run([*unprivileged, "touch", place / "locked" / "x"], capture_output=True)
    assert done.returncode != 0


def writable(folder):
    for path in [folder, *folder.rglob("*")]:
        path.chmod(path.stat().st_mode | stat.S_IWUSR)


@pytest.fixture
def unprivileged():
    """Return a prefix of calls with which file permissions apply to root too."""
    if os.getuid() != 0:
        return []
    if shutil.which("setpriv") is None:
        pytest.skip("root has all rights without setpriv")
    return ["setpriv", "--bounding-set=-all", "--inh-caps=-all", "--"]


def test_check_works_offline_elsewhere_without_rights_on_a_folder_that_may_not_be_written(
    place, unprivileged
):
    source = write_cabinet(place / "nur lesen").parent
    read_only(source)
    before = sorted(source.rglob("*"))
    try:
        done = call(place, "check", source, "--json", before=unprivileged)
        assert done.returncode == 0, done.stderr
        assert sorted(source.rglob("*")) == before
    finally:
        writable(source)
    assert json.loads(done.stdout)["verdict"] == "repaired"
    made = place / "checked" / source.name
    assert (made / "object.xml").is_file()
    again = call(place, "check", made, "--out", "again", "--json", before=unprivileged)
    assert json.loads(again.stdout)["verdict"] in {"passed", "repaired"}, again.stderr


def test_an_asset_folder_that_may_not_be_written_is_copied_to_one_that_may(tmp_path):
    from articulate.files import copy_writable

    (tmp_path / "a" / "deep").mkdir(parents=True)
    (tmp_path / "a" / "deep" / "x").write_text("x")
    read_only(tmp_path / "a")
    copy_writable(tmp_path / "a", tmp_path / "b")
    for path in [tmp_path / "b", *(tmp_path / "b").rglob("*")]:
        assert path.stat().st_mode & stat.S_IWUSR
    writable(tmp_path / "a")
    assert (tmp_path / "b" / "deep" / "x").read_text() == "x"


@pytest.mark.slow
def test_everything_from_a_urdf_to_a_robot_works_offline_in_a_folder_with_odd_letters(
    place, unprivileged
):
    source = embedded_cabinet(place / "Schrank 柜")
    (place / "tiny.yaml").write_text(TINY)
    asset = source if source.is_dir() else source.parent
    read_only(asset)
    flags = ["--asset", asset, "--joint", "drawer_0_slide", "--config", "tiny.yaml", "--json"]
    done = call(place, "train", *flags, before=unprivileged)
    writable(asset)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    (run,) = (p for p in (place / "runs").iterdir() if p.is_dir())
    assert run.name.startswith(f"{asset.name}-open_drawer-")
    assert report == json.loads((run / "report.json").read_text())
    for words in (
        ["evaluate", run, "--require-success", "1"],
        ["export", run, "--out", "Bündel 1.zip"],
        ["deploy", "Bündel 1.zip", "--episodes", "1", "--out", "Auf nahmen"],
        ["watch", "Bündel 1.zip", "--out", "Video 1.mp4"],
    ):
        done = call(place, *words, "--json", before=unprivileged)
        assert done.returncode == (3 if words[0] == "evaluate" else 0), done.stderr
        json.loads(done.stdout)


def test_two_checks_of_one_object_at_once_do_not_meet(place):
    source = write_cabinet(place / "in")
    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda _: call(place, "check", source, "--json"), range(2)))
    contents = [json.loads(done.stdout) for done in results]
    assert [done.returncode for done in results] == [0, 0]
    assert contents[0] == contents[1]  # the second took what the first had made
    (made,) = (place / "checked").iterdir()
    assert json.loads((made / "check_report.json").read_text()) == contents[0]
    assert list(place.glob("**/.little*")) == []


@pytest.fixture
def cabinet_flags(tmp_path, monkeypatch):
    from tests.assets import make_cabinet

    monkeypatch.setattr(runs, "load_checked_asset", load_unchecked)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    make_cabinet(tmp_path / "cabinet")
    return train.TrainFlags(asset="cabinet", joint="drawer_2_slide")


def test_runs_that_begin_in_the_same_second_get_folders_of_their_own(cabinet_flags, monkeypatch):
    monkeypatch.setattr("articulate_train.commands.train.time.strftime", lambda _: "now")
    monkeypatch.setattr(
        "articulate_train.feasibility_check.check_feasibility", lambda *_, **__: None
    )
    first, second = (train._new_run(cabinet_flags) for _ in range(2))
    assert first.folder == Path("runs/cabinet-open_drawer-now")
    assert second.folder == Path("runs/cabinet-open_drawer-now-2")


def test_two_runs_at_once_in_one_folder_leave_one_of_them_complete(tmp_path, monkeypatch):
    from tests.assets import make_cabinet

    monkeypatch.setattr(runs, "load_checked_asset", load_unchecked)
    asset = make_cabinet(tmp_path / "cabinet")
    barrier, free = threading.Barrier(2), require_space

    def meet(*words):
        barrier.wait(timeout=60)  # both have seen that the folder is free
        free(*words)

    monkeypatch.setattr(runs, "require_space", meet)
    config = TrainConfig(asset=str(asset.folder), joint="drawer_2_slide")

    def begin(_):
        try:
            return runs.create_run(config, tmp_path / "runs" / "one", tmp_path / "cache")
        except RunError as error:
            return error

    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(begin, range(2)))
    assert sorted(isinstance(result, RunError) for result in results) == [False, True]
    assert [p.name for p in (tmp_path / "runs").iterdir()] == ["one"]
    assert runs.open_run(tmp_path / "runs" / "one").task.joint == "drawer_2_slide"


def test_without_pybullet_an_object_is_checked_and_the_report_reports_it(tmp_path, monkeypatch):
    source = write_cabinet(tmp_path / "in")
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(
        "import sys\nsys.modules['pybullet'] = None\n"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "site"), *sys.path[1:]]))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    out = tmp_path / "out"
    assert main(["check", str(source), "--out", str(out)]) == 0
    checks = json.loads((out / "check_report.json").read_text())["checks"]
    fk = [c for c in checks if c["name"] == "forward_kinematics"]
    assert [c["outcome"] for c in fk] == ["passed", "not_applicable", "passed"]
    assert "not compared with PyBullet: pybullet is not installed" in fk[1]["message"]


def test_no_command_needs_pybullet_to_begin():
    modules = (
        "articulate.preparation.prepare",
        "articulate_deploy.deploy",
        "articulate_deploy.robots.mujoco",
        "articulate_train.run",
        "articulate_train.evaluate_run",
    )
    code = f"import sys; sys.modules['pybullet'] = None; import {', '.join(modules)}"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_home_without_a_cache_folder_is_enough(tmp_path, monkeypatch):
    from articulate.cache import cache_folder, cache_in_use

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with cache_in_use(cache_folder()):
        pass
    assert (tmp_path / "home").is_dir()
    shutil.rmtree(tmp_path / "home")


def test_no_help_text_waits_for_numpy_or_a_simulator():
    code = """
import contextlib, io, sys
from importlib.metadata import entry_points
from articulate.commands import main
for verb in sorted(entry_points(group="articulate.commands").names):
    with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.suppress(SystemExit):
        main([verb, "--help"])
    assert "Example:" in printed.getvalue(), verb
    print(verb, *[m for m in ("numpy", "scipy", "mujoco", "torch", "trimesh") if m in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.split()
    assert {"check", "deploy", "evaluate", "export", "train"} <= set(printed)
    assert not {"numpy", "scipy", "mujoco", "torch", "trimesh"} & set(printed), done.stdout
