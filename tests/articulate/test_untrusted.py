"""The gate in front of every parser: regular files, bounded, plain values."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from articulate.errors import MAX_QUOTED, AssetError, UsageError, quote, shorten
from articulate.untrusted import (
    load_json_object,
    load_yaml,
    open_regular,
    parse_json_object,
    parse_yaml,
    read_bounded,
    read_text,
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "file"
    path.write_bytes(b'{"a": [1, 2.5, null]}')
    return path


def test_a_regular_file_and_a_link_to_one_are_read(file: Path) -> None:
    link = file.with_name("link")
    link.symlink_to(file)
    assert read_bounded(link, 100) == file.read_bytes()
    with open_regular(file, limit_bytes=100) as stream:
        assert stream.read(1) == b"{"
    assert load_json_object(link) == {"a": [1, 2.5, None]}


def test_the_limit_is_the_largest_size_accepted(file: Path) -> None:
    assert len(read_bounded(file, 21)) == 21
    with pytest.raises(UsageError, match=r"file: larger than 20 bytes"):
        read_bounded(file, 20)


def test_a_fifo_a_folder_a_device_and_an_absent_file_are_rejected(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name, reason in [
        ("fifo", "not a regular file"),
        ("zero", "not a regular file"),
        ("", "is a folder; give a file"),
        ("absent", "No such file"),
        ("x" * 300, "File name too long"),
        ("zero\0byte", "not a file name"),
    ]:
        with pytest.raises(AssetError, match=reason):
            read_bounded(tmp_path / name, 100, error=AssetError)


def test_text_must_be_utf_8(file: Path) -> None:
    file.write_bytes(b"\xff")
    with pytest.raises(UsageError, match="not text in UTF-8"):
        read_text(file, 100)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[1]", r"holds \[1\]; a JSON object was expected"),
        ("[" * 100_000, "nested deeper"),
        ('{"a":' * 101 + "1" + "}" * 101, "nested deeper than 100 levels"),
        ('{"a": NaN}', "NaN is not a JSON number"),
        ('{"a": -Infinity}', "Infinity is not a JSON number"),
        ('{"a": 1e999}', "'1e999' is not finite"),
        ('{"a": 1, "a": 2}', "duplicate key 'a'"),
        ('{"a": ' + "1" * 5000 + "}", "not JSON"),
        ("", "not JSON"),
    ],
)
def test_json_must_be_a_plain_object(text: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason) as caught:
        parse_json_object(text, "x.json")
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


def test_the_deepest_accepted_json_is_read() -> None:
    assert parse_json_object('{"a":' * 99 + "1" + "}" * 99, "x.json")


def test_yaml_gives_plain_values_and_follows_aliases(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("a: &x {b: 1}\nc: *x\nd:\n  <<: *x\n  e: 2\n")
    assert load_yaml(path) == {"a": {"b": 1}, "c": {"b": 1}, "d": {"b": 1, "e": 2}}
    assert parse_yaml("", "x.yaml") is None


def doubling(levels: int) -> str:
    rows = ["a0: &a0 [1, 1]"]
    rows += [f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, levels)]
    return "\n".join(rows)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (doubling(60), "more than 2000000 values with all aliases"),
        ("a: &a [*a]", "contains itself"),
        ("a: 1\na: 2", r"x.yaml:2: not YAML \(duplicate key a\)"),
        ("? [1]\n: 2", "a key must be a name"),
        ("a: !!python/object:os.system {}", "could not determine a constructor"),
        ("[" * 150 + "]" * 150, "nested deeper than 100 levels"),
        ("[" * 100_000, "not YAML"),
        ("a: " + "1:" * 5000 + "1", "a number of 10001 characters"),
        ("a: " + "[" + "b" * 500, "not YAML"),
    ],
)
def test_yaml_is_bounded(text: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason) as caught:
        parse_yaml(text, "x.yaml")
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


def test_messages_quote_a_bounded_part_of_the_input() -> None:
    assert quote("a\nb") == r"'a\nb'"
    assert len(quote("x" * 1000)) == MAX_QUOTED + 2
    assert quote("x" * 1000).endswith("x…'")
    assert len(quote(list(range(1000)))) == MAX_QUOTED
    assert shorten("one\ntwo") == "one"
    assert shorten("a\tb\x1b") == "a b "
