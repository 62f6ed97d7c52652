"""Fit: which part of a known object moves in a clip, and how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.actors.geometric.candidates import (
    Motion,
    axes_of,
    contact_points,
    motions_of,
    plane_of,
    sample,
)
from articulate.actors.geometric.layers import CAP, Layers, draw, layers_of
from articulate.actors.geometric.light import fit_light, solve_light, still_samples
from articulate.actors.geometric.refine import Freedom, refine
from articulate.actors.geometric.round import round_axis
from articulate.actors.geometric.search import (
    Fit,
    coarse_fit,
    coarse_fits,
    on_one_scale,
    path_again,
    position_unit,
    turned_path,
    with_gain,
    without_jumps,
)
from articulate.actors.geometric.shot import LARGEST_ENLARGEMENT, Shot, change_map, shot_of
from articulate.actors.geometric.surface import Surface, surface_of
from articulate.actors.geometric.sweep import SAME_DEPTH, all_views
from articulate.actors.protocol import Pixels
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

QUICK_PX, QUICK_FRAMES = 72, 8
COARSE_PX, COARSE_FRAMES = 112, 12
FINE_PX, FINE_FRAMES = 224, 14
"""Longest side of the region [px] and number of frames: to choose the part, to choose among
candidates, and to refine."""
MOST_FRAMES = 40
"""Most frames that are looked at while searching: small regions allow more."""
SUSPECTS, HIDDEN = 6, 3
"""Parts that are tried: of those that are seen where something changes, and of those that hide."""
SEEDS = 3
"""Suspects of which it is asked what moves along."""
LIGHT_ROUNDS = 2
"""Times that the light is learned from what moves before candidates are compared."""
NUDGED, NUDGE_ROUNDS = 3, 3
"""Candidates whose axis is moved, and how often."""
NUDGES = [(a, b) for a in (-2.0, -1.0, 0.0, 1.0, 2.0) for b in (-2.0, -1.0, 0.0, 1.0, 2.0)]
"""By so much, across the axis, in pixels."""
KEPT = 8
"""Candidates that are refined coarsely."""
FINAL = 3
"""Candidates that are refined finely."""
WITHOUT_JUMPS = 1.05
"""A path that does not jump may cost this share of one that does."""
ANOTHER_WAY = 0.97
"""Share of its price below which a motion, once all frames are seen, is another than the one that
was refined."""
LEAST_MOTION_PX = 2.0
"""What moves less does not explain a clip in which something changes."""
SAME_WISH = 0.97
"""Cosine of the angle between axes that count as the same when one is not wanted again."""
TILTS, TILT_COS, SAME_TURN = 3, float(np.cos(0.45)), float(np.cos(0.02))
"""Axes near that of the best turn that are tried: most of them, cosines of how far off they are and
of how near two are one."""
SHOWS_WELL, AS_GOOD_ROUND = 0.06, 0.5
"""Below the first share of the largest cost, a turn of a round part about its own axis is taken
that gains the second share of what the best motion gains."""
SHOWS = 0.006
"""Share of the largest cost of a part's pixels below which its motion hardly shows."""
ENDLESS_RAD = 2.0 * np.pi + 0.5
"""What an endless turn is said to make in a clip in which nothing shows."""
SNAP = 0.01
"""Share of the gain that an axis along one of the object's directions may cost."""
TILT_GAIN = 0.03
"""Share of the gain that a turn about an axis of what moves, or what it touches, may cost."""
HINGE_GAIN = 0.04
"""A hinge must explain more than a slide by this share of what is explained at all."""
REACH = 0.5
"""Farthest a slide goes, as a share of the object's size."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip and the object in it."""

    clip: Pixels
    camera: Camera
    parts: tuple[PartMesh, ...]
    change: NDArray[np.bool_]
    box: tuple[int, int, int, int]

    @property
    def size_m(self) -> float:
        """Diagonal of the object [m]."""
        points = np.concatenate([p.bounds for p in self.parts])
        return float(np.linalg.norm(np.ptp(points, axis=0)))

    def look(self, most_px: int, n_frames: int, frames: Ints | None = None) -> Look:
        """The region in which something changes."""
        if frames is None:
            n_frames = max(n_frames, min(MOST_FRAMES, self._affordable(most_px, n_frames)))
            frames = np.unique(np.linspace(0, len(self.clip) - 1, n_frames).round().astype(int))
        shot = shot_of(self.clip, self.camera, frames, self.box, most_px)
        left, right, top, bottom = self.box
        height, width = shot.size
        piece = cv2.resize(
            self.change[top:bottom, left:right].astype(np.float32),
            (width, height),
            interpolation=cv2.INTER_AREA,
        )
        middle = np.mean([p.centre for p in self.parts], axis=0)
        surface = surface_of(self.parts, pixel_m=shot.pixel_m(middle))
        change = np.asarray(piece > 0.25)
        return Look(shot, surface, change, fit_light(shot, surface, change))

    def _affordable(self, most_px: int, n_frames: int) -> int:
        """Number of frames that take as long as ``n_frames`` of ``most_px`` squared would."""
        left, right, top, bottom = self.box
        factor = min(LARGEST_ENLARGEMENT, most_px / max(right - left, bottom - top))
        area = (right - left) * (bottom - top) * factor**2
        return int(n_frames * most_px**2 / max(area, 1.0))


@dataclass(frozen=True, eq=False)
class Look:
    """A shot with the object as coarse as it is."""

    shot: Shot
    surface: Surface
    change: NDArray[np.bool_]
    light: Array

    def layers(self, moving: Sequence[int]) -> Layers:
        """With the parts ``moving`` taken out."""
        return layers_of(self.shot, self.surface, moving, self.light, self.change)


def scene_of(clip: Pixels, camera: Camera, parts: Sequence[PartMesh]) -> Scene:
    """The scene; its box is the whole picture if nothing changes in it."""
    change = change_map(clip)
    rows, columns = np.nonzero(change)
    height, width = change.shape
    if not len(rows):
        return Scene(clip, camera, tuple(parts), change, (0, width, 0, height))
    left, right = np.percentile(columns, (0.2, 99.8))
    top, bottom = np.percentile(rows, (0.2, 99.8))
    margin = 6 + 0.12 * max(right - left, bottom - top)
    box = (
        max(0, int(left - margin)),
        min(width, int(right + margin) + 1),
        max(0, int(top - margin)),
        min(height, int(bottom + margin) + 1),
    )
    return Scene(clip, camera, tuple(parts), change, box)


@dataclass(frozen=True)
class Wish:
    """What is asked of a motion, after a critic has spoken."""

    kind: Literal["slide", "turn"] | None = None
    """Only such; None: either."""
    not_axes: tuple[tuple[float, float, float], ...] = ()
    """Directions that are not wanted again."""
    not_parts: tuple[int, ...] = ()
    """Parts that are not thought to lead the motion."""
    part: int | None = None
    """The part that leads it; None: whichever does."""
    near: Motion | None = None
    """Only motions like this one; None: any."""
    near_m: float = 0.0
    """How far from the axis of ``near`` that of a turn may lie [m]."""

    def allows(self, fit: Fit) -> bool:
        """Whether ``fit`` is what is asked for."""
        if self.kind is not None and fit.motion.kind != self.kind:
            return False
        if self.near is not None and not self._is_near(fit.motion, self.near):
            return False
        near = (abs(float(fit.motion.axis_o @ np.asarray(axis))) for axis in self.not_axes)
        return all(value < SAME_WISH for value in near)

    def _is_near(self, motion: Motion, wanted: Motion) -> bool:
        if motion.kind != wanted.kind or abs(float(motion.axis_o @ wanted.axis_o)) < SAME_WISH:
            return False
        off = np.cross(motion.pivot_o - wanted.pivot_o, wanted.axis_o)
        return motion.kind == "slide" or float(np.linalg.norm(off)) <= self.near_m


def find_motion(scene: Scene, wish: Wish | None = None) -> Fit | None:
    """The motion that explains the clip best.

    None if no part is in the region that changes, or none does what is asked.
    """
    wish = wish or Wish()
    quick = scene.look(QUICK_PX, QUICK_FRAMES)
    ranked = [part for part in rank_parts(quick) if part not in wish.not_parts]
    hidden = [part for part in hidden_parts(quick) if part not in (*ranked, *wish.not_parts)]
    suspects = [*ranked[:SUSPECTS], *hidden[:HIDDEN]] if wish.part is None else [wish.part]
    ranked += hidden[:HIDDEN]
    if not ranked:
        return None
    reach = REACH * scene.size_m
    firsts = [_quick_fit(quick, part, reach) for part in suspects]
    firsts.sort(key=lambda fit: -fit.worth)
    seeds = [_attached(quick, fit, ranked) for fit in firsts[:SEEDS]]
    seed = max(seeds, key=lambda fit: fit.worth)
    for _ in range(LIGHT_ROUNDS):
        quick = replace(quick, light=better_light(quick, seed, quick.shot))
        seed = _attached(quick, _quick_fit(quick, seed.parts[0], reach), ranked)
    moving = seed.parts
    coarse = replace(scene.look(COARSE_PX, COARSE_FRAMES), light=quick.light)
    layers = coarse.layers(moving)
    fits = _candidates(coarse, layers, moving, reach, wish)
    if not fits:
        return None
    coarse = replace(coarse, light=better_light(coarse, fits[0], coarse.shot))
    layers = coarse.layers(moving)
    fits = on_one_scale([_tightened(fit, layers) for fit in fits])
    fits.sort(key=lambda fit: -fit.worth)
    fine = replace(scene.look(FINE_PX, FINE_FRAMES), light=coarse.light)
    fine = replace(fine, light=better_light(fine, fits[0], coarse.shot))
    layers = fine.layers(moving)
    finals = [_finished(fit, layers, coarse.shot, fine.shot) for fit in _spread(fits, FINAL)]
    best = _chosen(finals)
    best = _or_tilted(best, layers, fine)
    best = _everywhere(scene, best, fine)
    return _round_or_not(scene, fine, best)


def _everywhere(scene: Scene, fit: Fit, fine: Look) -> Fit:
    """``fit`` with its position in every frame of the clip.

    A turn is also sought anew on the full circle: wheels look alike after a fraction of a turn,
    so that only frames close to each other tell which way they go.
    """
    look = replace(scene.look(FINE_PX, 0, np.arange(len(scene.clip))), light=fine.light)
    layers = look.layers(fit.parts)
    start = replace(fit, q=np.interp(look.shot.indices, fine.shot.indices, fit.q))
    tries = [start, path_again(start, layers, 1.5 * position_unit(start.motion, layers))]
    if fit.motion.kind == "turn":
        tries.append(turned_path(start, layers))
    fixed = Freedom(axis=False, pivot=False)
    refined = [refine(one, layers, fixed, rounds=3) for one in tries]
    best = min(refined, key=lambda fit: fit.price)
    if best.price < ANOTHER_WAY * refined[0].price:
        best = refine(best, layers, Freedom(axis=False))
        again = path_again(best, layers, 1.5 * position_unit(best.motion, layers))
        best = min((best, refine(again, layers, Freedom(), rounds=4)), key=lambda one: one.price)
    if fit.motion.kind == "turn" and (q := without_jumps(best.q)) is not best.q:
        smooth = refine(replace(best, q=q), layers, fixed, rounds=3)
        best = smooth if smooth.price <= WITHOUT_JUMPS * best.price else best
    return with_gain(best, layers)


def _round_or_not(scene: Scene, fine: Look, fit: Fit) -> Fit:
    """``fit``, or a turn of a round part about its own axis.

    Such a turn shows little, so that what explains a little more is no better; where next to
    nothing shows, it is said to be endless.
    """
    surface = fine.surface.only(fit.parts[:1])
    layers = fine.layers(fit.parts)
    share = fit.gain / (CAP * len(fit.q) * max(1, layers.own_px))
    motion = round_axis(surface, axes_of(surface)) if share <= SHOWS_WELL else None
    if motion is None:
        return fit
    if share <= SHOWS:
        return replace(fit, motion=motion, q=np.linspace(0.0, ENDLESS_RAD, len(fit.q)), gain=0.0)
    if fit.motion.kind == "slide":
        return fit
    start = Fit(motion, np.zeros(len(fine.shot.frames)), 0.0, fit.parts)
    turning = _everywhere(scene, start, fine)
    return turning if turning.gain >= AS_GOOD_ROUND * fit.gain else fit


def _tightened(fit: Fit, layers: Layers) -> Fit:
    """``fit`` with its path sought again and its pivot refined."""
    again = path_again(fit, layers, 2.0 * position_unit(fit.motion, layers))
    return with_gain(refine(again, layers, Freedom(axis=False), rounds=5), layers)


def roundest(scene: Scene) -> Fit | None:
    """An endless turn of the smallest round part that is seen, where nothing shows in the clip."""
    height, width = scene.clip.shape[1:3]
    look = replace(scene, box=(0, width, 0, height)).look(COARSE_PX * 2, 2)
    seen = draw(look.surface, look.shot)
    visible = np.unique(look.surface.part_ids[seen.face_ids[seen.face_ids >= 0]])
    found: list[tuple[float, int, Motion]] = []
    for part in visible:
        surface = look.surface.only([int(part)])
        motion = round_axis(surface, axes_of(surface))
        if motion is not None:
            size = float(np.linalg.norm(np.ptp(surface.points_o, axis=0)))
            found.append((size, int(part), motion))
    if not found:
        return None
    _, part, motion = min(found, key=lambda item: item[0])
    return Fit(motion, np.linspace(0.0, ENDLESS_RAD, len(scene.clip)), 0.0, (part,))


def rank_parts(look: Look) -> list[int]:
    """Parts by how much changes where they are, most first; those with nothing left out."""
    ids = _seen_ids(look)
    total = max(1, int(look.change.sum()))
    scores: list[tuple[float, int]] = []
    for part in np.unique(look.surface.part_ids):
        mask = cv2.dilate((ids == part).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        mask = mask if mask.any() else _alone(look, int(part))
        inside = float((mask & look.change).sum())
        if inside > 0:
            scores.append((inside / total * np.sqrt(inside / float(mask.sum())), int(part)))
    return [part for _, part in sorted(scores, reverse=True)]


def hidden_parts(look: Look) -> list[int]:
    """Parts that cannot be seen at 0, by how near they are to what changes, nearest first.

    A rack in an oven or a drawer under a table top shows only once it is out, beside where it was.
    """
    ids = _seen_ids(look)
    off_px = cv2.distanceTransform((~look.change).astype(np.uint8), cv2.DIST_L2, 3)
    found = []
    for part in np.unique(look.surface.part_ids):
        mask = _alone(look, int(part))
        if mask.any() and not (ids == part).any():
            found.append((float(off_px[mask].min()), int(part)))
    return [part for _, part in sorted(found)]


def _seen_ids(look: Look) -> Ints:
    """The part that each pixel shows at 0, -1 where none."""
    seen = draw(look.surface, look.shot)
    return np.where(seen.face_ids >= 0, look.surface.part_ids[seen.face_ids], -1)


def _alone(look: Look, part: int) -> NDArray[np.bool_]:
    """Where ``part`` would be seen if nothing else were there."""
    return np.asarray(draw(look.surface.only([part]), look.shot).face_ids >= 0)


def _quick_fit(look: Look, part: int, reach_m: float) -> Fit:
    layers = look.layers([part])
    surface = look.surface.only([part])
    rest = look.surface.only([k for k in np.unique(look.surface.part_ids) if k != part])
    motions = motions_of(surface, rest, axes_of(surface)[:3])
    return max(
        (coarse_fit(motion, layers, (part,), reach_m) for motion in motions),
        key=lambda fit: fit.worth,
    )


def _attached(look: Look, seed: Fit, others: Sequence[int]) -> Fit:
    """``seed`` with the parts that move as it does, itself first."""
    T_o = seed.motion.T_o(seed.q)
    best = seed
    cost = float(look.layers(seed.parts).path_cost(T_o).sum())
    for part in others:
        if part in best.parts:
            continue
        layers = look.layers((*best.parts, part))
        more = float(layers.path_cost(T_o).sum())
        if more < cost - 0.01 * max(seed.gain, 0.0):
            best, cost = (
                with_gain(replace(seed, parts=(*best.parts, part), cost=more), layers),
                more,
            )
    return best


def _candidates(
    look: Look, layers: Layers, moving: tuple[int, ...], reach_m: float, wish: Wish
) -> list[Fit]:
    """The best candidates, at least one slide and one turn if both are allowed."""
    surface = look.surface.only(moving)
    rest = look.surface.only([k for k in np.unique(look.surface.part_ids) if k not in moving])
    motions = motions_of(surface, rest, axes_of(look.surface.only(moving[:1])))
    if wish.near is not None:
        motions.append(wish.near)
    pairs = [coarse_fits(motion, layers, moving, reach_m) for motion in motions]
    fits = on_one_scale([fit for pair in pairs for fit in pair])
    fits = [fit for fit in fits if _moves(fit, layers)] or fits
    turns = [fit for fit in sorted(fits, key=lambda fit: -fit.worth) if fit.motion.kind == "turn"]
    wanted = _of_each_axis([fit for fit in turns if wish.allows(fit)])[:NUDGED]
    near = [_nudged(fit, layers, reach_m) for fit in wanted]
    fits = on_one_scale([*fits, *(fit for fit in near if _moves(fit, layers))])
    fits.sort(key=lambda fit: -fit.worth)
    return _spread([fit for fit in fits if wish.allows(fit)], KEPT)


def _moves(fit: Fit, layers: Layers) -> bool:
    """Whether more than a pixel or two of motion is said: something changes in the clip.

    A wire that is a little off is farther from its picture than one that hides all the time.
    """
    return float(np.ptp(fit.q)) >= LEAST_MOTION_PX * position_unit(fit.motion, layers)


def _of_each_axis(fits: Sequence[Fit]) -> list[Fit]:
    """The first of ``fits`` about each direction."""
    found: list[Fit] = []
    for fit in fits:
        if all(abs(float(fit.motion.axis_o @ one.motion.axis_o)) < SAME_TURN for one in found):
            found.append(fit)
    return found


def _nudged(fit: Fit, layers: Layers, reach_m: float) -> Fit:
    """The best even turn about an axis beside that of ``fit``.

    A thin part hardly meets its picture anywhere if the axis is off by its thickness.
    """
    best: Fit | None = None
    motion = fit.motion
    step = layers.shot.pixel_m(layers.moving.points_o.mean(axis=0))
    for _ in range(NUDGE_ROUNDS):
        across = plane_of(motion.axis_o)
        spots = [motion.pivot_o + step * (a * across[0] + b * across[1]) for a, b in NUDGES]
        tried = [
            coarse_fits(replace(motion, pivot_o=spot), layers, fit.parts, reach_m)[1]
            for spot in spots
        ]
        found = min(tried, key=lambda one: one.price)
        if best is not None and found.price >= best.price:
            break
        best, motion = found, found.motion
    assert best is not None
    return best


def _spread(fits: Sequence[Fit], n: int) -> list[Fit]:
    """The first ``n``, the first of each kind, and the first even ones, half as many."""
    kept = list(fits[:n])
    for kind in ("slide", "turn"):
        if all(fit.motion.kind != kind for fit in kept):
            kept += [fit for fit in fits if fit.motion.kind == kind][:1]
    missing = (n + 1) // 2 - sum(fit.even for fit in kept)
    return kept + [fit for fit in fits[n:] if fit.even and fit not in kept][: max(0, missing)]


def _or_tilted(fit: Fit, layers: Layers, fine: Look) -> Fit:
    """``fit``, or the best turn about an axis near its own that explains as much."""
    tilted = [_finished(one, layers, fine.shot, fine.shot) for one in _tilted(fit, fine)]
    before, *after = on_one_scale([fit, *tilted])
    best = max(after, key=lambda one: one.gain, default=before)
    return best if best.gain >= (1.0 - TILT_GAIN) * before.gain else fit


def _tilted(fit: Fit, look: Look) -> list[Fit]:
    """A turn about other axes near its own that the moved parts or what they touch have.

    A knob on a sloping front turns about an axis that is tilted as the front is, and what is told
    by its picture is caught half way.
    """
    if fit.motion.kind == "slide":
        return []
    axis, surface = fit.motion.axis_o, look.surface.only(fit.parts)
    others = [k for k in np.unique(look.surface.part_ids) if k not in fit.parts]
    shapes = [look.surface.only([k]) for k in fit.parts]
    samples = sample(surface)
    shapes += [
        s for k in others if len(contact_points(samples, s := look.surface.only([k]), surface))
    ]
    axes: list[tuple[str, Array]] = []
    for shape in shapes:
        for source, other in axes_of(shape):
            cosine = float(other @ axis)
            near = TILT_COS <= abs(cosine) < SAME_TURN
            if near and all(abs(float(other @ one)) < SAME_TURN for _, one in axes):
                axes.append((source, other * np.sign(cosine)))
    middle = surface.points_o.mean(axis=0)
    pivot = fit.motion.pivot_o + axis * float((middle - fit.motion.pivot_o) @ axis)
    return [
        replace(fit, motion=Motion("turn", other, pivot, f"{source}, tilted"))
        for source, other in axes[:TILTS]
    ]


def better_light(look: Look, fit: Fit, shot: Shot) -> Array:
    """The light, from what stands still and from what moves where ``fit`` says that it is."""
    layers = look.layers(fit.parts)
    still = look.surface.only([k for k in np.unique(look.surface.part_ids) if k not in fit.parts])
    q = np.interp(look.shot.indices, shot.indices, fit.q)
    groups = []
    if len(still.faces):
        groups.append(still_samples(look.shot, still, look.change))
    for t, T_o in enumerate(fit.motion.T_o(q)):
        seen = draw(layers.moving, look.shot, T_o)
        near = cv2.erode((seen.face_ids >= 0).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        mask = near & (seen.nearness * SAME_DEPTH >= layers.nearness)
        ids = seen.face_ids[mask]
        views = all_views(seen.points_c, layers.moving.faces)[ids]
        groups.append((views, layers.moving.albedo[ids], look.shot.frames[t][mask]))
    views, albedo, colours = (np.concatenate(column) for column in zip(*groups, strict=True))
    return solve_light(views, albedo, colours)


def _finished(fit: Fit, layers: Layers, before: Shot, shot: Shot) -> Fit:
    """``fit`` refined in a finer shot, its axis snapped back where that costs nothing."""
    start = replace(fit, q=np.interp(shot.indices, before.indices, fit.q))
    start = path_again(start, layers, 1.5 * position_unit(start.motion, layers))
    bound = refine(start, layers, Freedom(axis=False))
    again = path_again(bound, layers, 1.5 * position_unit(bound.motion, layers))
    if again.price < bound.price:
        bound = refine(again, layers, Freedom(axis=False), rounds=4)
    free = refine(bound, layers, Freedom())
    bound, free = on_one_scale([with_gain(bound, layers), with_gain(free, layers)])
    return bound if bound.gain >= (1.0 - SNAP) * free.gain else free


def _chosen(fits: Sequence[Fit]) -> Fit:
    """The one that gains most, slides being preferred."""
    fits = on_one_scale(fits)
    best = max(fits, key=lambda fit: fit.worth)
    slides = [fit for fit in fits if fit.motion.kind == "slide"]
    if slides and best.motion.kind == "turn":
        slide = max(slides, key=lambda fit: fit.worth)
        if slide.worth >= (1.0 - HINGE_GAIN) * best.worth:
            return slide
    return best
