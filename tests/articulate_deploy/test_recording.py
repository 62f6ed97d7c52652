import pathlib
import threading

import pytest

from articulate.errors import UsageError
from articulate_deploy.recording import give_back, new_folder, new_folders


def test_of_two_runs_into_one_new_folder_the_second_is_refused(tmp_path):
    new_folder(tmp_path / "out")
    with pytest.raises(UsageError, match="not empty"):
        new_folder(tmp_path / "out")


def test_of_runs_that_see_the_folder_empty_at_once_one_gets_it(tmp_path, monkeypatch):
    """All wait until each has looked into the empty folder."""
    folder, together = tmp_path / "out", threading.Barrier(4)
    listed = pathlib.Path.iterdir
    refused = []

    def looked(path):
        found = list(listed(path))
        together.wait(10.0)
        return iter(found)

    def run():
        try:
            new_folder(folder)
        except UsageError as error:
            refused.append(str(error))

    monkeypatch.setattr(pathlib.Path, "iterdir", looked)
    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert refused == [f"{folder}: exists and is not empty; choose another --out"] * 3


def test_a_claim_without_a_recording_is_taken_back(tmp_path):
    new_folder(tmp_path / "out")
    give_back([tmp_path / "out"])
    new_folder(tmp_path / "out")
    (tmp_path / "out" / "episode_0000.npz").write_text("")
    give_back([tmp_path / "out"])
    with pytest.raises(UsageError, match="not empty"):
        new_folder(tmp_path / "out")


def test_all_folders_are_claimed_or_none(tmp_path):
    (tmp_path / "b").write_text("a file")
    with pytest.raises(UsageError, match="cannot be written"):
        new_folders([tmp_path / "a", tmp_path / "b"])
    new_folder(tmp_path / "a")
