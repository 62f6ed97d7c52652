"""Finish: a motion that was found, refined: its axis, its path in every frame, round parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.actors.geometric.candidates import (
    Motion,
    axes_of,
    contact_points,
    sample,
)
from articulate.reconstruct.actors.geometric.compositing import CAP, Layers, draw
from articulate.reconstruct.actors.geometric.crop import Shot
from articulate.reconstruct.actors.geometric.gauss_newton import Freedom, refine
from articulate.reconstruct.actors.geometric.image_pyramid import (
    FINE_FRAMES,
    FINE_PX,
    Look,
    Scene,
    better_light,
)
from articulate.reconstruct.actors.geometric.rotational_symmetry import round_axis
from articulate.reconstruct.actors.geometric.search import (
    JUMP_STEPS,
    REACH,
    Fit,
    coarse_fits,
    on_one_scale,
    path_again,
    position_unit,
    turned_paths,
    with_gain,
    without_jumps,
)
from articulate.reconstruct.actors.geometric.spin import around, clear_spin, marks_of
from articulate.transforms import Array

EVEN_GAIN = 0.9
"""An even motion of what spins is taken that gains this share of what one gains that is not."""
JUMP_PX = 8.0
"""A slide leaps that makes so much more than its usual step, as one does that hides at first."""
WITHOUT_JUMPS = 1.05
"""A path that does not jump may cost this share of one that does."""
ANOTHER_WAY = 0.97
"""Share of its price below which a motion, once all frames are seen, is another than the one that
was refined."""
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
OFFSETS = 72
"""Places at which a turn that is told by marks may begin."""
STANDS_OUT, LEAST_STRENGTH = 3.0, 0.2
"""A part changes more than others that changes this many times as much as the usual one, and by
more than the second, 0 to 255."""
SNAP = 0.01
"""Share of the gain that an axis along one of the object's directions may cost."""
TILT_GAIN = 0.03
"""Share of the gain that a turn about an axis of what moves, or what it touches, may cost."""
FAINT = 0.02
"""Share of what it costs that nothing moves, from which on a faint motion of a round part is
believed. Slides along its axis have 0.05 and more where levers of a toaster come down by six
pixels, 0 for 19 of 20 knobs and wheels, and 0.03 for one whose turn has 0.14."""
HINGE_GAIN = 0.04
"""A hinge must explain more than a slide by this share of what is explained at all."""


def finished(fit: Fit, layers: Layers, before: Shot, shot: Shot) -> Fit:
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


def chosen(fits: Sequence[Fit]) -> Fit:
    """The one that gains most, slides being preferred."""
    fits = on_one_scale(fits)
    best = max(fits, key=lambda fit: fit.worth)
    slides = [fit for fit in fits if fit.motion.kind == "slide"]
    if slides and best.motion.kind == "turn":
        slide = max(slides, key=lambda fit: fit.worth)
        if slide.worth >= (1.0 - HINGE_GAIN) * best.worth:
            return slide
    return best


def or_tilted(fit: Fit, layers: Layers, fine: Look) -> Fit:
    """``fit``, or the best turn about an axis near its own that explains as much."""
    tilted = [finished(one, layers, fine.shot, fine.shot) for one in _tilted(fit, fine)]
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


def everywhere(scene: Scene, fit: Fit, fine: Look, *, spins: bool = False) -> Fit:
    """``fit`` with its position in every frame of the clip.

    Args:
        scene: The clip and the object.
        fit: What was found in some of its frames.
        fine: Where from: its frames, and the light.
        spins: Whether an even motion is preferred.

    A turn is also sought anew on the full circle: wheels look alike after a fraction of a turn,
    so that only frames close to each other tell which way they go.
    """
    look = _every_frame(scene, fine)
    layers = look.layers(fit.parts)
    start = replace(fit, q=np.interp(look.shot.indices, fine.shot.indices, fit.q))
    step = 1.5 * position_unit(start.motion, layers)
    tries = [start, path_again(start, layers, step)]
    if fit.motion.kind == "turn":
        tries.extend(turned_paths(start, layers))
    fixed = Freedom(axis=False, pivot=False)
    refined = [refine(one, layers, fixed, rounds=3) for one in tries]
    best = min(refined, key=lambda one: one.price)
    best = _or_even(best, refined, layers) if spins else best
    if best.price < ANOTHER_WAY * refined[0].price:
        best = refine(best, layers, Freedom(axis=False))
        again = path_again(best, layers, 1.5 * position_unit(best.motion, layers))
        best = min((best, refine(again, layers, Freedom(), rounds=4)), key=lambda one: one.price)
    whole = _without_jumps(best, layers)
    if whole is not best:
        whole = refine(whole, layers, fixed, rounds=3)
        best = whole if whole.price <= WITHOUT_JUMPS * best.price else best
    return with_gain(best, layers)


def _or_even(best: Fit, fits: Sequence[Fit], layers: Layers) -> Fit:
    """``best``, or the cheapest even one of ``fits`` if it explains about as much.

    What looks the same after a small turn may as well go to and fro.
    """
    even = min((fit for fit in fits if fit.even), key=lambda fit: fit.price, default=best)
    if even is best:
        return best
    before, after = on_one_scale([with_gain(best, layers), with_gain(even, layers)])
    return after if after.gain >= EVEN_GAIN * before.gain else best


def _without_jumps(fit: Fit, layers: Layers) -> Fit:
    """``fit`` with a path on which nothing leaps; itself where its own is one."""
    if fit.motion.kind == "turn":
        q = without_jumps(fit.q)
        return fit if q is fit.q else replace(fit, q=q)
    unit, steps = position_unit(fit.motion, layers), np.abs(np.diff(fit.q))
    if steps.max() <= JUMP_STEPS * float(np.median(steps)) + JUMP_PX * unit:
        return fit
    return path_again(replace(fit, even=True), layers, 1.5 * unit)


def round_or_not(scene: Scene, fine: Look, fit: Fit) -> Fit:
    """``fit``, or a turn of a round part about its own axis.

    Such a turn shows little, so that what explains a little more is no better; where next to
    nothing shows, see :func:`_faint`.
    """
    surface = fine.surface.only(fit.parts[:1])
    layers = fine.layers(fit.parts)
    share = fit.gain / (CAP * len(fit.q) * max(1, layers.own_px))
    motion = round_axis(surface, axes_of(surface)) if share <= SHOWS_WELL else None
    if motion is None:
        return fit
    told = by_its_marks(scene, fine, motion, fit.parts)
    if told is not None:
        return told
    if share <= SHOWS:
        return _faint(scene, motion, fit.parts)
    if fit.motion.kind == "slide":
        return fit
    start = Fit(motion, np.zeros(len(fine.shot.frames)), 0.0, fit.parts)
    turning = everywhere(scene, start, fine)
    return turning if turning.gain >= AS_GOOD_ROUND * fit.gain else fit


def _faint(scene: Scene, motion: Motion, parts: tuple[int, ...]) -> Fit:
    """What a round part does of which next to nothing shows: pressed like a button, or turned.

    Whichever explains more, turned about the axis near by about which most is explained; and
    turned without end about its own where neither explains a little.
    """
    fine = scene.look(FINE_PX, FINE_FRAMES)  # a light learnt from a wrong motion explains it away
    layers = fine.layers(parts)
    slide = replace(motion, kind="slide", source="along which it is round")
    found = [*coarse_fits(slide, layers, parts, REACH * scene.size_m, near=True)]
    way = np.linspace(0.0, ENDLESS_RAD, len(scene.video))
    for q in (way[fine.shot.indices], -way[fine.shot.indices]):
        turn = refine(_even(motion, q, parts, layers), layers, Freedom(axis=False)).motion
        found.append(_even(turn, q, parts, layers))
    best = max((with_gain(fit, layers) for fit in found), key=lambda fit: fit.share)
    if best.share < FAINT:
        return replace(best, motion=motion, q=way, gain=0.0)
    if best.motion.kind == "slide":
        return everywhere(scene, best, fine)
    layers = _every_frame(scene, fine).layers(parts)
    return with_gain(_even(best.motion, np.copysign(way, best.q[-1]), parts, layers), layers)


def spinning(scene: Scene, part: int, *, marked: bool = False) -> Fit | None:
    """A turn of ``part`` about the axis about which it is round.

    None if it is about none, and if only ``marked`` turns are asked for and marks tell none.
    """
    fine = scene.look(FINE_PX, FINE_FRAMES)
    surface = fine.surface.only([part])
    motion = round_axis(surface, axes_of(surface))
    if motion is None:
        return None
    start = Fit(motion, np.zeros(len(fine.shot.frames)), 0.0, (part,))
    fine = replace(fine, light=better_light(fine, start, fine.shot))
    told = by_its_marks(scene, fine, motion, (part,), blurred=marked)
    if told is not None or marked:
        return told
    return round_or_not(scene, fine, everywhere(scene, start, fine, spins=True))


def by_its_marks(
    scene: Scene, fine: Look, motion: Motion, parts: tuple[int, ...], *, blurred: bool = False
) -> Fit | None:
    """The even turn of a round part that the marks on it tell; None where they tell none clearly.

    They tell how far, and the model of the object from where: of some places the cheapest is taken.

    Args:
        scene: The clip and the object.
        fine: One of its looks, whose light is used.
        motion: The axis about which it is round.
        parts: What turns, itself first.
        blurred: Whether a turn of which marks do not tell how far is taken to be endless.
    """
    spin = clear_spin(scene, fine, parts[0], motion)
    if spin is None or not (spin.sharp or blurred):
        return None
    end_rad = spin.end_rad if spin.sharp else float(np.copysign(ENDLESS_RAD, spin.end_rad))
    layers = _every_frame(scene, fine).layers(parts)
    way = np.linspace(0.0, end_rad, len(scene.video))
    starts = np.linspace(0.0, 2.0 * np.pi, OFFSETS, endpoint=False)
    even = [_even(motion, way + start, parts, layers) for start in starts]
    return with_gain(min(even, key=lambda fit: fit.cost), layers)


def _every_frame(scene: Scene, fine: Look) -> Look:
    """All frames of the clip as finely as ``fine`` looks at some, under its light."""
    return replace(scene.look(FINE_PX, 0, np.arange(len(scene.video))), light=fine.light)


def _even(motion: Motion, q: Array, parts: tuple[int, ...], layers: Layers) -> Fit:
    """``parts`` moved to even positions ``q`` (T,) in the frames of ``layers``, and its cost."""
    cost = float(layers.path_cost(motion.T_o(q)).sum())
    return Fit(motion, q, cost, parts, even=True)


def roundest(scene: Scene) -> Fit | None:
    """An endless turn of the round part that changes most, where next to nothing shows in the clip.

    The smallest that is seen where none changes more than others.
    """
    height, width = scene.video.shape[1:3]
    scene = replace(scene, box=(0, width, 0, height))
    look = scene.look(max(height, width), 2)
    seen = draw(look.surface, look.shot)
    visible = np.unique(look.surface.part_ids[seen.face_ids[seen.face_ids >= 0]])
    found: list[tuple[float, float, int, Motion]] = []
    for part in visible:
        surface = look.surface.only([int(part)])
        motion = round_axis(surface, axes_of(surface))
        if motion is not None:
            marks = marks_of(around(scene, look, int(part)), int(part), motion)
            size = float(np.linalg.norm(np.ptp(surface.points_o, axis=0)))
            found.append((0.0 if marks is None else marks.strength, size, int(part), motion))
    if not found:
        return None
    usual = float(np.median([strength for strength, *_ in found]))
    marked = [one for one in found if one[0] > max(STANDS_OUT * usual, LEAST_STRENGTH)]
    if marked:
        _, _, part, motion = max(marked, key=lambda one: one[0])
    else:
        _, _, part, motion = min(found, key=lambda one: one[1])
    return Fit(motion, np.linspace(0.0, ENDLESS_RAD, len(scene.video)), 0.0, (part,))
