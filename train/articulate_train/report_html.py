"""Page of an evaluation report.

::

    report.json     all figures; success_rate at its top level
    report.html     the same figures as charts and tables; opens offline
    videos/         videos of the page, if there are any
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal
from urllib.parse import quote

import numpy as np

from articulate.files import write_json, write_text
from articulate.page import Bars, Chart, ChartLine, Page, Points, Tile
from articulate.page.text import escape_text
from articulate.statistics import Share, percent
from articulate.task.episode_monitor import REASONS
from articulate.task.task import done_word
from articulate.transforms import Array
from articulate_envs.rewards import TERMS
from articulate_train.report import Parameter, Report, Timeline

TRAINING_TEXT = (
    "The policy corrects a scripted expert, whose action it observes. It imitates the expert for "
    "the first 10 to 20 % of the steps; PPO trains it for the rest. By default a seed is an "
    "ensemble of two policies, and its checkpoint is selected on separate episodes. The curves are "
    "of training episodes from home, with exploration noise."
)
MAX_POSTER_BYTES = 2_000_000
"""Largest image that is embedded in the page."""
MAX_EMBEDDED_BYTES = 1_500_000
"""Largest video that is embedded; a larger one is linked."""
FIRST_FRAME = "#t=0.05"
"""Fragment of a video's address: phones show the first frame before playback."""
GOOD, BAD = 0.9, 0.5
"""Success rates from the first on are marked as good, below the second as bad."""
CHART_PARAMETERS = 6
"""Number of parameters with a chart; the table has all."""
CHART_TERMS = 8
"""Number of reward terms in the chart."""
REASON_TEXT = {
    "success": "success",
    "forbidden_contact": "arm touched the object",
    "speed": "joint too fast",
    "torque": "joint torque too high",
    "torque_rate": "joint torque rose too fast",
    "force": "force on the gripper too high",
    "moment": "moment on the gripper too high",
    "goal_not_reached": "part short of its target at the end",
    "not_at_rest": "at the target, but not at rest",
    "diverged": "simulation diverged",
}
"""Descriptions of :data:`articulate.task.episode_monitor.REASONS`."""
PEAK_TEXT = {
    "force": "force, 50 ms filter [N]",
    "force_short": "force, 10 ms filter [N]",
    "force_raw": "force, raw [N]",
    "moment": "moment on the gripper [Nm]",
    "speed_share": "joint speed / its limit",
    "torque_share": "joint torque / its limit",
    "torque_rate": "joint torque rate [Nm/s]",
}
"""Descriptions of the peaks, short enough for a phone."""
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
    "delay_steps": "delay of actions [control steps]",
    "gripper_latency_s": "latency of the gripper [s]",
    "bias_x_m": "handle error, x [m]",
    "bias_y_m": "handle error, y [m]",
    "bias_z_m": "handle error, z [m]",
    "bias_yaw_rad": "handle error, yaw [rad]",
    "estimate_delay_steps": "age of the state [control steps]",
    "push_x_n": "push, x [N]",
    "push_y_n": "push, y [N]",
    "push_z_n": "push, z [N]",
    "push_time": "time of the push, share",
    "part_open": "open at the beginning, share",
    "force_bias_x_n": "error of the measured force, x [N]",
    "force_bias_y_n": "error of the measured force, y [N]",
    "force_bias_z_n": "error of the measured force, z [N]",
    "distance_m": "shift, distance [m]",
    "start_rad": "start, distance [rad]",
    "bias_m": "handle error, distance [m]",
    "push_n": "push, strength [N]",
    "force_bias_n": "error of the measured force, strength [N]",
} | {f"start_{i}": f"start of joint {i} [rad]" for i in range(1, 8)}


def write_report(report: Report, folder: Path, *, poster: bytes | None = None) -> tuple[Path, Path]:
    """Write ``report.json`` and ``report.html`` into ``folder`` and return their paths.

    Small videos are embedded, so that the page is a single file.

    Args:
        report: The report.
        folder: Folder to write to; it holds the report's videos.
        poster: PNG at the top of the page.
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
    """Render the page as HTML; arguments as for :func:`write_report`."""
    info = report.info
    page = _ReportPage(
        f"{info.asset}: {info.task.replace('_', ' ')}",
        f"{info.name} · joint {info.joint} · {info.target_text}",
    )
    _headline(page, report)
    _videos(page, report, folder, poster, embed_videos)
    _failures(page, report)
    _episodes(page, report)
    _seeds(page, report)
    _learning(page, report)
    _parameters(page, report)
    _peaks(page, report)
    _repeat(page, report)
    return page.html()


@dataclass(frozen=True)
class _Video:
    """Video and its caption."""

    source: str
    caption: str


class _ReportPage(Page):
    """Page with videos and collapsed sections."""

    def videos(self, videos: Sequence[_Video]) -> None:
        """Add videos side by side."""
        figures = "".join(
            f"<figure><figcaption><b>{escape_text(c.caption)}</b></figcaption>"
            '<video controls muted loop playsinline preload="metadata" width="480" height="360" '
            f'aria-label="{escape_text(c.caption)}" src="{escape_text(c.source)}"></video></figure>'
            for c in videos
        )
        self._add(f'<div class="figures">{figures}</div>')

    def fold(self, title: str) -> None:
        """Begin a collapsed section; :meth:`unfold` ends it."""
        self._add(f"<details><summary>{escape_text(title)}</summary>")

    def unfold(self) -> None:
        """End the collapsed section."""
        self._add("</details>")


def _headline(page: Page, report: Report) -> None:
    iqm, opened = report.success_iqm, report.opened_iqm
    rate, word = report.success_rate, done_word(report.info.task)
    tone: Literal["plain", "good", "bad"] = "plain"
    if rate >= GOOD or rate < BAD:
        tone = "good" if rate >= GOOD else "bad"
    tiles = [
        Tile(value=_percent(rate), label=f"success: {word}, within all limits", tone=tone),
        Tile(value=_percent(report.opened_rate), label=f"{word}, ignoring limits"),
        Tile(value=_percent(report.worst_seed_success_rate), label="success of the worst seed"),
    ]
    if report.nominal_success_rate is not None:
        nominal = _percent(report.nominal_success_rate)
        tiles.append(Tile(value=nominal, label="success without randomization"))
    page.tiles(*tiles)
    seeds = len(report.seeds)
    if report.info.unfinished:
        page.text(f"Training incomplete: {report.info.unfinished}.")
    if report.info.early_stopping:
        page.text(f"Training ended at the target success, {report.info.early_stopping}.")
    over = f"Interquartile mean over seeds: success {_interval(iqm)}, {word} {_interval(opened)}. "
    page.text(
        f"{iqm.n} episodes with {seeds} trained {'policy' if seeds == 1 else 'policies'}. "
        f"{over if seeds > 1 else ''}"
        f"All episodes: success {_interval(report.success_pooled)}."
    )


def _videos(
    page: _ReportPage, report: Report, folder: Path, poster: bytes | None, embed: bool
) -> None:
    if poster is not None:
        page.png(poster, f"{report.info.asset}: scene of this run.")
    videos = []
    for video in report.videos:
        videos.append(_Video(_video_source(folder, video, embed), _caption(report, video)))
    if videos:
        page.videos(videos)
    else:
        page.text("No videos: rendering is not available on this machine.")


def _caption(report: Report, video: str) -> str:
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
    page.section("Failures")
    total = sum(report.reasons.values())
    if report.reasons.get("success", 0) == total:
        page.text(f"No failures: all {total} episodes succeeded.")
        return
    page.text(
        "The reason of a failure is the first violated limit. Without a violation it is the state "
        "at the end of the episode."
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
            label += f", median time {when[name].median_s:.1f} s"
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
    page.section("Example episodes")
    for line in report.timelines:
        if line.name == "failure":
            page.text(f"Reason of the failure: {REASON_TEXT.get(line.reason, line.reason)}.")
    limits = report.info.limits
    page.charts(
        _timeline_chart(report, "Opening", "fraction of the travel", "opened", report.info.target),
        _timeline_chart(
            report, "Force on the gripper", "N, 50 ms filter", "force_n", limits.force_n
        ),
        _timeline_chart(
            report,
            "Fastest joint",
            "fraction of its limit",
            "speed_share",
            limits.speed_share,
        ),
    )
    _params(page, report.timelines)


def _params(page: _ReportPage, lines: Sequence[Timeline]) -> None:
    """Add the sampled parameters of the example episodes."""
    sampled = [line for line in lines if line.params]
    if not sampled:
        return
    page.fold("Sampled parameters")
    page.table(
        ["parameter", *(line.name for line in sampled)],
        [
            [PARAMETER_TEXT.get(name, name), *(_rounded(line.params[name]) for line in sampled)]
            for name in sampled[0].params
        ],
    )
    page.unfold()


def _timeline_chart(report: Report, title: str, unit: str, name: str, goal: float) -> Chart:
    def values(line: Timeline) -> Array:
        return np.asarray(getattr(line, name), dtype=np.float64)

    what = "target" if name == "opened" else "limit"
    return Chart(
        title=title,
        marks=[ChartLine(name=line.name, x=line.t, y=values(line)) for line in report.timelines],
        x_label="time [s]",
        y_label=unit,
        goal=goal,
        caption=f"Dashed line: {what}, {goal:.3g}.",
    )


def _seeds(page: Page, report: Report) -> None:
    page.section("Seeds", "Success rates with 95 % intervals (Wilson).")
    nominal = any(s.nominal_success is not None for s in report.seeds)
    word = done_word(report.info.task)
    known = any(s.policy_steps for s in report.seeds)
    header = ["seed", "success", word, *(["not randomized"] if nominal else [])]
    header += ["selected checkpoint"] if known else []
    rows: list[list[str]] = []
    for s in report.seeds:
        row = [str(s.seed), _interval(s.success), _interval(s.opened)]
        if nominal:
            row.append("–" if s.nominal_success is None else _interval(s.nominal_success))
        if known:
            after = f"{s.policy_steps / 1e6:.2f}M steps" if s.policy_steps else "–"
            one = s.active_member
            row.append(after if one is None else f"{after}, ensemble member {one} only")
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
    page.section("Training", TRAINING_TEXT)
    if not any(len(c.steps) for c in report.curves):
        page.text("The training was too short for learning curves: no episode ended.")
        return
    done = f"{done_word(report.info.task).capitalize()}, ignoring limits"
    charts = [
        Chart(
            title=title,
            marks=[
                ChartLine(name=f"seed {c.seed}", x=c.steps, y=100.0 * getattr(c, name))
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
    """Chart the largest reward terms of the first seed."""
    first = report.curves[0]
    if not np.isfinite(first.reward_terms).any():
        return []
    weight = np.nanmax(np.abs(np.nan_to_num(first.reward_terms)), axis=0)
    order = [int(i) for i in np.argsort(-weight) if weight[i] > 0.0][:CHART_TERMS]
    return [
        Chart(
            title=f"Reward by term, seed {first.seed}",
            marks=[
                ChartLine(name=TERMS[i], x=first.steps, y=first.reward_terms[:, i]) for i in order
            ],
            x_label="steps",
            y_label="sum over an episode",
        )
    ]


def _parameters(page: _ReportPage, report: Report) -> None:
    if not report.parameters:
        return
    page.section(
        "Success by parameter",
        "Success rates in ranges with equally many episodes, with 95 % intervals, for the "
        "parameters with the largest dispersion. A dispersion of about 1 is chance.",
    )
    charted = [p for p in report.parameters[:CHART_PARAMETERS] if p.dispersion > 0.0]
    if charted:
        page.charts(*(_parameter_chart(p) for p in charted))
    rows: list[list[str | float | None]] = []
    for p in report.parameters:
        worst = min(p.bins, key=lambda b: b.success.value)
        rows.append(
            [
                PARAMETER_TEXT.get(p.name, p.name),
                round(p.dispersion, 1),
                round(100.0 * worst.success.value, 1),
                *(_rounded(v) for v in (worst.begin, worst.end, p.lowest, p.highest)),
            ]
        )
    page.fold(f"All {len(rows)} parameters")
    page.table(["parameter", "dispersion", "worst %", "from", "to", "sampled from", "to"], rows)
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
        x_label="sampled value",
        y_label="success %",
        y_range=(min(50.0, 100.0 * min(b.success.low for b in bins)) // 10 * 10, 100.0),
        caption=f"Dispersion {parameter.dispersion:.1f}.",
    )


def _peaks(page: Page, report: Report) -> None:
    page.section("Peaks", "Over all randomized episodes.")
    rows: list[list[str | float | None]] = [
        [PEAK_TEXT[p.name], p.limit, *(_rounded(v) for v in (p.median, p.p95, p.largest))]
        for p in report.peaks
    ]
    page.table(["largest in an episode", "allowed", "median", "95 %", "largest"], rows)


def _repeat(page: _ReportPage, report: Report) -> None:
    info = report.info
    page.section("Reproduction")
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
