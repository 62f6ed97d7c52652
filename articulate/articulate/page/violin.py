"""Violins as inline SVG: how values are spread, one outline a group."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.page.chart import N_COLOURS, WIDTH
from articulate.page.numbers import shown, tick_text, ticks

HEIGHT = 250.0
LEFT, RIGHT, TOP, BOTTOM = 46.0, 12.0, 26.0, 46.0
STEPS = 80
"""Points of an outline."""

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Violins:
    """Groups of values over a common axis, each as a smooth outline with its median."""

    title: str
    groups: Sequence[tuple[str, Sequence[float]]]
    """Name and values of each group; values that are not finite are left out."""
    y_label: str = ""
    """What is up, with its unit."""
    caption: str = ""
    y_range: tuple[float, float] | None = None
    """Values outside are drawn at its ends."""
    goal: float | None = None
    """Value that is marked by a dashed line."""

    def figure(self) -> str:
        """The violins as an HTML ``figure``."""
        groups = [(name, _finite(values)) for name, values in self.groups]
        filled = [values for _, values in groups if len(values)]
        low, high = self.y_range or _span(filled, self.goal)
        parts = [*self._grid(low, high)]
        room = (WIDTH - LEFT - RIGHT) / max(len(groups), 1)
        for i, (name, values) in enumerate(groups):
            x = LEFT + (i + 0.5) * room
            parts += _violin(x, 0.42 * room, np.clip(values, low, high), (low, high), i)
            parts.append(_label(x, HEIGHT - BOTTOM + 17, name, "middle"))
            median = f"{shown(float(np.median(values)))} (n {len(values)})" if len(values) else "–"
            parts.append(_label(x, HEIGHT - BOTTOM + 33, median, "middle"))
        text = f" {_text(self.caption)}" if self.caption else ""
        drawing = (
            f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" '
            f'aria-label="{_text(self.title)}">{"".join(parts)}</svg>'
        )
        return (
            f"<figure><figcaption><b>{_text(self.title)}</b>{text}</figcaption>{drawing}</figure>"
        )

    def _grid(self, low: float, high: float) -> list[str]:
        right = WIDTH - RIGHT
        parts = []
        for value in ticks(low, high):
            y = _height(value, low, high)
            parts.append(f'<path class="grid" d="M{LEFT:.1f} {y:.1f}H{right:.1f}"/>')
            parts.append(_label(LEFT - 6, y + 4, tick_text(value), "end"))
        parts.append(_label(0, 13, self.y_label, "start"))
        if self.goal is not None:
            y = _height(self.goal, low, high)
            parts.append(f'<path class="goal" d="M{LEFT:.1f} {y:.1f}H{right:.1f}"/>')
        return parts


def _violin(
    x: float, half_px: float, values: Array, span: tuple[float, float], i: int
) -> list[str]:
    if not len(values):
        return []
    colour = f"var(--s{i % N_COLOURS})"
    at = np.linspace(span[0], span[1], STEPS)
    density = _density(values, at, span)
    y = [_height(value, *span) for value in at]
    right = [f"{x + half_px * d:.1f} {v:.1f}" for d, v in zip(density, y, strict=True)]
    left = [f"{x - half_px * d:.1f} {v:.1f}" for d, v in zip(density, y, strict=True)]
    outline = "M" + "L".join([*right, *left[::-1]]) + "Z"
    middle = _height(float(np.median(values)), *span)
    return [
        f'<path style="fill:{colour};opacity:.35" d="{outline}"/>',
        f'<path class="line" style="stroke:{colour}" '
        f'd="M{x - 0.3 * half_px:.1f} {middle:.1f}h{0.6 * half_px:.1f}"/>',
    ]


def _density(values: Array, at: Array, span: tuple[float, float]) -> Array:
    """Density of ``values`` at ``at``, its largest value 1 (Silverman's width, reflected ends)."""
    least = 0.012 * (span[1] - span[0])
    spread = min(float(np.std(values)), float(np.subtract(*np.percentile(values, [75, 25]))) / 1.34)
    width = max(0.9 * spread * len(values) ** -0.2, least)
    mirrored = np.concatenate([values, 2.0 * span[0] - values, 2.0 * span[1] - values])
    away = (at[:, None] - mirrored[None]) / width
    density = np.exp(-0.5 * away**2).sum(axis=1)
    return np.asarray(density / density.max())


def _span(groups: Sequence[Array], goal: float | None) -> tuple[float, float]:
    values = np.concatenate([np.zeros(1), *groups, [] if goal is None else [goal]])
    low, high = float(values.min()), float(values.max())
    return low, high if high > low else low + 1.0


def _height(value: float, low: float, high: float) -> float:
    return HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM)


def _finite(values: Sequence[float]) -> Array:
    array = np.asarray(values, dtype=np.float64)
    return array[np.isfinite(array)]


def _label(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{_text(text)}</text>'


def _text(text: str) -> str:
    return html.escape(text, quote=True)
