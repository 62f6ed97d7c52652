"""Watch: from a film alone, how the part that is operated moves in the picture.

No geometry is known. Points are followed and the camera's motion is taken away; what is left tells
three things. The direction in which most of it goes is the direction of a slide, or lies across
the axis of a hinge. Points that flee from, or run to, one spot are of a part that slides along the
line of sight. And of a part that turns about an axis in the picture, points first come nearer and
then go away, or the other way round, so that how fast the picture of it widens across its motion
changes in time; of a part that slides it does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from articulate.errors import UsageError
from articulate.render.joint_video import Video
from articulate.transforms import Array, normalised
from articulate.video.moving_region import MovingPoints, moving_points
from articulate.video.read_video import check_motion
from articulate.video.tracks import Tracking, follow_points

FOCAL = 1.1
"""Focal length in units of the larger side of the picture: a phone's, held upright."""
STEPS = (2, 4, 8, 12)
"""Frames between which motion is measured; the first that is long enough."""
LONG = 0.03
"""Median motion that is long enough, as a share of the larger side."""
SHORT = 0.008
"""Points that move less between two frames are left out, as a share of the larger side."""
FEWEST = 10
"""Fewer points in two frames say nothing."""
FLEEING = 0.65
"""A slide along the line of sight: what a growing picture does not explain is less than this share
of what a shift alone does not."""
WIDENS = 0.48
"""Spread over time of how fast the picture of the part widens, per motion of one larger side, from
which on it turns. This and ``FLEEING`` were chosen on 17 filmed clips, by looking at them."""
FURTHEST = 4.0
"""Such rates beyond this are cut."""
DOUBTFUL = 0.1
"""Less confidence is doubt: what was measured lies within a tenth of the border between kinds."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """What is seen of a joint."""

    kind: Literal["revolute", "prismatic"]
    axis_c: tuple[float, float, float]
    """Direction of the axis, or of sliding along the motion, in the camera's frame (x right, y
    down, z ahead), of unit length."""
    path_px: tuple[tuple[float, float], ...]
    """Way of the point that was followed farthest, in the picture of the first frame."""
    box_px: tuple[float, float, float, float]
    """Left, right, top, bottom of what moves, in the picture of the first frame."""
    confidence: float
    """How clear the kind is, in [0, 1]: the distance from the border between kinds."""
    figures: Mapping[str, float]
    """What was measured."""

    @property
    def doubtful(self) -> bool:
        """Whether the other kind is nearly as likely."""
        return self.confidence < DOUBTFUL

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "kind": self.kind,
            "axis_camera": list(self.axis_c),
            "path_px": [list(point) for point in self.path_px],
            "box_px": list(self.box_px),
            "confidence": self.confidence,
            "doubtful": self.doubtful,
            "figures": dict(self.figures),
        }


@dataclass(frozen=True, eq=False)
class Step:
    """How points moved between two frames."""

    at: Array
    """Middle of the motion of each point, from the middle of the picture (N, 2) [px]."""
    by: Array
    """Motion of each point (N, 2) [px]."""


def watch(clip: Video, source: str) -> Observation:
    """How the part that is operated moves.

    Raises:
        UsageError: Nothing moves, or too little of it can be followed.
    """
    check_motion(clip.frames, source)
    height, width = clip.frames.shape[1:3]
    tracks = follow_points(clip.frames, Tracking(most_points=900, spacing_px=5, every=3))
    moving = moving_points(tracks, (width, height))
    side = float(max(width, height))
    steps = steps_of(moving, np.array([width, height]) / 2.0, side)
    if not steps:
        raise UsageError(
            f"{source}: too few points of what moves can be followed; give a film with more light, "
            "a larger part or a slower motion"
        )
    return _observed(steps, moving, side)


def steps_of(moving: MovingPoints, middle: Array, side: float) -> list[Step]:
    """The motion between frames that are far enough apart, one for each frame that allows it."""
    found = []
    for t in range(len(moving.uv) - STEPS[0]):
        best = None
        for step in STEPS:
            if t + step >= len(moving.uv):
                break
            both = moving.visible[t] & moving.visible[t + step]
            here, there = moving.uv[t][both], moving.uv[t + step][both]
            far = np.linalg.norm(there - here, axis=1)
            if (far > SHORT * side).sum() < FEWEST:
                continue
            chosen = far > SHORT * side
            best = Step(0.5 * (here[chosen] + there[chosen]) - middle, there[chosen] - here[chosen])
            if np.median(far[chosen]) > LONG * side:
                break
        if best is not None:
            found.append(best)
    return found


def _observed(steps: list[Step], moving: MovingPoints, side: float) -> Observation:
    along = main_direction(steps)
    axis: Array
    across = np.array([-along[1], along[0]])
    shift, grown = _unexplained(steps, side)
    widening = _widening(steps, along, across, side)
    fleeing = grown / max(shift, 1e-12)
    figures = {"fleeing": fleeing, "widening": widening, "steps": float(len(steps))}
    path, box = _path_and_box(moving)
    if fleeing < FLEEING or widening < WIDENS:
        kind: Literal["revolute", "prismatic"] = "prismatic"
        axis = _slide_direction(steps, side, depth=fleeing < FLEEING, along=along)
    else:
        kind, axis = "revolute", np.array([across[0], across[1], 0.0])
    # It turns if both figures are beyond their borders, and slides if either is not.
    beyond = min((fleeing - FLEEING) / FLEEING, (widening - WIDENS) / WIDENS)
    return Observation(
        kind=kind,
        axis_c=(float(axis[0]), float(axis[1]), float(axis[2])),
        path_px=path,
        box_px=box,
        confidence=float(min(1.0, abs(beyond))),
        figures=figures,
    )


def main_direction(steps: list[Step]) -> Array:
    """Unit vector (2,) along which most of the motion goes, sign aside."""
    tensor = np.zeros((2, 2))
    for step in steps:
        length = np.linalg.norm(step.by, axis=1)
        tensor += (step.by.T / length) @ step.by
    _, vectors = np.linalg.eigh(tensor)
    return np.asarray(vectors[:, 1])


def robust_lines(rows: Array, values: Array, soft: float) -> Array:
    """Coefficients (P,) of ``rows`` (N, P) that give ``values`` (N,) with least absolute errors."""
    weight: Array = np.ones(len(values))
    solution: Array = np.zeros(rows.shape[1])
    for _ in range(8):
        scaled = rows * weight[:, None]
        left = scaled.T @ rows + 1e-9 * np.eye(rows.shape[1])
        solution = np.asarray(np.linalg.solve(left, scaled.T @ values), dtype=np.float64)
        weight = np.asarray(1.0 / np.maximum(np.abs(values - rows @ solution), soft))
    return solution


def _flow_rows(step: Step) -> Array:
    """Rows (2 N, 3) of a motion that is a shift and a growth."""
    rows = np.zeros((len(step.at), 2, 3))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    rows[:, :, 2] = step.at
    return rows.reshape(-1, 3)


def _unexplained(steps: list[Step], side: float) -> tuple[float, float]:
    """Motion that neither a shift, nor a shift and a growth, explains [px]."""
    shift, grown = 0.0, 0.0
    for step in steps:
        rows, values = _flow_rows(step), step.by.reshape(-1)
        for columns in (2, 3):
            fit = rows[:, :columns] @ robust_lines(rows[:, :columns], values, 1.0)
            off = np.linalg.norm((values - fit).reshape(-1, 2), axis=1)
            total = float(np.minimum(off, 0.05 * side).sum())
            if columns == 2:
                shift += total
            else:
                grown += total
    return shift, grown


def _widening(steps: list[Step], along: Array, across: Array, side: float) -> float:
    """Spread over time of how fast the picture of the part widens across its motion."""
    rates, weights = [], []
    for step in steps:
        way = step.by @ along
        middle = float(np.median(way))
        same = np.sign(way) == np.sign(middle)
        if same.sum() < FEWEST - 2 or abs(middle) < 1e-9:
            continue
        at, by = step.at[same], step.by[same]
        x, y = at @ along, at @ across
        rows = np.stack([np.ones(len(at)), y - y.mean(), x - x.mean()], axis=1)
        rate = robust_lines(rows, by @ across, 0.002 * side)[1]
        rates.append(float(np.clip(side * rate / abs(middle), -FURTHEST, FURTHEST)))
        weights.append(len(at) * abs(middle))
    if not rates:
        return 0.0
    mean = np.average(rates, weights=weights)
    return float(np.sqrt(np.average((np.array(rates) - mean) ** 2, weights=weights)))


def _slide_direction(steps: list[Step], side: float, *, depth: bool, along: Array) -> Array:
    """Direction of a slide (3,) in the camera's frame, along the motion."""
    total = np.zeros(3)
    for step in steps:
        total += len(step.at) * robust_lines(_flow_rows(step), step.by.reshape(-1), 1.0)
    if depth:  # what comes nearer grows: the way is that of a shift over the focal length
        return np.asarray(
            normalised([total[0] / (FOCAL * side), total[1] / (FOCAL * side), -total[2]])
        )
    way = sum(float((step.by @ along).sum()) for step in steps)
    return np.array([along[0], along[1], 0.0]) * (1.0 if way >= 0.0 else -1.0)


def _path_and_box(
    moving: MovingPoints,
) -> tuple[tuple[tuple[float, float], ...], tuple[float, float, float, float]]:
    """The farthest way of one point, and the box around all."""
    best, best_far = 0, -1.0
    for n in range(moving.uv.shape[1]):
        way = moving.uv[moving.visible[:, n], n]
        far = float(np.linalg.norm(way[-1] - way[0]))
        if far > best_far:
            best, best_far = n, far
    way = moving.uv[moving.visible[:, best], best]
    seen = moving.uv[moving.visible]
    left, top = np.percentile(seen, 2, axis=0)
    right, bottom = np.percentile(seen, 98, axis=0)
    path = tuple((float(u), float(v)) for u, v in way)
    return path, (float(left), float(right), float(top), float(bottom))
