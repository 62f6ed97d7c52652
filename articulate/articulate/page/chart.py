"""Charts as inline SVG: lines with bands, points with error bars, horizontal bars."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from articulate.page.text import axis_values, escape_text, format_axis_value, format_number

WIDTH, HEIGHT = 400.0, 262.0
"""Size of a chart in the scale of its text [px]: the width of a phone."""
LEFT, RIGHT, TOP, BOTTOM = 46.0, 17.0, 26.0, 40.0
BAR_PITCH, BAR_HEIGHT = 40.0, 14.0
N_COLOURS = 8
MAX_POINTS = 400
"""Most points of a line; lines with more are thinned."""

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ChartLine:
    """A line; it is broken where ``y`` is NaN."""

    name: str
    x: ArrayLike
    y: ArrayLike
    low: ArrayLike | None = None
    """Lower edge of a band around the line."""
    high: ArrayLike | None = None
    """Upper edge of the band."""


@dataclass(frozen=True, kw_only=True)
class Points:
    """Points, with error bars where ``low`` and ``high`` are given."""

    name: str
    x: ArrayLike
    y: ArrayLike
    low: ArrayLike | None = None
    """Lower end of the error bars."""
    high: ArrayLike | None = None
    """Upper end of the error bars."""


@dataclass(frozen=True, kw_only=True)
class Bars:
    """Horizontal bars from 0, one a label; labels may be long."""

    labels: Sequence[str]
    values: Sequence[float]
    low: Sequence[float] | None = None
    """Lower end of the error bars."""
    high: Sequence[float] | None = None
    """Upper end of the error bars."""


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Lines and points over common axes, or one set of bars."""

    title: str
    marks: Sequence[ChartLine | Points] | Bars
    x_label: str = ""
    """Label of the horizontal axis, with the unit."""
    y_label: str = ""
    """Label of the vertical axis, with the unit; bars use ``x_label``."""
    caption: str = ""
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    goal: float | None = None
    """Value that is marked by a dashed line, such as a required one: vertical for bars."""

    def figure(self) -> str:
        """Return the chart as an HTML ``figure``."""
        caption = f"<b>{escape_text(self.title)}</b>" + (
            f" {escape_text(self.caption)}" if self.caption else ""
        )
        if isinstance(self.marks, Bars):
            drawing, key = _bars(self, self.marks), ""
        else:
            drawing, key = _plot(self, self.marks), _key(self.marks)
        return f"<figure><figcaption>{caption}</figcaption>{drawing}{key}</figure>"


@dataclass(frozen=True)
class _Axes:
    """Positions of values in the chart [px]."""

    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def x(self, value: float) -> float:
        low, high = self.x_range
        return LEFT + (value - low) / (high - low) * (WIDTH - LEFT - RIGHT)

    def y(self, value: float) -> float:
        low, high = self.y_range
        return HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM)


def _plot(chart: Chart, marks: Sequence[ChartLine | Points]) -> str:
    arrays = [_arrays(mark) for mark in marks]
    heights = [a for _, *rest in arrays for a in rest]
    heights += [np.array([chart.goal])] if chart.goal is not None else []
    lines_only = all(isinstance(mark, ChartLine) for mark in marks)
    axes = _Axes(
        chart.x_range or _span([x for x, *_ in arrays], margin=0.0 if lines_only else 0.04),
        chart.y_range or _span(heights, margin=0.05),
    )
    parts = [*_grid(chart, axes)]
    if chart.goal is not None:
        y = axes.y(chart.goal)
        parts.append(f'<path class="goal" d="M{LEFT:.1f} {y:.1f}H{WIDTH - RIGHT:.1f}"/>')
    shapes: list[str] = []
    for i, (mark, (x, y_values, low, high)) in enumerate(zip(marks, arrays, strict=True)):
        add = _line if isinstance(mark, ChartLine) else _points
        shapes += add(axes, x, y_values, low, high, f"var(--s{i % N_COLOURS})")
    box = (LEFT - 4, TOP - 4, WIDTH - LEFT - RIGHT + 8, HEIGHT - TOP - BOTTOM + 8)
    x0, y0, width, height = box
    # A nested svg cuts off everything outside of the given ranges.
    parts.append(
        f'<svg x="{x0}" y="{y0}" width="{width}" height="{height}" '
        f'viewBox="{x0} {y0} {width} {height}">{"".join(shapes)}</svg>'
    )
    return _svg(chart.title, HEIGHT, parts)


def _grid(chart: Chart, axes: _Axes) -> Iterator[str]:
    bottom = HEIGHT - BOTTOM
    for value in axis_values(*axes.y_range):
        y = axes.y(value)
        yield f'<path class="grid" d="M{LEFT:.1f} {y:.1f}H{WIDTH - RIGHT:.1f}"/>'
        yield _label(LEFT - 6, y + 4, format_axis_value(value), "end")
    for value in axis_values(*axes.x_range):
        x = axes.x(value)
        yield f'<path class="grid" d="M{x:.1f} {bottom:.1f}v4"/>'
        yield _label(x, bottom + 17, format_axis_value(value), "middle")
    yield _label((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, chart.x_label, "middle")
    yield _label(0, 13, chart.y_label, "start")


def _line(axes: _Axes, x: Array, y: Array, low: Array, high: Array, colour: str) -> Iterator[str]:
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), MAX_POINTS)).round().astype(int))
    x, y, low, high = x[keep], y[keep], low[keep], high[keep]
    for part in _runs(np.isfinite(x) & np.isfinite(low) & np.isfinite(high)):
        there = zip(x[part], high[part], strict=True)
        back = zip(x[part][::-1], low[part][::-1], strict=True)
        edge = [*there, *back]
        if np.any(high[part] > low[part]):
            yield f'<path class="band" style="fill:{colour}" d="{_path(axes, edge)}Z"/>'
    for part in _runs(np.isfinite(x) & np.isfinite(y)):
        d = _path(axes, zip(x[part], y[part], strict=True))
        if len(x[part]) == 1:
            d += "h0"  # a dot, by its round cap
        yield f'<path class="line" style="stroke:{colour}" d="{d}"/>'


def _points(axes: _Axes, x: Array, y: Array, low: Array, high: Array, colour: str) -> Iterator[str]:
    for xi, yi, a, b in zip(x, y, low, high, strict=True):
        if not np.isfinite([xi, yi]).all():
            continue
        px, py = axes.x(xi), axes.y(yi)
        if np.isfinite([a, b]).all() and b > a:
            bar = f"M{px:.1f} {axes.y(a):.1f}V{axes.y(b):.1f}"
            yield f'<path class="line" style="stroke:{colour};stroke-width:1.3" d="{bar}"/>'
        yield f'<circle cx="{px:.1f}" cy="{py:.1f}" r="3.2" style="fill:{colour}"/>'


def _bars(chart: Chart, bars: Bars) -> str:
    """Place each bar below its label and before its value, so that neither is cut off."""
    n = len(bars.labels)
    if len(bars.values) != n:
        raise ValueError(f"{n} labels, but {len(bars.values)} values")
    low = np.asarray(bars.values if bars.low is None else bars.low, dtype=np.float64)
    high = np.asarray(bars.values if bars.high is None else bars.high, dtype=np.float64)
    ends = np.array([0.0, *bars.values, *high, chart.goal or 0.0])
    top = chart.x_range[1] if chart.x_range else float(ends[np.isfinite(ends)].max()) or 1.0
    room = WIDTH - RIGHT - 48.0
    parts = []
    for i, (label, value) in enumerate(zip(bars.labels, bars.values, strict=True)):
        y = i * BAR_PITCH + 14.0
        length, start, end = (room * _share(v, top) for v in (value, low[i], high[i]))
        parts.append(_label(0, y, label, "start"))
        parts.append(
            f'<rect x="0" y="{y + 6:.1f}" width="{length:.1f}" height="{BAR_HEIGHT:.0f}" rx="2" '
            'style="fill:var(--s0)"/>'
        )
        if high[i] > low[i]:
            bar = f"M{start:.1f} {y + 6 + BAR_HEIGHT / 2:.1f}H{end:.1f}"
            parts.append(
                f'<path class="line" style="stroke:var(--ink);stroke-width:1.5" d="{bar}"/>'
            )
        parts.append(
            _label(
                max(length, end) + 6, y + 6 + BAR_HEIGHT - 3, format_number(float(value)), "start"
            )
        )
    height = n * BAR_PITCH + 22.0
    if chart.goal is not None:
        x = chart.goal / top * room
        parts.append(f'<path class="goal" d="M{x:.1f} 0V{n * BAR_PITCH:.1f}"/>')
    parts.append(_label(0, height - 6, chart.x_label, "start"))
    return _svg(chart.title, height, parts)


def _share(value: float, top: float) -> float:
    """Return ``value`` as a share of ``top``, limited to [0, 1]."""
    return float(np.clip(np.nan_to_num(value), 0.0, top)) / top


def _key(marks: Sequence[ChartLine | Points]) -> str:
    if len(marks) < 2:
        return ""
    items = [
        f'<span><i style="background:var(--s{i % N_COLOURS})"></i>{escape_text(mark.name)}</span>'
        for i, mark in enumerate(marks)
    ]
    return f'<div class="key">{"".join(items)}</div>'


def _arrays(mark: ChartLine | Points) -> tuple[Array, Array, Array, Array]:
    x, y = np.asarray(mark.x, np.float64).ravel(), np.asarray(mark.y, np.float64).ravel()
    low = y if mark.low is None else np.asarray(mark.low, np.float64).ravel()
    high = y if mark.high is None else np.asarray(mark.high, np.float64).ravel()
    if not len(x) == len(y) == len(low) == len(high):
        sizes = f"{len(x)}, {len(y)}, {len(low)} and {len(high)}"
        raise ValueError(f"{mark.name}: x, y, low and high have {sizes} values")
    return x, y, low, high


def _span(arrays: Iterable[Array], *, margin: float) -> tuple[float, float]:
    """Return the range of the finite values, never empty, with a margin as a share of it."""
    values = np.concatenate([np.zeros(0), *arrays])
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        pad = 0.5 * abs(high) or 0.5
        return low - pad, high + pad
    pad = margin * (high - low)
    # The axis does not cross 0 unless values do.
    return (low - pad if low < 0.0 or low > pad else 0.0), high + pad


def _runs(mask: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield slices of the runs in which ``mask`` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(stop))


def _path(axes: _Axes, points: Iterable[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{axes.x(x):.1f} {axes.y(y):.1f}" for x, y in points)


def _label(x: float, y: float, text: str, anchor: str) -> str:
    if not text:
        return ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape_text(text)}</text>'


def _svg(title: str, height: float, parts: Iterable[str]) -> str:
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img" aria-label="{escape_text(title)}">'
        f"{''.join(parts)}</svg>"
    )
