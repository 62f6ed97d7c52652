"""Posed: from where a clip was taken, found together with what moves in it.

Where a lid sweeps over all of a laptop nothing stands still by which a camera could be found. But
the whole object is known, and it is seen in many frames: under the right camera, and with the right
motion, what is drawn looks like each of them. So the camera is sought together with the positions
of the part, for a few of the motions that its shape suggests, by Gauss and Newton's steps. What is
far off counts at first, on blurred pictures, or nothing would say which way to go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.candidates import Motion
from articulate.reconstruct.actors.geometric.compositing import (
    CAP,
    Drawn,
    draw,
    spread_behind,
    total,
)
from articulate.reconstruct.actors.geometric.crop import Shot, moved, object_box, shot_of
from articulate.reconstruct.actors.geometric.fit import attached, motions_in
from articulate.reconstruct.actors.geometric.image_pyramid import (
    QUICK_FRAMES,
    QUICK_PX,
    Look,
    Scene,
)
from articulate.reconstruct.actors.geometric.kernels import Floats, all_views, face_colours
from articulate.reconstruct.actors.geometric.lighting import solve_light
from articulate.reconstruct.actors.geometric.part_ranking import hidden_parts, rank_parts
from articulate.reconstruct.actors.geometric.search import REACH, Fit, coarse_fits
from articulate.reconstruct.actors.geometric.surface import Surface, surface_of
from articulate.render.camera import Camera
from articulate.render.parts import joint_bounds
from articulate.transforms import Array, Ints, inverse

STEP = np.array([0.06, 0.06, 0.06, 0.02, 0.02, 0.04])
"""How far a camera may be off: turns about the object's middle [rad], where that is seen [tangent],
logarithm of its distance."""
STEP_Q = {"turn": 0.06, "slide": 0.03}
"""The same of a part [rad, m]."""


@dataclass(frozen=True)
class Level:
    """How pictures are compared."""

    most_px: int
    """Longest side of the region [px]."""
    steps: float
    """Steps, as a share of the first."""
    blur_px: float
    cap: float
    """Differences of a pixel count up to this, summed over its colours."""
    rounds: int


FIRST = Level(80, 1.0, 3.0, 400.0, 8)
LEVELS = (Level(80, 0.6, 2.0, 250.0, 6), Level(160, 0.3, 1.5, CAP, 6))
"""From coarse to fine: the first for each motion that is tried, the others for the best."""
FRAMES = 8
"""Frames that are looked at."""
SUSPECTS, HIDDEN = 3, 1
"""Parts whose motions are tried: of those seen where something changes, and of those that hide."""
FEW, MOST = 2, 6
"""Motions that are tried, and at most where none of the first explains the clip well."""
SLOPE = 0.3
"""Differences for slopes, as a share of the steps."""
LEAST_OFF = 6.0
"""Differences below this count as squares, above it as absolute values, 0 to 255."""
DAMPED = 4
"""Times that a step is made shorter."""
SETTLED = 0.002
"""A round that lowers the cost by less than this share is the last."""
HINT, GAIN = 0.05, 0.35
"""Shares by which a camera elsewhere must explain the clip better to be sought finely, and to be
believed: where the right motion is not among those that are tried, a camera a little off may
explain a clip better by a quarter."""
WELL = 5.0
"""Costs below this leave nothing large unexplained."""
CLEAR = 3.0
"""A clip that costs less under the camera that was told needs no other: clips cost 1 to 3 under the
true one, 11 and more under one that is off by 5 degrees where nothing stands still that tells."""
POSITIONS = 48
"""Positions that are tried in each frame."""
PASSES = 2
"""Times that motions are looked for, each under the camera that was found before."""
SAME_COSINE, SAME_M = 0.99, 0.03
"""Axes nearer to each other are one."""


@dataclass(frozen=True, eq=False)
class Posed:
    """Some frames, and the object with one part in motion."""

    shot: Shot
    surface: Surface
    corners: Ints
    """Corners of the surface that move."""
    motion: Motion
    middle_o: Array
    """Middle of the object (3,) [m]."""
    level: Level
    light: Array
    behind: Floats
    """What lies behind the object (H, W, 3)."""

    def seen(self, x: Array, q: float) -> Drawn:
        """The object as a camera ``x`` away sees it with the part at ``q``."""
        points, T_o = self.surface.points_o.copy(), self.motion.T_o(np.asarray(q))
        points[self.corners] = points[self.corners] @ T_o[:3, :3].T + T_o[:3, 3]
        there = replace(self.shot, T_co=moved(self.shot.T_co, self.middle_o, x))
        return draw(replace(self.surface, points_o=points), there)

    def residuals(self, k: int, x: Array, q: float) -> Floats:
        """What frame ``k`` differs from what is drawn (pixels, 3)."""
        seen, model = self.seen(x, q), self.behind.copy()
        solid = seen.face_ids >= 0
        colours = face_colours(seen.points_c, self.surface.faces, self.surface.albedo, self.light)
        model[solid] = colours[seen.face_ids[solid]]
        off = cv2.GaussianBlur(model - self.shot.frames[k], (0, 0), self.level.blur_px)
        return np.asarray(off).reshape(-1, 3)

    def all_residuals(self, x: Array, q: Array) -> list[Floats]:
        """Those of all frames."""
        return [self.residuals(k, x, float(position)) for k, position in enumerate(q)]

    def cost(self, residuals: Sequence[Floats]) -> float:
        """Mean over frames and pixels of the absolute differences, each up to the cap."""
        sums = [np.minimum(total(off), self.level.cap) for off in residuals]
        return float(np.mean([s.mean() for s in sums]))

    def nearest(self, x: Array, q: Array, tried: Array) -> Array:
        """For each frame that of ``tried`` (Q,), or its own of ``q`` (T,), of least cost."""
        best = q.copy()
        for k, position in enumerate(q.tolist()):
            positions = np.append(tried, position)
            costs = [self.cost([self.residuals(k, x, float(value))]) for value in positions]
            best[k] = positions[int(np.argmin(costs))]
        return best

    def fitted(self, x: Array, q: Array) -> Posed:
        """With light and background as they follow from where the object is thought to be."""
        views, albedo, colours, covers = [], [], [], []
        for frame, position in zip(self.shot.frames, q, strict=True):
            seen = self.seen(x, float(position))
            covers.append(seen.face_ids >= 0)
            inner = cv2.erode(covers[-1].astype(np.uint8), np.ones((3, 3))) > 0
            ids = seen.face_ids[inner]
            views.append(all_views(seen.points_c, self.surface.faces)[ids])
            albedo.append(self.surface.albedo[ids])
            colours.append(frame[inner])
        light = solve_light(*(np.concatenate(column) for column in (views, albedo, colours)))
        return replace(self, light=light, behind=_behind(self.shot.frames, np.array(covers)))


def _behind(frames: Floats, covers: NDArray[np.bool_]) -> Floats:
    """Mean colour (H, W, 3) where frames do not show the object, spread to where all do."""
    room = 1 + round(0.04 * max(covers.shape[1:]))
    kernel = np.ones((2 * room + 1, 2 * room + 1))
    free = np.stack([cv2.dilate(c.astype(np.uint8), kernel) == 0 for c in covers])[..., None]
    count = free.sum(axis=0)
    mean = (frames * free).sum(axis=0) / np.maximum(count, 1)
    known = count[..., 0] > 0
    if not known.any():
        return np.full(frames.shape[1:], 255.0, dtype=np.float32)
    return np.where(known[..., None], mean, spread_behind(mean, known)).astype(np.float32)


def camera_of_motion(scene: Scene, least: float = GAIN) -> tuple[Camera, float]:
    """The camera near that of ``scene`` under which the object moves as in the clip.

    Args:
        scene: The clip, and where the camera is thought to be.
        least: Share by which another has to explain the clip better.

    Returns:
        That camera, and by which share what it draws differs less; the camera of ``scene`` and 0
        where no other explains the clip clearly better.
    """
    camera, gain = _camera_once(scene, CLEAR if least >= GAIN else 0.0)
    if gain < least:
        return scene.camera, 0.0
    for _ in range(PASSES - 1):
        again, more = _camera_once(replace(scene, camera=camera), 0.0)
        if more > 0.0:
            camera, gain = again, 1.0 - (1.0 - gain) * (1.0 - more)
    return camera, gain


def _camera_once(scene: Scene, clear: float) -> tuple[Camera, float]:
    """A better camera than that of ``scene``, by the motions that it suggests, and how much.

    None is looked for where one of the first motions costs less than ``clear`` under that camera.
    """
    fits, frames = _motions(scene)
    as_told = [_under_told(scene, fit, frames) for fit in fits[:FEW]]
    if any(told < clear for _, _, told in as_told):
        return scene.camera, 0.0
    best: tuple[float, float, Fit, Array, Array] | None = None
    for n, fit in enumerate(fits):
        if n >= FEW and best is not None and best[0] < WELL:
            if best[0] > (1.0 - HINT) * best[1]:
                return scene.camera, 0.0
            break
        posed, q, told = as_told[n] if n < FEW else _under_told(scene, fit, frames)
        x, q, cost = _sought_far(posed, np.zeros(6), q)
        if best is None or cost < best[0]:
            best = (cost, told, fit, x, q)
    if best is None:
        return scene.camera, 0.0
    _, _, fit, x, q = best
    for level in LEVELS:
        posed = _posed(scene, fit, frames, level, x)
        _, _, told = _sought_far(posed, np.zeros(6), fit.q, turned=False)
        x, q, cost = _sought(posed, x, q)
    gain = max(0.0, 1.0 - cost / max(told, 1e-9))
    return scene.camera.at(inverse(moved(scene.camera.T_cw, posed.middle_o, x))), gain


def _under_told(scene: Scene, fit: Fit, frames: Ints) -> tuple[Posed, Array, float]:
    """The frames, positions of the part that suit the camera that was told, and what they cost."""
    posed = _posed(scene, fit, frames, FIRST, np.zeros(6))
    _, q, told = _sought_far(posed, np.zeros(6), fit.q, turned=False)
    return posed, q, told


def _motions(scene: Scene) -> tuple[list[Fit], Ints]:
    """The motions that explain most under the camera of ``scene``, and frames of their ``q``."""
    look = scene.look(QUICK_PX, QUICK_FRAMES)
    few = np.unique(np.linspace(0, len(look.shot.indices) - 1, FRAMES).round().astype(int))
    ranked = rank_parts(look)
    hidden = [part for part in hidden_parts(look) if part not in ranked]
    fits: list[Fit] = []
    for part in [*ranked[:SUSPECTS], *hidden[:HIDDEN]]:
        fits += _fits(look, part, REACH * scene.size_m)
    fits.sort(key=lambda fit: -fit.worth)
    found = [attached(look, fit, ranked) for fit in _distinct(fits)]
    return [replace(fit, q=fit.q[few]) for fit in found], look.shot.indices[few]


def _fits(look: Look, part: int, reach_m: float) -> list[Fit]:
    layers, motions = look.layers([part]), motions_in(look, part)
    return [fit for motion in motions for fit in coarse_fits(motion, layers, (part,), reach_m)]


def _distinct(fits: Sequence[Fit]) -> list[Fit]:
    """The first of ``fits`` that are not alike; free ones and even ones never are."""
    found: list[Fit] = []
    for fit in fits:
        if not any(_alike(fit, one) for one in found):
            found.append(fit)
        if len(found) == MOST:
            break
    return found


def _alike(a: Fit, b: Fit) -> bool:
    if (a.motion.kind, a.even, a.parts) != (b.motion.kind, b.even, b.parts):
        return False
    if abs(float(a.motion.axis_o @ b.motion.axis_o)) < SAME_COSINE:
        return False
    off = np.cross(a.motion.pivot_o - b.motion.pivot_o, b.motion.axis_o)
    return a.motion.kind == "slide" or float(np.linalg.norm(off)) <= SAME_M


def _posed(scene: Scene, fit: Fit, frames: Ints, level: Level, x: Array) -> Posed:
    """The frames as ``level`` has them, about the object as a camera ``x`` away would see it."""
    middle_o = joint_bounds(scene.parts).mean(axis=0)
    nearby = scene.camera.at(inverse(moved(scene.camera.T_cw, middle_o, x)))
    own, change = object_box(nearby, scene.parts), scene.box
    left, right = min(own[0], change[0]), max(own[1], change[1])
    box = (left, right, min(own[2], change[2]), max(own[3], change[3]))
    shot = shot_of(scene.video, scene.camera, frames, box, level.most_px)
    surface = surface_of(scene.parts, pixel_m=shot.pixel_m(middle_o))
    moving = np.isin(surface.part_ids, list(fit.parts))
    return Posed(
        shot=shot,
        surface=surface,
        corners=np.unique(surface.faces[moving]),
        motion=fit.motion,
        middle_o=middle_o,
        level=level,
        light=np.zeros(0),
        behind=np.zeros(0, dtype=np.float32),
    )


def _sought(posed: Posed, x: Array, q: Array, *, turned: bool = True) -> tuple[Array, Array, float]:
    """The camera and positions of least cost near ``x`` and ``q``, and that cost.

    Gauss and Newton's steps with weights for absolute differences, damped as by Levenberg and
    Marquardt where they do not lower the cost.

    Args:
        posed: The frames.
        x: Where the camera is thought to be (6,).
        q: Where the part is thought to be (T,).
        turned: Whether the camera is sought; without, the positions alone are.
    """
    posed = posed.fitted(x, q)
    off = posed.all_residuals(x, q)
    cost, damping = posed.cost(off), 0.1
    step = posed.level.steps * STEP * turned
    step_q = posed.level.steps * STEP_Q[posed.motion.kind]
    for _ in range(posed.level.rounds):
        normal, force = _equations(posed, x, q, off, step, step_q)
        diagonal = np.diag(np.diag(normal) + 1e-6 * np.trace(normal) / len(normal) + 1e-12)
        before = cost
        for _ in range(DAMPED):
            change = np.linalg.solve(normal + damping * diagonal, force)
            x_next, q_next = x - step * change[:6], q - step_q * change[6:]
            tried = posed.all_residuals(x_next, q_next)
            if posed.cost(tried) < cost:
                x, q, cost, damping = x_next, q_next, posed.cost(tried), 0.2 * damping
                break
            damping *= 6.0
        if before - cost < SETTLED * before:
            break
        posed = posed.fitted(x, q)
        off = posed.all_residuals(x, q)
        cost = posed.cost(off)
    return x, q, cost


def _sought_far(
    posed: Posed, x: Array, q: Array, *, turned: bool = True
) -> tuple[Array, Array, float]:
    """As :func:`_sought`; where much is left, positions far from ``q`` are tried too.

    A path that was found under another camera may be wrong by half a turn in some frames, from
    where no steps lead back.
    """
    found = _sought(posed, x, q, turned=turned)
    if found[2] <= WELL:
        return found
    near, there = posed.fitted(*found[:2]), found[1]
    far = near.nearest(found[0], there, _tried(posed.motion, there))
    return min(found, _sought(posed, found[0], far, turned=turned), key=lambda one: one[2])


def _tried(motion: Motion, q: Array) -> Array:
    """Positions that are tried in each frame: a full turn, or twice as far as ``q`` (T,) goes."""
    if motion.kind == "turn":
        return np.arange(POSITIONS, dtype=np.float64) * (2.0 * np.pi / POSITIONS)
    reach = 2.0 * float(np.abs(q).max())
    return np.asarray(np.linspace(-reach, reach, POSITIONS))


def _equations(
    posed: Posed, x: Array, q: Array, off: Sequence[Floats], step: Array, step_q: float
) -> tuple[Array, Array]:
    """Normal matrix (6 + T, 6 + T) and right side (6 + T,), in steps of camera and positions."""
    n = 6 + len(q)
    normal, force = np.zeros((n, n)), np.zeros(n)
    own = [a for a in range(6) if step[a] > 0.0]
    for k, position in enumerate(q.tolist()):
        size = total(off[k])
        weight = np.repeat((size < posed.level.cap) / np.maximum(size, LEAST_OFF), 3)
        rows = [_slope(posed, k, x, position, SLOPE * step * (np.arange(6) == a)) for a in own]
        rows.append(_slope(posed, k, x, position, np.zeros(6), SLOPE * step_q))
        slopes = np.stack(rows).astype(np.float64)
        where = [*own, 6 + k]
        normal[np.ix_(where, where)] += (slopes * weight) @ slopes.T
        force[where] += (slopes * weight) @ off[k].ravel()
    return normal, force


def _slope(posed: Posed, k: int, x: Array, q: float, dx: Array, dq: float = 0.0) -> Floats:
    """What a whole step changes in the residuals of frame ``k`` (3 pixels,)."""
    change = posed.residuals(k, x + dx, q + dq) - posed.residuals(k, x - dx, q - dq)
    return np.asarray(0.5 / SLOPE * change.ravel())
