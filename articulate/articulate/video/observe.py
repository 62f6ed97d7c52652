"""Estimate joint type and axis of the operated part from a video without geometry.

Points are tracked and the camera's motion is removed; the rest gives three
cues. The main direction of the motion is that of a slide, or is perpendicular to the axis of a
hinge. Points that move away from one spot, or towards it, belong to a part that slides along the
line of sight. And a part that rotates about an axis in the image plane first approaches the camera
and then recedes, or the reverse, so that the expansion of its image across its motion changes over
time; that of a sliding part does not.
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

FOCAL_RATIO = 1.1
"""Focal length in units of the larger side of the image: a phone's, held upright."""
FRAME_GAPS = (2, 4, 8, 12)
"""Frames between which motion is measured; the first gap with enough motion is used."""
MIN_STEP_MOTION = 0.03
"""Median motion that is enough, as a share of the larger side."""
MIN_POINT_MOTION = 0.008
"""Points that move less between two frames are ignored, as a share of the larger side."""
MIN_POINTS = 10
"""Fewer points in two frames are ignored."""
MAX_DEPTH_RATIO = 0.65
"""Motion that shift and scaling leave unexplained, as a share of what a shift leaves, below which a
part slides along the line of sight."""
MIN_EXPANSION = 0.48
"""Spread over time of the expansion rate, per motion of one larger side, above which a part
rotates. This and ``MAX_DEPTH_RATIO`` were chosen by inspection on 17 recorded videos
(``benchmarks/filmed_clips.py`` evaluates them)."""
MAX_RATE = 4.0
"""Largest such rate; larger ones are clipped."""
MIN_CONFIDENCE = 0.1
"""Confidence below which the kind is doubtful: a measured cue is within a tenth of the border."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Joint type and axis estimated from a video."""

    kind: Literal["revolute", "prismatic"]
    axis_c: tuple[float, float, float]
    """Unit vector of the axis, or of sliding along the motion, in the camera frame (x right, y
    down, z forward)."""
    path_px: tuple[tuple[float, float], ...]
    """Path of the point that moved farthest, in pixels of the first frame."""
    box_px: tuple[float, float, float, float]
    """Left, right, top, bottom of the moving region, in pixels of the first frame."""
    confidence: float
    """Distance of the cues from the border between the kinds, in [0, 1]."""
    figures: Mapping[str, float]
    """The measured cues."""

    @property
    def doubtful(self) -> bool:
        """The other kind is nearly as likely."""
        return self.confidence < MIN_CONFIDENCE

    def as_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
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
class FlowStep:
    """Motion of points between two frames."""

    at: Array
    """Midpoint of the motion of each point, relative to the image centre (N, 2) [px]."""
    by: Array
    """Motion of each point (N, 2) [px]."""


def observe_joint(clip: Video, source: str) -> Observation:
    """Estimate how the operated part moves.

    Args:
        clip: The video.
        source: Its name, for messages.

    Raises:
        UsageError: Nothing moves, or too few moving points can be tracked.
    """
    check_motion(clip.frames, source)
    height, width = clip.frames.shape[1:3]
    tracks = follow_points(clip.frames, Tracking(most_points=900, spacing_px=5, every=3))
    moving = moving_points(tracks, (width, height))
    side = float(max(width, height))
    steps = steps_of(moving, np.array([width, height]) / 2.0, side)
    if not steps:
        raise UsageError(
            f"{source}: too few moving points can be tracked; give a video with more light, "
            "a larger part or a slower motion"
        )
    return _observed(steps, moving, side)


def steps_of(moving: MovingPoints, middle: Array, side: float) -> list[FlowStep]:
    """Return the motion between frames that are far enough apart, one for each frame that has one.

    Args:
        moving: Moving points.
        middle: Image centre (2,) [px].
        side: Larger side of the image [px].
    """
    found = []
    for t in range(len(moving.uv) - FRAME_GAPS[0]):
        best = None
        for step in FRAME_GAPS:
            if t + step >= len(moving.uv):
                break
            both = moving.visible[t] & moving.visible[t + step]
            here, there = moving.uv[t][both], moving.uv[t + step][both]
            far = np.linalg.norm(there - here, axis=1)
            if (far > MIN_POINT_MOTION * side).sum() < MIN_POINTS:
                continue
            chosen = far > MIN_POINT_MOTION * side
            best = FlowStep(
                0.5 * (here[chosen] + there[chosen]) - middle, there[chosen] - here[chosen]
            )
            if np.median(far[chosen]) > MIN_STEP_MOTION * side:
                break
        if best is not None:
            found.append(best)
    return found


def _observed(steps: list[FlowStep], moving: MovingPoints, side: float) -> Observation:
    along = main_direction(steps)
    axis: Array
    across = np.array([-along[1], along[0]])
    shift, grown = _residual_motion(steps, side)
    expanding = _expansion(steps, along, across, side)
    moving_away = grown / max(shift, 1e-12)
    figures = {"moving_away": moving_away, "expanding": expanding, "steps": float(len(steps))}
    path, box = _path_and_box(moving)
    if moving_away < MAX_DEPTH_RATIO or expanding < MIN_EXPANSION:
        kind: Literal["revolute", "prismatic"] = "prismatic"
        axis = _slide_direction(steps, side, depth=moving_away < MAX_DEPTH_RATIO, along=along)
    else:
        kind, axis = "revolute", np.array([across[0], across[1], 0.0])
    # It rotates if both cues are beyond their borders, otherwise it slides.
    beyond = min(
        (moving_away - MAX_DEPTH_RATIO) / MAX_DEPTH_RATIO,
        (expanding - MIN_EXPANSION) / MIN_EXPANSION,
    )
    return Observation(
        kind=kind,
        axis_c=(float(axis[0]), float(axis[1]), float(axis[2])),
        path_px=path,
        box_px=box,
        confidence=float(min(1.0, abs(beyond))),
        figures=figures,
    )


def main_direction(steps: list[FlowStep]) -> Array:
    """Return the unit vector (2,) along which most of the motion goes, up to sign."""
    tensor = np.zeros((2, 2))
    for step in steps:
        length = np.linalg.norm(step.by, axis=1)
        tensor += (step.by.T / length) @ step.by
    _, vectors = np.linalg.eigh(tensor)
    return np.asarray(vectors[:, 1])


def robust_lines(rows: Array, values: Array, soft: float) -> Array:
    """Fit coefficients (P,) of ``rows`` (N, P) to ``values`` (N,), least absolute errors.

    Iteratively reweighted least squares; errors below ``soft`` (in the unit of the values, here
    [px]) are squared.
    """
    weight: Array = np.ones(len(values))
    solution: Array = np.zeros(rows.shape[1])
    for _ in range(8):
        scaled = rows * weight[:, None]
        left = scaled.T @ rows + 1e-9 * np.eye(rows.shape[1])
        solution = np.asarray(np.linalg.solve(left, scaled.T @ values), dtype=np.float64)
        weight = np.asarray(1.0 / np.maximum(np.abs(values - rows @ solution), soft))
    return solution


def _flow_rows(step: FlowStep) -> Array:
    """Return rows (2 N, 3) of a motion by shift and scaling."""
    rows = np.zeros((len(step.at), 2, 3))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    rows[:, :, 2] = step.at
    return rows.reshape(-1, 3)


def _residual_motion(steps: list[FlowStep], side: float) -> tuple[float, float]:
    """Return the motion that a shift, and a shift with scaling, leave unexplained [px]."""
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


def _expansion(steps: list[FlowStep], along: Array, across: Array, side: float) -> float:
    """Return the spread over time of the expansion rate of the part across its motion."""
    rates, weights = [], []
    for step in steps:
        travel = step.by @ along
        middle = float(np.median(travel))
        same = np.sign(travel) == np.sign(middle)
        if same.sum() < MIN_POINTS - 2 or abs(middle) < 1e-9:
            continue
        at, by = step.at[same], step.by[same]
        x, y = at @ along, at @ across
        rows = np.stack([np.ones(len(at)), y - y.mean(), x - x.mean()], axis=1)
        rate = robust_lines(rows, by @ across, 0.002 * side)[1]
        rates.append(float(np.clip(side * rate / abs(middle), -MAX_RATE, MAX_RATE)))
        weights.append(len(at) * abs(middle))
    if not rates:
        return 0.0
    mean = np.average(rates, weights=weights)
    return float(np.sqrt(np.average((np.array(rates) - mean) ** 2, weights=weights)))


def _slide_direction(steps: list[FlowStep], side: float, *, depth: bool, along: Array) -> Array:
    """Return the direction of a slide (3,) in the camera frame, along the motion."""
    total = np.zeros(3)
    for step in steps:
        total += len(step.at) * robust_lines(_flow_rows(step), step.by.reshape(-1), 1.0)
    if depth:  # an approaching part grows: the direction is shift over focal length
        return np.asarray(
            normalised(
                [total[0] / (FOCAL_RATIO * side), total[1] / (FOCAL_RATIO * side), -total[2]]
            )
        )
    travel = sum(float((step.by @ along).sum()) for step in steps)
    return np.array([along[0], along[1], 0.0]) * (1.0 if travel >= 0.0 else -1.0)


def _path_and_box(
    moving: MovingPoints,
) -> tuple[tuple[tuple[float, float], ...], tuple[float, float, float, float]]:
    """Return the longest path of a point, and the box around all points."""
    best, best_far = 0, -1.0
    for n in range(moving.uv.shape[1]):
        travel = moving.uv[moving.visible[:, n], n]
        far = float(np.linalg.norm(travel[-1] - travel[0]))
        if far > best_far:
            best, best_far = n, far
    travel = moving.uv[moving.visible[:, best], best]
    seen = moving.uv[moving.visible]
    left, top = np.percentile(seen, 2, axis=0)
    right, bottom = np.percentile(seen, 98, axis=0)
    path = tuple((float(u), float(v)) for u, v in travel)
    return path, (float(left), float(right), float(top), float(bottom))
