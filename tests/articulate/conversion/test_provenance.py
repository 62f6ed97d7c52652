"""Source and licence of an object."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from articulate.conversion.metric_size import category_of
from articulate.conversion.provenance import PARTNET_LICENCE, origin_of
from articulate.formats.config import ConvertConfig


def urdf_in(folder: Path, name: str = "thing.urdf") -> Path:
    path = folder / name
    path.write_text("<robot name='thing'/>", encoding="utf-8")
    return path


def test_source_and_licence_beside_the_file_are_used(tmp_path: Path) -> None:
    content = {"source": "my workshop", "licence": "CC0"}
    (tmp_path / "source.json").write_text(json.dumps(content), encoding="utf-8")
    assert origin_of(urdf_in(tmp_path), ConvertConfig()) == ("my workshop", "CC0")


def test_a_configured_licence_wins(tmp_path: Path) -> None:
    (tmp_path / "source.json").write_text('{"licence": "CC0"}', encoding="utf-8")
    assert origin_of(urdf_in(tmp_path), ConvertConfig(licence="MIT"))[1] == "MIT"


def test_an_object_of_the_data_set_carries_its_terms(tmp_path: Path) -> None:
    source, licence = origin_of(urdf_in(tmp_path, "mobility.urdf"), ConvertConfig())
    assert source == f"PartNet-Mobility {tmp_path.name}"
    assert licence == PARTNET_LICENCE
    assert "non-commercial" in licence


def test_an_object_of_the_data_set_is_named_by_its_folder_from_within(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    urdf_in(tmp_path, "mobility.urdf")
    monkeypatch.chdir(tmp_path)
    source, _ = origin_of(Path("mobility.urdf"), ConvertConfig())
    assert source == f"PartNet-Mobility {tmp_path.name}"


def test_the_urdf_of_an_asset_carries_source_and_licence_of_the_asset(tmp_path: Path) -> None:
    content = {"source": "articulate make", "licence": "MIT", "joints": []}
    (tmp_path / "asset.json").write_text(json.dumps(content), encoding="utf-8")
    assert origin_of(urdf_in(tmp_path, "object.urdf"), ConvertConfig()) == (
        "articulate make",
        "MIT",
    )


def test_without_information_it_is_unknown_even_from_a_broken_file(tmp_path: Path) -> None:
    (tmp_path / "source.json").write_text("{", encoding="utf-8")
    assert origin_of(urdf_in(tmp_path), ConvertConfig()) == ("thing.urdf", "unknown")


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "null", "[1]"])
def test_a_file_that_holds_something_else_is_ignored(tmp_path: Path, text: str) -> None:
    (tmp_path / "source.json").write_text(text, encoding="utf-8")
    assert origin_of(urdf_in(tmp_path), ConvertConfig()) == ("thing.urdf", "unknown")
    assert category_of(urdf_in(tmp_path), ConvertConfig()) == "unknown"


@pytest.mark.parametrize("value", ["null", '""', "3", "[]"])
def test_a_licence_that_is_no_word_is_none(tmp_path: Path, value: str) -> None:
    content = f'{{"source": {value}, "licence": {value}}}'
    (tmp_path / "source.json").write_text(content, encoding="utf-8")
    assert origin_of(urdf_in(tmp_path), ConvertConfig()) == ("thing.urdf", "unknown")
