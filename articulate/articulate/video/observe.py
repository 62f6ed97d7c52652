"""Estimate the operated joint from a video without geometry: type, axis, side and direction.

Dense point tracks are freed from the camera's motion and grouped by common motion. A hinge and a
slide are fitted to each group. Classifiers learned from rendered videos choose the group that is
the operated part, not an arm or a person, and give the probability that it rotates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from articulate.errors import UsageError
from articulate.render.joint_video import Video
from articulate.transforms import Array
from articulate.video.candidate_parts import (
    CandidatePart,
    Motion,
    candidate_parts,
    regrouped,
    video_motion,
)
from articulate.video.joint_classifier import joint_classifier
from articulate.video.motion_features import features, opening_features, points_at
from articulate.video.motion_groups import travel
from articulate.video.opening_direction import opening_logs
from articulate.video.read_video import check_motion
from articulate.video.surface_tracks import follow_surface

LONGEST_PX = 480
"""Longest side of the frames in which points are tracked [px]."""
MOST_FRAMES = 72
"""Frames in which points are tracked."""
LEAST_FRAMES = 6
"""Shorter videos show no motion."""
GROUPINGS = 4
"""Groupings of the points, by different seeds, whose candidates decide together."""
DARK = 14.0
"""Mean brightness of the brightest tenth of the pixels below which nothing can be tracked."""
SHAKE_SHARE = 0.12
"""Median motion of the camera between frames that cannot be removed, as a share of the side."""
SECOND_PART = 0.75
"""Probability above which a second candidate is another operated part."""
SHARED = 0.1
"""Share of common points above which two candidates are the same part."""
CERTAIN = 0.65
"""Probability above which the sense of the motion is reported."""

Kind = Literal["revolute", "prismatic"]
Side = Literal["left", "right", "top", "bottom", ""]


@dataclass(frozen=True, kw_only=True)
class Observation:
    """Joint type and axis estimated from a video."""

    kind: Kind
    axis_c: tuple[float, float, float]
    """Unit vector of the axis, or of sliding along the first motion, in the camera frame (x right,
    y down, z forward)."""
    path_px: tuple[tuple[float, float], ...]
    """Path of the point that moved farthest, in pixels of the first frame."""
    box_px: tuple[float, float, float, float]
    """Left, right, top, bottom of the moving region, in pixels of the first frame."""
    confidence: float
    """Calibrated probability of the joint type, in [0.5, 1]."""
    figures: Mapping[str, float]
    """The measured cues."""
    doubtful: bool
    """The joint type is not reliable."""
    p_revolute: float
    """Calibrated probability that the part rotates."""
    side: Side
    """Edge of the moving region at which the hinge is seen; empty for a sliding part."""
    direction_px: tuple[float, float]
    """Unit vector of the first motion of the part in the image (x right, y down)."""
    opening: bool | None
    """The first motion opens the part; None if that cannot be distinguished."""
    travel: float
    """Estimated travel: angle [rad], or distance in units of the part's distance from the
    camera."""
    moving_parts: int
    """Number of parts that seem to be operated."""
    openings: tuple[float, ...]
    """Logarithm of the likelihood of each opening of ``opening_direction``."""

    def as_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "kind": self.kind,
            "axis_camera": list(self.axis_c),
            "path_px": [list(point) for point in self.path_px],
            "box_px": list(self.box_px),
            "confidence": self.confidence,
            "doubtful": self.doubtful,
            "p_revolute": self.p_revolute,
            "side": self.side,
            "direction_px": list(self.direction_px),
            "opening": self.opening,
            "travel": self.travel,
            "moving_parts": self.moving_parts,
            "figures": dict(self.figures),
        }


def observe_joint(video: Video, source: str) -> Observation:
    """Estimate how the operated part moves.

    Args:
        video: The video; frames of about ``LONGEST_PX`` and at most ``MOST_FRAMES`` suffice.
        source: Its name, for messages.

    Raises:
        UsageError: Nothing moves; the video is too dark, short or shaky; or too few moving points
            can be tracked.
    """
    return observe_tracks(track_motion(video, source), source)


def track_motion(video: Video, source: str) -> Motion:
    """Track points, remove the motion of the camera, and group the points that move.

    Args:
        video: The video, as for ``observe_joint``.
        source: Its name, for messages.

    Raises:
        UsageError: Nothing moves, or the video is too dark, short or shaky.
    """
    frames = video.frames
    _check_frames(video, source)
    check_motion(frames, source)
    height, width = frames.shape[1:3]
    motion = video_motion(follow_surface(frames), (width, height))
    _check_camera(motion, source)
    return motion


def observe_tracks(motion: Motion, source: str, groupings: int = GROUPINGS) -> Observation:
    """Estimate how the operated part moves, from the tracks of a video.

    Args:
        motion: Result of ``track_motion``.
        source: Name of the video, for messages.
        groupings: Groupings of the points whose candidates decide together.

    Raises:
        UsageError: Too few moving points can be tracked.
    """
    candidates: list[CandidatePart] = []
    found: list[dict[str, float]] = []
    grouping: list[int] = []
    for seed in range(groupings):
        again = regrouped(motion, seed) if seed else motion
        parts = candidate_parts(again)
        candidates += parts
        found += [features(again, parts, k) for k in range(len(parts))]
        grouping += [seed] * len(parts)
    if not candidates:
        raise UsageError(
            f"{source}: too few moving points can be tracked; give a video with more light, "
            "a larger part or a slower motion"
        )
    model = joint_classifier()
    p_revolute, role, odds = model.decide(found)
    kind: Kind = "revolute" if p_revolute > 0.5 else "prismatic"
    # The part whose points support the decision most: its hinge or slide is reported.
    agrees = np.where((odds > 0.0) == (kind == "revolute"), 1.0, 0.2)
    k = int(np.argmax(role * agrees))
    confidence = max(p_revolute, 1.0 - p_revolute)
    same = np.array(grouping) == grouping[k]
    moving_parts = _count_parts(candidates, np.where(same, role, 0.0), k)
    turning = role / (1.0 + np.exp(-2.0 * odds))
    side: Side = _hinge_side(candidates, turning) if kind == "revolute" else ""
    figures = {**found[k], "role": float(role[k]), "log_odds": float(odds[k])}
    return _observation(
        motion,
        candidates[k],
        kind,
        confidence=confidence,
        doubtful=confidence < model.doubtful_below or moving_parts > 1,
        p_revolute=p_revolute,
        moving_parts=moving_parts,
        side=side,
        openings=opening_logs(candidates, role, odds),
        figures=figures,
    )


def _check_frames(video: Video, source: str) -> None:
    frames = video.frames
    if len(frames) < LEAST_FRAMES:
        raise UsageError(
            f"{source}: has {len(frames)} frames, too short to observe a motion; "
            f"give {LEAST_FRAMES} frames or more"
        )
    picks = frames[:: max(1, len(frames) // 8), ::4, ::4].mean(axis=-1)
    bright = float(np.percentile(picks, 95))
    if bright < DARK:
        raise UsageError(
            f"{source}: too dark to track points (brightest pixels {bright:.0f} of 255); "
            "give a video with more light"
        )


def _check_camera(motion: Motion, source: str) -> None:
    centre = np.array([0.5 * motion.size_px[0], 0.5 * motion.size_px[1], 1.0])
    path = motion.camera @ centre
    steps = np.linalg.norm(np.diff(path[:, :2] / path[:, 2:], axis=0), axis=1)
    shake = float(np.median(steps)) / motion.side
    if shake > SHAKE_SHARE:
        raise UsageError(
            f"{source}: too shaky (the camera moves by {100 * shake:.0f} % of the image between "
            "frames); give a video of a camera at rest"
        )


def _count_parts(candidates: list[CandidatePart], role: Array, k: int) -> int:
    """Return the number of parts: candidate ``k``, and likely ones that share no point with it."""
    kept = [k]
    for j in np.argsort(-role, kind="stable"):
        names = candidates[int(j)].names
        apart = all(
            len(np.intersect1d(names, candidates[i].names)) < SHARED * len(names) for i in kept
        )
        if role[j] > SECOND_PART and apart:
            kept.append(int(j))
    return len(kept)


def _observation(
    motion: Motion,
    part: CandidatePart,
    kind: Kind,
    *,
    confidence: float,
    doubtful: bool,
    p_revolute: float,
    moving_parts: int,
    side: Side,
    openings: Array,
    figures: Mapping[str, float],
) -> Observation:
    fit = part.hinge if kind == "revolute" else part.slide
    axis = fit.axis
    positions = fit.positions - fit.positions[0]
    peak = int(np.argmax(np.abs(positions)))
    if kind == "prismatic" and positions[peak] < 0.0:
        axis = -axis
    path, box, direction = _path_and_box(motion, part)
    return Observation(
        kind=kind,
        axis_c=(float(axis[0]), float(axis[1]), float(axis[2])),
        path_px=path,
        box_px=box,
        confidence=confidence,
        figures=figures,
        doubtful=doubtful,
        p_revolute=p_revolute,
        side=side,
        direction_px=direction,
        opening=_opening(part, kind),
        travel=float(np.ptp(positions)),
        moving_parts=moving_parts,
        openings=tuple(float(value) for value in openings),
    )


def _hinge_side(candidates: list[CandidatePart], weight: Array) -> Side:
    """Return the side at which most candidates have their hinge, seen when the part is closed.

    Args:
        candidates: All candidates.
        weight: Weight of each (N,).
    """
    votes: dict[Side, float] = {"left": 0.0, "right": 0.0, "top": 0.0, "bottom": 0.0}
    for part, share in zip(candidates, weight, strict=True):
        votes[_side_of(part)] += float(share) * min(1.0, float(np.ptp(part.hinge.positions)))
    return max(votes, key=lambda side: votes[side])


def _side_of(part: CandidatePart) -> Side:
    hinge = part.hinge
    peak = int(np.argmax(np.abs(hinge.positions - hinge.positions[0])))
    opens = joint_classifier().p_opening("revolute", opening_features(part))
    ends = [points_at(hinge, frame).mean(axis=0) for frame in (0, peak)]
    centre = opens * ends[0] + (1.0 - opens) * ends[1]
    foot = hinge.pivot + hinge.axis * float((centre - hinge.pivot) @ hinge.axis)
    nearest = np.maximum(np.stack([centre, foot])[:, 2:], 0.05)
    seen = np.stack([centre, foot])[:, :2] / nearest
    off = seen[1] - seen[0]
    if abs(off[0]) >= abs(off[1]):
        return "left" if off[0] < 0.0 else "right"
    return "top" if off[1] < 0.0 else "bottom"


def _opening(part: CandidatePart, kind: Kind) -> bool | None:
    """Return whether the first motion opens the part; None if that is uncertain."""
    p = joint_classifier().p_opening(kind, opening_features(part))
    return None if max(p, 1.0 - p) < CERTAIN else p > 0.5


def _path_and_box(
    motion: Motion, part: CandidatePart
) -> tuple[tuple[tuple[float, float], ...], tuple[float, float, float, float], tuple[float, float]]:
    """Return the longest path of a point, the box around all points, and the first direction."""
    uv, visible = motion.uv[:, part.names], motion.visible[:, part.names]
    best = int(np.argmax(travel(uv, visible)))
    path = uv[visible[:, best], best]
    seen = uv[visible]
    left, top = np.percentile(seen, 2, axis=0)
    right, bottom = np.percentile(seen, 98, axis=0)
    far = int(np.argmax(np.linalg.norm(path - path[0], axis=1)))
    step = path[far] - path[0]
    step = step / max(float(np.linalg.norm(step)), 1e-9)
    return (
        tuple((float(u), float(v)) for u, v in path),
        (float(left), float(right), float(top), float(bottom)),
        (float(step[0]), float(step[1])),
    )
