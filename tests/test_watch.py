"""``articulate watch``: a run's policy and a bundle's, as a clip, a recording and in a window."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

from articulate.commands import main
from articulate.errors import MissingError
from articulate.render import playback as plays
from articulate_deploy.deploy import deploy
from articulate_deploy.robots.play import watch_bundle
from articulate_train.watch import watch_run


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A run in episodes of a second and its bundle; not to be changed."""
    folder = tmp_path_factory.mktemp("watched")
    make_run(folder / "run", make_cabinet(folder / "cabinet"), seeds=(0, 3), episode_s=1.0)
    assert main(["export", str(folder / "run"), "--out", str(folder / "b.zip"), "--seed", "0"]) == 0
    return folder


@pytest.fixture(scope="module")
def run_play(made):
    return watch_run(made / "run", seed=3, episode=1, randomise=False)


@pytest.fixture(scope="module")
def bundle_play(made):
    return watch_bundle(made / "b.zip", seed=None, episode=1, randomise=True)


def test_a_run_is_watched_for_a_whole_episode(run_play, made):
    assert run_play.title == "open_drawer of cabinet (drawer_2_slide), seed 3"
    assert run_play.qpos.shape == (20, run_play.model.nq)
    assert np.isfinite(run_play.qpos).all()
    assert set(run_play.curves) == {"opened", "force_n", "speed_share"}
    again = watch_run(made / "run", seed=3, episode=1, randomise=False)
    assert (again.qpos == run_play.qpos).all()
    other = watch_run(made / "run", seed=3, episode=2, randomise=False)
    assert (other.qpos != run_play.qpos).any()


def test_a_bundle_is_watched_in_the_episodes_that_deploy_counts(bundle_play, made):
    report = deploy(made / "b.zip", episodes=2)
    assert bundle_play.reason == report.results[1].reason
    assert len(bundle_play.qpos) == report.results[1].steps
    assert (bundle_play.model.geom_group == 0).all()


@pytest.mark.render
@pytest.mark.parametrize("what", ["run", "b.zip"])
def test_a_clip_is_written_where_it_is_asked_for(made, tmp_path, capsys, what):
    out = tmp_path / "clips" / "a.mp4"
    flags = ["--no-randomise", "--out", str(out), "--json"]
    assert main(["watch", str(made / what), *flags]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["file"] == str(out)
    assert content["seconds"] == 1.0
    assert out.read_bytes()[4:8] == b"ftyp"
    assert main(["watch", str(made / what), *flags]) == 2
    assert "exists; choose another --out" in capsys.readouterr().err


@pytest.mark.render
def test_the_default_name_tells_what_was_watched(made, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["watch", str(made / "b.zip"), "--no-randomise"]) == 0
    (written,) = (tmp_path / "watched").iterdir()
    assert written.name.startswith("b-")
    assert capsys.readouterr().out.startswith(f"watched/{written.name}: open_drawer of cabinet")


@pytest.mark.parametrize("which", ["run_play", "bundle_play"])
def test_a_recording_for_rerun_is_written(which, request, tmp_path):
    pytest.importorskip("rerun")
    path = plays.write_rerun(tmp_path / "a.rrd", request.getfixturevalue(which))
    assert path.read_bytes()[:3] == b"RRF"
    assert len(path.read_bytes()) > 10_000
    assert [p.name for p in tmp_path.iterdir()] == ["a.rrd"]


def test_without_rerun_one_line_says_how_to_get_it(run_play, tmp_path, monkeypatch, error_line):
    monkeypatch.setitem(sys.modules, "rerun", None)
    error_line("write_rrd(a.rrd)", lambda: plays.write_rerun(tmp_path / "a.rrd", run_play))
    assert not list(tmp_path.iterdir())


def test_a_window_shows_every_tick_until_it_is_closed(run_play, monkeypatch):
    seen: list[Any] = []

    class Window:
        def __init__(self, model, data):
            self.data = data

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def is_running(self):
            return len(seen) < 25

        def sync(self):
            seen.append(self.data.qpos.copy())

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("articulate.render.playback.time.sleep", lambda _: None)
    monkeypatch.setattr(plays, "open_viewer", Window)
    plays.show_in_viewer(run_play)
    assert np.allclose(seen[:20], run_play.qpos)
    assert np.allclose(seen[20:], run_play.qpos[:5])


def test_without_a_display_the_window_is_refused(run_play, monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(MissingError, match="cannot open a window"):
        plays.show_in_viewer(run_play)


def test_what_is_neither_a_run_nor_a_bundle_is_refused_before_anything_heavy(tmp_path, capsys):
    (tmp_path / "folder").mkdir()
    for source, what in [("nowhere", "does not exist"), ("folder", "neither a run nor a bundle")]:
        assert main(["watch", str(tmp_path / source)]) == 2
        assert what in capsys.readouterr().err
    assert Path(tmp_path / "watched").exists() is False
