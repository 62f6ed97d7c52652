from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from articulate.errors import AssetError
from articulate.formats.read_urdf import read_urdf
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import MAX_LINKS
from articulate.formats.xml_input import MAX_BYTES, MAX_ELEMENTS, read_markup, tag_of

BOMB = (
    '<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {n} "{f"&{m};" * 10}">' for m, n in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + ']><robot name="&i;"/>'
)
"""Ten to the power of nine letters, if anybody expands it."""


def parsed(folder: Path, content: bytes | str) -> tuple[Any, str]:
    path = folder / "a.urdf"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    repairs = Repairs()
    root = read_markup(path, repairs)
    assert tag_of(root) == "robot"
    return root, "\n".join(repairs.messages)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<?xml version="1.0"?><robot/>', ""),
        ('\n\n<?xml version="1.0"?><robot/>', "declaration not at the start"),
        ('<?xml version="1.0"?>\n<?xml version="1.0"?><robot/>', "declaration repeated"),
        ('<!-- made by hand -->\n<?xml version="1.0"?><robot/>', "declaration repeated or not"),
        ('<?xml version="0.0"?><robot/>', "version '0.0' read as 1.0"),
        ("<robot><!-- a <!-- b --></robot>", "-- inside a comment"),
        ("<robot/>\n\0", "zero bytes"),
        ("<robot/>\n<robot/>", "what follows the end"),
        ("<robot><xacro:x/></robot>", "undeclared XML prefix"),
        ('<robot xmlns:a="u" xmlns:a="v"/>', "declared twice"),
        ('<robot xmlns="http://drake.mit.edu"/>', ""),
        ("hello <robot/>", "text before the first element"),
    ],
)
def test_slips_without_doubt_are_repaired_and_listed(tmp_path: Path, text: str, words: str) -> None:
    _, messages = parsed(tmp_path, text)
    assert (words in messages) if words else (not messages)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('<robot name="\u00e4"/>'.encode("utf-8-sig"), ""),
        ('<?xml version="1.0" encoding="utf-16"?><robot name="\u00e4"/>'.encode("utf-16"), ""),
        ('<robot name="\u00e4"/>'.encode("utf-16-be"), ""),
        ('<?xml version="1.0" encoding="iso-8859-1"?><robot name="\u00e4"/>'.encode("latin-1"), ""),
        ('<robot name="\u00e4"/>'.encode("latin-1"), "not text in utf-8: read as latin-1"),
        ('<?xml version="1.0" encoding="zlib_codec"?><robot name="\u00e4"/>'.encode(), "not known"),
        ('<?xml version="1.0" encoding="utf-16"?><robot name="\u00e4"/>'.encode(), "not that of"),
    ],
)
def test_encodings_are_those_of_the_bytes(tmp_path: Path, content: bytes, words: str) -> None:
    root, messages = parsed(tmp_path, content)
    assert root.get("name") == "\u00e4"
    assert (words in messages) if words else (not messages)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (BOMB, "has a DOCTYPE or entities, which are not accepted"),
        (BOMB.replace("DOCTYPE", "doctype"), "has a DOCTYPE or entities"),
        (BOMB.encode("utf-16"), "has a DOCTYPE or entities"),
        ('<robot name="&x;"/>', "Entity 'x' not defined"),
        ("<robot><link></robot>", "not XML"),
        ("<robot><link/>", "not XML"),
        ('<robot name="1" name="2"/>', "Attribute name redefined"),
        ("<robot>" * 400 + "</robot>" * 400, "not XML: Excessive depth"),
        ("<robot>" + "<a/>" * (MAX_ELEMENTS + 1) + "</robot>", "elements; at most"),
        ("", "no XML in it"),
        (b"\xff\xfe<", "not text in utf-16"),
        (b"\x89PNG\r\n\x1a\n", "no XML in it"),
    ],
)
def test_doubtful_or_dangerous_input_is_rejected_in_one_line(
    tmp_path: Path, content: bytes | str, words: str
) -> None:
    with pytest.raises(AssetError) as caught:
        parsed(tmp_path, content)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "a.urdf" in str(caught.value)


def test_a_file_that_is_too_large_is_not_even_parsed(tmp_path: Path) -> None:
    path = tmp_path / "big.urdf"
    with path.open("wb") as stream:
        stream.write(b"<robot>")
        stream.truncate(MAX_BYTES + 1)
    with pytest.raises(AssetError, match=f"larger than {MAX_BYTES} bytes"):
        read_markup(path, Repairs())


def test_lines_in_messages_are_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_text(
        '\n\n<?xml version="1.0"?>\n<robot>\n<link name="a"/>\n<joint name="j"/></robot>'
    )
    with pytest.raises(AssetError, match=r"a\.urdf:6: joint 'j' is of type ''"):
        read_urdf(path)


def test_so_many_links_are_no_object(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    links = "".join(f'<link name="l{i}"/>' for i in range(MAX_LINKS + 1))
    path.write_text(f"<robot>{links}</robot>")
    with pytest.raises(AssetError, match=f"at most {MAX_LINKS} are accepted"):
        read_urdf(path)
