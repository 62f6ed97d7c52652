import pathlib
import threading

import pytest

from articulate.errors import UsageError
from articulate_deploy.recording import claim_folder, claim_folders, release_folders


def test_of_two_runs_into_one_new_folder_the_second_is_refused(tmp_path):
    claim_folder(tmp_path / "out")
    with pytest.raises(UsageError, match="not empty"):
        claim_folder(tmp_path / "out")


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
            claim_folder(folder)
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
    claim_folder(tmp_path / "out")
    release_folders([tmp_path / "out"])
    claim_folder(tmp_path / "out")
    (tmp_path / "out" / "episode_0000.npz").write_text("")
    release_folders([tmp_path / "out"])
    with pytest.raises(UsageError, match="not empty"):
        claim_folder(tmp_path / "out")


def test_all_folders_are_claimed_or_none(tmp_path):
    (tmp_path / "b").write_text("a file")
    with pytest.raises(UsageError, match="cannot be written"):
        claim_folders([tmp_path / "a", tmp_path / "b"])
    claim_folder(tmp_path / "a")
