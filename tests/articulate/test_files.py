import hashlib
import os

import pytest

from articulate.errors import UsageError
from articulate.files import atomic_write, sha256, write_bytes, write_json, write_text


def test_content_is_written_and_hashed(tmp_path):
    path = tmp_path / "new" / "folder" / "text.txt"
    write_text(path, "größe\n")
    assert path.read_text(encoding="utf-8") == "größe\n"
    assert sha256(path) == hashlib.sha256("größe\n".encode()).hexdigest()


def test_failure_inside_the_block_keeps_the_old_content_and_leaves_nothing(tmp_path):
    path = tmp_path / "kept.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), atomic_write(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["kept.txt"]


def test_a_file_missing_inside_the_block_is_not_blamed_on_the_target(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_write(tmp_path / "target.txt"):
        (tmp_path / "absent.txt").read_text()
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_a_file_is_bad_input(tmp_path, error_line):
    (tmp_path / "file").write_text("")
    error_line(
        "write_text(Path('file/x.txt'), '')", lambda: write_text(tmp_path / "file/x.txt", "")
    )


def test_target_that_is_a_folder_is_bad_input(tmp_path, error_line):
    (tmp_path / "folder").mkdir()
    error_line("write_text(Path('folder'), '')", lambda: write_text(tmp_path / "folder", ""))
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_folder_that_cannot_be_written_is_bad_input(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(UsageError, match="cannot be written"):
        write_bytes(tmp_path / "x", b"")


def test_full_disk_is_bad_input_and_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UsageError, match="No space left on device"):
        write_text(tmp_path / "x.txt", "content")
    assert list(tmp_path.iterdir()) == []


def test_json_with_nan_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "x.json", {"a": float("nan")})
    assert list(tmp_path.iterdir()) == []


def test_files_are_readable_by_others(tmp_path):
    write_json(tmp_path / "x.json", [1])
    assert (tmp_path / "x.json").stat().st_mode & 0o777 == 0o644


def test_what_is_no_character_is_written_as_an_escape(tmp_path):
    """A file's name that is not UTF-8 reaches Python so."""
    write_text(tmp_path / "a.txt", "clip \udcff.mp4")
    assert (tmp_path / "a.txt").read_text() == "clip \\udcff.mp4"
