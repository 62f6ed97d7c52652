"""Read XML from untrusted files: bounded, without entities, repaired where nothing is lost."""

from __future__ import annotations

import codecs
import re
from pathlib import Path
from typing import Any

from lxml import etree

from articulate.errors import AssetError, UsageError, quote, shorten
from articulate.formats.repairs import Repairs
from articulate.untrusted import open_regular, read_bounded

MAX_BYTES = 20_000_000
"""Largest file that is read."""
MAX_ELEMENTS = 100_000
"""Most elements of a file."""
ENCODINGS = re.compile(
    r"utf-?(8|16|32)([-_]?[bl]e)?|(us-)?ascii|latin-?1|iso-?8859-\d+|(windows|cp)-?\d+|gb\w+|"
    r"big5|shift_jis|euc[-_]\w+|koi8-\w",
    re.IGNORECASE,
)
"""Encodings that a declaration may name."""
MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)
"""First bytes of a file and the encoding they mark."""
DECLARATION = re.compile(r"<\?xml\b[^>]{0,300}\?>")
MAX_ATTRIBUTES = 200
"""Most attributes of an element; reading them takes quadratic time."""
NAMES = ("name", "link", "joint", "type", "class", "childclass", "material", "mesh", "model")
"""Attributes that messages quote."""
MAX_NAME = 200
"""Longest of them, in characters."""
HEAD_BYTES = 200_000
"""Enough of a file to find its first element, after the longest of licences."""
REPAIRED = {
    "ERR_HYPHEN_IN_COMMENT": "-- inside a comment",
    "ERR_DOCUMENT_END": "what follows the end of the root element is ignored",
}
"""Errors of libxml2 that leave no doubt about the content, by its name of the error."""

# Element of a third-party library without stubs.
Element = Any


def read_markup(path: Path, repairs: Repairs) -> Element:
    """Return the root element of the XML file at ``path``.

    Comments are removed; undeclared prefixes stay in the names of their elements.

    Raises:
        AssetError: It cannot be read, is too large, has a DOCTYPE or is not XML.
    """
    content = read_bounded(path, MAX_BYTES, error=AssetError)
    text = _decoded(content, path, repairs)
    if "\0" in text:
        repairs.add("zero bytes in the file were left out")
        text = text.replace("\0", "")
    if re.search(r"<!\s*(DOCTYPE|ENTITY|ELEMENT|ATTLIST)", text, re.IGNORECASE):
        raise AssetError(f"{path}: has a DOCTYPE or entities, which are not accepted; remove them")
    start = text.find("<")
    if start < 0:
        raise AssetError(f"{path}: no XML in it")
    if text[:start].strip("\ufeff \t\r\n"):
        repairs.add("text before the first element was skipped")
    return _parsed(_undeclared(text, start, repairs), path, repairs)


def root_tag(path: Path) -> str:
    """Return the name of the first element of an XML file; empty where there is none."""
    try:
        with open_regular(path, limit_bytes=MAX_BYTES) as stream:
            head = stream.read(HEAD_BYTES).replace(b"\0", b"")
    except UsageError:
        return ""
    while True:
        found = re.search(rb"<\s*([A-Za-z_][\w.:-]*)|<!--|<\?", head)
        if found is None or found.group(1):
            return found.group(1).decode() if found else ""
        _, _, head = head[found.end() :].partition(b"-->" if found.group() == b"<!--" else b"?>")


def tag_of(element: Element) -> str:
    """Return the name of an element without its namespace; empty for comments."""
    return str(element.tag).rsplit("}", 1)[-1] if isinstance(element.tag, str) else ""


def children_of(element: Element, tag: str) -> list[Element]:
    """Return the direct children of that name."""
    return [child for child in element if tag_of(child) == tag]


def child_of(element: Element, tag: str) -> Element | None:
    """Return the first direct child of that name."""
    found = children_of(element, tag)
    return found[0] if found else None


def _decoded(content: bytes, path: Path, repairs: Repairs) -> str:
    encoding = next((name for mark, name in MARKS if content.startswith(mark)), "")
    if not encoding:
        declared = re.search(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([\w.-]+)", content[:2000])
        named = declared.group(1).decode("ascii", "replace") if declared else "utf-8"
        encoding = named if ENCODINGS.fullmatch(named) else "utf-8"
        if encoding != named:
            repairs.add(f"encoding {quote(named)} is not known: read as {encoding}")
        if re.match(r"utf-?(16|32)", encoding, re.IGNORECASE):  # its first bytes show otherwise
            repairs.add(f"encoding {quote(named)} is not that of the file: read as utf-8")
            encoding = "utf-8"
    for name in dict.fromkeys((encoding, "utf-8")):
        try:
            return content.decode(name)
        except (UnicodeDecodeError, LookupError):
            continue
    if encoding.lower().startswith(("utf-16", "utf-32")):
        raise AssetError(f"{path}: not text in {encoding}, which its first bytes mark")
    repairs.add(f"not text in {encoding}: read as latin-1")
    return content.decode("latin-1")


def _undeclared(text: str, start: int, repairs: Repairs) -> str:
    """Return the text without XML declarations, with the same lines."""
    found = list(DECLARATION.finditer(text, start))
    if len(found) > 1 or (found and found[0].start() > start):
        repairs.add("XML declaration repeated or not at the start: ignored")
    elif found and start and text[:start].lstrip("\ufeff"):
        repairs.add("XML declaration not at the start: ignored")
    for match in found:
        version = re.search(r"version\s*=\s*[\"']([^\"']*)", match.group())
        if version and version.group(1) not in {"1.0", "1.1"}:
            repairs.add(f"XML version {quote(version.group(1))} read as 1.0")
    lead = "\n" * text.count("\n", 0, start)
    return lead + DECLARATION.sub(lambda m: "\n" * m.group().count("\n"), text[start:])


def _parsed(text: str, path: Path, repairs: Repairs) -> Element:
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        recover=True,
        remove_comments=True,
        remove_pis=True,
        encoding="utf-8",
    )
    try:
        root = etree.fromstring(text.encode("utf-8", "replace"), parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise AssetError(f"{path}: not XML: {shorten(error)}") from None
    for entry in parser.error_log:
        if entry.domain_name == "NAMESPACE":
            repairs.add(f"undeclared XML prefix ignored (line {entry.line})")
        elif entry.type_name in REPAIRED:
            repairs.add(f"{REPAIRED[entry.type_name]} (line {entry.line})")
        elif entry.type_name == "ERR_ATTRIBUTE_REDEFINED" and "xmlns" in entry.message:
            repairs.add(f"an XML prefix is declared twice: the first is used (line {entry.line})")
        else:
            raise AssetError(f"{path}:{entry.line}: not XML: {shorten(entry.message)}")
    if root is None:
        raise AssetError(f"{path}: no XML in it")
    count = 0
    for element in root.iter():
        count += 1
        if len(element.attrib) > MAX_ATTRIBUTES:
            raise AssetError(
                f"{path}:{element.sourceline}: more than {MAX_ATTRIBUTES} attributes of an element"
            )
        for key in NAMES:
            name = element.get(key) or ""
            if len(name) > MAX_NAME or not name.isprintable():
                reason = f"more than {MAX_NAME}" if name.isprintable() else "unprintable"
                raise AssetError(f"{path}:{element.sourceline}: {key} has {reason} characters")
    if count > MAX_ELEMENTS:
        raise AssetError(f"{path}: {count} elements; at most {MAX_ELEMENTS} are accepted")
    return root
