"""The page of a report: what people look at and show each other.

::

    report.json     every figure; success_rate at its top level
    report.html     the same figures, drawn; opens anywhere, offline
    videos/         clips that the page plays, if there are any
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal
from urllib.parse import quote

import numpy as np

from articulate.files import write_json, write_text
from articulate.page import Bars, Chart, Line, Page, Points, Tile
from articulate.task.episode_monitor import REASONS
from articulate.task.task import done_word
from articulate.transforms import Array
from articulate_envs.rewards import TERMS
from articulate_train.report import Parameter, Report, Timeline
from articulate_train.statistics import Share, percent

MAX_POSTER_BYTES = 2_000_000
"""Largest picture that is put into the page."""
MAX_EMBEDDED_BYTES = 1_500_000
"""Largest clip that is put into the page; a larger one is played from beside it."""
FIRST_FRAME = "#t=0.05"
"""Behind an address of a clip: phones show its beginning, and not an empty box, before it plays."""
GOOD, BAD = 0.9, 0.5
"""From the first on, a success rate is shown as good; below the second, as bad."""
SHOWN_PARAMETERS = 6
"""Parameters that get a chart; all are in the table."""
SHOWN_TERMS = 8
"""Terms of the reward that get a line."""
REASON_TEXT = {
    "success": "success",
    "touch": "arm touched the object",
    "speed": "joint too fast",
    "torque": "joint torque too high",
    "torque_rate": "joint torque rose too fast",
    "force": "force on the hand too high",
    "moment": "moment on the hand too high",
    "not_open": "not open at the end",
    "moving": "at the target, but not at rest",
    "diverged": "simulation diverged",
    "not_closed": "not closed at the end",
}
"""What a reader is told of :data:`articulate.task.episode_monitor.REASONS`."""
PEAK_TEXT = {
    "force": "force, 50 ms filter [N]",
    "force_short": "force, 10 ms filter [N]",
    "force_raw": "force, raw [N]",
    "moment": "moment on the hand [Nm]",
    "speed_share": "joint speed / its limit",
    "torque_share": "joint torque / its limit",
    "torque_rate": "joint torque rate [Nm/s]",
}
"""What a reader is told of the peaks; short, so that numbers beside them fit on a phone."""
PARAMETER_TEXT = {
    "friction": "finger friction, factor",
    "joint_damping": "joint damping, factor",
    "joint_friction": "joint dry friction, factor",
    "armature": "armature of the arm, factor",
    "mass": "mass of moving parts, factor",
    "stiffness": "arm stiffness, factor",
    "damping": "arm damping, factor",
    "scale": "size of the object, factor",
    "x_m": "shift forward [m]",
    "y_m": "shift to the left [m]",
    "yaw_rad": "turn of the object [rad]",
    "delay_ticks": "delay of actions [ticks]",
    "hand_latency_s": "latency of the hand [s]",
    "bias_x_m": "handle error, x [m]",
    "bias_y_m": "handle error, y [m]",
    "bias_z_m": "handle error, z [m]",
    "bias_yaw_rad": "handle error, yaw [rad]",
    "estimate_delay_ticks": "age of the state [ticks]",
    "push_x_n": "push, x [N]",
    "push_y_n": "push, y [N]",
    "push_z_n": "push, z [N]",
    "push_time": "time of the push, share",
    "part_open": "open at the beginning, share",
    "force_bias_x_n": "error of the felt force, x [N]",
    "force_bias_y_n": "error of the felt force, y [N]",
    "force_bias_z_n": "error of the felt force, z [N]",
    "distance_m": "shift, distance [m]",
    "start_rad": "start, distance [rad]",
    "bias_m": "handle error, distance [m]",
    "push_n": "push, strength [N]",
    "force_bias_n": "error of the felt force, strength [N]",
} | {f"start_{i}": f"start of joint {i} [rad]" for i in range(1, 8)}


def write_report(report: Report, folder: Path, *, poster: bytes | None = None) -> tuple[Path, Path]:
    """Write ``report.json`` and ``report.html`` into ``folder`` and return their paths.

    Small clips are put into the page itself, so that it can be passed on alone.

    Args:
        report: What is written.
        folder: Where to; the report's videos lie in it.
        poster: PNG shown at the top.
    """
    if poster is not None and len(poster) > MAX_POSTER_BYTES:
        poster = None
    page = report_page(report, folder, poster=poster, embed_videos=True)
    json_path, html_path = folder / "report.json", folder / "report.html"
    write_json(json_path, report.content())
    write_text(html_path, page)
    return json_path, html_path


def report_page(
    report: Report, folder: Path, *, poster: bytes | None = None, embed_videos: bool = False
) -> str:
    """The page as HTML; the arguments are those of :func:`write_report`."""
    info = report.info
    page = _ReportPage(
        f"{info.asset}: {info.task.replace('_', ' ')}",
        f"{info.name} · joint {info.joint} · {info.target_text}",
    )
    _headline(page, report)
    _pictures(page, report, folder, poster, embed_videos)
    _failures(page, report)
    _episodes(page, report)
    _seeds(page, report)
    _learning(page, report)
    _parameters(page, report)
    _peaks(page, report)
    _repeat(page, report)
    return page.html()


@dataclass(frozen=True)
class _Clip:
    """A clip and what is said of it."""

    source: str
    caption: str


class _ReportPage(Page):
    """A page that can also refer to clips beside it and fold away what few readers want."""

    def clips(self, clips: Sequence[_Clip]) -> None:
        """Add clips side by side; they play on request."""
        figures = "".join(
            f"<figure><figcaption><b>{_text(c.caption)}</b></figcaption>"
            '<video controls muted loop playsinline preload="metadata" width="480" height="360" '
            f'aria-label="{_text(c.caption)}" src="{_text(c.source)}"></video></figure>'
            for c in clips
        )
        self._add(f'<div class="figures">{figures}</div>')

    def fold(self, title: str) -> None:
        """Begin what is shown on request; :meth:`unfold` ends it."""
        self._add(f"<details><summary>{_text(title)}</summary>")

    def unfold(self) -> None:
        """End what :meth:`fold` began."""
        self._add("</details>")


def _headline(page: Page, report: Report) -> None:
    iqm, opened = report.success_iqm, report.opened_iqm
    rate, word = report.success_rate, done_word(report.info.task)
    tone: Literal["plain", "good", "bad"] = "plain"
    if rate >= GOOD or rate < BAD:
        tone = "good" if rate >= GOOD else "bad"
    tiles = [
        Tile(value=_percent(rate), label=f"success: {word}, within all limits", tone=tone),
        Tile(value=_percent(report.opened_rate), label=f"{word}, limits aside"),
        Tile(value=_percent(report.worst_seed_success_rate), label="success of the worst seed"),
    ]
    if report.nominal_success_rate is not None:
        nominal = _percent(report.nominal_success_rate)
        tiles.append(Tile(value=nominal, label="success without randomisation"))
    page.tiles(*tiles)
    seeds = len(report.seeds)
    if report.info.unfinished:
        page.text(f"Training is not over: {report.info.unfinished}.")
    over = f"Interquartile mean over seeds: success {_interval(iqm)}, {word} {_interval(opened)}. "
    page.text(
        f"{iqm.episodes} episodes with {seeds} trained {'policy' if seeds == 1 else 'policies'}. "
        f"{over if seeds > 1 else ''}"
        f"All episodes taken together: success {_interval(report.success_pooled)}."
    )


def _pictures(
    page: _ReportPage, report: Report, folder: Path, poster: bytes | None, embed: bool
) -> None:
    if poster is not None:
        page.png(poster, f"{report.info.asset}: the scene of this run.")
    clips = []
    for video in report.videos:
        clips.append(_Clip(_video_source(folder, video, embed), _clip_caption(report, video)))
    if clips:
        page.clips(clips)
    else:
        page.text("No clips were made.")


def _clip_caption(report: Report, video: str) -> str:
    stem = PurePosixPath(video).stem
    reasons = {line.name: line.reason for line in report.timelines}
    caption = stem.replace("_", " ").replace("-", " ").capitalize()
    if stem in reasons and reasons[stem] != stem:
        caption += f": {REASON_TEXT.get(reasons[stem], reasons[stem])}"
    return caption


def _video_source(folder: Path, video: str, embed: bool) -> str:
    path = folder / video
    if embed and path.is_file() and path.stat().st_size <= MAX_EMBEDDED_BYTES:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
        return f"data:video/mp4;base64,{data}{FIRST_FRAME}"
    return quote(video) + FIRST_FRAME


def _failures(page: Page, report: Report) -> None:
    page.section("What failed first")
    total = sum(report.reasons.values())
    if report.reasons.get("success", 0) == total:
        page.text(f"Nothing: all {total} episodes succeeded.")
        return
    page.text(
        "An episode fails by the first limit that it breaks; one that breaks none fails by how "
        "it ends."
    )
    page.charts(_reason_chart(report, total), _seed_chart(report))


def _reason_chart(report: Report, total: int) -> Chart:
    failed = {name: n for name, n in report.reasons.items() if name != "success"}
    when = {v.reason: v for v in report.violations}
    ordered = sorted(failed, key=lambda name: -failed[name])
    share = [100.0 * failed[name] / total for name in ordered]
    labels = []
    for name in ordered:
        label = f"{REASON_TEXT[name]}: {failed[name]}"
        if name in when:
            label += f", at {when[name].median_s:.1f} s in the median"
        labels.append(label)
    return Chart(
        title="Failures",
        marks=Bars(labels=labels, values=[round(s, 2) for s in share]),
        x_label=f"% of {total} episodes",
    )


def _seed_chart(report: Report) -> Chart:
    return Chart(
        title="Success by seed",
        marks=Bars(
            labels=[f"seed {s.seed}" for s in report.seeds],
            values=[round(100.0 * s.success.value, 1) for s in report.seeds],
            low=[100.0 * s.success.low for s in report.seeds],
            high=[100.0 * s.success.high for s in report.seeds],
        ),
        x_label="% of episodes, with 95 % intervals",
        x_range=(0.0, 100.0),
    )


def _episodes(page: _ReportPage, report: Report) -> None:
    if not report.timelines:
        return
    page.section("Two episodes" if len(report.timelines) > 1 else "One episode")
    for line in report.timelines:
        if line.name == "failure":
            page.text(f"The failure: {REASON_TEXT.get(line.reason, line.reason)}.")
    limits = report.info.limits
    page.charts(
        _timeline_chart(
            report, "How far it is open", "share of the way", "opened", report.info.target
        ),
        _timeline_chart(report, "Force on the hand", "N, 50 ms filter", "force_n", limits.force_n),
        _timeline_chart(
            report,
            "Fastest joint",
            "share of its limit",
            "speed_share",
            limits.speed_share,
        ),
    )
    _drawn(page, report.timelines)


def _drawn(page: _ReportPage, lines: Sequence[Timeline]) -> None:
    """What was drawn for the episodes that are shown."""
    told = [line for line in lines if line.drawn]
    if not told:
        return
    page.fold("What was drawn for " + ("it" if len(told) == 1 else "them"))
    page.table(
        ["parameter", *(line.name for line in told)],
        [
            [PARAMETER_TEXT.get(name, name), *(_rounded(line.drawn[name]) for line in told)]
            for name in told[0].drawn
        ],
    )
    page.unfold()


def _timeline_chart(report: Report, title: str, unit: str, name: str, goal: float) -> Chart:
    def values(line: Timeline) -> Array:
        return np.asarray(getattr(line, name), dtype=np.float64)

    what = "the target" if name == "opened" else "what is allowed"
    return Chart(
        title=title,
        marks=[Line(name=line.name, x=line.t, y=values(line)) for line in report.timelines],
        x_label="time [s]",
        y_label=unit,
        goal=goal,
        caption=f"Dashed: {what}, {goal:.3g}.",
    )


def _seeds(page: Page, report: Report) -> None:
    page.section("Seeds", "Shares with 95 % intervals (Wilson).")
    nominal = any(s.nominal_success is not None for s in report.seeds)
    word = done_word(report.info.task)
    known = any(s.policy_steps for s in report.seeds)
    header = ["seed", "success", word, *(["not randomised"] if nominal else [])]
    header += ["policy after"] if known else []
    rows: list[list[str]] = []
    for s in report.seeds:
        row = [str(s.seed), _interval(s.success), _interval(s.opened)]
        if nominal:
            row.append("–" if s.nominal_success is None else _interval(s.nominal_success))
        if known:
            after = f"{s.policy_steps / 1e6:.2f}M ticks" if s.policy_steps else "–"
            row.append(after if s.alone is None else f"{after}, member {s.alone} alone")
        rows.append(row)
    page.table(header, rows)
    seen = [r for r in REASONS if any(r in s.reasons for s in report.seeds)]
    page.table(
        ["ended by", *(f"seed {s.seed}" for s in report.seeds)],
        [[REASON_TEXT[r], *(s.reasons.get(r, 0) for s in report.seeds)] for r in seen],
    )


def _learning(page: Page, report: Report) -> None:
    if not report.curves:
        return
    page.section("Learning", "Training episodes from home, with the noise of exploration.")
    if not any(len(c.steps) for c in report.curves):
        page.text("The training was too short for curves: no episode ended in it.")
        return
    done = f"{done_word(report.info.task).capitalize()}, limits aside"
    charts = [
        Chart(
            title=title,
            marks=[
                Line(name=f"seed {c.seed}", x=c.steps, y=100.0 * getattr(c, name))
                for c in report.curves
            ],
            x_label="steps",
            y_label="% of episodes",
            y_range=(0.0, 100.0),
        )
        for title, name in (("Success", "success"), (done, "opened"))
    ]
    charts += _reward_charts(report)
    page.charts(*charts)


def _reward_charts(report: Report) -> list[Chart]:
    """The terms of the reward of the first seed that weigh most; the seeds' moments may differ."""
    first = report.curves[0]
    if not np.isfinite(first.reward_terms).any():
        return []
    weight = np.nanmax(np.abs(np.nan_to_num(first.reward_terms)), axis=0)
    order = [int(i) for i in np.argsort(-weight) if weight[i] > 0.0][:SHOWN_TERMS]
    return [
        Chart(
            title=f"Reward by term, seed {first.seed}",
            marks=[Line(name=TERMS[i], x=first.steps, y=first.reward_terms[:, i]) for i in order],
            x_label="steps",
            y_label="sum over an episode",
        )
    ]


def _parameters(page: _ReportPage, report: Report) -> None:
    if not report.parameters:
        return
    page.section(
        "What was randomised",
        "Success in ranges of equally many episodes, with 95 % intervals, for what divides "
        "success most unevenly. An unevenness of about 1 is chance.",
    )
    telling = [p for p in report.parameters[:SHOWN_PARAMETERS] if p.unevenness > 0.0]
    if telling:
        page.charts(*(_parameter_chart(p) for p in telling))
    rows: list[list[str | float | None]] = []
    for p in report.parameters:
        worst = min(p.bins, key=lambda b: b.success.value)
        rows.append(
            [
                PARAMETER_TEXT.get(p.name, p.name),
                round(p.unevenness, 1),
                round(100.0 * worst.success.value, 1),
                *(_rounded(v) for v in (worst.begin, worst.end, p.lowest, p.highest)),
            ]
        )
    page.fold(f"All {len(rows)} parameters")
    page.table(
        ["most uneven first", "unevenness", "worst %", "from", "to", "drawn from", "to"], rows
    )
    page.unfold()


def _parameter_chart(parameter: Parameter) -> Chart:
    bins = parameter.bins
    return Chart(
        title=f"{PARAMETER_TEXT.get(parameter.name, parameter.name)}",
        marks=[
            Points(
                name="success",
                x=[b.centre for b in bins],
                y=[100.0 * b.success.value for b in bins],
                low=[100.0 * b.success.low for b in bins],
                high=[100.0 * b.success.high for b in bins],
            )
        ],
        x_label="drawn value",
        y_label="success %",
        y_range=(min(50.0, 100.0 * min(b.success.low for b in bins)) // 10 * 10, 100.0),
        caption=f"Unevenness {parameter.unevenness:.1f}.",
    )


def _peaks(page: Page, report: Report) -> None:
    page.section("Peaks", "Over all episodes with randomisation.")
    rows: list[list[str | float | None]] = [
        [PEAK_TEXT[p.name], p.limit, *(_rounded(v) for v in (p.median, p.p95, p.largest))]
        for p in report.peaks
    ]
    page.table(["largest in an episode", "allowed", "median", "95 %", "largest"], rows)


def _repeat(page: _ReportPage, report: Report) -> None:
    info = report.info
    page.section("To repeat it")
    page.code(info.command)
    took: dict[str, str | int] = {}
    if info.seconds:
        took["training"] = _duration(info.seconds)
        took["steps per second"] = round(info.steps_per_s)
    page.pairs(
        {
            "object": info.asset,
            "source": info.source,
            "licence": info.licence,
            "joint": info.joint,
            "target": info.target_text,
            "steps per seed": info.steps,
            **took,
            "commit": info.commit,
            **info.versions,
        }
    )
    page.fold("Configuration")
    page.code(info.config)
    page.unfold()


def _percent(value: float) -> str:
    return f"{percent(value)}\N{NO-BREAK SPACE}%"


def _interval(share: Share) -> str:
    return f"{_percent(share.value)} ({percent(share.low)}–{percent(share.high)})"


def _rounded(value: float) -> float | None:
    return float(f"{value:.3g}") if np.isfinite(value) else None


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def _text(text: object) -> str:
    return html.escape(str(text), quote=True)
