"""Fit: which part of a known object moves in a clip, and how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from articulate.reconstruct.actors.geometric.candidates import (
    Motion,
    axes_of,
    motions_of,
    plane_of,
)
from articulate.reconstruct.actors.geometric.compositing import Layers
from articulate.reconstruct.actors.geometric.gauss_newton import Freedom, refine
from articulate.reconstruct.actors.geometric.image_pyramid import (
    COARSE_FRAMES,
    COARSE_PX,
    FINE_FRAMES,
    FINE_PX,
    QUICK_FRAMES,
    QUICK_PX,
    Look,
    Scene,
    better_light,
)
from articulate.reconstruct.actors.geometric.part_ranking import hidden_parts, in_place, rank_parts
from articulate.reconstruct.actors.geometric.refine_motion import (
    SAME_TURN,
    chosen,
    everywhere,
    finished,
    or_tilted,
    round_or_not,
    spinning,
)
from articulate.reconstruct.actors.geometric.rotational_symmetry import round_axis
from articulate.reconstruct.actors.geometric.search import (
    REACH,
    Fit,
    coarse_fit,
    coarse_fits,
    moves,
    on_one_scale,
    path_again,
    position_unit,
    with_gain,
)

SUSPECTS, HIDDEN = 6, 3
"""Parts that are tried: of those that are seen where something changes, and of those that hide."""
BULKY = 0.25
"""By this share of its gain a part that is as large as the object has to explain more."""
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
SAME_WISH = 0.97
"""Cosine of the angle between axes that count as the same when one is not wanted again."""
IN_SIGHT = 0.25
"""A slide, or a hinge across the axis of a round part, that explains this share of what it costs
that nothing moves is seen. Knobs and wheels of the data set have 0.17 at most, two drawers
that were taken for knobs 0.37 and 0.64, a door 0.31."""


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
    spun = _spun(scene, quick, ranked) if wish.part is None else None
    if spun is not None and wish.allows(spun):
        return spun
    reach = REACH * scene.size_m
    firsts = [_quick_fit(quick, part, reach) for part in suspects]
    firsts.sort(key=lambda fit: -fit.worth)
    seeds = [attached(quick, fit, ranked) for fit in firsts[:SEEDS]]
    seed = max(seeds, key=lambda fit: fit.worth * (1.0 - BULKY * _bulk(quick, fit)))
    for _ in range(LIGHT_ROUNDS):
        quick = replace(quick, light=better_light(quick, seed, quick.shot))
        seed = attached(quick, _quick_fit(quick, seed.parts[0], reach), ranked)
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
    fits = _spread(_distinct(fits, layers), FINAL)
    finals = [finished(fit, layers, coarse.shot, fine.shot) for fit in fits]
    wholes: list[Fit] = []
    for fit in [chosen(finals), *sorted(finals, key=lambda fit: -fit.worth)]:
        wholes.append(_whole(scene, fine, layers, fit, wish))
        if moves(wholes[-1], layers):
            return wholes[-1]
    # What the model gets wrong may make it cheapest to hide a part all the time.
    return _last(scene, quick, wish) or wholes[0]


def _whole(scene: Scene, fine: Look, layers: Layers, fit: Fit, wish: Wish) -> Fit:
    """``fit``, its axis sought near by, in every frame of the clip."""
    whole = everywhere(scene, or_tilted(fit, layers, fine), fine)
    rounded = round_or_not(scene, fine, whole)
    return rounded if wish.allows(rounded) else whole


def _last(scene: Scene, quick: Look, wish: Wish) -> Fit | None:
    """A turn of the round part in whose picture all changes lie, whatever its marks tell."""
    part = in_place(quick, whole=False) if wish.part is None else None
    spun = None if part is None or part in wish.not_parts else spinning(scene, part)
    return spun if spun is not None and wish.allows(spun) else None


def _spun(scene: Scene, quick: Look, ranked: Sequence[int]) -> Fit | None:
    """The turn of a part in its own picture, all over it, or in some of it if its marks tell so."""
    part = in_place(quick)
    if part is not None:
        return spinning(scene, part) if part in ranked else None
    part = in_place(quick, whole=False)
    if part is None or part not in ranked or leaves_in_sight(quick, part, REACH * scene.size_m):
        return None
    return spinning(scene, part, marked=True)


def _tightened(fit: Fit, layers: Layers) -> Fit:
    """``fit`` with its path sought again and its pivot refined."""
    again = path_again(fit, layers, 2.0 * position_unit(fit.motion, layers))
    return with_gain(refine(again, layers, Freedom(axis=False), rounds=5), layers)


def leaves_in_sight(look: Look, part: int, reach_m: float) -> bool:
    """Whether a motion out of its place explains so much that ``part`` does not turn in it.

    A square drawer that begins half open is nearly round, and so is a square door; all that changes
    may lie where it is. A hinge is one about another axis than that about which it is round.
    """
    surface = look.surface.only([part])
    round_ = round_axis(surface, axes_of(surface))
    own = np.zeros(3) if round_ is None else round_.axis_o
    return any(
        fit.share >= IN_SIGHT
        and (fit.motion.kind == "slide" or abs(float(fit.motion.axis_o @ own)) < SAME_WISH)
        for fit in _quick_fits(look, part, reach_m)
    )


def _quick_fit(look: Look, part: int, reach_m: float) -> Fit:
    return max(_quick_fits(look, part, reach_m), key=lambda fit: fit.worth)


def _quick_fits(look: Look, part: int, reach_m: float) -> list[Fit]:
    layers = look.layers([part])
    return [coarse_fit(motion, layers, (part,), reach_m) for motion in motions_in(look, part)]


def motions_in(look: Look, part: int) -> list[Motion]:
    """The motions of ``part`` along and about the axes of the frame."""
    surface = look.surface.only([part])
    rest = look.surface.only([k for k in np.unique(look.surface.part_ids) if k != part])
    return motions_of(surface, rest, axes_of(surface)[:3])


def _bulk(look: Look, fit: Fit) -> float:
    """Volume of the box around the part that leads ``fit`` over that around the object."""
    size = np.ptp(look.surface.only(fit.parts[:1]).points_o, axis=0)
    return float(np.prod(size) / max(float(np.prod(np.ptp(look.surface.points_o, axis=0))), 1e-12))


def attached(look: Look, seed: Fit, others: Sequence[int]) -> Fit:
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
    own = round_axis(surface, axes_of(surface))  # marks that turn look like short slides across it
    pairs = [
        coarse_fits(
            motion,
            layers,
            moving,
            reach_m,
            near=own is None or abs(float(motion.axis_o @ own.axis_o)) >= SAME_WISH,
        )
        for motion in motions
    ]
    fits = on_one_scale([fit for pair in pairs for fit in pair])
    fits = [
        fit
        for kind in ("slide", "turn")
        for fit in _moving([one for one in fits if one.motion.kind == kind], layers)
    ]
    turns = [fit for fit in sorted(fits, key=lambda fit: -fit.worth) if fit.motion.kind == "turn"]
    wanted = _distinct([fit for fit in turns if wish.allows(fit)], layers)[:NUDGED]
    near = [_nudged(fit, layers, reach_m) for fit in wanted]
    fits = on_one_scale([*fits, *_moving(near, layers)])
    fits.sort(key=lambda fit: -fit.worth)
    return _spread([fit for fit in fits if wish.allows(fit)], KEPT)


def _moving(fits: Sequence[Fit], layers: Layers) -> list[Fit]:
    """Those in which something moves by more than a pixel or two; all where nothing does.

    A wire that is a little off is farther from its picture than one that hides all the time.
    """
    return [fit for fit in fits if moves(fit, layers)] or list(fits)


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


def _distinct(fits: Sequence[Fit], layers: Layers) -> list[Fit]:
    """``fits`` without those that are about the same axis as one before, within a pixel."""
    pixel_m = layers.shot.pixel_m(layers.moving.points_o.mean(axis=0))
    found: list[Fit] = []
    for fit in fits:
        if all(
            (fit.motion.kind, fit.even) != (one.motion.kind, one.even)
            or abs(float(fit.motion.axis_o @ one.motion.axis_o)) < SAME_TURN
            or np.linalg.norm(np.cross(fit.motion.pivot_o - one.motion.pivot_o, one.motion.axis_o))
            > pixel_m
            for one in found
        ):
            found.append(fit)
    return found


def _spread(fits: Sequence[Fit], n: int) -> list[Fit]:
    """The first ``n``, the first of each kind, and the first even ones, half as many."""
    kept = list(fits[:n])
    for kind in ("slide", "turn"):
        if all(fit.motion.kind != kind for fit in kept):
            kept += [fit for fit in fits if fit.motion.kind == kind][:1]
    missing = (n + 1) // 2 - sum(fit.even for fit in kept)
    return kept + [fit for fit in fits[n:] if fit.even and fit not in kept][: max(0, missing)]
