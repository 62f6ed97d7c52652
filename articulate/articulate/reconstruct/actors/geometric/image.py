"""Correct joints by one image of the open object.

Joints predicted without the image give the hypotheses that are tried first. Each moving part is
rendered at many positions of its joint, together with all parts that it carries, and compared with
the image. Where no position explains the image, all slides and hinges that the part's shape
suggests are tried, and the best one replaces the joint.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.compositing import (
    Compositing,
    Crop,
    absolute_sum,
    crop_video,
    model_image,
    object_box,
    rasterize,
)
from articulate.reconstruct.actors.geometric.kernels import Floats, face_colours
from articulate.reconstruct.actors.geometric.parameters import COMPOSITING, STILL
from articulate.reconstruct.actors.geometric.search import MotionFit, position_unit
from articulate.reconstruct.actors.geometric.surface import (
    JointMotion,
    PartSurface,
    build_surface,
    candidate_axes,
    candidate_motions,
    perpendicular_axes,
)
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction, TraceStep
from articulate.transforms import Array, apply, axis_angle_to_matrix, inverse, normalised

Poses = Mapping[str, Array]
"""Motion of each part (4, 4), by name."""


@dataclass(frozen=True, eq=False)
class StillImage:
    """The image at one resolution, and the parts."""

    crop: Crop
    pieces: Mapping[str, PartSurface]
    background: Array
    """Background colour (3,), 0 to 255."""
    light: Array
    """Light (LIGHT_ROWS, 3)."""

    def rendered(self, poses: Poses) -> tuple[Floats, Floats]:
        """Return inverse depth (H, W) [1/m] and colours (H, W, 3) of the parts in ``poses``."""
        image = np.broadcast_to(self.background, (*self.crop.size, 3)).astype(np.float32)
        if not poses:
            return np.zeros(self.crop.size, dtype=np.float32), image
        surface = _merged([_moved(self.pieces[name], T) for name, T in poses.items()])
        seen = rasterize(surface, self.crop)
        solid = seen.face_ids >= 0
        colours = face_colours(seen.points_c, surface.faces, surface.albedo, self.light)
        image[solid] = colours[seen.face_ids[solid]]
        return seen.nearness, image

    def compositing(self, poses: Poses, moving: Poses, T_parent: Array) -> Compositing:
        """Separate moving parts from the others.

        Args:
            poses: Motion of the other parts.
            moving: Motion of the moving parts relative to their parent.
            T_parent: Motion of this parent (4, 4), homogeneous.
        """
        nearness, still = self.rendered(poses)
        base = np.minimum(absolute_sum(self.crop.frames - still), COMPOSITING.pixel_cost_cap)
        surface = _merged([_moved(self.pieces[name], T) for name, T in moving.items()])
        crop = replace(self.crop, T_co=self.crop.T_co @ T_parent)
        return Compositing(crop, surface, self.light, nearness, still, base.astype(np.float32))

    def unexplained_px(self, poses: Poses) -> float:
        """Return the cost of the parts in ``poses`` in wrong pixels, edges excluded."""
        _, image = self.rendered(poses)
        wrong = cv2.erode(_pixel_costs(self.crop, image), np.ones((3, 3)))
        return float(wrong.sum()) / COMPOSITING.pixel_cost_cap


@dataclass
class JointState:
    """Joint of each part and its position in the image."""

    joints: dict[str, PredictedJoint]
    q: dict[str, float] = field(default_factory=dict)
    """Position of each joint [m or rad], 0 by default."""

    def pose(self, name: str | None) -> Array:
        """Return the motion of a part (4, 4)."""
        if name is None or name not in self.joints:
            return np.eye(4)
        joint = self.joints[name]
        return np.asarray(self.pose(joint.parent) @ joint.T_o(self.q.get(name, 0.0)))

    def poses(self, names: Sequence[str]) -> dict[str, Array]:
        """Return the motion of each of some parts."""
        return {name: self.pose(name) for name in names}

    def carried(self, name: str) -> list[str]:
        """Return a part and all parts that it carries."""
        found = [name]
        for one in found:
            found += [j.part for j in self.joints.values() if j.parent == one]
        return found


def correct_joints(
    evidence: Evidence, prediction: Prediction, background: Array, light: Array
) -> Prediction:
    """Return ``prediction`` with the joints that the image contradicts replaced.

    Args:
        evidence: Parts in their places, an image and its camera.
        prediction: Joints predicted without the image.
        background: Background colour (3,), 0 to 255.
        light: Light (LIGHT_ROWS, 3) in the camera frame.
    """
    start = time.monotonic()
    state = JointState({joint.part: joint for joint in prediction.joints})
    coarse = _still_image(evidence, background, light, STILL.coarse_px)
    names = list(coarse.pieces)
    before = coarse.unexplained_px(state.poses(names))
    units = _visible_units(coarse, state)
    if before < STILL.min_change_px or not units:
        return prediction
    for _ in range(STILL.rounds):
        for name in units:
            _settle(coarse, state, name)
    after = coarse.unexplained_px(state.poses(names))
    replaced: list[str] = []
    fine = _still_image(evidence, background, light, STILL.fine_px)
    if after >= STILL.min_change_px:
        for _ in range(STILL.rounds):
            for name in units:
                if _replace_joint(coarse, fine, state, name) and name not in replaced:
                    replaced.append(name)
    after = coarse.unexplained_px(state.poses(names))
    surface = _merged(list(coarse.pieces.values()))
    solid_px = int((rasterize(surface, coarse.crop).face_ids >= 0).sum())
    joints = tuple(_with_seen_range(state, joint) for joint in prediction.joints)
    text = f"replaced: {', '.join(replaced)}" if replaced else "no joint replaced"
    if after > STILL.max_unexplained_share * solid_px:
        joints, text = prediction.joints, "the image differs too much from the parts to be used"
    step = TraceStep(
        title="joints compared with the image",
        text=text,
        figures={"unexplained_closed_px": before, "unexplained_px": after},
        seconds=time.monotonic() - start,
    )
    return replace(prediction, joints=joints, trace=(*prediction.trace, step))


def _still_image(evidence: Evidence, background: Array, light: Array, max_px: int) -> StillImage:
    """Build the image at a resolution; the region holds the object in all joint states."""
    assert evidence.image is not None
    assert evidence.camera is not None
    box = _region(evidence, background)
    crop = crop_video(evidence.image[None], evidence.camera, np.array([0]), box, max_px)
    middle = np.mean([part.centre for part in evidence.parts], axis=0)
    pixel_m = crop.pixel_m(middle)
    pieces = {part.name: build_surface([part], pixel_m=pixel_m) for part in evidence.parts}
    return StillImage(crop, pieces, background, light)


def _region(evidence: Evidence, background: Array) -> tuple[int, int, int, int]:
    """Return the region of the object, open and closed: first and end column, and row [px]."""
    assert evidence.image is not None
    assert evidence.camera is not None
    left, right, top, bottom = object_box(evidence.camera, evidence.parts)
    seen = np.abs(evidence.image - background).max(axis=-1) > STILL.background_tolerance
    rows, columns = np.nonzero(seen)
    if not len(rows):
        return left, right, top, bottom
    return (
        min(left, int(columns.min())),
        max(right, int(columns.max()) + 1),
        min(top, int(rows.min())),
        max(bottom, int(rows.max()) + 1),
    )


def _visible_units(image: StillImage, state: JointState) -> list[str]:
    """Return the moving parts that are large enough in the image, the largest first."""
    areas = {}
    for name, joint in state.joints.items():
        if joint.kind == "fixed":
            continue
        shapes = [image.pieces[one] for one in state.carried(name) if one in image.pieces]
        areas[name] = int((rasterize(_merged(shapes), image.crop).face_ids >= 0).sum())
    large = [name for name in areas if areas[name] >= STILL.min_part_px]
    return sorted(large, key=lambda name: -areas[name])[: STILL.max_units]


def _layers(image: StillImage, state: JointState, name: str) -> Compositing:
    """Separate a part, and all parts that it carries, from the others."""
    carried = state.carried(name)
    own = inverse(state.pose(name))
    rest = state.poses([one for one in image.pieces if one not in carried])
    moving = {one: own @ state.pose(one) for one in carried if one in image.pieces}
    return image.compositing(rest, moving, state.pose(state.joints[name].parent))


def _motion_of(joint: PredictedJoint) -> JointMotion:
    kind = "slide" if joint.kind == "prismatic" else "turn"
    return JointMotion(
        "slide" if kind == "slide" else "turn",
        normalised(joint.axis_o),
        np.asarray(joint.pivot_o, dtype=np.float64),
        "predicted",
    )


def _best_position(
    motion: JointMotion, layers: Compositing, *, steps: int = STILL.turn_positions
) -> tuple[float, float]:
    """Return the position of ``motion`` that explains the image best, and its cost."""
    if motion.kind == "turn":
        q = np.asarray((np.arange(steps) - steps // 2) * (2.0 * np.pi / steps))
    else:
        unit = STILL.slide_step_px * position_unit(motion, layers)
        reach = STILL.slide_reach_px * position_unit(motion, layers)
        half = max(1, round(reach / unit))
        q = np.asarray(np.arange(-half, half + 1) * unit)
    costs = layers.costs(motion.T_o(q))[:, 0]
    k = int(costs.argmin())
    near = q[k] + (q[1] - q[0]) * np.array(STILL.finer_steps)
    finer = layers.costs(motion.T_o(near))[:, 0]
    j = int(finer.argmin())
    return (float(near[j]), float(finer[j])) if finer[j] < costs[k] else (q[k], float(costs[k]))


def _settle(image: StillImage, state: JointState, name: str) -> None:
    """Move a part along its joint to the position that explains the image best."""
    layers = _layers(image, state, name)
    motion = _motion_of(state.joints[name])
    q, cost = _best_position(motion, layers)
    closed = float(layers.costs(np.eye(4)[None])[0, 0])
    gained = closed - cost > STILL.min_gain_share * layers.own_px * COMPOSITING.pixel_cost_cap
    state.q[name] = q if gained else 0.0


def _replace_joint(coarse: StillImage, fine: StillImage, state: JointState, name: str) -> bool:
    """Replace the joint of a part if another one explains the image much better."""
    _settle(coarse, state, name)
    layers = _layers(coarse, state, name)
    now = float(layers.costs(state.joints[name].T_o(np.array([state.q.get(name, 0.0)])))[0, 0])
    margin = STILL.better_share * layers.own_px * COMPOSITING.pixel_cost_cap
    others = [one for one in coarse.pieces if one not in state.carried(name)]
    rest = _merged([coarse.pieces[one] for one in others])
    lead = coarse.pieces[name]
    tried: list[tuple[float, JointMotion, float]] = []
    for motion in candidate_motions(lead, rest, candidate_axes(lead)):
        q, cost = _best_position(motion, layers)
        tried.append((cost, motion, q))
    tried = [one for one in sorted(tried, key=lambda one: one[0]) if one[0] < now - margin]
    detail = _layers(fine, state, name)
    old = _with_cost(_motion_of(state.joints[name]), state.q.get(name, 0.0), detail)
    starts = [(motion, q) for _, motion, q in tried[: STILL.refined]]
    fits = [_refined(motion, q, detail) for motion, q in [(old.motion, old.q[0]), *starts]]
    best = min(fits, key=lambda fit: fit.cost)
    slides = [fit for fit in fits if fit.motion.kind == "slide"]
    if slides:  # they have fewer parameters than hinges
        slide = min(slides, key=lambda fit: fit.cost)
        if slide.cost <= best.cost + STILL.slide_share * (old.cost - best.cost):
            best = slide
    if not _explains_more(best, old, detail):
        return False
    state.joints[name] = _joint_from(state.joints[name], best)
    state.q[name] = float(best.q[0])
    return True


def _with_cost(motion: JointMotion, q: float, layers: Compositing) -> MotionFit:
    cost = float(layers.costs(motion.T_o(np.array([q])))[0, 0])
    return MotionFit(motion, np.array([q]), cost, ())


def _explains_more(new: MotionFit, old: MotionFit, layers: Compositing) -> bool:
    """Return whether wrong pixels where the two differ, edges excluded, become much fewer."""
    images = [model_image(fit.motion.T_o(fit.q)[0], layers) for fit in (new, old)]
    differ = (absolute_sum(images[0] - images[1]) > STILL.background_tolerance).astype(np.uint8)
    where = cv2.dilate(differ, np.ones((5, 5))).astype(np.bool_)
    after, before = (
        float(cv2.erode(_pixel_costs(layers.crop, image), np.ones((3, 3)))[where].sum())
        for image in images
    )
    return (
        after <= STILL.most_left_share * before
        and before - after >= STILL.min_replaced_px * COMPOSITING.pixel_cost_cap
    )


def _pixel_costs(crop: Crop, image: Floats) -> Floats:
    """Return the cost of each pixel of ``image`` (H, W)."""
    off = np.minimum(absolute_sum(crop.frames[0] - image), COMPOSITING.pixel_cost_cap)
    return np.asarray(off, dtype=np.float32)


def _refined(motion: JointMotion, q: float, layers: Compositing) -> MotionFit:
    """Return the best motion close to a candidate; the pivot moves only if that explains more.

    The part is shifted and rotated in the plane of its rotation until no step improves the cost;
    gradients of a plain part in one image reach only a pixel far.
    """
    unit = position_unit(motion, layers)
    start = _with_cost(motion, q, layers)
    for step in (2.0 * unit, 0.5 * unit):
        start = min(
            (start, *(_with_cost(motion, start.q[0] + k * step, layers) for k in STILL.steps)),
            key=lambda fit: fit.cost,
        )
    if motion.kind == "slide":
        return start
    across = perpendicular_axes(motion.axis_o)
    pixel_m = layers.crop.pixel_m(layers.moving.points_o.mean(axis=0))
    best = start
    for step_px in STILL.pivot_steps_px:
        for _ in range(STILL.pivot_rounds):
            tried = [
                _shifted(best, across, step_px * pixel_m * np.array([a, b]), c * step_px * unit)
                for a in (-1, 0, 1)
                for b in (-1, 0, 1)
                for c in (-1, 0, 1)
            ]
            costs = layers.costs(np.concatenate([fit.motion.T_o(fit.q) for fit in tried]))[:, 0]
            k = int(costs.argmin())
            if costs[k] >= best.cost:
                break
            best = replace(tried[k], cost=float(costs[k]))
    snapped = STILL.snap_share * layers.own_px * COMPOSITING.pixel_cost_cap
    return best if best.cost < start.cost - snapped else start


def _shifted(fit: MotionFit, across: Array, shift: Array, turn: float) -> MotionFit:
    """Return a rotation that puts the part at another place in the plane of its rotation.

    Args:
        fit: The rotation.
        across: Two directions of the plane (2, 3).
        shift: Shift of the part's centre of rotation in the plane (2,) [m].
        turn: Further rotation [rad].
    """
    q = float(fit.q[0])
    if abs(q + turn) < STILL.min_turn_rad:
        return fit
    # A shift s of the part equals a shift p of the pivot with s = p - R p, in the plane.
    rot = axis_angle_to_matrix(fit.motion.axis_o, q + turn)
    plane = np.eye(2) - across @ rot @ across.T
    pivot = fit.motion.pivot_o + across.T @ np.linalg.solve(plane, shift)
    return replace(fit, motion=replace(fit.motion, pivot_o=pivot), q=np.array([q + turn]))


def _joint_from(joint: PredictedJoint, fit: MotionFit) -> PredictedJoint:
    """Return ``joint`` with the motion of ``fit``, from closed to where it was seen or farther.

    One image shows no limits: a rotation stays endless if it was.
    """
    slide = fit.motion.kind == "slide"
    end = float(fit.q[0])
    end = float(np.copysign(max(abs(end), 0.0 if slide else 0.5 * np.pi), end))
    x, y, z = (float(v) for v in fit.motion.axis_o)
    px, py, pz = (float(v) for v in fit.motion.pivot_o)
    endless = joint.kind == "continuous" and not slide
    return replace(
        joint,
        kind="prismatic" if slide else "continuous" if endless else "revolute",
        axis_o=(x, y, z),
        pivot_o=(px, py, pz),
        lower=None if endless else min(0.0, end),
        upper=None if endless else max(0.0, end),
        confidence=STILL.confidence,
    )


def _with_seen_range(state: JointState, joint: PredictedJoint) -> PredictedJoint:
    """Return the joint of a part with a range that holds its position in the image."""
    joint, q = state.joints[joint.part], state.q.get(joint.part, 0.0)
    if joint.lower is None or joint.upper is None or q == 0.0:
        return joint
    if joint.lower <= q <= joint.upper:
        return joint
    lower, upper = joint.lower, joint.upper
    if lower <= 0.0 <= upper and 0.0 in (lower, upper):  # it opens the other way
        lower, upper = -upper, -lower
    return replace(joint, lower=min(lower, q), upper=max(upper, q))


def _moved(surface: PartSurface, T: Array) -> PartSurface:
    return replace(surface, points_o=apply(T, surface.points_o))


def _merged(surfaces: Sequence[PartSurface]) -> PartSurface:
    """Return the faces of all surfaces; the k-th has part k."""
    starts = np.cumsum([0, *(len(s.points_o) for s in surfaces[:-1])])
    return PartSurface(
        np.concatenate([np.zeros((0, 3)), *(s.points_o for s in surfaces)]),
        np.concatenate(
            [
                np.zeros((0, 3), dtype=np.int64),
                *(s.faces + start for s, start in zip(surfaces, starts, strict=True)),
            ]
        ),
        np.concatenate([np.zeros((0, 3)), *(s.albedo for s in surfaces)]),
        np.concatenate(
            [
                np.zeros(0, dtype=np.int64),
                *(np.full(len(s.faces), k, dtype=np.int64) for k, s in enumerate(surfaces)),
            ]
        ),
    )
