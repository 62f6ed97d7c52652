"""Frames: extend a pane to the door that surrounds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.panels import Panel, handles_of
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array

LINE = 0.7
"""Least share of the side of a pane along which its frame ends at one line."""
WIDEST = 0.5
"""Widest frame, as a share of the side of the pane."""
STEP = 0.003
"""Least step in depth that ends a frame, as a share of the diagonal of the object."""


def grown(parts: Segmentation, panel: Panel) -> Panel:
    """Return the panel with its frame, or the same panel without one."""
    view = parts.view
    label = np.where(view.face >= 0, parts.facets.label[np.maximum(view.face, 0)], -1)
    rows, columns = view.window(panel.rect)
    depth = np.where(np.isfinite(view.depth), view.depth, parts.mesh.bounds[0, 0] - 1.0)
    step = STEP * parts.mesh.diagonal
    across = (np.diff(label, axis=1) != 0) | (np.abs(np.diff(depth, axis=1)) > step)
    down = (np.diff(label, axis=0) != 0) | (np.abs(np.diff(depth, axis=0)) > step)
    beside = across[rows].mean(axis=0)
    width, height = columns.stop - columns.start, rows.stop - rows.start
    left = _first(beside[: max(columns.start - 2, 0)][::-1], WIDEST * width)
    right = _first(beside[columns.stop + 1 :], WIDEST * width)
    above = down[:, columns].mean(axis=1)
    top = _first(above[: max(rows.start - 2, 0)][::-1], WIDEST * height)
    bottom = _first(above[rows.stop + 1 :], WIDEST * height)
    found = [side for side in (left, right, top, bottom) if side is not None]
    if len(found) < 3:
        return panel
    pixel = view.pixel
    margins = np.array([_margin(side) for side in (left, bottom, right, top)]) * pixel
    rect = panel.rect + np.array([-1.0, -1.0, 1.0, 1.0]) * margins
    rows, columns = view.window(rect)
    window = view.depth[rows, columns]
    tolerance = 0.03 * parts.mesh.diagonal
    if float((np.abs(window - panel.front) < tolerance).mean()) < 0.8:
        return panel
    seen = window[np.isfinite(window)]
    surface = float(np.quantile(seen, 0.6)) if len(seen) else panel.front
    front = max(panel.front, surface)
    return replace(
        panel,
        rect=rect,
        front=front,
        back=min(panel.back, panel.front),
        handles=handles_of(parts.mesh, view, rect, window, front),
    )


def _first(lines: Array, most: float) -> int | None:
    """Return the pixels to the first line, None if there is none within ``most``."""
    found = np.flatnonzero(lines > LINE)
    return int(found[0]) if len(found) and found[0] <= most else None


def _margin(side: int | None) -> float:
    return 0.0 if side is None else side + 2.0


