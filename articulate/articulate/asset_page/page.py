"""Write the page of one check report: verdict, 3-D view, images and all measurements."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path

from articulate.asset_page.images import MAX_OPEN, AssetImage, AssetImages, render_images
from articulate.asset_page.viewer import viewer_html
from articulate.assets.asset import Asset
from articulate.assets.check_report import Check, CheckReport, JointCheck
from articulate.checks.model import ObjectModel, load_model
from articulate.errors import AssetError, MissingError
from articulate.files import write_bytes
from articulate.page import Page, Tile
from articulate.page.text import escape_text, format_number

OUTCOME_TEXT = {
    "passed": "passed",
    "failed": "failed",
    "warning": "warning",
    "undecided": "undecided",
    "not_applicable": "not applicable",
}
THIN = "\N{NARROW NO-BREAK SPACE}"
FEW = 12
"""Longer lists are collapsed."""


def write_page(
    check_report: CheckReport,
    asset: Asset | None,
    path: Path,
    *,
    meanings: Mapping[str, str] | None = None,
) -> None:
    """Write the page of ``check_report`` to ``path``, and a thumbnail beside it as ``.webp``.

    The page needs no other file. Without an OpenGL driver it has no images.

    Args:
        check_report: Content of the page.
        asset: Checked asset; None if none could be made.
        path: File that is written, completely or not at all.
        meanings: Meaning of each check by its name, one sentence.
    """
    page = ReportPage(check_report.asset, _lead(check_report, asset))
    page.verdict(check_report)
    if asset is None:
        page.text("No asset could be made of the input.")
    else:
        images = _show(page, check_report, asset)
        if images is not None:
            write_bytes(path.with_suffix(".webp"), images.thumbnail)
    _figures(page, check_report)
    _joints(page, check_report)
    _checks(page, check_report.checks, meanings or {})
    _repairs(page, check_report)
    _origin(page, check_report, asset)
    page.save(path)


class ReportPage(Page):
    """Page with the elements of check reports: verdicts, marks, images, lists, collapsed parts."""

    def __init__(self, title: str, lead: str = "") -> None:
        super().__init__(title, lead)
        assets = resources.files("articulate.asset_page").joinpath("assets")
        self._add(f"<style>{assets.joinpath('check_report.css').read_text('utf-8')}</style>")

    def verdict(self, check_report: CheckReport) -> None:
        """Add the verdict and its reasons."""
        title, text = verdict_text(check_report)
        reasons = "".join(f"<li>{escape_text(reason)}</li>" for reason in check_report.reasons)
        self._add(
            f'<div class="verdict {check_report.verdict}"><b>{escape_text(title)}</b>'
            f"<p>{escape_text(text)}</p>{f'<ul>{reasons}</ul>' if reasons else ''}</div>"
        )

    def view(self, inner: str) -> None:
        """Add a 3-D view; ``inner`` is HTML."""
        self._add(inner)

    def images(self, images: Iterable[AssetImage]) -> None:
        """Add images side by side."""
        figures = "".join(
            f'<figure><img alt="{escape_text(p.caption)}" loading="lazy" '
            f'src="data:image/webp;base64,{base64.b64encode(p.webp).decode("ascii")}">'
            f"<figcaption>{escape_text(p.caption)}</figcaption></figure>"
            for p in images
        )
        self._add(f'<div class="images">{figures}</div>')

    def lines(self, lines: Sequence[str]) -> None:
        """Add a list of sentences."""
        items = "".join(f"<li>{escape_text(line)}</li>" for line in lines)
        self._add(f'<ul class="plain">{items}</ul>')

    def fold(self, title: str) -> None:
        """Begin a collapsed part; :meth:`unfold` ends it."""
        self._add(f"<details><summary>{escape_text(title)}</summary>")

    def unfold(self) -> None:
        """End the collapsed part."""
        self._add("</details>")

    def outcome_table(
        self,
        header: Sequence[str],
        rows: Sequence[tuple[str, Sequence[str]]],
        name: str,
        *,
        wide: bool = True,
    ) -> None:
        """Add a table of rows that carry an outcome; cells are HTML, the header is text.

        Args:
            header: Titles of the columns.
            rows: Outcome and cells of each row.
            name: Description of the table for screen readers.
            wide: Show each row as a card if the window is narrow.
        """
        head = "".join(f'<th scope="col">{escape_text(title)}</th>' for title in header)
        body = "".join(
            f'<tr class="{outcome}">{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>'
            for outcome, cells in rows
        )
        kind = "evidence cards" if wide else "evidence"
        self._add(
            f'<div class="scroll {kind}" tabindex="0" role="region" '
            f'aria-label="{escape_text(name)}">'
            f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        )


def verdict_text(check_report: CheckReport) -> tuple[str, str]:
    """Return the verdict of ``check_report`` as a headline and a sentence."""
    counted = [c for c in check_report.checks if c.outcome != "not_applicable"]
    held = sum(c.outcome == "passed" for c in counted)
    if not check_report.is_usable:
        headline = check_report.verdict.capitalize()
        if not counted:
            return headline, "It was not measured:"
        return headline, f"{held} of {len(counted)} measurements passed. Reasons:"
    warnings = sum(c.outcome == "warning" for c in counted)
    what = (
        f"All {len(counted)} measurements passed." if counted else "There was nothing to measure."
    )
    if warnings:
        what = f"{held} of {len(counted)} measurements passed, {warnings} with an accepted warning."
    if not check_report.joints:
        what = f"It has no movable joint and was checked as a rigid object. {what}"
    if check_report.verdict == "passed":
        return "Passed", f"{what} Nothing had to be repaired."
    repairs = _count(len(check_report.repairs), "repair")
    return f"Passed after {repairs}", f"{what} What was changed is listed below."


def amount(value: float | None, unit: str) -> str:
    """Return a figure with a readable unit: millimetres, degrees or per cent."""
    if value is None:
        return ""
    factor, name = {"m": (1000.0, "mm"), "rad": (57.29577951308232, "°"), "1": (100.0, "%")}.get(
        unit, (1.0, unit)
    )
    number = format_number(float(f"{factor * value:.4g}"))
    return f"{number}{THIN if name != '°' else ''}{name}".strip()


def bound(checks: Sequence[Check]) -> str:
    """Return ``"≤"`` or ``"≥"``, the comparison of measured and allowed values of one check.

    It is derived from outcomes: a measurement that passed below the limit has an upper limit.
    """
    for check in checks:
        if check.measured is None or check.allowed is None or check.measured == check.allowed:
            continue
        if check.outcome in ("passed", "failed"):
            small = (check.measured < check.allowed) == (check.outcome == "passed")
            return "≤" if small else "≥"
    return ""


def _lead(check_report: CheckReport, asset: Asset | None) -> str:
    known = [] if asset is None or asset.category == "unknown" else [asset.category]
    if check_report.joints:
        known.append(_count(len(check_report.joints), "joint"))
    if asset is not None:
        size = (b - a for a, b in zip(*asset.bounds_o, strict=True))
        known.append(" × ".join(f"{100.0 * side:.0f}" for side in size) + " cm")
    if check_report.seconds:
        known.append(f"converted and checked in {check_report.seconds:.1f} s")
    return " · ".join(known)


def _show(page: ReportPage, check_report: CheckReport, asset: Asset) -> AssetImages | None:
    """Add the 3-D view and the images, or the reason why there are none."""
    try:
        subject = load_model(asset)
    except AssetError as error:
        page.text(f"There is no 3-D view and no image: {error}.")
        return None
    needs = {joint.name: joint.needs for joint in check_report.joints if joint.needs}
    page.view(viewer_html(subject, needs))
    return _images(page, subject, needs)


def _images(
    page: ReportPage, subject: ObjectModel, needs: Mapping[str, tuple[str, ...]]
) -> AssetImages | None:
    page.section("Images")
    try:
        images = render_images(subject, needs)
    except (MissingError, AssetError) as error:
        page.text(f"No images: {error}.")
        return None
    page.images(images.in_order)
    if len(subject.free_joints) > MAX_OPEN:
        page.text(
            f"Of {len(subject.free_joints)} joints the images show the first {MAX_OPEN} open."
        )
    return images


def _figures(page: ReportPage, check_report: CheckReport) -> None:
    counted = [c for c in check_report.checks if c.outcome != "not_applicable"]
    held = sum(c.outcome == "passed" for c in counted)
    tiles = []
    if counted:
        tiles.append(_share_tile(held, len(counted), "measurements passed"))
    if check_report.joints:
        free = sum(not joint.blocked for joint in check_report.joints)
        tiles.append(_share_tile(free, len(check_report.joints), "joints move through their range"))
    tried = [c for c in counted if c.name == "opening"]
    if tried:
        opened = sum(c.outcome == "passed" for c in tried)
        tiles.append(_share_tile(opened, len(tried), "joints open under 30 N"))
    tiles.append(Tile(value=check_report.colliders, label="collision shapes"))
    if check_report.step_us is not None:
        tiles.append(Tile(value=float(f"{check_report.step_us:.3g}"), label="physics step [µs]"))
    page.tiles(*tiles)


def _share_tile(part: int, total: int, label: str) -> Tile:
    return Tile(
        value=f"{part}{THIN}/{THIN}{total}", label=label, tone="good" if part == total else "bad"
    )


def _joints(page: ReportPage, check_report: CheckReport) -> None:
    if not check_report.joints:
        return
    page.section("Joints")
    rows = [(_joint_outcome(joint), _joint_cells(joint)) for joint in check_report.joints]
    header = ["joint", "moves", "free of others", "opened by 30 N", "needs"]
    page.outcome_table(header, rows, "joints", wide=False)


def _joint_outcome(joint: JointCheck) -> str:
    return "failed" if joint.blocked else "passed"


def _joint_cells(joint: JointCheck) -> list[str]:
    travel = amount(abs(joint.span), "m" if joint.kind == "slide" else "rad")
    kind = "slides" if joint.kind == "slide" else "turns"
    limits = "without limits"
    if joint.lower is not None and joint.upper is not None:
        limits = f"limits {joint.lower:.3g} to {joint.upper:.3g}"
    free = f"{100.0 * joint.swept:.0f}{THIN}% of its travel"
    if joint.blocked:
        free = f'<span class="mark failed">blocked</span><small>{free} is free</small>'
    opened = "not tried" if joint.opened is None else f"{100.0 * joint.opened:.0f}{THIN}%"
    needs = f"{escape_text(', '.join(joint.needs))} open" if joint.needs else "–"
    return [
        f"<b>{escape_text(joint.name)}</b>",
        f"{kind} {travel}<small>{limits}</small>",
        free,
        opened,
        needs,
    ]


def _checks(page: ReportPage, checks: Sequence[Check], meanings: Mapping[str, str]) -> None:
    if not checks:
        return
    page.section("Checks")
    names = list(dict.fromkeys(check.name for check in checks))
    names.sort(key=lambda name: not any(c.outcome == "failed" for c in checks if c.name == name))
    rows: list[tuple[str, list[str]]] = []
    for name in names:
        rows += _check_rows([c for c in checks if c.name == name], meanings.get(name, ""))
    header = ["check", "outcome", "measured", "allowed", "result"]
    page.outcome_table(header, rows, "checks")
    page.text("`check-asset --explain CHECK` explains a check: meaning, importance and remedy.")
    page.fold(f"All {len(checks)} measurements")
    every = [
        (
            c.outcome,
            [escape_text(c.name), escape_text(c.subject or "–"), *_measured_cells(c, checks)],
        )
        for c in checks
    ]
    header = ["check", "subject", "outcome", "measured", "allowed", "result"]
    page.outcome_table(header, every, "all measurements")
    page.unfold()


def _check_rows(group: Sequence[Check], meaning: str) -> list[tuple[str, list[str]]]:
    """Return a row for every failure of one check, and one row for all that passed."""
    title = f"<b>{escape_text(group[0].name)}</b>"
    failed = [c for c in group if c.outcome in ("failed", "warning", "undecided")]
    passed = [c for c in group if c.outcome == "passed"]
    rows: list[tuple[str, list[str]]] = []
    for check in failed:
        about = f"<b>{escape_text(check.subject)}</b>: " if check.subject else ""
        *figures, message = _measured_cells(check, group)
        rows.append((check.outcome, [title, *figures, about + message]))
    if passed:
        sign = bound(group)
        mark, measured, allowed, message = _measured_cells(_worst(passed, sign), group)
        if len(passed) > 1:
            of = (
                f"all {len(group)}"
                if len(passed) == len(group)
                else f"{len(passed)} of {len(group)}"
            )
            mark += f"<small>{of}</small>"
            about = escape_text(_worst(passed, sign).subject)
            about = f", {about}" if about else ""
            message = f"<small>closest to the limit{about}:</small>{message}" if sign else message
        rows.append(("passed", [title, mark, measured, allowed, message]))
    if not rows:
        *figures, message = _measured_cells(group[0], group)
        reasons = list(dict.fromkeys(c.message for c in group))
        more = f"<small>and {len(reasons) - 1} other reasons</small>" if len(reasons) > 1 else ""
        rows.append(("not_applicable", [title, *figures, message + more]))
    if meaning:
        rows[0][1][-1] += f"<small>{escape_text(meaning)}</small>"
    return rows


def _worst(passed: Sequence[Check], sign: str) -> Check:
    """Return the measurement closest to the limit."""
    known = [c for c in passed if c.measured is not None]
    if not known or not sign:
        return (known or list(passed))[0]
    return (max if sign == "≤" else min)(known, key=lambda c: c.measured or 0.0)


def _measured_cells(check: Check, peers: Sequence[Check]) -> list[str]:
    """Return outcome, measured value, limit and message of a check as HTML."""
    mark = f'<span class="mark {check.outcome}">{OUTCOME_TEXT[check.outcome]}</span>'
    sign = bound([c for c in peers if c.name == check.name])
    allowed = amount(check.allowed, check.unit)
    limit = f"{sign} {allowed}".strip() if allowed else "–"
    measured = amount(check.measured, check.unit) or "–"
    cells = [escape_text(text).replace(" ", "&nbsp;") for text in (measured, limit)]
    return [mark, *cells, escape_text(check.message)]


def _repairs(page: ReportPage, check_report: CheckReport) -> None:
    page.section("Changes")
    if not check_report.repairs:
        page.text("None.")
        return
    if len(check_report.repairs) > FEW:
        page.fold(f"{len(check_report.repairs)} changes")
    page.lines(check_report.repairs)
    if len(check_report.repairs) > FEW:
        page.unfold()


def _origin(page: ReportPage, check_report: CheckReport, asset: Asset | None) -> None:
    page.section("Source")
    if check_report.counts is not None:
        counts = check_report.counts
        page.table(
            ["", "in the input", "in the asset"],
            [
                [name, *getattr(counts, name)]
                for name in ("links", "joints", "visuals", "collisions")
            ],
        )
    about = {"source": check_report.source, "licence": check_report.licence}
    if asset is not None:
        about["size"] = asset.size_rule or "as in the input"
        about["mass"] = f"{sum(link.mass_kg for link in asset.links):.3g} kg"
    page.pairs(about)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
