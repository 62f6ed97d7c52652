"""Critic of a joint in a video: independent cues, and better alternatives.

The actor fits colours. The critic finds the predicted joint's position in each frame and checks two
other cues: whether image edges coincide with those of the model, and whether point tracks move with
the part. Then it compares alternatives: wider limits, another pivot, another axis, another kind of
joint. The first of these, in the order of Articulate-Anything, that explains much more is the
failure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.compositing import Compositing, model_image, rasterize
from articulate.reconstruct.actors.geometric.fit import has_visible_motion
from articulate.reconstruct.actors.geometric.image_pyramid import (
    PyramidLevel,
    VideoScene,
    build_scene,
    frames_above_model,
    refit_light,
)
from articulate.reconstruct.actors.geometric.kernels import Floats
from articulate.reconstruct.actors.geometric.parameters import CRITIC, IMAGE, SEARCH
from articulate.reconstruct.actors.geometric.parts import part_in_place
from articulate.reconstruct.actors.geometric.refine import FreeParameters, refine
from articulate.reconstruct.actors.geometric.rotational_symmetry import clear_spin, symmetry_axis
from articulate.reconstruct.actors.geometric.search import (
    MotionFit,
    coarse_fit,
    free_path,
    moves,
    position_unit,
    refine_path,
    rescale_gains,
    uniform_path,
    with_gain,
)
from articulate.reconstruct.actors.geometric.surface import (
    JointMotion,
    candidate_axes,
    candidate_motions,
)
from articulate.reconstruct.actors.protocol import (
    Evidence,
    Failure,
    PredictedJoint,
    Prediction,
    Verdict,
)
from articulate.transforms import Array, Ints, apply, inverse, normalised
from articulate.video.tracks import PointTracks, follow_points

RATING_CAPS: Mapping[Failure, float] = {
    "joint_type": CRITIC.type_cap,
    "joint_axis": CRITIC.axis_cap,
    "joint_origin": CRITIC.origin_cap,
    "joint_limit": CRITIC.limit_cap,
}
"""Highest rating of each failure: the graver, the lower."""


@dataclass(frozen=True)
class CueScores:
    """Agreement of a prediction with edges and point tracks."""

    edges: float
    """Correlation of the edges of image and model where something changes, in [-1, 1]."""
    track_error: float
    """Median error of point tracks as a share of their motion; NaN without tracks."""
    n_tracks: int


@dataclass(frozen=True)
class VideoCritic:
    """Critic of a joint in a video."""

    name: str = "geometric"
    tracks: bool = True
    """Use point tracks in addition to edges."""

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """Return the failure of a prediction, if any, and its rating."""
        if evidence.video is None or evidence.camera is None:
            return Verdict(
                failure="success", rating=CRITIC.neutral_rating, reason="there is no video"
            )
        moving = [joint for joint in prediction.joints if joint.kind != "fixed"]
        if not moving:
            return Verdict(failure="joint_type", rating=0.0, reason="no moving joint is predicted")
        scene = build_scene(evidence.video, evidence.camera, evidence.parts)
        if not scene.change.any():
            reason = "nothing changes in the video"
            return Verdict(failure="success", rating=CRITIC.neutral_rating, reason=reason)
        return _assess_joint(scene, moving[0], prediction, self._tracks(scene))

    def _tracks(self, scene: VideoScene) -> PointTracks:
        """Return point tracks where something changes."""
        if not self.tracks:
            n_frames = len(scene.video)
            nowhere = np.zeros((n_frames, 0), dtype=np.bool_)
            return PointTracks(uv=np.zeros((n_frames, 0, 2)), visible=nowhere)
        near = cv2.dilate(scene.change.astype(np.uint8), np.ones((9, 9))).astype(np.bool_)
        return follow_points(scene.video, mask=near)


def _assess_joint(
    scene: VideoScene, joint: PredictedJoint, prediction: Prediction, tracks: PointTracks
) -> Verdict:
    level = scene.level(CRITIC.level_px, CRITIC.level_frames)
    fit = _placed(joint, _moving_parts(scene, joint, prediction), level)
    level = replace(level, light=refit_light(level, fit, level.crop))
    fit = _placed(joint, fit.parts, level)
    layers = level.compositing(fit.parts)
    cues = _measure_cues(scene, level, layers, fit, tracks)
    failure, better = _failure(scene, level, layers, fit, joint)
    rating = _rating(cues)
    from_marks = _failure_from_marks(scene, level, joint, fit)
    if from_marks is not None:
        failure, rating = from_marks, max(rating, CRITIC.marked_rating)
    if failure != "success":
        rating = min(rating, RATING_CAPS[failure])
    elif rating <= 5.0:
        rating = max(rating, CRITIC.doubtful_rating) if moves(fit, layers) else rating
        failure = "joint_axis" if cues.edges > CRITIC.edges_bad else "joint_type"
    figures = {
        "edges": cues.edges,
        "track_error": cues.track_error,
        "tracks": float(cues.n_tracks),
        **{f"gain_{name}": value for name, value in better.items()},
    }
    image = frames_above_model(layers, fit.motion.T_o(fit.q))
    return Verdict(
        failure=failure,
        rating=rating,
        reason=_reason(failure, cues),
        figures={k: v for k, v in figures.items() if np.isfinite(v)},
        images={"video above, prediction below": image},
    )


def _failure_from_marks(
    scene: VideoScene, level: PyramidLevel, joint: PredictedJoint, fit: MotionFit
) -> Failure | None:
    """Return the failure by the marks on a round part; None without marks.

    For a part whose image contains all changes: edges do not move there, and point tracks are
    unreliable.
    """
    part = fit.parts[0]
    if part_in_place(level, all_over=False) != part:
        return None
    surface = level.surface.only([part])
    motion = symmetry_axis(surface, candidate_axes(surface))
    spin = None if motion is None else clear_spin(scene, level, part, motion)
    if motion is None or spin is None:
        return None
    if has_visible_motion(
        scene.level(IMAGE.quick_px, IMAGE.quick_frames),
        part,
        SEARCH.slide_reach_share * scene.size_m,
    ):
        return None
    if joint.kind == "prismatic":
        return "joint_type"
    if abs(float(motion.axis_o @ fit.motion.axis_o)) < np.cos(CRITIC.same_axis_rad):
        return "joint_axis"
    if not spin.sharp:
        return "success"
    if joint.lower is None or joint.upper is None:
        return "success" if spin.full_turn else "joint_limit"
    off = float(joint.upper) - float(joint.lower) - abs(spin.end_rad)
    return "joint_limit" if spin.full_turn or abs(off) > CRITIC.marked_tolerance_rad else "success"


def _moving_parts(
    scene: VideoScene, joint: PredictedJoint, prediction: Prediction
) -> tuple[int, ...]:
    """Return the indices of the moving part and of all parts fixed to it."""
    names = [part.name for part in scene.parts]
    moved = [joint.part]
    for _ in prediction.joints:
        moved += [
            other.part
            for other in prediction.joints
            if other.kind == "fixed" and other.parent in moved and other.part not in moved
        ]
    return tuple(names.index(name) for name in moved)


def _placed(joint: PredictedJoint, parts: tuple[int, ...], level: PyramidLevel) -> MotionFit:
    """Return the joint's position in each frame, between its limits."""
    kind = "slide" if joint.kind == "prismatic" else "turn"
    motion = JointMotion(
        "slide" if kind == "slide" else "turn",
        normalised(joint.axis_o),
        np.asarray(joint.pivot_o, dtype=np.float64),
        "prediction",
    )
    endless = joint.lower is None or joint.upper is None
    if endless:
        q = np.arange(CRITIC.positions, dtype=np.float64) * (2.0 * np.pi / CRITIC.positions)
    else:
        q = np.linspace(float(joint.lower or 0.0), float(joint.upper or 0.0), CRITIC.positions)
    layers = level.compositing(parts)
    costs = np.ascontiguousarray(layers.costs(motion.T_o(q)).T)
    tries = (
        free_path(costs, layers, SEARCH.fine_change_share, CRITIC.positions // 2, circular=endless),
        uniform_path(costs, layers, circular=endless),
    )
    placed = [MotionFit(motion, q[0] + path * (q[1] - q[0]), cost, parts) for path, cost in tries]
    ends = None if endless else (float(q[0]), float(q[-1]))
    return max((_settled(fit, layers, ends) for fit in placed), key=lambda fit: fit.gain)


def _settled(fit: MotionFit, layers: Compositing, ends: tuple[float, float] | None) -> MotionFit:
    """Refine the positions of ``fit``, within ``ends`` if there are any."""
    refined = refine(fit, layers, FreeParameters(axis=False, pivot=False), rounds=5)
    if ends is not None:
        kept = np.clip(refined.q, *ends)
        cost = float(layers.path_cost(refined.motion.T_o(kept)).sum())
        refined = replace(refined, q=kept, cost=cost)
        refined = refined if cost < fit.cost else fit
    return with_gain(refined, layers)


def _measure_cues(
    scene: VideoScene, level: PyramidLevel, layers: Compositing, fit: MotionFit, tracks: PointTracks
) -> CueScores:
    """Measure the agreement with edges and point tracks."""
    error, n = _track_error(scene, level, layers, fit, tracks)
    return CueScores(
        edges=_edge_correlation(level, layers, fit.motion.T_o(fit.q)),
        track_error=error,
        n_tracks=n,
    )


def _edge_correlation(level: PyramidLevel, layers: Compositing, T_o: Array) -> float:
    """Return the correlation of edge strengths of frames and model where something changes."""
    where = cv2.dilate(level.change.astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
    seen, expected = [], []
    for frame, pose in zip(layers.crop.frames, T_o, strict=True):
        seen.append(_edges(frame)[where])
        expected.append(_edges(model_image(pose, layers))[where])
    # Edges present in all frames carry no information about motion.
    a, b = np.stack(seen), np.stack(expected)
    a, b = (a - a.mean(axis=0)).reshape(-1), (b - b.mean(axis=0)).reshape(-1)
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0.0 else 0.0


def _edges(image: Floats) -> Array:
    grey = cv2.GaussianBlur(image.astype(np.float32).mean(axis=-1), (0, 0), 1.2)
    across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    return np.asarray(np.minimum(np.hypot(across, down), 80.0), dtype=np.float64)


def _track_error(
    scene: VideoScene, level: PyramidLevel, layers: Compositing, fit: MotionFit, tracks: PointTracks
) -> tuple[float, int]:
    """Return the median relative error of the tracks on the part, and their number."""
    frames = level.crop.indices
    poses = fit.motion.T_o(fit.q)
    shares: list[float] = []
    full = scene.camera
    left, _, top, _ = scene.box
    sx, sy = level.crop.pinhole[0] / full.fx_px, level.crop.pinhole[1] / full.fy_px
    for i in range(len(frames) - 1):
        a, b = frames[i], frames[i + 1]
        both = tracks.visible[a] & tracks.visible[b]
        if not both.any():
            continue
        here, there = tracks.uv[a][both], tracks.uv[b][both]
        rasterized = rasterize(layers.moving, level.crop, poses[i])
        u = np.rint((here[:, 0] - left + 0.5) * sx - 0.5).astype(int)
        v = np.rint((here[:, 1] - top + 0.5) * sy - 0.5).astype(int)
        height, width = level.crop.size
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        here, there, u, v = here[inside], there[inside], u[inside], v[inside]
        nearness = rasterized.nearness[v, u]
        on = (nearness > 0) & (nearness >= layers.nearness[v, u])
        if not on.any():
            continue
        point_o = full.unproject(here[on], 1.0 / nearness[on].astype(np.float64))
        moved_o = apply(poses[i + 1] @ inverse(poses[i]), point_o)
        expected, _ = full.project(moved_o)
        off = np.linalg.norm(expected - there[on], axis=1)
        far = np.linalg.norm(there[on] - here[on], axis=1)
        expected_far = np.linalg.norm(expected - here[on], axis=1)
        moved = np.maximum(far, expected_far)
        shares += list(
            off[moved > CRITIC.min_track_motion_px] / moved[moved > CRITIC.min_track_motion_px]
        )
    if len(shares) < CRITIC.min_tracks:
        return float("nan"), len(shares)
    return float(np.median(shares)), len(shares)


def _failure(
    scene: VideoScene,
    level: PyramidLevel,
    layers: Compositing,
    fit: MotionFit,
    joint: PredictedJoint,
) -> tuple[Failure, dict[str, float]]:
    """Return the first alternative that explains much more, and the gain of every alternative."""
    floor = 0.002 * fit.cost
    wide = _wider(fit, layers, joint, scene)
    rivals = _rivals(scene, level, wide)
    fit, wide, *others = rescale_gains([fit, wide, *rivals.values()])
    rivals = dict(zip(rivals, others, strict=True))
    gains = {"as_predicted": fit.gain, "wider_limits": wide.gain}
    gains |= {name: rival.gain for name, rival in rivals.items()}
    pivot = max(wide.gain, gains.get("other_pivot", 0.0))
    axis = max(pivot, gains.get("other_axis", 0.0))
    if gains.get("other_kind", 0.0) > CRITIC.better_ratio * axis + floor:
        return "joint_type", gains
    if gains.get("other_axis", 0.0) > CRITIC.better_ratio * pivot + floor:
        return "joint_axis", gains
    other, shifted = rivals.get("other_pivot"), pivot > 1.06 * wide.gain + floor
    if shifted and other is not None and _pivot_shift(fit, other) > CRITIC.other_pivot_m:
        return "joint_origin", gains
    if wide.gain > 1.04 * fit.gain + floor or _unused(fit, joint):
        return "joint_limit", gains
    return "success", gains


def _rivals(scene: VideoScene, level: PyramidLevel, fit: MotionFit) -> dict[str, MotionFit]:
    """Return the best motions of the same part with another pivot, axis, or kind."""
    quick = replace(scene.level(IMAGE.quick_px, IMAGE.quick_frames), light=level.light)
    surface = quick.surface.only(fit.parts)
    rest = quick.surface.only([k for k in np.unique(quick.surface.part_ids) if k not in fit.parts])
    own = ("predicted", fit.motion.axis_o)
    axes = [own, *(axis for axis in candidate_axes(surface) if not _same_axis(axis[1], own[1]))]
    quick_layers, layers = quick.compositing(fit.parts), level.compositing(fit.parts)
    groups: dict[str, list[MotionFit]] = {}
    for motion in candidate_motions(surface, rest, axes):
        if motion.kind != fit.motion.kind:
            group = "other_kind"
        elif _same_axis(motion.axis_o, fit.motion.axis_o):
            group = "other_pivot"
        else:
            group = "other_axis"
        tried = coarse_fit(motion, quick_layers, fit.parts, SEARCH.slide_reach_share * scene.size_m)
        if moves(tried, quick_layers):
            groups.setdefault(group, []).append(tried)
    best = {name: max(fits, key=lambda one: one.gain) for name, fits in groups.items()}
    return {name: _polished(one, quick.crop.indices, layers) for name, one in best.items()}


def _polished(fit: MotionFit, indices: Ints, layers: Compositing) -> MotionFit:
    """Refine ``fit``, found in the frames ``indices``, in the crop of ``layers``."""
    start = replace(fit, q=np.interp(layers.crop.indices, indices, fit.q))
    start = refine_path(start, layers, 2.0 * position_unit(start.motion, layers))
    return with_gain(refine(start, layers, FreeParameters(axis=False), rounds=5), layers)


def _same_axis(a: Array, b: Array) -> bool:
    return abs(float(a @ b)) > float(np.cos(CRITIC.same_axis_rad))


def _unused(fit: MotionFit, joint: PredictedJoint) -> bool:
    """Return whether part of the range is never reached in the video."""
    if joint.lower is None or joint.upper is None:
        return False
    reached: float = np.ptp(fit.q).item()
    return reached < 0.8 * (joint.upper - joint.lower) - 1e-9


def _pivot_shift(a: MotionFit, b: MotionFit) -> float:
    """Return the distance of the two axes [m]; 0 for slides."""
    if a.motion.kind == "slide":
        return 0.0
    return float(np.linalg.norm(np.cross(b.motion.pivot_o - a.motion.pivot_o, a.motion.axis_o)))


def _wider(
    fit: MotionFit, layers: Compositing, joint: PredictedJoint, scene: VideoScene
) -> MotionFit:
    """Return the best path of the joint without limits."""
    if joint.lower is None or joint.upper is None:
        return fit
    free = coarse_fit(fit.motion, layers, fit.parts, SEARCH.slide_reach_share * scene.size_m)
    again = refine_path(free, layers, 1.5 * position_unit(free.motion, layers))
    again = _settled(again, layers, None)
    return again if again.gain > fit.gain else fit


def _rating(cues: CueScores) -> float:
    """Return a rating from 0 to 10; the better of the two cues counts a little more."""
    edges = (cues.edges - CRITIC.edges_bad) / (CRITIC.edges_good - CRITIC.edges_bad)
    votes = [float(np.clip(edges, 0.0, 1.0))]
    if np.isfinite(cues.track_error):
        tracks = (CRITIC.tracks_bad - cues.track_error) / (CRITIC.tracks_bad - CRITIC.tracks_good)
        votes.append(float(np.clip(tracks, 0.0, 1.0)))
    return 10.0 * (
        CRITIC.worse_cue_weight * min(votes) + (1.0 - CRITIC.worse_cue_weight) * max(votes)
    )


def _reason(failure: Failure, cues: CueScores) -> str:
    text = f"edges agree by {cues.edges:.2f}"
    if np.isfinite(cues.track_error):
        text += f", {cues.n_tracks} point tracks are off by {cues.track_error:.0%}"
    what = {
        "success": "the joint explains the video",
        "joint_type": "another kind of joint explains the video better",
        "joint_axis": "another axis explains the video better",
        "joint_origin": "another pivot explains the video better",
        "joint_limit": "other limits explain the video better",
    }[failure]
    return f"{what}: {text}"
