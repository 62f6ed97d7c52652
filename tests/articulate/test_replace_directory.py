"""An asset takes the place of an earlier one whole, or not at all."""

from __future__ import annotations

import errno
import json
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.articulate.conversion.boxes import BODY_BOX, made, written

from articulate.assets.asset import load_asset
from articulate.conversion import convert
from articulate.conversion.convert import build_asset, read_input, write_asset
from articulate.errors import AssetError, UsageError
from articulate.files import MAX_TRIES, replace_directory
from articulate.formats.config import ConvertConfig
from articulate.formats.find_source import find_source

LONG = "x" * 300


def folder(path: Path, word: str, asset: bool = True) -> Path:
    """A folder with one file that says ``word``."""
    path.mkdir(parents=True)
    content = json.dumps({"schema": "articulate.asset", "word": word})
    (path / ("asset.json" if asset else "notes.txt")).write_text(content if asset else word)
    return path


def word_in(path: Path) -> str:
    return str(json.loads((path / "asset.json").read_text())["word"])


def names(path: Path) -> list[str]:
    return sorted(p.name for p in path.iterdir())


@pytest.mark.parametrize("before", ["nothing", "empty", "asset"])
def test_a_folder_takes_the_place_of_an_asset_and_of_nothing(tmp_path: Path, before: str) -> None:
    new, aside = folder(tmp_path / "new", "new"), tmp_path / "aside"
    aside.mkdir()
    out = tmp_path / "out"
    if before == "empty":
        out.mkdir()
    if before == "asset":
        folder(out, "old")
    replace_directory(new, out, aside)
    assert word_in(out) == "new"
    assert [word_in(old) for old in aside.iterdir()] == ["old"] * (before == "asset")


@pytest.mark.parametrize("content", ["{}", "[]", "not JSON", '{"schema": "another"}'])
def test_a_folder_of_others_that_has_a_file_of_that_name_is_left_alone(
    tmp_path: Path, content: str
) -> None:
    new, out = folder(tmp_path / "new", "new"), tmp_path / "out"
    (tmp_path / "aside").mkdir()
    out.mkdir()
    (out / "asset.json").write_text(content)
    (out / "thesis.txt").write_text("years")
    with pytest.raises(OSError, match="not empty"):
        replace_directory(new, out, tmp_path / "aside")
    assert names(out) == ["asset.json", "thesis.txt"]


@pytest.mark.parametrize("code", [errno.EIO, errno.ENOTEMPTY])
def test_an_asset_goes_back_where_the_new_one_cannot_be_moved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    new, out = folder(tmp_path / "new", "new"), folder(tmp_path / "out", "old")
    (tmp_path / "aside").mkdir()
    calls, rename = [], Path.rename

    def broken(path: Path, target: Path) -> Path:
        if path == new:
            calls.append(path)
            raise OSError(code, os.strerror(code))
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", broken)
    with pytest.raises(OSError, match=os.strerror(code)):
        replace_directory(new, out, tmp_path / "aside")
    assert len(calls) == (1 if code == errno.EIO else MAX_TRIES)
    assert word_in(out) == "old"


def test_what_is_no_asset_is_never_moved(tmp_path: Path) -> None:
    new, out = folder(tmp_path / "new", "new"), folder(tmp_path / "out", "years", asset=False)
    (tmp_path / "aside").mkdir()
    with pytest.raises(OSError, match="not empty"):
        replace_directory(new, out, tmp_path / "aside")
    assert names(out) == ["notes.txt"]


def test_a_full_disk_is_said_and_leaves_the_earlier_asset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    earlier = made(tmp_path)
    config = ConvertConfig(size_m=1.0)
    parts = build_asset(read_input(written(tmp_path, (BODY_BOX, BODY_BOX)), config), config)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    module = sys.modules[write_asset.__module__]  # its package has a function of this name
    monkeypatch.setattr(module, "write_meshes", full)
    with pytest.raises(UsageError, match=r"out: cannot be written \(No space left on device\)"):
        write_asset(*parts, tmp_path / "out")
    assert load_asset(tmp_path / "out") == earlier
    assert names(tmp_path) == ["out", "two.urdf"]


def test_two_who_write_one_asset_do_not_meet(tmp_path: Path) -> None:
    config = ConvertConfig()
    parts = build_asset(read_input(written(tmp_path), config), config)

    def write(_: int) -> bool:
        return write_asset(*parts, tmp_path / "out") == first

    first = write_asset(*parts, tmp_path / "out")
    with ThreadPoolExecutor(2) as pool:
        assert all(pool.map(write, range(8)))
    assert load_asset(tmp_path / "out") == first
    assert names(tmp_path) == ["out", "two.urdf"]


def test_names_too_long_for_the_disk_are_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match=r"cannot be read \(File name too long\)") as caught:
        find_source(tmp_path / LONG)
    assert "\n" not in str(caught.value)
    with pytest.raises(UsageError, match=r"cannot be written \(File name too long\)"):
        convert(written(tmp_path), tmp_path / LONG)
