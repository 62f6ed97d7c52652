"""Find the part of a known object that moves in a video, and its motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from articulate.reconstruct.actors.geometric.compositing import Compositing
from articulate.reconstruct.actors.geometric.image_pyramid import (
    PyramidLevel,
    VideoScene,
    refit_light,
)
from articulate.reconstruct.actors.geometric.parameters import FIT, IMAGE, SEARCH
from articulate.reconstruct.actors.geometric.parts import hidden_parts, part_in_place, rank_parts
from articulate.reconstruct.actors.geometric.refine import (
    SAME_AXIS_COS,
    FreeParameters,
    choose_motion,
    fit_all_frames,
    fit_own_axis_turn,
    prefer_own_axis,
    refine,
    refine_finely,
    try_tilted_axes,
)
from articulate.reconstruct.actors.geometric.rotational_symmetry import symmetry_axis
from articulate.reconstruct.actors.geometric.search import (
    MotionFit,
    coarse_fit,
    coarse_fits,
    moves,
    position_unit,
    refine_path,
    rescale_gains,
    with_gain,
)
from articulate.reconstruct.actors.geometric.surface import (
    JointMotion,
    candidate_axes,
    candidate_motions,
    perpendicular_axes,
)


@dataclass(frozen=True)
class MotionConstraints:
    """Constraints on a motion, derived from rejected predictions."""

    kind: Literal["slide", "turn"] | None = None
    """Required kind; None: either."""
    excluded_axes: tuple[tuple[float, float, float], ...] = ()
    """Directions that were rejected (unit vectors)."""
    excluded_parts: tuple[int, ...] = ()
    """Indices of parts that were rejected as the leading part."""
    part: int | None = None
    """Required leading part; None: any."""
    near: JointMotion | None = None
    """Motion that the result must resemble; None: any."""
    near_m: float = 0.0
    """Largest distance from the axis of ``near`` for rotations [m]."""

    def allows(self, fit: MotionFit) -> bool:
        """Return whether ``fit`` satisfies the constraints."""
        if self.kind is not None and fit.motion.kind != self.kind:
            return False
        if self.near is not None and not self._is_near(fit.motion, self.near):
            return False
        near = (abs(float(fit.motion.axis_o @ np.asarray(axis))) for axis in self.excluded_axes)
        return all(value < FIT.same_axis_cos for value in near)

    def _is_near(self, motion: JointMotion, wanted: JointMotion) -> bool:
        if (
            motion.kind != wanted.kind
            or abs(float(motion.axis_o @ wanted.axis_o)) < FIT.same_axis_cos
        ):
            return False
        off = np.cross(motion.pivot_o - wanted.pivot_o, wanted.axis_o)
        return motion.kind == "slide" or float(np.linalg.norm(off)) <= self.near_m


def find_motion(
    scene: VideoScene, constraints: MotionConstraints | None = None
) -> MotionFit | None:
    """Return the motion that explains the video best.

    None if no part is in the region that changes, or no motion satisfies the constraints.
    """
    constraints = constraints or MotionConstraints()
    quick = scene.level(IMAGE.quick_px, IMAGE.quick_frames)
    ranked = [part for part in rank_parts(quick) if part not in constraints.excluded_parts]
    hidden = [
        part for part in hidden_parts(quick) if part not in (*ranked, *constraints.excluded_parts)
    ]
    candidates = (
        [*ranked[: FIT.visible_parts], *hidden[: FIT.hidden_parts]]
        if constraints.part is None
        else [constraints.part]
    )
    ranked += hidden[: FIT.hidden_parts]
    if not ranked:
        return None
    spun = _turn_in_place(scene, quick, ranked) if constraints.part is None else None
    if spun is not None and constraints.allows(spun):
        return spun
    reach = SEARCH.slide_reach_share * scene.size_m
    firsts = [_quick_fit(quick, part, reach) for part in candidates]
    firsts.sort(key=lambda fit: -fit.score)
    seeds = [attach_parts(quick, fit, ranked) for fit in firsts[: FIT.seeds]]
    seed = max(
        seeds, key=lambda fit: fit.score * (1.0 - FIT.bulk_penalty * _relative_volume(quick, fit))
    )
    for _ in range(FIT.light_rounds):
        quick = replace(quick, light=refit_light(quick, seed, quick.crop))
        seed = attach_parts(quick, _quick_fit(quick, seed.parts[0], reach), ranked)
    moving = seed.parts
    coarse = replace(scene.level(IMAGE.coarse_px, IMAGE.coarse_frames), light=quick.light)
    layers = coarse.compositing(moving)
    fits = _candidates(coarse, layers, moving, reach, constraints)
    if not fits:
        return None
    coarse = replace(coarse, light=refit_light(coarse, fits[0], coarse.crop))
    layers = coarse.compositing(moving)
    fits = rescale_gains([_refine_coarsely(fit, layers) for fit in fits])
    fits.sort(key=lambda fit: -fit.score)
    fine = replace(scene.level(IMAGE.fine_px, IMAGE.fine_frames), light=coarse.light)
    fine = replace(fine, light=refit_light(fine, fits[0], coarse.crop))
    layers = fine.compositing(moving)
    fits = _spread(_distinct(fits, layers), FIT.fine_candidates)
    finals = [refine_finely(fit, layers, coarse.crop, fine.crop) for fit in fits]
    finished: list[MotionFit] = []
    for fit in [choose_motion(finals), *sorted(finals, key=lambda fit: -fit.score)]:
        finished.append(_in_all_frames(scene, fine, layers, fit, constraints))
        if moves(finished[-1], layers):
            return finished[-1]
    # Errors of the model may make a permanently hidden part the cheapest explanation.
    return _any_turn_in_place(scene, quick, constraints) or finished[0]


def _in_all_frames(
    scene: VideoScene,
    fine: PyramidLevel,
    layers: Compositing,
    fit: MotionFit,
    constraints: MotionConstraints,
) -> MotionFit:
    """Return ``fit`` with axes close to its own tried, and positions in every frame."""
    all_over = fit_all_frames(scene, try_tilted_axes(fit, layers, fine), fine)
    rounded = prefer_own_axis(scene, fine, all_over)
    return rounded if constraints.allows(rounded) else all_over


def _any_turn_in_place(
    scene: VideoScene, quick: PyramidLevel, constraints: MotionConstraints
) -> MotionFit | None:
    """Return a rotation of the round part whose image contains all changes."""
    part = part_in_place(quick, all_over=False) if constraints.part is None else None
    spun = (
        None
        if part is None or part in constraints.excluded_parts
        else fit_own_axis_turn(scene, part)
    )
    return spun if spun is not None and constraints.allows(spun) else None


def _turn_in_place(
    scene: VideoScene, quick: PyramidLevel, ranked: Sequence[int]
) -> MotionFit | None:
    """Return the rotation of a part within its image, fully or by its marks."""
    part = part_in_place(quick)
    if part is not None:
        return fit_own_axis_turn(scene, part) if part in ranked else None
    part = part_in_place(quick, all_over=False)
    if (
        part is None
        or part not in ranked
        or has_visible_motion(quick, part, SEARCH.slide_reach_share * scene.size_m)
    ):
        return None
    return fit_own_axis_turn(scene, part, marked=True)


def _refine_coarsely(fit: MotionFit, layers: Compositing) -> MotionFit:
    """Search the path of ``fit`` again and refine its pivot."""
    again = refine_path(fit, layers, 2.0 * position_unit(fit.motion, layers))
    return with_gain(refine(again, layers, FreeParameters(axis=False), rounds=5), layers)


def has_visible_motion(level: PyramidLevel, part: int, reach_m: float) -> bool:
    """Return whether a motion out of place explains so much that ``part`` does not rotate in place.

    A square drawer that starts half open is nearly round, and so is a square door; all changes may
    lie where it is. A hinge has another axis than the axis of symmetry.
    """
    surface = level.surface.only([part])
    round_ = symmetry_axis(surface, candidate_axes(surface))
    own = np.zeros(3) if round_ is None else round_.axis_o
    return any(
        fit.share >= FIT.visible_motion_share
        and (fit.motion.kind == "slide" or abs(float(fit.motion.axis_o @ own)) < FIT.same_axis_cos)
        for fit in _quick_fits(level, part, reach_m)
    )


def _quick_fit(level: PyramidLevel, part: int, reach_m: float) -> MotionFit:
    return max(_quick_fits(level, part, reach_m), key=lambda fit: fit.score)


def _quick_fits(level: PyramidLevel, part: int, reach_m: float) -> list[MotionFit]:
    layers = level.compositing([part])
    return [coarse_fit(motion, layers, (part,), reach_m) for motion in frame_motions(level, part)]


def frame_motions(level: PyramidLevel, part: int) -> list[JointMotion]:
    """Return the motions of ``part`` along and about the axes of the object frame."""
    surface = level.surface.only([part])
    rest = level.surface.only([k for k in np.unique(level.surface.part_ids) if k != part])
    return candidate_motions(surface, rest, candidate_axes(surface)[:3])


def _relative_volume(level: PyramidLevel, fit: MotionFit) -> float:
    """Return the bounding box volume of the leading part as a share of the object's."""
    size = np.ptp(level.surface.only(fit.parts[:1]).points_o, axis=0)
    return float(np.prod(size) / max(float(np.prod(np.ptp(level.surface.points_o, axis=0))), 1e-12))


def attach_parts(level: PyramidLevel, seed: MotionFit, others: Sequence[int]) -> MotionFit:
    """Add the parts that move as the leading part of ``seed`` does."""
    T_o = seed.motion.T_o(seed.q)
    best = seed
    cost = float(level.compositing(seed.parts).path_cost(T_o).sum())
    for part in others:
        if part in best.parts:
            continue
        layers = level.compositing((*best.parts, part))
        more = float(layers.path_cost(T_o).sum())
        if more < cost - 0.01 * max(seed.gain, 0.0):
            best, cost = (
                with_gain(replace(seed, parts=(*best.parts, part), cost=more), layers),
                more,
            )
    return best


def _candidates(
    level: PyramidLevel,
    layers: Compositing,
    moving: tuple[int, ...],
    reach_m: float,
    constraints: MotionConstraints,
) -> list[MotionFit]:
    """Return the best candidates, at least one slide and one rotation if both are allowed."""
    surface = level.surface.only(moving)
    rest = level.surface.only([k for k in np.unique(level.surface.part_ids) if k not in moving])
    motions = candidate_motions(surface, rest, candidate_axes(level.surface.only(moving[:1])))
    if constraints.near is not None:
        motions.append(constraints.near)
    own = symmetry_axis(
        surface, candidate_axes(surface)
    )  # rotating marks look like short slides across the axis
    pairs = [
        coarse_fits(
            motion,
            layers,
            moving,
            reach_m,
            near=own is None or abs(float(motion.axis_o @ own.axis_o)) >= FIT.same_axis_cos,
        )
        for motion in motions
    ]
    fits = rescale_gains([fit for pair in pairs for fit in pair])
    fits = [
        fit
        for kind in ("slide", "turn")
        for fit in _moving([one for one in fits if one.motion.kind == kind], layers)
    ]
    turns = [fit for fit in sorted(fits, key=lambda fit: -fit.score) if fit.motion.kind == "turn"]
    wanted = _distinct([fit for fit in turns if constraints.allows(fit)], layers)[
        : FIT.shifted_candidates
    ]
    near = [_shift_axis(fit, layers, reach_m) for fit in wanted]
    fits = rescale_gains([*fits, *_moving(near, layers)])
    fits.sort(key=lambda fit: -fit.score)
    return _spread([fit for fit in fits if constraints.allows(fit)], FIT.coarse_candidates)


def _moving(fits: Sequence[MotionFit], layers: Compositing) -> list[MotionFit]:
    """Return the fits that move by more than a pixel or two; all if none does.

    A wire that is slightly off is farther from its image than one that is always hidden.
    """
    return [fit for fit in fits if moves(fit, layers)] or list(fits)


def _shift_axis(fit: MotionFit, layers: Compositing, reach_m: float) -> MotionFit:
    """Return the best uniform rotation about an axis beside that of ``fit``.

    A thin part hardly overlaps its image if the axis is off by its thickness.
    """
    best: MotionFit | None = None
    motion = fit.motion
    step = layers.crop.pixel_m(layers.moving.points_o.mean(axis=0))
    for _ in range(FIT.shift_rounds):
        across = perpendicular_axes(motion.axis_o)
        spots = [
            motion.pivot_o + step * (a * across[0] + b * across[1])
            for a in FIT.shift_px
            for b in FIT.shift_px
        ]
        tried = [
            coarse_fits(replace(motion, pivot_o=spot), layers, fit.parts, reach_m)[1]
            for spot in spots
        ]
        found = min(tried, key=lambda one: one.total_cost)
        if best is not None and found.total_cost >= best.total_cost:
            break
        best, motion = found, found.motion
    assert best is not None
    return best


def _distinct(fits: Sequence[MotionFit], layers: Compositing) -> list[MotionFit]:
    """Return ``fits`` without those whose axis is within a pixel of an earlier one."""
    pixel_m = layers.crop.pixel_m(layers.moving.points_o.mean(axis=0))
    found: list[MotionFit] = []
    for fit in fits:
        if all(
            (fit.motion.kind, fit.uniform) != (one.motion.kind, one.uniform)
            or abs(float(fit.motion.axis_o @ one.motion.axis_o)) < SAME_AXIS_COS
            or np.linalg.norm(np.cross(fit.motion.pivot_o - one.motion.pivot_o, one.motion.axis_o))
            > pixel_m
            for one in found
        ):
            found.append(fit)
    return found


def _spread(fits: Sequence[MotionFit], n: int) -> list[MotionFit]:
    """Return the first ``n``, the first of each kind, and the first uniform ones, half as many."""
    kept = list(fits[:n])
    for kind in ("slide", "turn"):
        if all(fit.motion.kind != kind for fit in kept):
            kept += [fit for fit in fits if fit.motion.kind == kind][:1]
    missing = (n + 1) // 2 - sum(fit.uniform for fit in kept)
    return kept + [fit for fit in fits[n:] if fit.uniform and fit not in kept][: max(0, missing)]
