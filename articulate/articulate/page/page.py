"""Builder of one HTML file without scripts, fonts and external addresses."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Literal

from articulate.files import write_text
from articulate.page.chart import Chart
from articulate.page.text import escape_text, format_number

Cell = str | int | float | bool | None

LONG_CELL = 28
"""A cell of a table with more characters is kept wide."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """Key figure at the top of a page."""

    value: Cell
    """The figure; numbers are formatted with at most four digits."""
    label: str
    """Name of the figure, with its unit."""
    tone: Literal["plain", "good", "bad"] = "plain"
    """Colour of the figure."""


class Page:
    """A page that is built from top to bottom; all text is escaped.

    Every method adds one element and returns the page, so that calls can be chained::

        Page("Run 7").section("Learning").charts(chart).save(Path("report.html"))
    """

    def __init__(self, title: str, lead: str = "") -> None:
        self.title = title
        self._parts = [f"<h1>{escape_text(title)}</h1>"]
        if lead:
            self._parts.append(f'<p class="lead">{escape_text(lead)}</p>')
        self._footer = ""

    def section(self, title: str, text: str = "") -> Page:
        """Begin a section with an optional paragraph."""
        self._parts.append(f"<h2>{escape_text(title)}</h2>")
        return self.text(text) if text else self

    def text(self, text: str) -> Page:
        """Add a paragraph; text between backquotes becomes code."""
        pieces = escape_text(text).split("`")
        if len(pieces) % 2:
            pieces[1::2] = [f"<code>{piece}</code>" for piece in pieces[1::2]]
            return self._add(f"<p>{''.join(pieces)}</p>")
        return self._add(f"<p>{escape_text(text)}</p>")

    def code(self, text: str) -> Page:
        """Add preformatted lines."""
        return self._add(f"<pre>{escape_text(text)}</pre>")

    def links(self, addresses: Mapping[str, str]) -> Page:
        """Add links to files beside the page: texts and relative paths."""
        items = [
            f'<a href="{escape_text(to)}">{escape_text(text)}</a>' for text, to in addresses.items()
        ]
        return self._add(f"<p>{', '.join(items)}</p>")

    def tiles(self, *tiles: Tile) -> Page:
        """Add a row of key figures."""
        items = [
            f'<div class="tile {tile.tone}"><b>{escape_text(format_number(tile.value))}</b>'
            f"<span>{escape_text(tile.label)}</span></div>"
            for tile in tiles
        ]
        return self._add(f'<div class="tiles">{"".join(items)}</div>')

    def table(
        self, header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = ""
    ) -> Page:
        """Add a table; columns of numbers are aligned to the right.

        Args:
            header: Titles of the columns, with units.
            rows: One sequence for each row, as long as ``header``.
            caption: Caption of the table.
        """
        for row in rows:
            if len(row) != len(header):
                raise ValueError(f"row {row} has {len(row)} cells; the header has {len(header)}")
        numeric = [
            any(_is_number(row[i]) for row in rows)
            and all(_is_number(row[i]) or row[i] is None for row in rows)
            for i in range(len(header))
        ]
        head = _row("th", header, numeric)
        body = "".join(_row("td", row, numeric) for row in rows)
        title = f"<caption>{escape_text(caption)}</caption>" if caption else ""
        # Focusable, so that it can be scrolled with the keyboard.
        name = escape_text(caption or "table")
        return self._add(
            f'<div class="scroll" tabindex="0" role="region" aria-label="{name}">'
            f"<table>{title}<thead>{head}</thead><tbody>{body}</tbody></table></div>"
        )

    def pairs(self, values: Mapping[str, Cell], caption: str = "") -> Page:
        """Add a table of names and values."""
        self.table(["name", "value"], [(k, format_number(v)) for k, v in values.items()], caption)
        self._parts[-1] = self._parts[-1].replace("<table>", '<table class="pairs">', 1)
        return self

    def charts(self, *charts: Chart) -> Page:
        """Add charts, side by side if they fit."""
        figures = "".join(chart.figure() for chart in charts)
        return self._add(f'<div class="figures">{figures}</div>')

    def png(self, content: bytes | Path, caption: str, alt: str = "") -> Page:
        """Add a PNG image; ``alt`` describes it, and defaults to the caption."""
        data = _base64(content, b"\x89PNG\r\n\x1a\n", 0)
        image = f'<img alt="{escape_text(alt or caption)}" src="data:image/png;base64,{data}">'
        return self._figure(image, caption)

    def mp4(self, content: bytes | Path, caption: str) -> Page:
        """Add an MP4 video with controls."""
        data = _base64(content, b"ftyp", 4)
        video = (
            f'<video controls muted loop playsinline preload="metadata" '
            f'aria-label="{escape_text(caption)}" src="data:video/mp4;base64,{data}"></video>'
        )
        return self._figure(video, caption)

    def footer(self, command: str, versions: Mapping[str, str]) -> Page:
        """Set the footer: the command and the versions that made the page."""
        listed = ", ".join(f"{name} {version}" for name, version in versions.items())
        listed = ", ".join(filter(None, [f"Python {platform.python_version()}", listed]))
        self._footer = (
            f"<footer><p>Made by <code>{escape_text(command)}</code></p>"
            f"<p>{escape_text(listed)}</p></footer>"
        )
        return self

    def html(self) -> str:
        """Return the HTML of the page."""
        style = resources.files("articulate.page").joinpath("style.css").read_text("utf-8")
        head = (
            '<meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width,initial-scale=1">'
            f"<title>{escape_text(self.title)}</title><style>{style}</style>"
        )
        body = "\n".join(self._parts)
        return (
            f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
            f"<body><main>\n{body}\n{self._footer}</main></body></html>\n"
        )

    def save(self, path: Path) -> Path:
        """Write the page atomically and return its path."""
        write_text(path, self.html())
        return path

    def _figure(self, inner: str, caption: str) -> Page:
        return self._add(f"<figure>{inner}<figcaption>{escape_text(caption)}</figcaption></figure>")

    def _add(self, part: str) -> Page:
        self._parts.append(part)
        return self


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, (int, float)) and not isinstance(cell, bool)


def _row(tag: str, cells: Sequence[Cell], numeric: Sequence[bool]) -> str:
    scope = ' scope="col"' if tag == "th" else ""
    items = []
    for cell, is_number in zip(cells, numeric, strict=True):
        text = format_number(cell)
        # n: aligned to the right; w: text that is wide before it breaks into lines
        kind = ' class="n"' if is_number else ' class="w"' if len(text) > LONG_CELL else ""
        items.append(f"<{tag}{scope}{kind}>{escape_text(text)}</{tag}>")
    return f"<tr>{''.join(items)}</tr>"


def _base64(content: bytes | Path, magic: bytes, at: int) -> str:
    """Encode ``content`` for a data URL; reject files without the magic bytes of their kind."""
    data = content.read_bytes() if isinstance(content, Path) else content
    if data[at : at + len(magic)] != magic:
        raise ValueError(f"not the expected kind of file: {data[:12]!r}")
    return base64.b64encode(data).decode("ascii")
