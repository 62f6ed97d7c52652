"""Features of a candidate part: how it moves, and how likely it is the operated part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array, axis_angle_to_matrix
from articulate.video.candidate_parts import CandidatePart, Motion
from articulate.video.joint_fit import JointFit, TrackSet
from articulate.video.motion_groups import travel

BORDER_SHARE = 0.03
"""Margin of the image that counts as its border, as a share of the larger side."""
REST_SHARE = 0.0012
"""Motion between frames below which a point is still, as a share of the larger side."""
SMALL = 1e-6


def features(motion: Motion, candidates: list[CandidatePart], k: int) -> dict[str, float]:
    """Return the features of candidate ``k``."""
    part = candidates[k]
    found = {"rank": float(k), "candidates": float(len(candidates))}
    found.update(_fit_features(part))
    found.update(_flow_features(part.tracks))
    found.update(_role_features(motion, part))
    others = [c for j, c in enumerate(candidates) if j != k]
    total = sum(len(c.names) for c in candidates)
    found["share"] = len(part.names) / max(total, 1)
    found["overlap"] = max(
        (len(np.intersect1d(part.names, c.names)) / len(part.names) for c in others), default=0.0
    )
    return {
        name: float(np.nan_to_num(value, posinf=20.0, neginf=-20.0))
        for name, value in found.items()
    }


def _fit_features(part: CandidatePart) -> dict[str, float]:
    slide, hinge = part.slide, part.hinge
    found = {
        "slide_cost": np.log(slide.cost + 0.01),
        "hinge_cost": np.log(hinge.cost + 0.01),
        "cost_ratio": np.log((hinge.cost + 0.02) / (slide.cost + 0.02)),
        "slide_rms": np.log(np.median(slide.rms) + 0.05),
        "hinge_rms": np.log(np.median(hinge.rms) + 0.05),
        "slide_outliers": float((slide.rms > 2.0).mean()),
        "hinge_outliers": float((hinge.rms > 2.0).mean()),
        "rms_p80_ratio": np.log(
            (np.percentile(hinge.rms, 80) + 0.1) / (np.percentile(slide.rms, 80) + 0.1)
        ),
        "hinge_range": float(np.ptp(hinge.positions)),
        "hinge_net": abs(float(hinge.positions[-1] - hinge.positions[0])),
        "hinge_nx": abs(float(hinge.axis[0])),
        "hinge_ny": abs(float(hinge.axis[1])),
        "hinge_nz": abs(float(hinge.axis[2])),
        "slide_dx": abs(float(slide.axis[0])),
        "slide_dy": abs(float(slide.axis[1])),
        "slide_dz": abs(float(slide.axis[2])),
        "slide_range": float(np.ptp(slide.positions)),
        "log_tracks": np.log(len(part.names)),
        "log_observations": np.log(part.tracks.seen.sum()),
    }
    gap = max(0.0, slide.cost - hinge.cost)
    found["cost_gap"] = gap
    found["evidence"] = np.log1p(gap * part.tracks.seen.sum())
    found.update(_axis_features(hinge))
    return found


def _axis_features(hinge: JointFit) -> dict[str, float]:
    """Return how far the points are from the fitted hinge, relative to their spread."""
    off = hinge.points - hinge.pivot
    arm = np.linalg.norm(np.cross(off, hinge.axis), axis=1)
    spread = float(np.linalg.norm(hinge.points.std(axis=0))) + SMALL
    low, middle, high = np.percentile(arm, [5, 50, 95])
    return {
        "arm_spread": np.log((middle + SMALL) / spread),
        "arm_ratio": float(low / (high + SMALL)),
        "spread": np.log(spread),
        "arc": np.log(float(np.ptp(hinge.positions)) * middle / spread + SMALL),
    }


def _flow_features(tracks: TrackSet) -> dict[str, float]:
    """Return features of the motion between frames that are far apart, without a joint."""
    seen, xy = tracks.seen, tracks.xy
    t_count = seen.shape[1]
    best: tuple[int, int, float] | None = None
    for t in range(t_count):
        for u in range(t + 1, t_count):
            both = seen[:, t] & seen[:, u]
            if both.sum() < 6:
                continue
            length = float(np.median(np.linalg.norm(xy[both, u] - xy[both, t], axis=1)))
            score = length * np.sqrt(both.sum())
            if best is None or score > best[2]:
                best = (t, u, score)
    found = {"straightness": _straightness(tracks)}
    zero = dict.fromkeys(
        ("far_share", "uniform", "scale", "stretch", "image_turn", "rank_one", "isotropic",
         "grown_ratio", "affine_gain"), 0.0
    )  # fmt: skip
    if best is None:
        return found | zero | _expansion_features(tracks)
    t, u, _ = best
    both = seen[:, t] & seen[:, u]
    here, there = xy[both, t], xy[both, u]
    by = there - here
    length = np.linalg.norm(by, axis=1)
    mean = by.mean(axis=0)
    left = np.concatenate([here - here.mean(axis=0), np.ones((len(here), 1))], axis=1)
    lean = 1e-6 * np.eye(3)
    M = np.linalg.solve(left.T @ left + lean, left.T @ by)[:2].T
    s = np.linalg.svd(np.eye(2) + M, compute_uv=False)
    split = np.linalg.svd(M, compute_uv=False)
    size = float(np.linalg.norm(here.std(axis=0)))
    isotropic = 0.5 * np.trace(M)
    residual_shift = float(np.median(np.linalg.norm(by - np.median(by, axis=0), axis=1)))
    middle = here - here.mean(axis=0)
    zoom = float((middle * (by - mean)).sum() / ((middle**2).sum() + SMALL))
    residual_zoom = float(np.median(np.linalg.norm(by - mean - zoom * middle, axis=1)))
    residual_affine = float(np.median(np.linalg.norm(by - left @ np.linalg.solve(
        left.T @ left + lean, left.T @ by), axis=1)))  # fmt: skip
    pixel = 1.0 / tracks.focal_px
    return (
        found
        | {
            "far_share": float(np.median(length)),
            "uniform": float(np.percentile(length, 10) / (np.percentile(length, 90) + SMALL)),
            "scale": float(np.log(max(s[0] * s[1], 1e-3))),
            "stretch": float(np.log((s[0] + 1e-3) / (s[1] + 1e-3))),
            "image_turn": abs(float(np.arctan2(M[1, 0] - M[0, 1], 2.0 + M[0, 0] + M[1, 1]))),
            "rank_one": float(split[0] * size / (np.linalg.norm(mean) + SMALL)),
            "isotropic": abs(float(isotropic)) / (float(np.linalg.norm(M)) + SMALL),
            "grown_ratio": (residual_zoom + pixel) / (residual_shift + pixel),
            "affine_gain": (residual_affine + pixel) / (residual_zoom + pixel),
        }
        | _expansion_features(tracks)
    )


def _straightness(tracks: TrackSet) -> float:
    """Return the median over tracks of the extent across the path, divided by that along it."""
    ratios = []
    for i in range(len(tracks.xy)):
        path = tracks.xy[i, tracks.seen[i]]
        if len(path) < 4:
            continue
        s = np.linalg.svd(path - path.mean(axis=0), compute_uv=False)
        if s[0] * tracks.focal_px < 4.0:
            continue
        ratios.append((s[1] + 0.5 / tracks.focal_px) / s[0])
    return float(np.median(ratios)) if ratios else 0.0


def _expansion_features(tracks: TrackSet) -> dict[str, float]:
    """Return how the expansion across and along the motion changes over time."""
    across_rates, along_rates, weights, angles = [], [], [], []
    seen, xy = tracks.seen, tracks.xy
    t_count = seen.shape[1]
    gap = max(1, t_count // 8)
    for t in range(t_count - gap):
        both = seen[:, t] & seen[:, t + gap]
        if both.sum() < 6:
            continue
        here, by = xy[both, t], xy[both, t + gap] - xy[both, t]
        mean = np.median(by, axis=0)
        length = float(np.linalg.norm(mean))
        if length * tracks.focal_px < 3.0:
            continue
        along = mean / length
        across = np.array([-along[1], along[0]])
        middle = here - np.median(here, axis=0)
        rows = np.stack([np.ones(len(here)), middle @ along, middle @ across], axis=1)
        lean = 1e-5 * np.eye(3)
        inner = np.linalg.solve(rows.T @ rows + lean, rows.T @ by)
        across_rates.append(float(np.clip(inner[2] @ across / length, -5, 5)))
        along_rates.append(float(np.clip(inner[1] @ along / length, -8, 8)))
        angles.append(np.arctan2(along[1], along[0]))
        weights.append(length * both.sum())
    if len(weights) < 2:
        return {
            "expansion": 0.0,
            "contraction": 0.0,
            "along_mean": 0.0,
            "bend": 0.0,
            "across_mean": 0.0,
        }
    w = np.array(weights) / np.sum(weights)
    a, b = np.array(across_rates), np.array(along_rates)
    doubled = np.exp(2j * np.array(angles))  # a reversal is no bend
    return {
        "expansion": float(np.sqrt(w @ (a - w @ a) ** 2)),
        "across_mean": abs(float(w @ a)),
        "contraction": float(np.sqrt(w @ (b - w @ b) ** 2)),
        "along_mean": abs(float(w @ b)),
        "bend": 1.0 - abs(complex(w @ doubled)),
    }


def _role_features(motion: Motion, part: CandidatePart) -> dict[str, float]:
    """Return features that distinguish the operated part from arms and people."""
    names = part.core
    uv, visible, side = motion.uv[:, names], motion.visible[:, names], motion.side
    n_frames = len(uv)
    raw = motion.raw_uv[:, names]
    width, height = motion.size_px
    margin = BORDER_SHARE * side
    border = (
        (raw[..., 0] < margin)
        | (raw[..., 0] > width - margin)
        | (raw[..., 1] < margin)
        | (raw[..., 1] > height - margin)
    ) & visible
    step = np.linalg.norm(np.diff(uv, axis=0), axis=2)
    both = visible[1:] & visible[:-1]
    still = (step < REST_SHARE * side) & both
    first = visible.argmax(axis=0)
    last = n_frames - 1 - visible[::-1].argmax(axis=0)
    life = visible.sum(axis=0)
    speed = _speed(motion)
    mine = _group_speed(step, both)
    active = mine > REST_SHARE * side
    path = travel(uv, visible)
    points = uv[visible]
    low, high = np.percentile(points, [5, 95], axis=0)
    before = _stillness(still, both, first, last, begin=True)
    after = _stillness(still, both, first, last, begin=False)
    entered = border[first, np.arange(len(names))] & (first > 2)
    return {
        "border": float(border.sum() / max(visible.sum(), 1)),
        "enters": float(entered.mean()),
        "rest": float(still.sum() / max(both.sum(), 1)),
        "rest_before": before,
        "rest_after": after,
        "life": float(life.mean() / n_frames),
        "first_seen": float(np.percentile(first, 10) / n_frames),
        "active": float(active.mean()),
        "active_share": float(active.sum() / max((speed > REST_SHARE * side).sum(), 1)),
        "path": float(np.median(path) / side),
        "extent": float(np.sqrt(np.prod(high - low)) / side),
        "centre": float(np.linalg.norm((0.5 * (low + high) - [width / 2, height / 2]) / side)),
        "low_centre": float((0.5 * (low + high)[1] - height / 2) / side),
        "growth": np.log(len(part.names) / len(part.core)),
        "log_core": np.log(len(part.core)),
    }


def _group_speed(step: Array, both: NDArray[np.bool_]) -> Array:
    """Return the mean motion of the points between frames (T - 1,) [px]."""
    count = np.maximum(both.sum(axis=1), 1)
    return np.asarray(np.where(both, step, 0.0).sum(axis=1) / count)


def _speed(motion: Motion) -> Array:
    names = motion.groups.tracks
    uv, visible = motion.uv[:, names], motion.visible[:, names]
    step = np.linalg.norm(np.diff(uv, axis=0), axis=2)
    return _group_speed(step, visible[1:] & visible[:-1])


def _stillness(
    still: NDArray[np.bool_], both: NDArray[np.bool_], first: Array, last: Array, *, begin: bool
) -> float:
    """Return the share of tracks that rest during their first (or last) three steps."""
    rests, count = 0, 0
    for n in range(still.shape[1]):
        at = int(first[n]) if begin else max(int(first[n]), int(last[n]) - 3)
        window = slice(at, at + 3)
        if both[window, n].sum() < 2:
            continue
        count += 1
        rests += int(still[window, n].sum() >= 2)
    return rests / max(count, 1)


OPENING = (
    "slide_z",
    "slide_y",
    "slide_x",
    "hinge_z",
    "hinge_y",
    "grown",
    "slide_zy",
    "returns",
)
"""Names of the features of the sense of the motion."""


def opening_features(part: CandidatePart) -> dict[str, float]:
    """Return features of the sense of the first motion: an opened part mostly approaches."""
    slide, hinge = part.slide, part.hinge
    first = _first_stroke(slide)
    x, y, z = np.sign(first) * slide.axis
    begin, peak = (
        points_at(hinge, 0),
        points_at(hinge, int(np.argmax(np.abs(hinge.positions - hinge.positions[0])))),
    )
    spread = float(np.linalg.norm(hinge.points.std(axis=0))) + SMALL
    seen = begin[:, :2] / begin[:, 2:], peak[:, :2] / peak[:, 2:]
    grown = np.log((np.prod(seen[1].std(axis=0)) + SMALL) / (np.prod(seen[0].std(axis=0)) + SMALL))
    path = slide.positions - slide.positions[0]
    values = (
        z,
        y,
        abs(x),
        np.clip((peak - begin)[:, 2].mean() / spread, -3, 3),
        np.clip((seen[1] - seen[0])[:, 1].mean() / spread, -3, 3),
        np.clip(grown, -2, 2),
        z * y,
        abs(path[-1] - first) / (float(np.ptp(path)) + SMALL),
    )
    return {name: float(np.nan_to_num(v)) for name, v in zip(OPENING, values, strict=True)}


def _first_stroke(fit: JointFit) -> float:
    """Return the largest joint position relative to the first."""
    path = fit.positions - fit.positions[0]
    return float(path[int(np.argmax(np.abs(path)))])


def points_at(hinge: JointFit, frame: int) -> Array:
    """Return the points (N, 3) of a hinge at a frame."""
    turn = axis_angle_to_matrix(hinge.axis, float(hinge.positions[frame]))
    return np.asarray((hinge.points - hinge.pivot) @ turn.T + hinge.pivot)
