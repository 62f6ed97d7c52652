"""Divide the rectified front of an object into rectangles, by gaps and handles.

The gap around a drawer or a door crosses the region that it divides from edge to edge; the frame
of a decorated door does not. A gap of few millimetres is a faint line, so its contrast is averaged
along the line. Every drawer and door has one handle, so a region with several handles is divided
between them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.render.raster import Pixels
from articulate.transforms import Array

FRONT_PX = 256
"""Longest side of the rectified front [px]."""
MIN_CUT = 0.62
"""Score of a line at which a region is divided, without handles on both sides."""
MIN_CUT_EMPTY = 0.85
"""The same where one side has no handle, on a front with handles."""
HANDLES_APART = 0.5
"""Gain of a line with handles on both sides."""
CROSSED = 0.4
"""Loss of a line that crosses a handle."""
CENTRED = 0.25
"""Gain of a line midway between the handles next to it."""
MIN_SIDE = 0.07
"""Smallest side of a region as a share of the longer side of the front."""
MARGIN_PX = 5
"""Lines closer to the border of a region are its border [px]."""
MAX_DEPTH = 8
PIECES = 5
"""Pieces of a line; the second weakest counts, since a handle may cover one."""
END_SHARE, END_CONTRAST = 0.07, 0.4
"""Ends of a line, as a share of it, and their least contrast relative to the line: a gap reaches
the border of the region."""
Z_FULL = 7.0
"""Mean contrast of a piece over its spread between lines that gives the full score."""


@dataclass(frozen=True, kw_only=True)
class Handle:
    """Handle on a front; lengths are shares of the width and of the height of the front."""

    u: float
    """Middle, from the left."""
    v: float
    """Middle, from below."""
    width: float
    height: float
    direction: Literal["level", "upright", "compact"]
    contrast: float


@dataclass(frozen=True, kw_only=True)
class FrontCell:
    """Rectangle of a front, in shares of its width from the left and of its height from below."""

    left: float
    right: float
    bottom: float
    top: float
    evidence: float
    """Smallest score of the lines that separate it; 1 without a line."""
    handle: Handle | None = None


def rectify(image: Pixels, corners: Array, aspect: float) -> Pixels:
    """Return the front (H, W, 3) seen straight on, with ``aspect`` of width to height.

    Args:
        image: Colours (H, W, 3).
        corners: Corners in the image (4, 2) [px], from top left clockwise.
        aspect: Width over height.
    """
    width = max(24, round(FRONT_PX * min(1.0, aspect)))
    height = max(24, round(FRONT_PX * min(1.0, 1.0 / aspect)))
    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32) - 0.5
    H = cv2.getPerspectiveTransform(corners.astype(np.float32), target)
    return np.asarray(cv2.warpPerspective(image, H, (width, height), flags=cv2.INTER_LINEAR))


def parse_front(front: Pixels) -> tuple[FrontCell, ...]:
    """Return the cells of a rectified front (H, W, 3), from the top left by rows."""
    parser = _Parser(front)
    parser.divide((0, front.shape[1], 0, front.shape[0]), 1.0, 0)
    return tuple(sorted(parser.cells, key=lambda c: (-round(c.top, 2), c.left)))


def covered(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and columns of a rectified mask (H, W), boolean, that the object covers.

    Legs leave the lower rows mostly empty.
    """
    out = []
    for axis in (1, 0):
        lines = np.flatnonzero(mask.mean(axis=axis) >= MIN_COVERED)
        all_lines = slice(0, mask.shape[1 - axis])
        out.append(slice(int(lines[0]), int(lines[-1]) + 1) if len(lines) else all_lines)
    return out[0], out[1]


def find_handles(front: Pixels) -> list[Handle]:
    """Return the handles of a rectified front (H, W, 3): small regions that stand out locally."""
    height, width = front.shape[:2]
    lab = cv2.cvtColor(cv2.GaussianBlur(front, (0, 0), 0.7), cv2.COLOR_RGB2LAB)
    size = 2 * (min(height, width) // 6) + 1
    local = np.stack([cv2.medianBlur(channel, min(size, 61)) for channel in cv2.split(lab)], axis=2)
    away = np.linalg.norm(lab.astype(np.float32) - local.astype(np.float32), axis=2)
    threshold = max(9.0, 4.0 * (float(np.median(away)) + 1.0))
    binary = (away > threshold).astype(np.uint8)
    binary = cv2.morphologyEx(binary, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    count, _, stats, centres = cv2.connectedComponentsWithStats(binary, connectivity=8)
    found = []
    for k in range(1, count):
        x, y, w, h, area = (int(value) for value in stats[k])
        if x <= 1 or y <= 1 or x + w >= width - 1:
            continue
        share, longest = area / binary.size, max(w / width, h / height)
        if not HANDLE_AREA[0] < share < HANDLE_AREA[1] or longest > HANDLE_LENGTH:
            continue
        if min(w, h) < 2 or area < 0.2 * w * h or min(w, h) > 0.2 * min(width, height):
            continue
        direction: Literal["level", "upright", "compact"] = "compact"
        if w > BAR * h:
            direction = "level"
        elif h > BAR * w:
            direction = "upright"
        found.append(
            Handle(
                u=float(centres[k][0]) / width,
                v=1.0 - float(centres[k][1]) / height,
                width=w / width,
                height=h / height,
                direction=direction,
                contrast=float(away[y : y + h, x : x + w].max()),
            )
        )
    return alike(found)


MIN_COVERED = 0.7
"""Share of a row that a front covers at least."""
HANDLE_AREA = (0.0004, 0.03)
"""Smallest and largest share of the front that a handle covers."""
HANDLE_LENGTH = 0.7
"""Longest handle as a share of the front."""
BAR = 1.6
"""Ratio of the sides of a bar above which its direction counts."""


def alike(handles: list[Handle]) -> list[Handle]:
    """Return the handles without those of far lower contrast than the strongest."""
    if not handles:
        return []
    strongest = max(handle.contrast for handle in handles)
    return [handle for handle in handles if handle.contrast > 0.35 * strongest]


class _Parser:
    """Divides a front recursively."""

    def __init__(self, front: Pixels) -> None:
        self.height, self.width = front.shape[:2]
        self.edges = edge_maps(front)
        self.ridges = ridge_maps(front)
        self.handles = find_handles(front)
        self.cells: list[FrontCell] = []
        self.smallest = max(MARGIN_PX, int(MIN_SIDE * max(self.height, self.width)))

    def divide(self, region: tuple[int, int, int, int], evidence: float, depth: int) -> None:
        """Divide a region (left, right, top, bottom) [px], or add it as a cell."""
        left, right, top, bottom = region
        best: tuple[float, bool, int] = (0.0, True, -1)
        for level in (True, False) if depth < MAX_DEPTH else ():
            scores = self.scores(region, level)
            k = int(np.argmax(scores))
            if scores[k] < self.threshold(region, level, k):
                continue
            if scores[k] > best[0]:
                best = (float(scores[k]), level, (top if level else left) + k)
        score, level, at = best
        if at < 0:
            self.cells.append(self.cell(region, evidence))
            return
        parts = (
            ((left, right, top, at), (left, right, at, bottom))
            if level
            else ((left, at, top, bottom), (at, right, top, bottom))
        )
        for part in parts:
            self.divide(part, min(evidence, score), depth + 1)

    def threshold(self, region: tuple[int, int, int, int], level: bool, at: int) -> float:
        """Return the score at which a line divides a region.

        Where the front has handles, a part without one is rarely an openable part.
        """
        left, right, top, bottom = region
        first = (left, right, top, top + at) if level else (left, left + at, top, bottom)
        second = (left, right, top + at, bottom) if level else (left + at, right, top, bottom)
        empty = min(len(self.inside(first)), len(self.inside(second))) == 0
        return MIN_CUT_EMPTY if self.handles and empty else MIN_CUT

    def scores(self, region: tuple[int, int, int, int], level: bool) -> Array:
        """Return the score of each row or column of a region as a cut (N,)."""
        left, right, top, bottom = region
        window = (slice(top, bottom), slice(left, right))
        edges, ridges = (
            self.edges[0 if level else 1][window],
            self.ridges[0 if level else 1][window],
        )
        if not level:
            edges, ridges = edges.T, ridges.T
        n = len(edges)
        out = np.maximum(line_scores(edges), ridge_scores(ridges))
        out = self._with_handles(out, region, level)
        out[: self.smallest] = 0.0
        out[max(0, n - self.smallest) :] = 0.0
        return out

    def _with_handles(self, scores: Array, region: tuple[int, int, int, int], level: bool) -> Array:
        """Add the evidence of the handles of a region to the score of each line."""
        inside = self.inside(region)
        start, length = (region[2], self.height) if level else (region[0], self.width)
        spans = []
        for handle in inside:
            middle = (1.0 - handle.v if level else handle.u) * length - start
            half = 0.5 * (handle.height if level else handle.width) * length
            spans.append((middle - half, middle + half, middle))
        lines = np.arange(len(scores), dtype=np.float64)
        before = np.sum([high < lines for _, high, _ in spans], axis=0) if spans else 0 * lines
        after = np.sum([low > lines for low, _, _ in spans], axis=0) if spans else 0 * lines
        crossed = len(spans) - before - after
        out = scores + HANDLES_APART * ((before > 0) & (after > 0)) - CROSSED * (crossed > 0)
        middles = sorted(middle for _, _, middle in spans)
        for one, other in itertools.pairwise(middles):
            gap = other - one
            if gap < 4.0:
                continue
            near = np.exp(-(((lines - 0.5 * (one + other)) / (0.12 * gap + 2.0)) ** 2))
            out += CENTRED * near * ((lines > one) & (lines < other))
        return np.asarray(out)

    def inside(self, region: tuple[int, int, int, int]) -> list[Handle]:
        """Return the handles whose middle is in a region."""
        left, right, top, bottom = region
        return [
            h
            for h in self.handles
            if left <= h.u * self.width < right and top <= (1.0 - h.v) * self.height < bottom
        ]

    def cell(self, region: tuple[int, int, int, int], evidence: float) -> FrontCell:
        """Return a region as a cell with its strongest handle."""
        left, right, top, bottom = region
        inside = self.inside(region)
        return FrontCell(
            left=left / self.width,
            right=right / self.width,
            bottom=1.0 - bottom / self.height,
            top=1.0 - top / self.height,
            evidence=evidence,
            handle=max(inside, key=lambda h: h.contrast * (h.width + h.height), default=None),
        )


def edge_maps(front: Pixels) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where horizontal and vertical edges are (H, W), boolean, thickened by a pixel."""
    soft = cv2.GaussianBlur(front, (0, 0), 0.9).astype(np.float32)
    maps = []
    for dx, dy in ((0, 1), (1, 0)):
        along = np.abs(cv2.Sobel(soft, cv2.CV_32F, dx, dy, ksize=3)).max(axis=2)
        other = np.abs(cv2.Sobel(soft, cv2.CV_32F, dy, dx, ksize=3)).max(axis=2)
        kernel = np.ones((5, 1) if dy else (1, 5), np.uint8)
        peak = along >= cv2.dilate(along, kernel) - 1e-3
        noise = 1.5 * float(np.median(along)) + 12.0
        strong = peak & (along > noise) & (along > 1.2 * other)
        maps.append(cv2.dilate(strong.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
    return maps[0], maps[1]


def ridge_maps(front: Pixels) -> tuple[Array, Array]:
    """Return how much darker each pixel (H, W) is than its sides across a level, upright line."""
    grey = cv2.cvtColor(front, cv2.COLOR_RGB2GRAY).astype(np.float32)
    maps = []
    for axis in (0, 1):
        best = np.full(grey.shape, -255.0, dtype=np.float32)
        for reach in (2, 3):
            sides = np.minimum(np.roll(grey, reach, axis), np.roll(grey, -reach, axis))
            best = np.maximum(best, sides - grey)
        kernel = np.ones((3, 1) if axis == 0 else (1, 3), np.uint8)
        dark = cv2.dilate(np.clip(best, -8.0, 24.0), kernel)
        maps.append(np.asarray(dark, dtype=np.float64))
    return maps[0], maps[1]


def line_scores(edges: NDArray[np.bool_]) -> Array:
    """Return the score of each line (N,) of an edge map (N, L): its covered share.

    The least covered fifth of a line counts twice, since a gap crosses the region entirely.
    """
    pieces = np.array_split(np.arange(edges.shape[1]), PIECES)
    covered = np.stack([edges[:, piece].mean(axis=1) for piece in pieces if len(piece)])
    return np.asarray((edges.mean(axis=1) + 2.0 * covered.min(axis=0)) / 3.0)


def ridge_scores(ridges: Array) -> Array:
    """Return the score of each line (N,) of a map of dark lines (N, L), in [0, 1]."""
    pieces = np.array_split(np.arange(ridges.shape[1]), PIECES)
    means = np.stack([np.clip(ridges[:, p], None, 12.0).mean(axis=1) for p in pieces if len(p)])
    centre = np.median(means, axis=1, keepdims=True)
    spread = 1.4826 * np.median(np.abs(means - centre), axis=1, keepdims=True) + 0.25
    z = np.sort((means - centre) / spread, axis=0)
    end = max(3, round(END_SHARE * ridges.shape[1]))
    ends = np.minimum(ridges[:, :end].mean(axis=1), ridges[:, -end:].mean(axis=1))
    crossing = np.clip(ends / (END_CONTRAST * np.median(means, axis=0) + 1e-6), 0.0, 1.0)
    return np.asarray(np.clip(z[1] / Z_FULL, 0.0, 1.0) * np.clip(z[0] / 2.0, 0.0, 1.0) * crossing)
