"""Critic of a joint in a clip: other cues than those the actor fitted, and what would be better.

The actor fits colours. The critic takes the predicted joint, finds where it would have to be in
each frame, and asks two other witnesses: do edges of the picture lie where the model has edges,
and do points that are followed through the clip move as the joint would carry them? Then it asks
what would be better: wider limits, another pivot, another axis, another kind of joint. The first
of these, in the published order, that explains much more is what is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.candidates import Motion, axes_of, motions_of
from articulate.reconstruct.actors.geometric.compositing import Layers, draw
from articulate.reconstruct.actors.geometric.fit import leaves_in_sight
from articulate.reconstruct.actors.geometric.gauss_newton import Freedom, model_picture, refine
from articulate.reconstruct.actors.geometric.image_pyramid import (
    QUICK_FRAMES,
    QUICK_PX,
    Look,
    Scene,
    better_light,
    scene_of,
)
from articulate.reconstruct.actors.geometric.images import rows_of
from articulate.reconstruct.actors.geometric.kernels import Floats
from articulate.reconstruct.actors.geometric.part_ranking import in_place
from articulate.reconstruct.actors.geometric.rotational_symmetry import round_axis
from articulate.reconstruct.actors.geometric.search import (
    FINE,
    REACH,
    Fit,
    coarse_fit,
    even_path,
    free_path,
    moves,
    on_one_scale,
    path_again,
    position_unit,
    with_gain,
)
from articulate.reconstruct.actors.geometric.spin import clear_spin
from articulate.reconstruct.actors.protocol import (
    Evidence,
    Failure,
    PredictedJoint,
    Prediction,
    Verdict,
)
from articulate.transforms import Array, Ints, apply, inverse, normalised
from articulate.video.tracks import PointTracks, follow_points

JUDGED_PX, JUDGED_FRAMES = 144, 12
POSITIONS = 61
"""Positions between the limits at which the part is looked for."""
MUCH = 1.12
"""Something else is better if it explains this many times as much."""
EDGES_GOOD, EDGES_BAD = 0.75, 0.25
"""Correlation of edges rated 10 and 0."""
TRACKS_GOOD, TRACKS_BAD = 0.08, 0.6
"""Error of followed points, as a share of how far they move, rated 10 and 0."""
CALM = 0.4
"""Weight of the worse witness: on small or plain parts one of the two has nothing to go by."""
ENOUGH_TRACKS = 12
"""Fewer followed points are no witness."""
MOVED_PX = 2.0
"""Points that move less than this say nothing."""
FAR_PIVOT_M = 0.03
"""An axis that passes farther than this from the predicted one is another [m]."""
SAME_AXIS_RAD = 0.2
"""Axes nearer to each other than this are alike."""
CAPS: Mapping[Failure, float] = {
    "joint_type": 1.0,
    "joint_axis": 2.0,
    "joint_origin": 3.0,
    "joint_limit": 4.0,
}
"""Highest rating of each failure: the graver, the lower."""
MARKED, OFF_MARKS_RAD = 7.0, 0.3
"""Lowest rating of a turn that agrees with the marks on a round part, and by how much it may
differ [rad]."""
DOUBTED = 1.5
"""Lowest rating of a joint which edges and points do not bear out, but than which none explains the
clip better: one of the wrong kind is worse."""
NOTHING_SHOWS = 3.0
"""Rating where the clip neither supports nor contradicts the joint."""


@dataclass(frozen=True)
class Witness:
    """What was measured of a prediction."""

    edges: float
    """Correlation of the edges of picture and model where something changes, in [-1, 1]."""
    track_error: float
    """Median error of followed points as a share of how far they move; NaN without points."""
    n_tracks: int


@dataclass(frozen=True)
class VideoCritic:
    """Judges the joint of a clip."""

    name: str = "geometric"
    tracks: bool = True
    """Whether followed points are asked beside edges."""

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """What is wrong with the prediction, if anything is."""
        if evidence.video is None or evidence.camera is None:
            return Verdict(failure="success", rating=NOTHING_SHOWS, reason="there is no clip")
        moving = [joint for joint in prediction.joints if joint.kind != "fixed"]
        if not moving:
            return Verdict(failure="joint_type", rating=0.0, reason="no joint is said to move")
        scene = scene_of(evidence.video, evidence.camera, evidence.parts)
        if not scene.change.any():
            reason = "nothing changes in the clip that could tell"
            return Verdict(failure="success", rating=NOTHING_SHOWS, reason=reason)
        return _judged(scene, moving[0], prediction, self._tracks(scene, evidence))

    def _tracks(self, scene: Scene, evidence: Evidence) -> PointTracks:
        """Points that are followed where something changes, or those that were handed in."""
        if not self.tracks:
            n_frames = len(scene.video)
            nowhere = np.zeros((n_frames, 0), dtype=np.bool_)
            return PointTracks(uv=np.zeros((n_frames, 0, 2)), visible=nowhere)
        if evidence.tracks is not None:
            return PointTracks(uv=evidence.tracks.uv, visible=evidence.tracks.visible)
        near = cv2.dilate(scene.change.astype(np.uint8), np.ones((9, 9))).astype(np.bool_)
        return follow_points(scene.video, mask=near)


def _judged(
    scene: Scene, joint: PredictedJoint, prediction: Prediction, tracks: PointTracks
) -> Verdict:
    look = scene.look(JUDGED_PX, JUDGED_FRAMES)
    fit = _placed(joint, _moving(scene, joint, prediction), look)
    look = replace(look, light=better_light(look, fit, look.shot))
    fit = _placed(joint, fit.parts, look)
    layers = look.layers(fit.parts)
    witness = _heard(scene, look, layers, fit, tracks)
    failure, better = _failure(scene, look, layers, fit, joint)
    rating = _rating(witness)
    marked = _marked(scene, look, joint, fit)
    if marked is not None:
        failure, rating = marked, max(rating, MARKED)
    if failure != "success":
        rating = min(rating, CAPS[failure])
    elif rating <= 5.0:
        rating = max(rating, DOUBTED) if moves(fit, layers) else rating
        failure = "joint_axis" if witness.edges > EDGES_BAD else "joint_type"
    figures = {
        "edges": witness.edges,
        "track_error": witness.track_error,
        "tracks": float(witness.n_tracks),
        **{f"gain_{name}": value for name, value in better.items()},
    }
    picture = rows_of(layers, fit.motion.T_o(fit.q))
    return Verdict(
        failure=failure,
        rating=rating,
        reason=_reason(failure, witness),
        figures={k: v for k, v in figures.items() if np.isfinite(v)},
        images={"clip above, prediction below": picture},
    )


def _marked(scene: Scene, look: Look, joint: PredictedJoint, fit: Fit) -> Failure | None:
    """What marks say of a round part in whose picture all changes lie; None where they say nothing.

    Edges do not move there, and points are followed badly.
    """
    part = fit.parts[0]
    if in_place(look, whole=False) != part:
        return None
    surface = look.surface.only([part])
    motion = round_axis(surface, axes_of(surface))
    spin = None if motion is None else clear_spin(scene, look, part, motion)
    if motion is None or spin is None:
        return None
    if leaves_in_sight(scene.look(QUICK_PX, QUICK_FRAMES), part, REACH * scene.size_m):
        return None
    if joint.kind == "prismatic":
        return "joint_type"
    if abs(float(motion.axis_o @ fit.motion.axis_o)) < np.cos(SAME_AXIS_RAD):
        return "joint_axis"
    if not spin.sharp:
        return "success"
    if joint.lower is None or joint.upper is None:
        return "success" if spin.whole else "joint_limit"
    off = float(joint.upper) - float(joint.lower) - abs(spin.end_rad)
    return "joint_limit" if spin.whole or abs(off) > OFF_MARKS_RAD else "success"


def _moving(scene: Scene, joint: PredictedJoint, prediction: Prediction) -> tuple[int, ...]:
    """Indices of the part that moves and of all that is fixed to it."""
    names = [part.name for part in scene.parts]
    moved = [joint.part]
    for _ in prediction.joints:
        moved += [
            other.part
            for other in prediction.joints
            if other.kind == "fixed" and other.parent in moved and other.part not in moved
        ]
    return tuple(names.index(name) for name in moved)


def _placed(joint: PredictedJoint, parts: tuple[int, ...], look: Look) -> Fit:
    """Where the joint is in each frame, between its limits."""
    kind = "slide" if joint.kind == "prismatic" else "turn"
    motion = Motion(
        "slide" if kind == "slide" else "turn",
        normalised(joint.axis_o),
        np.asarray(joint.pivot_o, dtype=np.float64),
        "prediction",
    )
    endless = joint.lower is None or joint.upper is None
    if endless:
        q = np.arange(POSITIONS, dtype=np.float64) * (2.0 * np.pi / POSITIONS)
    else:
        q = np.linspace(float(joint.lower or 0.0), float(joint.upper or 0.0), POSITIONS)
    layers = look.layers(parts)
    costs = np.ascontiguousarray(layers.costs(motion.T_o(q)).T)
    tries = (
        free_path(costs, layers, FINE, POSITIONS // 2, circular=endless),
        even_path(costs, layers, circular=endless),
    )
    placed = [Fit(motion, q[0] + path * (q[1] - q[0]), cost, parts) for path, cost in tries]
    ends = None if endless else (float(q[0]), float(q[-1]))
    return max((_settled(fit, layers, ends) for fit in placed), key=lambda fit: fit.gain)


def _settled(fit: Fit, layers: Layers, ends: tuple[float, float] | None) -> Fit:
    """``fit`` with its positions refined, between ``ends`` if there are any, as rivals' are."""
    refined = refine(fit, layers, Freedom(axis=False, pivot=False), rounds=5)
    if ends is not None:
        kept = np.clip(refined.q, *ends)
        cost = float(layers.path_cost(refined.motion.T_o(kept)).sum())
        refined = replace(refined, q=kept, cost=cost)
        refined = refined if cost < fit.cost else fit
    return with_gain(refined, layers)


def _heard(scene: Scene, look: Look, layers: Layers, fit: Fit, tracks: PointTracks) -> Witness:
    """What edges and followed points say."""
    error, n = _track_error(scene, look, layers, fit, tracks)
    return Witness(
        edges=_edge_correlation(look, layers, fit.motion.T_o(fit.q)),
        track_error=error,
        n_tracks=n,
    )


def _edge_correlation(look: Look, layers: Layers, T_o: Array) -> float:
    """Correlation of edge strength of frames and model where something changes."""
    where = cv2.dilate(look.change.astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
    seen, expected = [], []
    for frame, pose in zip(layers.shot.frames, T_o, strict=True):
        seen.append(_edges(frame)[where])
        expected.append(_edges(model_picture(pose, layers))[where])
    # What is an edge in all frames tells nothing of motion.
    a, b = np.stack(seen), np.stack(expected)
    a, b = (a - a.mean(axis=0)).reshape(-1), (b - b.mean(axis=0)).reshape(-1)
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0.0 else 0.0


def _edges(picture: Floats) -> Array:
    grey = cv2.GaussianBlur(picture.astype(np.float32).mean(axis=-1), (0, 0), 1.2)
    across, down = cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1)
    return np.asarray(np.minimum(np.hypot(across, down), 80.0), dtype=np.float64)


def _track_error(
    scene: Scene, look: Look, layers: Layers, fit: Fit, tracks: PointTracks
) -> tuple[float, int]:
    """Median error of points on the part as a share of their motion, and their number."""
    frames = look.shot.indices
    poses = fit.motion.T_o(fit.q)
    shares: list[float] = []
    full = scene.camera
    left, _, top, _ = scene.box
    sx, sy = look.shot.pinhole[0] / full.fx_px, look.shot.pinhole[1] / full.fy_px
    for i in range(len(frames) - 1):
        a, b = frames[i], frames[i + 1]
        both = tracks.visible[a] & tracks.visible[b]
        if not both.any():
            continue
        here, there = tracks.uv[a][both], tracks.uv[b][both]
        drawn = draw(layers.moving, look.shot, poses[i])
        u = np.rint((here[:, 0] - left + 0.5) * sx - 0.5).astype(int)
        v = np.rint((here[:, 1] - top + 0.5) * sy - 0.5).astype(int)
        height, width = look.shot.size
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        here, there, u, v = here[inside], there[inside], u[inside], v[inside]
        nearness = drawn.nearness[v, u]
        on = (nearness > 0) & (nearness >= layers.nearness[v, u])
        if not on.any():
            continue
        point_o = full.unproject(here[on], 1.0 / nearness[on].astype(np.float64))
        carried = apply(poses[i + 1] @ inverse(poses[i]), point_o)
        expected, _ = full.project(carried)
        off = np.linalg.norm(expected - there[on], axis=1)
        far = np.linalg.norm(there[on] - here[on], axis=1)
        expected_far = np.linalg.norm(expected - here[on], axis=1)
        moved = np.maximum(far, expected_far)
        shares += list(off[moved > MOVED_PX] / moved[moved > MOVED_PX])
    if len(shares) < ENOUGH_TRACKS:
        return float("nan"), len(shares)
    return float(np.median(shares)), len(shares)


def _failure(
    scene: Scene, look: Look, layers: Layers, fit: Fit, joint: PredictedJoint
) -> tuple[Failure, dict[str, float]]:
    """The first thing that, changed, explains much more; and what each change explains."""
    floor = 0.002 * fit.cost
    wide = _wider(fit, layers, joint, scene)
    rivals = _rivals(scene, look, wide)
    fit, wide, *others = on_one_scale([fit, wide, *rivals.values()])
    rivals = dict(zip(rivals, others, strict=True))
    gains = {"as_predicted": fit.gain, "wider_limits": wide.gain}
    gains |= {name: rival.gain for name, rival in rivals.items()}
    pivot = max(wide.gain, gains.get("other_pivot", 0.0))
    axis = max(pivot, gains.get("other_axis", 0.0))
    if gains.get("other_kind", 0.0) > MUCH * axis + floor:
        return "joint_type", gains
    if gains.get("other_axis", 0.0) > MUCH * pivot + floor:
        return "joint_axis", gains
    other, shifted = rivals.get("other_pivot"), pivot > 1.06 * wide.gain + floor
    if shifted and other is not None and _pivot_shift(fit, other) > FAR_PIVOT_M:
        return "joint_origin", gains
    if wide.gain > 1.04 * fit.gain + floor or _unused(fit, joint):
        return "joint_limit", gains
    return "success", gains


def _rivals(scene: Scene, look: Look, fit: Fit) -> dict[str, Fit]:
    """The best motions of the same part with another pivot, another axis, and of another kind."""
    quick = replace(scene.look(QUICK_PX, QUICK_FRAMES), light=look.light)
    surface = quick.surface.only(fit.parts)
    rest = quick.surface.only([k for k in np.unique(quick.surface.part_ids) if k not in fit.parts])
    own = ("predicted", fit.motion.axis_o)
    axes = [own, *(axis for axis in axes_of(surface) if not _alike(axis[1], own[1]))]
    quick_layers, layers = quick.layers(fit.parts), look.layers(fit.parts)
    groups: dict[str, list[Fit]] = {}
    for motion in motions_of(surface, rest, axes):
        if motion.kind != fit.motion.kind:
            group = "other_kind"
        elif _alike(motion.axis_o, fit.motion.axis_o):
            group = "other_pivot"
        else:
            group = "other_axis"
        tried = coarse_fit(motion, quick_layers, fit.parts, REACH * scene.size_m)
        if moves(tried, quick_layers):
            groups.setdefault(group, []).append(tried)
    best = {name: max(fits, key=lambda one: one.gain) for name, fits in groups.items()}
    return {name: _polished(one, quick.shot.indices, layers) for name, one in best.items()}


def _polished(fit: Fit, indices: Ints, layers: Layers) -> Fit:
    """``fit``, found in the frames ``indices``, refined in the shot of ``layers``."""
    start = replace(fit, q=np.interp(layers.shot.indices, indices, fit.q))
    start = path_again(start, layers, 2.0 * position_unit(start.motion, layers))
    return with_gain(refine(start, layers, Freedom(axis=False), rounds=5), layers)


def _alike(a: Array, b: Array) -> bool:
    return abs(float(a @ b)) > float(np.cos(SAME_AXIS_RAD))


def _unused(fit: Fit, joint: PredictedJoint) -> bool:
    """Whether part of the range is never reached in the clip."""
    if joint.lower is None or joint.upper is None:
        return False
    reached: float = np.ptp(fit.q).item()
    return reached < 0.8 * (joint.upper - joint.lower) - 1e-9


def _pivot_shift(a: Fit, b: Fit) -> float:
    """Distance of the two axes [m]; 0 for slides."""
    if a.motion.kind == "slide":
        return 0.0
    return float(np.linalg.norm(np.cross(b.motion.pivot_o - a.motion.pivot_o, a.motion.axis_o)))


def _wider(fit: Fit, layers: Layers, joint: PredictedJoint, scene: Scene) -> Fit:
    """The cheapest path if the joint had no limits."""
    if joint.lower is None or joint.upper is None:
        return fit
    free = coarse_fit(fit.motion, layers, fit.parts, REACH * scene.size_m)
    again = path_again(free, layers, 1.5 * position_unit(free.motion, layers))
    again = _settled(again, layers, None)
    return again if again.gain > fit.gain else fit


def _rating(witness: Witness) -> float:
    """0 to 10 from what edges and followed points say; the better counts a little more."""
    edges = (witness.edges - EDGES_BAD) / (EDGES_GOOD - EDGES_BAD)
    votes = [float(np.clip(edges, 0.0, 1.0))]
    if np.isfinite(witness.track_error):
        tracks = (TRACKS_BAD - witness.track_error) / (TRACKS_BAD - TRACKS_GOOD)
        votes.append(float(np.clip(tracks, 0.0, 1.0)))
    return 10.0 * (CALM * min(votes) + (1.0 - CALM) * max(votes))


def _reason(failure: Failure, witness: Witness) -> str:
    heard = f"edges agree by {witness.edges:.2f}"
    if np.isfinite(witness.track_error):
        heard += f", {witness.n_tracks} followed points are off by {witness.track_error:.0%}"
    what = {
        "success": "the joint explains the clip",
        "joint_type": "another kind of joint explains the clip better",
        "joint_axis": "another axis explains the clip better",
        "joint_origin": "another pivot explains the clip better",
        "joint_limit": "other limits explain the clip better",
    }[failure]
    return f"{what}: {heard}"
