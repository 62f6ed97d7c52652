"""Folders of recordings: one process writes to each, and nothing is left without an episode."""

import subprocess
import sys

import pytest

from articulate.errors import UsageError
from articulate_deploy.recording import claimed_folders

NOT_EMPTY = "exists and is not empty"


def refused(folder, match):
    with pytest.raises(UsageError, match=match), claimed_folders([folder]):
        pytest.fail("claimed")


def test_of_two_recordings_into_one_folder_the_second_is_rejected(tmp_path):
    with claimed_folders([tmp_path / "out"]):
        refused(tmp_path / "out", "in use by another process")
        assert (tmp_path / "out" / "episodes.jsonl").exists()


def test_without_an_episode_only_the_folders_of_before_are_left(tmp_path):
    (tmp_path / "old").mkdir()
    for folder in (tmp_path / "old", tmp_path / "new" / "out"):
        with pytest.raises(RuntimeError), claimed_folders([folder]):
            raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert list((tmp_path / "old").iterdir()) == []


def test_all_folders_are_claimed_or_none(tmp_path):
    (tmp_path / "b").write_text("a file")
    with (
        pytest.raises(UsageError, match="cannot be written"),
        claimed_folders([tmp_path / "a", tmp_path / "b"]),
    ):
        pytest.fail("claimed")
    assert not (tmp_path / "a").exists()


def test_the_recording_of_a_killed_process_is_replaced(tmp_path):
    code = (
        "import os, pathlib, sys; from articulate_deploy.recording import claimed_folders\n"
        "folder = pathlib.Path(sys.argv[1])\n"
        "with claimed_folders([folder]):\n"
        "    (folder / 'episode_0000.npz').touch()\n"
        "    (folder / '.episode_0001.npz.abc').touch()\n"
        "    os.kill(os.getpid(), 9)"
    )
    out = tmp_path / "out"
    assert subprocess.run([sys.executable, "-c", code, str(out)]).returncode == -9
    assert len(list(out.iterdir())) == 3
    with claimed_folders([out]):
        assert [path.name for path in out.iterdir()] == ["episodes.jsonl"]


@pytest.mark.parametrize("name", ["notes.txt", "report.json", "episode_0000.npz"])
def test_other_files_are_never_replaced(tmp_path, name):
    (tmp_path / name).write_text("mine")
    refused(tmp_path, NOT_EMPTY)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_complete_recording_is_never_replaced(tmp_path):
    with claimed_folders([tmp_path / "out"]):
        (tmp_path / "out" / "episode_0000.npz").touch()
        (tmp_path / "new").write_text("a line")
        (tmp_path / "new").replace(tmp_path / "out" / "episodes.jsonl")
    refused(tmp_path / "out", NOT_EMPTY)


def test_a_link_in_place_of_the_claim_is_not_followed(tmp_path):
    (tmp_path / "mine").write_text("")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "episodes.jsonl").symlink_to(tmp_path / "mine")
    refused(tmp_path / "out", "cannot be written")
