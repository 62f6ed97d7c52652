"""Builds one HTML file that needs nothing else: no script, no font, no address."""

from __future__ import annotations

import base64
import html
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Literal

from articulate.files import write_text
from articulate.page.chart import Chart
from articulate.page.numbers import shown
from articulate.page.violin import Violins

Cell = str | int | float | bool | None

LONG_CELL = 28
"""Letters beyond which a cell of a table is kept wide."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A key figure: what one looks for first."""

    value: Cell
    """The figure; numbers are shown with four digits at most."""
    label: str
    """What it is, with its unit."""
    tone: Literal["plain", "good", "bad"] = "plain"
    """Colour of the figure."""


class Page:
    """A page that grows from top to bottom; all text given to it is escaped.

    Every method adds one element and returns the page, so that calls can be chained::

        Page("Run 7").section("Learning").charts(chart).save(Path("report.html"))
    """

    def __init__(self, title: str, lead: str = "") -> None:
        self.title = title
        self._parts = [f"<h1>{_text(title)}</h1>"]
        if lead:
            self._parts.append(f'<p class="lead">{_text(lead)}</p>')
        self._footer = ""

    def section(self, title: str, text: str = "") -> Page:
        """Begin a section, with a paragraph below its title if ``text`` is given."""
        self._parts.append(f"<h2>{_text(title)}</h2>")
        return self.text(text) if text else self

    def text(self, text: str) -> Page:
        """Add a paragraph; what stands between backquotes is set as code."""
        pieces = _text(text).split("`")
        if len(pieces) % 2:
            pieces[1::2] = [f"<code>{piece}</code>" for piece in pieces[1::2]]
            return self._add(f"<p>{''.join(pieces)}</p>")
        return self._add(f"<p>{_text(text)}</p>")

    def code(self, text: str) -> Page:
        """Add lines of code or of a command, as they are."""
        return self._add(f"<pre>{_text(text)}</pre>")

    def links(self, addresses: Mapping[str, str]) -> Page:
        """Add links to files beside the page: texts and relative paths."""
        items = [f'<a href="{_text(to)}">{_text(text)}</a>' for text, to in addresses.items()]
        return self._add(f"<p>{', '.join(items)}</p>")

    def tiles(self, *tiles: Tile) -> Page:
        """Add a row of key figures."""
        items = [
            f'<div class="tile {tile.tone}"><b>{_text(shown(tile.value))}</b>'
            f"<span>{_text(tile.label)}</span></div>"
            for tile in tiles
        ]
        return self._add(f'<div class="tiles">{"".join(items)}</div>')

    def table(
        self, header: Sequence[str], rows: Sequence[Sequence[Cell]], caption: str = ""
    ) -> Page:
        """Add a table; columns that hold numbers only are set to the right.

        Args:
            header: Titles of the columns, units in them.
            rows: One sequence a row, as long as ``header``.
            caption: What the table shows.
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
        title = f"<caption>{_text(caption)}</caption>" if caption else ""
        # Focusable, so that it can be scrolled without a pointer.
        name = _text(caption or "table")
        return self._add(
            f'<div class="scroll" tabindex="0" role="region" aria-label="{name}">'
            f"<table>{title}<thead>{head}</thead><tbody>{body}</tbody></table></div>"
        )

    def pairs(self, values: Mapping[str, Cell], caption: str = "") -> Page:
        """Add a table of names and values."""
        self.table(["name", "value"], [(k, shown(v)) for k, v in values.items()], caption)
        self._parts[-1] = self._parts[-1].replace("<table>", '<table class="pairs">', 1)
        return self

    def charts(self, *charts: Chart | Violins) -> Page:
        """Add charts, side by side where there is room."""
        figures = "".join(chart.figure() for chart in charts)
        return self._add(f'<div class="figures">{figures}</div>')

    def png(self, content: bytes | Path, caption: str, alt: str = "") -> Page:
        """Add a PNG picture; ``alt`` says what is to be seen on it, the caption if empty."""
        data = _base64(content, b"\x89PNG\r\n\x1a\n", 0)
        image = f'<img alt="{_text(alt or caption)}" src="data:image/png;base64,{data}">'
        return self._figure(image, caption)

    def mp4(self, content: bytes | Path, caption: str) -> Page:
        """Add an MP4 clip that plays on request."""
        data = _base64(content, b"ftyp", 4)
        video = (
            f'<video controls muted loop playsinline preload="metadata" '
            f'aria-label="{_text(caption)}" src="data:video/mp4;base64,{data}"></video>'
        )
        return self._figure(video, caption)

    def footer(self, command: str, versions: Mapping[str, str]) -> Page:
        """Set the foot: the command that made the page and the versions it ran with."""
        listed = ", ".join(f"{name} {version}" for name, version in versions.items())
        listed = ", ".join(filter(None, [f"Python {platform.python_version()}", listed]))
        self._footer = (
            f"<footer><p>Made by <code>{_text(command)}</code></p><p>{_text(listed)}</p></footer>"
        )
        return self

    def html(self) -> str:
        """The whole page."""
        style = resources.files("articulate.page").joinpath("style.css").read_text("utf-8")
        head = (
            '<meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width,initial-scale=1">'
            f"<title>{_text(self.title)}</title><style>{style}</style>"
        )
        body = "\n".join(self._parts)
        return (
            f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
            f"<body><main>\n{body}\n{self._footer}</main></body></html>\n"
        )

    def save(self, path: Path) -> Path:
        """Write the page to ``path``, whole or not at all, and return the path."""
        write_text(path, self.html())
        return path

    def _figure(self, inner: str, caption: str) -> Page:
        return self._add(f"<figure>{inner}<figcaption>{_text(caption)}</figcaption></figure>")

    def _add(self, part: str) -> Page:
        self._parts.append(part)
        return self


def _text(text: object) -> str:
    return html.escape(str(text), quote=True)


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, (int, float)) and not isinstance(cell, bool)


def _row(tag: str, cells: Sequence[Cell], numeric: Sequence[bool]) -> str:
    scope = ' scope="col"' if tag == "th" else ""
    items = []
    for cell, is_number in zip(cells, numeric, strict=True):
        text = shown(cell)
        # n: set to the right; w: text that wants room before it breaks into lines
        kind = ' class="n"' if is_number else ' class="w"' if len(text) > LONG_CELL else ""
        items.append(f"<{tag}{scope}{kind}>{_text(text)}</{tag}>")
    return f"<tr>{''.join(items)}</tr>"


def _base64(content: bytes | Path, magic: bytes, at: int) -> str:
    """``content`` for a data address; refuses what does not begin as its kind does."""
    data = content.read_bytes() if isinstance(content, Path) else content
    if data[at : at + len(magic)] != magic:
        raise ValueError(f"not the expected kind of file: {data[:12]!r}")
    return base64.b64encode(data).decode("ascii")
