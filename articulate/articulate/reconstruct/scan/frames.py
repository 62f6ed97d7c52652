"""Frames: extend a pane to the door around it, and join the boards of a framed door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.panels import Panel, handles_of
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array

LINE = 0.7
"""Least share of the side of a pane along which its frame ends at one line."""
WIDEST = 0.5
"""Widest frame, as a share of the side of the pane."""
FRAME_STEP = 0.03
"""Largest distance of the surfaces of a pane and its frame, as a share of the diagonal."""
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


def joined_frames(parts: Segmentation, panels: Sequence[Panel]) -> list[Panel]:
    """Return the panels, with a pane and the two stiles and two rails around it as one panel."""
    left = list(panels)
    found: list[Panel] = []
    for pane in sorted(panels, key=lambda panel: -panel.area):
        if not any(pane is other for other in left):
            continue
        boards = _frame(parts, pane, [other for other in left if other is not pane])
        if boards is None:
            continue
        together = [pane, *boards]
        left = [panel for panel in left if not any(panel is other for other in together)]
        found.append(_union(parts, together))
    return [*found, *left]


def _frame(parts: Segmentation, pane: Panel, others: Sequence[Panel]) -> list[Panel] | None:
    """Return the boards on all four sides of a pane; None unless two of them span the door."""
    near = 3.0 * parts.near
    boards = [_beside(pane, others, axis, high, near) for axis in (0, 1) for high in (False, True)]
    left, right, bottom, top = boards
    if left is None or right is None or bottom is None or top is None:
        return None
    found = [left, right, bottom, top]
    if any(abs(board.front - pane.front) > FRAME_STEP * parts.mesh.diagonal for board in found):
        return None
    if _handle_count(found, near) > 1:
        return None  # doors and drawers around another one
    rects = np.stack([panel.rect for panel in [pane, *found]])
    union = np.concatenate([rects[:, :2].min(axis=0), rects[:, 2:].max(axis=0)])
    stiles = all(_spans(board.rect, union, 1, near) for board in (left, right))
    rails = all(_spans(board.rect, union, 0, near) for board in (bottom, top))
    tiled = float((rects[:, 2:] - rects[:, :2]).prod(axis=1).sum())
    full = float(np.prod(union[2:] - union[:2]))
    return found if (stiles or rails) and tiled > 0.9 * full else None


def _handle_count(boards: Sequence[Panel], near: float) -> int:
    """Return the number of boards with handles; one of a stile may end on the rails."""
    rects = [[handle.rect for handle in board.handles] for board in boards if board.handles]
    first = rects[0] if rects else []
    return len(rects[:1]) + sum(
        not any(_touch(one, other, near) for one in own for other in first) for own in rects[1:]
    )


def _touch(one: Array, other: Array, near: float) -> bool:
    return bool((one[:2] < other[2:] + near).all() and (other[:2] < one[2:] + near).all())


def _beside(
    pane: Panel, others: Sequence[Panel], axis: int, high: bool, near: float
) -> Panel | None:
    """Return the board that touches a side of a pane along its entire length."""
    edge, opposite = (axis + 2, axis) if high else (axis, axis + 2)
    across = 1 - axis
    for other in others:
        touches = abs(other.rect[opposite] - pane.rect[edge]) < near
        covers = other.rect[across] < pane.rect[across] + near
        covers &= other.rect[across + 2] > pane.rect[across + 2] - near
        if touches and covers:
            return other
    return None


def _spans(rect: Array, union: Array, axis: int, near: float) -> bool:
    return bool(rect[axis] < union[axis] + near and rect[axis + 2] > union[axis + 2] - near)


def _union(parts: Segmentation, panels: Sequence[Panel]) -> Panel:
    rects = np.stack([panel.rect for panel in panels])
    rect = np.concatenate([rects[:, :2].min(axis=0), rects[:, 2:].max(axis=0)])
    front = max(panel.front for panel in panels)
    rows, columns = parts.view.window(rect)
    return Panel(
        rect=rect,
        front=front,
        back=min(panel.back for panel in panels),
        own=np.unique(np.concatenate([panel.own for panel in panels])),
        fill=1.0,
        thin=True,
        score=1.0,
        handles=handles_of(parts.mesh, parts.view, rect, parts.view.depth[rows, columns], front),
    )
