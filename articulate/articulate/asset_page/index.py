"""Write the page that lists many check reports, to be sorted and filtered in the browser."""

from __future__ import annotations

import base64
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from urllib.parse import quote

from articulate.asset_page.page import ReportPage
from articulate.assets.check_report import CheckReport, Verdict
from articulate.errors import shorten
from articulate.page import Tile
from articulate.page.text import escape_text

VERDICT_TEXT: dict[Verdict, str] = {
    "rejected": "rejected",
    "undecided": "undecided",
    "repaired": "repaired",
    "passed": "passed",
}
"""In the order of the rows: objects that require attention come first."""
LONGEST_REASON = 240
"""Characters of a reason in the list; the page of the object has all."""
HEADER = ("", "object", "verdict", "category", "why", "joints", "collision shapes", "seconds")


@dataclass(frozen=True, kw_only=True)
class IndexRow:
    """One check report in the list."""

    check_report: CheckReport
    category: str = "unknown"
    """Category of the object."""
    page: Path | None = None
    """Its page; an image of the same name with the suffix ``.webp`` is included."""


def write_index(rows: Sequence[IndexRow], path: Path, *, title: str = "Check reports") -> None:
    """Write the page that lists ``rows``, with links to their pages, completely or not at all.

    Args:
        rows: Entries; rejected ones come first, then by name.
        path: File that is written. Images are embedded, links are relative to it.
        title: Headline.
    """
    counts = Counter(row.check_report.verdict for row in rows)
    good = counts["passed"] + counts["repaired"]
    page = ReportPage(title, f"{good} of {len(rows)} objects passed, some after repairs.")
    page.tiles(
        Tile(value=counts["passed"], label="passed as they are", tone="good"),
        Tile(value=counts["repaired"], label="passed after listed repairs", tone="good"),
        Tile(
            value=counts["rejected"],
            label="rejected with a reason",
            tone="bad" if counts["rejected"] else "plain",
        ),
        Tile(value=counts["undecided"], label="undecided"),
    )
    order = list(VERDICT_TEXT)
    listed = sorted(
        rows, key=lambda row: (order.index(row.check_report.verdict), row.check_report.asset)
    )
    body = "".join(_row(row, path.parent) for row in listed)
    head = "".join(_head(k, name) for k, name in enumerate(HEADER))
    script = resources.files("articulate.asset_page").joinpath("assets/index.js").read_text("utf-8")
    page.view(
        f'{_filters(counts)}<div class="scroll index" tabindex="0" role="region" '
        f'aria-label="objects"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        f"</div><script>{script}</script>"
    )
    page.save(path)


def _filters(counts: Counter[Verdict]) -> str:
    buttons = "".join(
        f'<button type="button" data-verdict="{verdict}" aria-pressed="false">'
        f"{text} {counts[verdict]}</button>"
        for verdict, text in VERDICT_TEXT.items()
    )
    return (
        '<div class="filters"><button type="button" data-verdict="" aria-pressed="true">all '
        f"{sum(counts.values())}</button>{buttons}"
        '<input type="search" placeholder="name, category or reason" aria-label="search"></div>'
    )


def _head(column: int, name: str) -> str:
    if not name:
        return '<th scope="col"></th>'
    kind = ' class="n"' if column > 4 else ""
    return (
        f'<th scope="col"{kind} data-column="{column}"><button type="button">{name}</button></th>'
    )


def _row(row: IndexRow, folder: Path) -> str:
    check_report = row.check_report
    name = escape_text(check_report.asset)
    if row.page is not None:
        name = f'<a href="{escape_text(_address(row.page, folder))}">{name}</a>'
    cells = [
        _image(row.page),
        name,
        f'<span class="mark {"passed" if check_report.is_usable else "failed"}">'
        f"{VERDICT_TEXT[check_report.verdict]}</span>",
        escape_text(row.category),
        escape_text(_why(check_report)),
    ]
    keys = [
        "",
        check_report.asset,
        list(VERDICT_TEXT).index(check_report.verdict),
        row.category,
        _why(check_report),
    ]
    kinds = ["", "", "", "", ' class="why"']
    for value, text in (
        (len(check_report.joints), str(len(check_report.joints))),
        (check_report.colliders, str(check_report.colliders)),
        (check_report.seconds, f"{check_report.seconds:.1f}"),
    ):
        keys.append(value)
        cells.append(text)
        kinds.append(' class="n"')
    inner = "".join(
        f'<td{kind} data-key="{escape_text(key)}">{cell}</td>'
        for kind, key, cell in zip(kinds, keys, cells, strict=True)
    )
    return f'<tr class="{check_report.verdict}" data-verdict="{check_report.verdict}">{inner}</tr>'


def _why(check_report: CheckReport) -> str:
    if check_report.verdict == "passed":
        return ""
    texts = check_report.repairs if check_report.is_usable else check_report.reasons
    if not texts:
        return ""
    first = shorten(texts[0], LONGEST_REASON)
    return first if len(texts) == 1 else f"{first} (+ {len(texts) - 1} more)"


def _image(page: Path | None) -> str:
    path = None if page is None else page.with_suffix(".webp")
    if path is None or not path.is_file():
        return '<span class="blank"></span>'
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="" loading="lazy" src="data:image/webp;base64,{data}">'


def _address(page: Path, folder: Path) -> str:
    relative = os.path.relpath(page.resolve(), folder.resolve())
    return quote(Path(relative).as_posix())
