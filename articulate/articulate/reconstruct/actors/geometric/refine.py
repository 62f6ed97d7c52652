"""Refinement of a motion: axis, pivot and positions by Gauss-Newton on the images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.reconstruct.actors.geometric.compositing import Compositing, Crop, rasterize
from articulate.reconstruct.actors.geometric.image_pyramid import (
    PyramidLevel,
    VideoScene,
    refit_light,
)
from articulate.reconstruct.actors.geometric.kernels import (
    normal_equations,
    render_poses,
)
from articulate.reconstruct.actors.geometric.parameters import (
    COMPOSITING,
    IMAGE,
    REFINE,
    SEARCH,
    SYMMETRY,
)
from articulate.reconstruct.actors.geometric.rotational_symmetry import (
    clear_spin,
    extract_marks,
    scene_around,
    symmetry_axis,
)
from articulate.reconstruct.actors.geometric.search import (
    MotionFit,
    bend_matrix,
    coarse_fits,
    full_turn_paths,
    path_bend_cost,
    position_unit,
    refine_path,
    rescale_gains,
    with_gain,
    without_jumps,
)
from articulate.reconstruct.actors.geometric.surface import (
    JointMotion,
    candidate_axes,
    contact_points,
    perpendicular_axes,
    sample_points,
)
from articulate.transforms import Array, axis_angle_to_matrix, normalised

TILT_COS = float(np.cos(REFINE.max_tilt_rad))
SAME_AXIS_COS = float(np.cos(REFINE.same_turn_rad))


@dataclass(frozen=True)
class FreeParameters:
    """Parameters that may change in addition to the positions."""

    axis: bool = True
    pivot: bool = True

    def size(self, motion: JointMotion) -> int:
        """Return the number of parameters."""
        return 2 * int(self.axis) + 2 * int(self.pivot and motion.kind == "turn")


def refine(
    fit: MotionFit, layers: Compositing, freedom: FreeParameters, *, rounds: int = 8
) -> MotionFit:
    """Return a fit close to ``fit`` whose total cost is no higher.

    Args:
        fit: Initial fit, with positions in the frames of ``layers``.
        layers: The frames.
        freedom: Parameters that may change.
        rounds: Steps at most.
    """
    best = replace(fit, cost=float(layers.path_cost(fit.motion.T_o(fit.q)).sum()))
    best, damping = replace(best, bend_cost=path_bend_cost(best, layers)), 1e-2
    most = SEARCH.max_bend_cost * COMPOSITING.pixel_cost_cap * layers.own_px
    for _ in range(rounds):
        hessian, gradient, scales = _assemble_equations(best, layers, freedom)
        n, unit = freedom.size(best.motion), scales[-1]
        bend = bend_matrix(best.motion, layers)
        bend = bend[(bend @ best.q) ** 2 < most]
        hessian[n:, n:] += unit**2 * bend.T @ bend
        gradient[n:] -= unit * bend.T @ (bend @ best.q)
        before = best.total_cost
        for _ in range(4):
            lifted = hessian + damping * np.diag(np.diag(hessian) + 1e-9 * np.trace(hessian))
            step = np.linalg.solve(lifted + 1e-6 * np.eye(len(hessian)), gradient)
            step = np.clip(step, -6.0, 6.0) * scales
            trial = _stepped(best, step, freedom)
            cost = float(layers.path_cost(trial.motion.T_o(trial.q)).sum())
            trial = replace(trial, cost=cost, bend_cost=path_bend_cost(trial, layers))
            if trial.total_cost < best.total_cost:
                best, damping = trial, max(damping * 0.3, 1e-4)
                break
            damping *= 5.0
        if before - best.total_cost <= REFINE.converged * abs(before):
            break
    return best


def shift_motion(motion: JointMotion, change: Array, freedom: FreeParameters) -> JointMotion:
    """Tilt the axis of ``motion`` and shift its pivot across it.

    Args:
        motion: Initial motion.
        change: Tilts about two axes [rad] if the axis is free, then shifts [m] if the pivot is;
            (0,) to (4,).
        freedom: Parameters that may change.
    """
    across = perpendicular_axes(motion.axis_o)
    axis, pivot, k = motion.axis_o, motion.pivot_o, 0
    if freedom.axis:
        turn = change[0] * across[0] + change[1] * across[1]
        axis = normalised(
            axis_angle_to_matrix(normalised(turn + 1e-300), np.linalg.norm(turn)) @ axis
        )
        k = 2
    if freedom.pivot and motion.kind == "turn":
        pivot = pivot + change[k] * across[0] + change[k + 1] * across[1]
    return replace(motion, axis_o=axis, pivot_o=pivot)


def _stepped(fit: MotionFit, step: Array, freedom: FreeParameters) -> MotionFit:
    n = freedom.size(fit.motion)
    return replace(fit, motion=shift_motion(fit.motion, step[:n], freedom), q=fit.q + step[n:])


def _assemble_equations(
    fit: MotionFit, layers: Compositing, freedom: FreeParameters
) -> tuple[Array, Array, Array]:
    """Return Hessian (D, D), descent direction (D,) and units (D,), positions last."""
    n, n_frames = freedom.size(fit.motion), len(fit.q)
    scales = _units(fit, layers, freedom)
    hessian, gradient = np.zeros((n + n_frames, n + n_frames)), np.zeros(n + n_frames)
    crop, surface = layers.crop, layers.moving
    shapes = (surface.points_o, surface.faces, surface.albedo)
    images = np.empty((2 * n + 3, *crop.size, 3), dtype=np.float32)
    box = np.empty(4, dtype=np.int64)
    small, force = np.empty((n + 1, n + 1)), np.empty(n + 1)
    poses_co = np.ascontiguousarray(crop.T_co @ _varied(fit, freedom, scales))
    pinhole, near = crop.pinhole, layers.nearness
    for t in range(n_frames):
        render_poses(shapes, layers.light, poses_co[t], pinhole, near, layers.still, box, images)
        normal_equations(images, box, crop.frames[t], REFINE.soft_colour, small, force)
        where = np.array([*range(n), n + t])
        hessian[np.ix_(where, where)] += small
        gradient[where] += force
    return hessian, gradient, scales


def _varied(fit: MotionFit, freedom: FreeParameters, scales: Array) -> Array:
    """Return poses (T, 2 n + 3, 4, 4): current, and a step up and down per parameter."""
    n = freedom.size(fit.motion)
    poses = [fit.motion.T_o(fit.q)]
    for change in np.diag(scales[:n]):
        poses += [
            shift_motion(fit.motion, sign * change, freedom).T_o(fit.q) for sign in (1.0, -1.0)
        ]
    poses += [fit.motion.T_o(fit.q + sign * scales[n:]) for sign in (1.0, -1.0)]
    return np.stack(poses, axis=1)


def _units(fit: MotionFit, layers: Compositing, freedom: FreeParameters) -> Array:
    """Return the change of each parameter that moves the part by about a pixel (D,)."""
    points = layers.moving.points_o
    pixel_m = SEARCH.position_unit_px * layers.crop.pixel_m(points.mean(axis=0))
    if fit.motion.kind == "slide":
        reach = max(float(np.abs(fit.q).max()), 2.0 * pixel_m)
    else:
        arm = np.linalg.norm(points - fit.motion.pivot_o, axis=1)
        reach = float(np.percentile(arm, 90)) + 1e-9
    units = []
    if freedom.axis:
        units += [min(pixel_m / reach, 0.2)] * 2
    if freedom.pivot and fit.motion.kind == "turn":
        units += [pixel_m] * 2
    return np.array([*units, *([position_unit(fit.motion, layers)] * len(fit.q))])


def refine_finely(fit: MotionFit, layers: Compositing, before: Crop, crop: Crop) -> MotionFit:
    """Refine ``fit`` in a finer crop; its axis stays fixed where that costs little."""
    start = replace(fit, q=np.interp(crop.indices, before.indices, fit.q))
    start = refine_path(start, layers, 1.5 * position_unit(start.motion, layers))
    bound = refine(start, layers, FreeParameters(axis=False))
    again = refine_path(bound, layers, 1.5 * position_unit(bound.motion, layers))
    if again.total_cost < bound.total_cost:
        bound = refine(again, layers, FreeParameters(axis=False), rounds=4)
    free = refine(bound, layers, FreeParameters())
    bound, free = rescale_gains([with_gain(bound, layers), with_gain(free, layers)])
    return bound if bound.gain >= (1.0 - REFINE.snap_gain_share) * free.gain else free


def choose_motion(fits: Sequence[MotionFit]) -> MotionFit:
    """Return the fit of the best score; slides are preferred to hinges of a similar score."""
    fits = rescale_gains(fits)
    best = max(fits, key=lambda fit: fit.score)
    slides = [fit for fit in fits if fit.motion.kind == "slide"]
    if slides and best.motion.kind == "turn":
        slide = max(slides, key=lambda fit: fit.score)
        if slide.score >= (1.0 - REFINE.hinge_gain_share) * best.score:
            return slide
    return best


def try_tilted_axes(fit: MotionFit, layers: Compositing, fine: PyramidLevel) -> MotionFit:
    """Return ``fit``, or the best rotation about an axis close to its own that explains as much."""
    tilted = [refine_finely(one, layers, fine.crop, fine.crop) for one in _tilted_fits(fit, fine)]
    before, *after = rescale_gains([fit, *tilted])
    best = max(after, key=lambda one: one.gain, default=before)
    return best if best.gain >= (1.0 - REFINE.tilt_gain_share) * before.gain else fit


def _tilted_fits(fit: MotionFit, level: PyramidLevel) -> list[MotionFit]:
    """Return rotations about axes close to that of ``fit`` that the part, or what it touches, has.

    A knob on a sloping front rotates about an axis that is tilted as the front is, and a fit
    to its image stops half way.
    """
    if fit.motion.kind == "slide":
        return []
    axis, surface = fit.motion.axis_o, level.surface.only(fit.parts)
    others = [k for k in np.unique(level.surface.part_ids) if k not in fit.parts]
    shapes = [level.surface.only([k]) for k in fit.parts]
    samples = sample_points(surface)
    shapes += [
        s for k in others if len(contact_points(samples, s := level.surface.only([k]), surface))
    ]
    axes: list[tuple[str, Array]] = []
    for shape in shapes:
        for source, other in candidate_axes(shape):
            cosine = float(other @ axis)
            near = TILT_COS <= abs(cosine) < SAME_AXIS_COS
            if near and all(abs(float(other @ one)) < SAME_AXIS_COS for _, one in axes):
                axes.append((source, other * np.sign(cosine)))
    middle = surface.points_o.mean(axis=0)
    pivot = fit.motion.pivot_o + axis * float((middle - fit.motion.pivot_o) @ axis)
    return [
        replace(fit, motion=JointMotion("turn", other, pivot, f"{source}, tilted"))
        for source, other in axes[: REFINE.tilted_axes]
    ]


def fit_all_frames(
    scene: VideoScene, fit: MotionFit, fine: PyramidLevel, *, spins: bool = False
) -> MotionFit:
    """Fit the positions in every frame of the video.

    A rotation is also searched on the full circle: wheels look alike after a fraction of a turn, so
    that only consecutive frames show the direction.

    Args:
        scene: The video and the object.
        fit: The motion found in some frames.
        fine: The level with these frames and the light.
        spins: Prefer a uniform motion.
    """
    level = _every_frame(scene, fine)
    layers = level.compositing(fit.parts)
    start = replace(fit, q=np.interp(level.crop.indices, fine.crop.indices, fit.q))
    step = 1.5 * position_unit(start.motion, layers)
    tries = [start, refine_path(start, layers, step)]
    if fit.motion.kind == "turn":
        tries.extend(full_turn_paths(start, layers))
    fixed = FreeParameters(axis=False, pivot=False)
    refined = [refine(one, layers, fixed, rounds=3) for one in tries]
    best = min(refined, key=lambda one: one.total_cost)
    best = _prefer_uniform(best, refined, layers) if spins else best
    if best.total_cost < REFINE.new_motion_cost_ratio * refined[0].total_cost:
        best = refine(best, layers, FreeParameters(axis=False))
        again = refine_path(best, layers, 1.5 * position_unit(best.motion, layers))
        best = min(
            (best, refine(again, layers, FreeParameters(), rounds=4)),
            key=lambda one: one.total_cost,
        )
    smooth = _without_jumps(best, layers)
    if smooth is not best:
        smooth = refine(smooth, layers, fixed, rounds=3)
        best = smooth if smooth.total_cost <= REFINE.smooth_cost_ratio * best.total_cost else best
    return with_gain(best, layers)


def _prefer_uniform(best: MotionFit, fits: Sequence[MotionFit], layers: Compositing) -> MotionFit:
    """Return ``best``, or the cheapest uniform one of ``fits`` if it explains about as much.

    A part that looks the same after a small rotation may as well oscillate.
    """
    uniform = min(
        (fit for fit in fits if fit.uniform), key=lambda fit: fit.total_cost, default=best
    )
    if uniform is best:
        return best
    before, after = rescale_gains([with_gain(best, layers), with_gain(uniform, layers)])
    return after if after.gain >= REFINE.uniform_gain_share * before.gain else best


def _without_jumps(fit: MotionFit, layers: Compositing) -> MotionFit:
    """Return ``fit`` with a path without jumps; ``fit`` itself if it has none."""
    if fit.motion.kind == "turn":
        q = without_jumps(fit.q)
        return fit if q is fit.q else replace(fit, q=q)
    unit, steps = position_unit(fit.motion, layers), np.abs(np.diff(fit.q))
    if steps.max() <= SEARCH.jump_step_ratio * float(np.median(steps)) + REFINE.jump_px * unit:
        return fit
    return refine_path(replace(fit, uniform=True), layers, 1.5 * unit)


def prefer_own_axis(scene: VideoScene, fine: PyramidLevel, fit: MotionFit) -> MotionFit:
    """Return ``fit``, or a rotation of a round part about its own axis.

    Such a rotation changes little in the images, so that a small advantage of another motion is no
    evidence; for hardly visible motions see :func:`_fit_faint_motion`.
    """
    surface = fine.surface.only(fit.parts[:1])
    layers = fine.compositing(fit.parts)
    share = fit.gain / (COMPOSITING.pixel_cost_cap * len(fit.q) * max(1, layers.own_px))
    motion = (
        symmetry_axis(surface, candidate_axes(surface)) if share <= SYMMETRY.visible_share else None
    )
    if motion is None:
        return fit
    from_marks = turn_from_marks(scene, fine, motion, fit.parts)
    if from_marks is not None:
        return from_marks
    if share <= SYMMETRY.faint_share:
        return _fit_faint_motion(scene, motion, fit.parts)
    if fit.motion.kind == "slide":
        return fit
    start = MotionFit(motion, np.zeros(len(fine.crop.frames)), 0.0, fit.parts)
    turning = fit_all_frames(scene, start, fine)
    return turning if turning.gain >= SYMMETRY.own_axis_gain_share * fit.gain else fit


def _fit_faint_motion(scene: VideoScene, motion: JointMotion, parts: tuple[int, ...]) -> MotionFit:
    """Return the hardly visible motion of a round part: pressed like a button, or rotated.

    The one that explains more, rotations about the best axis close to its own; an endless rotation
    about its own axis if neither explains anything.
    """
    fine = scene.level(
        IMAGE.fine_px, IMAGE.fine_frames
    )  # light fitted to a wrong motion would hide the change
    layers = fine.compositing(parts)
    slide = replace(motion, kind="slide", source="along which it is round")
    found = [*coarse_fits(slide, layers, parts, SEARCH.slide_reach_share * scene.size_m, near=True)]
    travel = np.linspace(0.0, SYMMETRY.endless_rad, len(scene.video))
    for q in (travel[fine.crop.indices], -travel[fine.crop.indices]):
        turn = refine(
            _uniform_fit(motion, q, parts, layers), layers, FreeParameters(axis=False)
        ).motion
        found.append(_uniform_fit(turn, q, parts, layers))
    best = max((with_gain(fit, layers) for fit in found), key=lambda fit: fit.share)
    if best.share < SYMMETRY.min_faint_share:
        return replace(best, motion=motion, q=travel, gain=0.0)
    if best.motion.kind == "slide":
        return fit_all_frames(scene, best, fine)
    layers = _every_frame(scene, fine).compositing(parts)
    return with_gain(
        _uniform_fit(best.motion, np.copysign(travel, best.q[-1]), parts, layers), layers
    )


def fit_own_axis_turn(scene: VideoScene, part: int, *, marked: bool = False) -> MotionFit | None:
    """Return a rotation of ``part`` about its axis of symmetry.

    None if it has none, or if only ``marked`` rotations are accepted and its marks show none.
    """
    fine = scene.level(IMAGE.fine_px, IMAGE.fine_frames)
    surface = fine.surface.only([part])
    motion = symmetry_axis(surface, candidate_axes(surface))
    if motion is None:
        return None
    start = MotionFit(motion, np.zeros(len(fine.crop.frames)), 0.0, (part,))
    fine = replace(fine, light=refit_light(fine, start, fine.crop))
    from_marks = turn_from_marks(scene, fine, motion, (part,), blurred=marked)
    if from_marks is not None or marked:
        return from_marks
    return prefer_own_axis(scene, fine, fit_all_frames(scene, start, fine, spins=True))


def turn_from_marks(
    scene: VideoScene,
    fine: PyramidLevel,
    motion: JointMotion,
    parts: tuple[int, ...],
    *,
    blurred: bool = False,
) -> MotionFit | None:
    """Return the uniform rotation that surface marks show; None if they are unclear.

    The marks show the angle, the model of the object shows the start: the cheapest of some is used.

    Args:
        scene: The video and the object.
        fine: One of its levels, for the light.
        motion: Rotation about the axis of symmetry.
        parts: Moving parts, the leading one first.
        blurred: Treat a rotation of unclear angle as endless.
    """
    spin = clear_spin(scene, fine, parts[0], motion)
    if spin is None or not (spin.sharp or blurred):
        return None
    end_rad = spin.end_rad if spin.sharp else float(np.copysign(SYMMETRY.endless_rad, spin.end_rad))
    layers = _every_frame(scene, fine).compositing(parts)
    travel = np.linspace(0.0, end_rad, len(scene.video))
    starts = np.linspace(0.0, 2.0 * np.pi, SYMMETRY.start_angles, endpoint=False)
    uniform = [_uniform_fit(motion, travel + start, parts, layers) for start in starts]
    return with_gain(min(uniform, key=lambda fit: fit.cost), layers)


def _every_frame(scene: VideoScene, fine: PyramidLevel) -> PyramidLevel:
    """Return the level with all frames of the video, at the resolution and light of ``fine``."""
    return replace(scene.level(IMAGE.fine_px, 0, np.arange(len(scene.video))), light=fine.light)


def _uniform_fit(
    motion: JointMotion, q: Array, parts: tuple[int, ...], layers: Compositing
) -> MotionFit:
    """Return the fit of ``parts`` at uniform positions ``q`` (T,) in the frames of ``layers``."""
    cost = float(layers.path_cost(motion.T_o(q)).sum())
    return MotionFit(motion, q, cost, parts, uniform=True)


def guess_round_part(scene: VideoScene) -> MotionFit | None:
    """Return an endless rotation of the round part that changes most.

    The smallest visible one if none changes more than the others.
    """
    height, width = scene.video.shape[1:3]
    scene = replace(scene, box=(0, width, 0, height))
    level = scene.level(max(height, width), 2)
    seen = rasterize(level.surface, level.crop)
    visible = np.unique(level.surface.part_ids[seen.face_ids[seen.face_ids >= 0]])
    found: list[tuple[float, float, int, JointMotion]] = []
    for part in visible:
        surface = level.surface.only([int(part)])
        motion = symmetry_axis(surface, candidate_axes(surface))
        if motion is not None:
            marks = extract_marks(scene_around(scene, level, int(part)), int(part), motion)
            size = float(np.linalg.norm(np.ptp(surface.points_o, axis=0)))
            found.append((0.0 if marks is None else marks.strength, size, int(part), motion))
    if not found:
        return None
    usual = float(np.median([strength for strength, *_ in found]))
    marked = [
        one for one in found if one[0] > max(SYMMETRY.outlier_ratio * usual, SYMMETRY.min_strength)
    ]
    if marked:
        _, _, part, motion = max(marked, key=lambda one: one[0])
    else:
        _, _, part, motion = min(found, key=lambda one: one[1])
    return MotionFit(motion, np.linspace(0.0, SYMMETRY.endless_rad, len(scene.video)), 0.0, (part,))
