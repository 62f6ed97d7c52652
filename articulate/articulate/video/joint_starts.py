"""Tracks of one group in a few frames, and first guesses of its joint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array, Ints, normalised
from articulate.video.joint_fit import FRAMES, POINTS, Start, TrackSet
from articulate.video.motion_groups import travel

FOCAL_RATIO = 1.1
"""Focal length in units of the larger side of the image: that of most phones."""
LEAST_SEEN = 3
"""Frames in which a track must be visible."""
LINES = (-0.05, -0.6)
"""Distances of the first guesses of a hinge beyond the moving region, as a share of its extent."""
FULL = 0.98
"""Cosine of the angle at which a part appears widest."""


def track_set(
    uv: Array,
    visible: NDArray[np.bool_],
    names: Ints,
    size_px: tuple[int, int],
    frames: Ints | None = None,
) -> TrackSet | None:
    """Return the tracks ``names`` in at most ``FRAMES`` frames, or None if there are too few.

    Args:
        uv: Stabilised pixels (T, N, 2).
        visible: Visibility (T, N).
        names: Indices of the tracks.
        size_px: Width and height [px].
        frames: Frames to use; evenly spread over the group's visible time if None.
    """
    focal = FOCAL_RATIO * max(size_px)
    if frames is None:
        now = np.nonzero(visible[:, names].sum(axis=1) >= 4)[0]
        if len(now) < 5:
            return None
        at = np.unique(np.linspace(0, len(now) - 1, FRAMES).round().astype(np.int64))
        frames = now[at].astype(np.int64)
    seen = visible[frames][:, names].T
    usable = seen.sum(axis=1) >= LEAST_SEEN
    if usable.sum() < 5:
        return None
    kept = names[usable]
    if len(kept) > POINTS:  # of the best seen, those of every travel alike
        best = np.argsort(-seen[usable].sum(axis=1), kind="stable")[: 2 * POINTS]
        path = travel(uv[frames][:, kept[best]], visible[frames][:, kept[best]])
        order = best[np.argsort(path, kind="stable")]
        spread = np.linspace(0, len(order) - 1, POINTS).round().astype(np.int64)
        kept = np.sort(kept[order[spread]])
    xy = uv[frames][:, kept].transpose(1, 0, 2) - 0.5 * np.asarray(size_px, dtype=np.float64)
    return TrackSet(
        xy=np.ascontiguousarray(xy / focal),
        seen=np.ascontiguousarray(visible[frames][:, kept].T),
        frames=frames,
        names=kept.astype(np.int64),
        focal_px=focal,
    )


def _chained(tracks: TrackSet) -> tuple[Array, Array, Array]:
    """Return shift (T, 2), turn (T,) and log scale (T,) of the group since the first frame.

    Similarity transforms between successive frames are multiplied.
    """
    t_count = tracks.seen.shape[1]
    shift, turn, grown = np.zeros((t_count, 2)), np.zeros(t_count), np.zeros(t_count)
    for t in range(1, t_count):
        both = tracks.seen[:, t] & tracks.seen[:, t - 1]
        shift[t], turn[t], grown[t] = shift[t - 1], turn[t - 1], grown[t - 1]
        if both.sum() < 3:
            continue
        here, there = tracks.xy[both, t - 1], tracks.xy[both, t]
        shift[t] += np.median(there - here, axis=0)
        a, b = here - np.median(here, axis=0), there - np.median(there, axis=0)
        z = (b[:, 0] + 1j * b[:, 1]) @ (a[:, 0] - 1j * a[:, 1])
        power = float((a**2).sum())
        if abs(z) > 1e-12 and power > 0.0:
            turn[t] += float(np.angle(z))
            grown[t] += float(np.log(max(abs(z) / power, 0.2)))
    return shift, turn, grown


def main_direction(shift: Array) -> Array:
    """Return the unit vector (2,) along which most of a path (T, 2) goes, with its sense."""
    steps = np.diff(shift, axis=0)
    length = np.linalg.norm(steps, axis=1)
    if length.max(initial=0.0) < 1e-12:
        return np.array([1.0, 0.0])
    tensor = (steps.T / np.maximum(length, 1e-12)) @ steps
    _, vectors = np.linalg.eigh(tensor)
    along = vectors[:, 1]
    path = shift @ along
    far = path[int(np.argmax(np.abs(path)))]
    return np.asarray(along if far >= 0.0 else -along)


def _mean_points(tracks: TrackSet, at: Array) -> Array:
    """Return the mean (N, 3) over the visible frames of places ``at`` (N, T, 2), at depth 1."""
    count = np.maximum(tracks.seen.sum(axis=1), 1)
    mean = np.where(tracks.seen[..., None], at, 0.0).sum(axis=1) / count[:, None]
    return np.concatenate([mean, np.ones((len(mean), 1))], axis=1)


def slide_starts(tracks: TrackSet) -> list[Start]:
    """Return first guesses of a slide: across the image, obliquely, and along the view."""
    shift, _, grown = _chained(tracks)
    along = main_direction(shift)
    path = shift @ along
    points = _mean_points(tracks, tracks.xy - path[None, :, None] * along)
    starts = []
    for depth in (0.0, -1.0, 1.0):
        axis = normalised(np.array([along[0], along[1], depth]))
        starts.append(
            Start(axis=axis, pivot=np.zeros(3), positions=path / axis[:2].dot(along), points=points)
        )
    nearer = np.exp(-grown) - 1.0
    scaled = tracks.xy * (1.0 + nearer)[None, :, None]
    starts.append(
        Start(
            axis=np.array([0.0, 0.0, 1.0]),
            pivot=np.zeros(3),
            positions=nearer,
            points=_mean_points(tracks, scaled),
        )
    )
    return starts


def hinge_starts(tracks: TrackSet) -> list[Start]:
    """Return first guesses of a hinge: lines across the motion, and an axis along the view."""
    shift, turn, _ = _chained(tracks)
    along = main_direction(shift)
    seen_xy = tracks.xy[tracks.seen]
    starts = []
    across = np.array([-along[1], along[0]])
    middle = float(np.median(seen_xy @ across))
    for sign in (1.0, -1.0):
        for share in LINES:
            reach = seen_xy @ (sign * along)
            low, high = np.percentile(reach, [2, 98])
            line = low + share * (high - low)
            starts += _line_starts(tracks, sign * along, line, middle * sign)
    starts.append(_view_start(tracks, turn))
    return starts


def _line_starts(tracks: TrackSet, e: Array, line: float, middle: float) -> list[Start]:
    """Return hinges in the image plane: the line at ``line`` along ``e`` (2,)."""
    a = np.array([-e[1], e[0]])
    away = tracks.xy @ e - line
    t_count = away.shape[1]
    ratio = np.ones(t_count)
    for t in range(1, t_count):
        both = tracks.seen[:, t] & tracks.seen[:, t - 1] & (away[:, t - 1] > 1e-3)
        step = np.median(away[both, t] / away[both, t - 1]) if both.sum() >= 3 else 1.0
        ratio[t] = ratio[t - 1] * float(np.clip(step, 0.3, 3.0))
    cosine = FULL * ratio / ratio.max()
    angle = np.arccos(np.clip(cosine, 0.05, FULL))
    radius = away / np.cos(angle)[None, :]
    along = tracks.xy @ a
    at = e * (line + radius)[..., None] + a * along[..., None]
    points = _mean_points(tracks, at)
    axis = np.array([a[0], a[1], 0.0])
    pivot = np.array([*(line * e + middle * a), 1.0])
    signs = [np.ones(t_count), -np.ones(t_count)]
    widest = int(np.argmax(ratio))
    if 0.15 * t_count < widest < 0.85 * t_count:
        crossing = np.where(np.arange(t_count) < widest, -1.0, 1.0)
        signs += [crossing, -crossing]
    return [Start(axis=axis, pivot=pivot, positions=sign * angle, points=points) for sign in signs]


def _view_start(tracks: TrackSet, turn: Array) -> Start:
    """Return a hinge along the line of sight: a rotation in the image."""
    rows, values = [], []
    t_count = tracks.seen.shape[1]
    for t in range(1, t_count):
        both = tracks.seen[:, t] & tracks.seen[:, t - 1]
        if both.sum() < 3:
            continue
        step = turn[t] - turn[t - 1]
        R = np.array([[np.cos(step), -np.sin(step)], [np.sin(step), np.cos(step)]])
        here = np.median(tracks.xy[both, t - 1], axis=0)
        there = np.median(tracks.xy[both, t], axis=0)
        rows.append(np.eye(2) - R)
        values.append(there - R @ here)
    centre = np.median(tracks.xy[tracks.seen], axis=0)
    if rows:
        left, right = np.concatenate(rows), np.concatenate(values)
        lean = 1e-4
        centre = np.linalg.solve(left.T @ left + lean * np.eye(2), left.T @ right + lean * centre)
        centre = np.clip(centre, -2.0, 2.0)
    c, s = np.cos(turn), np.sin(turn)
    back = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)  # (T, 2, 2)
    at = np.einsum("tij,ntj->nti", back, tracks.xy - centre) + centre
    return Start(
        axis=np.array([0.0, 0.0, 1.0]),
        pivot=np.array([centre[0], centre[1], 1.0]),
        positions=turn,
        points=_mean_points(tracks, at),
    )
