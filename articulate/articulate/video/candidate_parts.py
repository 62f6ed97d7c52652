"""Candidates for the operated part: groups of points, each with both joints fitted to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array, Ints
from articulate.video.joint_fit import JointFit, TrackSet, best_fit, residuals_under
from articulate.video.joint_starts import hinge_starts, slide_starts, track_set
from articulate.video.motion_groups import MotionGroups, group_points, travel
from articulate.video.moving_region import camera_motion, stabilised
from articulate.video.tracks import PointTracks

CANDIDATES = 4
"""Groups that are examined."""
GROWTH_PX = 1.3
"""Residual below which a point of another group joins [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Tracks of a video without the camera's motion."""

    uv: Array
    """Pixels (T, N, 2) as seen from the first camera pose."""
    visible: NDArray[np.bool_]
    """Visibility (T, N)."""
    raw_uv: Array
    """Pixels (T, N, 2) in each frame."""
    camera: Array
    """Homographies from each frame to the first (T, 3, 3)."""
    size_px: tuple[int, int]
    """Width and height [px]."""
    groups: MotionGroups

    @property
    def side(self) -> float:
        """Larger side of the image [px]."""
        return float(max(self.size_px))

    def seen_from(self, frame: int) -> Array:
        """Return the pixels (T, N, 2) as seen from the camera pose of a frame."""
        back = np.tile(np.linalg.inv(self.camera[frame]), (len(self.uv), 1, 1))
        return stabilised(PointTracks(uv=self.uv, visible=self.visible), back)


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidatePart:
    """A group of points with both joints fitted to it."""

    names: Ints
    """Indices of the tracks."""
    core: Ints
    """Indices of the tracks of the group from which it grew."""
    tracks: TrackSet
    slide: JointFit
    hinge: JointFit


def video_motion(tracks: PointTracks, size_px: tuple[int, int]) -> Motion:
    """Remove the camera's motion from tracks and group those that move.

    Args:
        tracks: Tracked points.
        size_px: Width and height of the video [px].
    """
    camera = camera_motion(tracks)
    uv = stabilised(tracks, camera)
    groups = group_points(uv, tracks.visible, float(max(size_px)))
    return Motion(
        uv=uv,
        visible=tracks.visible,
        raw_uv=tracks.uv,
        camera=camera,
        size_px=size_px,
        groups=groups,
    )


def regrouped(motion: Motion, seed: int) -> Motion:
    """Return the same motion with groups from another ``seed``; a border case may change."""
    groups = group_points(motion.uv, motion.visible, motion.side, seed)
    return replace(motion, groups=groups)


def candidate_parts(motion: Motion) -> list[CandidatePart]:
    """Return the candidates for the operated part, by decreasing number and motion of points."""
    groups = motion.groups
    weights = []
    for k in range(groups.count):
        names = groups.members(k)
        path = travel(motion.uv[:, names], motion.visible[:, names])
        weights.append(float((np.minimum(path, 0.3 * motion.side)).sum()))
    order = np.argsort(-np.array(weights), kind="stable")[:CANDIDATES]
    found = []
    for k in order:
        candidate = _grown(motion, groups.members(int(k)))
        if candidate is not None:
            found.append(candidate)
    return found


def _fitted(motion: Motion, names: Ints) -> tuple[TrackSet, JointFit, JointFit] | None:
    tracks = track_set(motion.uv, motion.visible, names, motion.size_px)
    if tracks is None:
        return None
    slide = best_fit("prismatic", tracks, slide_starts(tracks))
    hinge = best_fit("revolute", tracks, hinge_starts(tracks))
    return tracks, slide, hinge


def _grown(motion: Motion, core: Ints) -> CandidatePart | None:
    """Fit both joints to a group, then also to the points of other groups that fit either.

    The right joint explains points all over the part, the wrong one only some of them.
    """
    fitted = _fitted(motion, core)
    if fitted is None:
        return None
    names = core
    tracks, slide, hinge = fitted
    others = np.setdiff1d(motion.groups.tracks, names)
    rest = track_set(motion.uv, motion.visible, others, motion.size_px, frames=tracks.frames)
    if rest is not None:
        joins = np.zeros(len(rest.names), dtype=np.bool_)
        for fit in (slide, hinge):
            limit = GROWTH_PX * max(1.0, float(np.median(fit.rms)))
            joins |= residuals_under(fit, rest) < limit
        if joins.any():
            names = np.sort(np.concatenate([core, rest.names[joins]]))
            fitted = _fitted(motion, names) or fitted
    tracks, slide, hinge = fitted
    return CandidatePart(names=names, core=core, tracks=tracks, slide=slide, hinge=hinge)
