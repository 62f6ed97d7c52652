"""Calibrate: from where a clip was really taken, and a clip as if the camera had stood still.

The camera that a person tells stands a little elsewhere, and one that is held in a hand moves.
Both are found from what does not move: a picture of the object at rest is drawn under cameras near
the one that was told and compared with the clip, and the motion that most of a picture shares is
taken away.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.compositing import CAP, draw, plain_behind, total
from articulate.reconstruct.actors.geometric.crop import (
    Shot,
    change_map,
    moved,
    object_box,
    shot_of,
)
from articulate.reconstruct.actors.geometric.image_pyramid import scene_of
from articulate.reconstruct.actors.geometric.joint_camera_fit import (
    DAMPED,
    HINT,
    LEAST_OFF,
    STEP,
    camera_of_motion,
)
from articulate.reconstruct.actors.geometric.joint_camera_fit import GAIN as GAIN_OF_MOTION
from articulate.reconstruct.actors.geometric.kernels import Floats, face_colours
from articulate.reconstruct.actors.geometric.lighting import fit_light
from articulate.reconstruct.actors.geometric.surface import Surface, surface_of
from articulate.reconstruct.actors.protocol import Evidence, Pixels, TraceStep
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, inverse
from articulate.video.moving_region import camera_motion
from articulate.video.tracks import Tracking, follow_points

LEVELS_PX = (80, 160, 240)
"""Longest side of the object in pixels, from coarse to fine."""
TRIES = 96
"""Cameras that are drawn at random on the coarsest level, the best of which are refined."""
KEPT = 3
ROUNDS = 8
"""Steps of a refinement."""
SLOPE = 0.1
"""Differences for slopes, as a share of the steps of a level."""
SOFT_PX = 1.0
"""Pictures are blurred by this before they are compared [px]."""
FINER = 0.35
"""Steps of a level, as a share of those of the level before."""
GAIN = 0.08
"""A camera elsewhere must explain what does not move better by this share: a search that begins at
the true one gains a little by fitting what the model of the object lacks."""
UNSURE = 0.12
"""So far from where the object is thought to be seen, as a share of its size, there may be object
instead of background."""
FEWEST_PX = 400
"""Fewer pixels of the object that do not change say nothing of the camera [coarsest level]."""
EDGE = 24.0
"""Change of brightness from pixel to pixel from which on motion would show, 0 to 255."""
STRAYS = 10.0
"""The camera may move where such pixels stray from their middle value by this, 0 to 255."""
STEADIER = 0.7
"""It did move if they stray by less than this share of that once its motion is taken away."""


@dataclass(frozen=True, eq=False)
class Still:
    """What does not move in a clip, on one level."""

    shot: Shot
    """One frame: the middle of all."""
    surface: Surface
    mask: NDArray[np.bool_]
    """Pixels that are compared (H, W)."""
    behind: Floats
    """What lies behind the object (H, W, 3)."""
    middle_o: Array
    """Middle of the object (3,) [m]."""

    def shot_from(self, x: Array) -> Shot:
        """The same frame, as if taken by a camera ``x`` away."""
        return replace(self.shot, T_co=moved(self.shot.T_co, self.middle_o, x))

    def residuals(self, x: Array, light: Array) -> Floats:
        """What the picture differs from that of a camera ``x`` away, (N, 3) of pixels compared."""
        shot = self.shot_from(x)
        seen = draw(self.surface, shot)
        solid = seen.face_ids >= 0
        model = self.behind.copy()
        colours = face_colours(seen.points_c, self.surface.faces, self.surface.albedo, light)
        model[solid] = colours[seen.face_ids[solid]]
        off = cv2.GaussianBlur(model - shot.frames[0], (0, 0), SOFT_PX)
        return np.asarray(off[self.mask])

    def cost(self, x: Array, light: Array) -> float:
        """Sum of the absolute differences of colours, at most ``CAP``, a mean over pixels."""
        return _cost(self.residuals(x, light))


def _cost(residuals: Floats) -> float:
    return float(np.minimum(total(residuals), CAP).mean())


def refined_camera(
    clip: Pixels, camera: Camera, parts: Sequence[PartMesh], *, seed: int = 0
) -> tuple[Camera, float]:
    """The camera near ``camera`` under which what does not move looks as in the clip.

    Args:
        clip: (T, H, W, 3).
        camera: The one that was told.
        parts: The object at 0.
        seed: Of the cameras that are tried.

    Returns:
        That camera, and by which share what it draws differs less; ``camera`` itself and 0 where
        no other explains the clip clearly better, or too little of the object stands still.
    """
    still = _still(clip, camera, parts, LEVELS_PX[0])
    inside = draw(still.surface, still.shot).face_ids >= 0
    if (inside & still.mask).sum() < FEWEST_PX:
        return camera, 0.0
    rng = np.random.default_rng(seed)
    light = _light(still, np.zeros(6))
    drawn = STEP * rng.uniform(-1.5, 1.5, (TRIES, 6))
    costs = [still.cost(x, light) for x in drawn]
    starts = [np.zeros(6), *drawn[np.argsort(costs)[:KEPT]]]
    found = [_lowest(still, x, STEP) for x in starts]
    x = min(found, key=lambda item: item[1])[0]
    step = STEP
    for most_px in LEVELS_PX[1:]:
        step = FINER * step
        nearby = camera.at(inverse(moved(camera.T_cw, still.middle_o, x)))
        still = _still(clip, camera, parts, most_px, seen_by=nearby)
        x, _ = _lowest(still, x, step)
    told = still.cost(np.zeros(6), _light(still, np.zeros(6)))
    here = still.cost(x, _light(still, x))
    gain = 1.0 - here / max(told, 1e-9)
    if gain < GAIN:
        return camera, 0.0
    return camera.at(inverse(moved(camera.T_cw, still.middle_o, x))), gain


def _light(still: Still, x: Array) -> Array:
    return fit_light(still.shot_from(x), still.surface, ~still.mask)


def _lowest(still: Still, x: Array, step: Array) -> tuple[Array, float]:
    """The camera of least cost about ``x``.

    Gauss and Newton's steps with weights for absolute differences, damped as by Levenberg and
    Marquardt where they do not lower the cost; slopes are differences over a tenth of ``step``, as
    pictures are not smooth.
    """
    light = _light(still, x)
    off = still.residuals(x, light)
    cost, damping = _cost(off), 0.1
    for _ in range(ROUNDS):
        slopes = _slopes(still, x, SLOPE * step, light) / SLOPE
        size = total(off)
        weight = np.repeat((size < CAP) / np.maximum(size, LEAST_OFF), 3)
        normal = (slopes * weight) @ slopes.T
        force = (slopes * weight) @ off.ravel()
        diagonal = np.diag(np.diag(normal) + 1e-9 * np.trace(normal) + 1e-12)
        for _ in range(DAMPED):
            there = x - step * np.linalg.solve(normal + damping * diagonal, force)
            tried = still.residuals(there, light)
            if _cost(tried) < cost:
                x, off, cost, damping = there, tried, _cost(tried), 0.2 * damping
                break
            damping *= 6.0
        else:
            break
        light = _light(still, x)
        off = still.residuals(x, light)
        cost = _cost(off)
    return x, cost


def _slopes(still: Still, x: Array, step: Array, light: Array) -> Array:
    """Half of what each step to both sides of ``x`` changes in the residuals (6, 3 N)."""
    rows = [still.residuals(x + dx, light) - still.residuals(x - dx, light) for dx in np.diag(step)]
    return 0.5 * np.stack(rows).astype(np.float64).reshape(len(rows), -1)


def _still(
    clip: Pixels,
    camera: Camera,
    parts: Sequence[PartMesh],
    most_px: int,
    *,
    seen_by: Camera | None = None,
) -> Still:
    """The region about the object, as ``seen_by`` has it, in ``most_px`` pixels."""
    change = change_map(clip)
    middle_frame = np.median(clip[:: max(1, len(clip) // 16)], axis=0)
    box = object_box(seen_by or camera, parts)
    picture: Pixels = middle_frame.astype(np.uint8)[None]
    shot = shot_of(picture, camera, np.array([0]), box, most_px)
    left, right, top, bottom = box
    height, width = shot.size
    moving = cv2.dilate(change.astype(np.uint8), np.ones((5, 5)))[top:bottom, left:right]
    piece = cv2.resize(moving.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
    middle_o = joint_bounds(parts).mean(axis=0)
    surface = surface_of(parts, pixel_m=shot.pixel_m(middle_o))
    mask = np.asarray(piece < 0.1)
    near = shot if seen_by is None else replace(shot, T_co=seen_by.T_cw)
    solid = (draw(surface, near).face_ids >= 0).astype(np.uint8)
    room = 1 + round(most_px * (UNSURE if seen_by is None else FINER**2 * UNSURE))
    unsure = cv2.dilate(solid, np.ones((2 * room + 1, 2 * room + 1))) > 0
    return Still(shot, surface, mask, plain_behind(shot, unsure, ~mask), middle_o)


def steadied(clip: Pixels, box: tuple[int, int, int, int]) -> tuple[Pixels, float]:
    """The clip (T, H, W, 3) as if the camera had only stood where it stood first.

    Its motion is that of what is seen beside the object, since before a plain wall a camera that
    moves looks like an object that does: there it is thought to stand still.

    Args:
        clip: (T, H, W, 3).
        box: Where the object is: first column, column after the last, first row, row after the
            last.

    Returns:
        The clip and the largest shift of a picture's corner [px]; the same clip and 0 where the
        camera seems to stand still.
    """
    grey = cv2.cvtColor(np.ascontiguousarray(clip[0]), cv2.COLOR_RGB2GRAY).astype(np.float32)
    slope = np.hypot(cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1)) / 4.0
    beside = np.ones(grey.shape, dtype=np.bool_)
    beside[box[2] : box[3], box[0] : box[1]] = False
    edges = beside & (slope > EDGE)
    if edges.sum() < FEWEST_PX or _spread(clip, edges) < STRAYS:
        return clip, 0.0
    tracks = follow_points(clip, Tracking(most_points=600, spacing_px=8), beside)
    motion = camera_motion(tracks)
    height, width = clip.shape[1:3]
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], dtype=float)
    shifted = np.einsum("tij,nj->tni", motion, corners)
    shift = np.linalg.norm(shifted[..., :2] / shifted[..., 2:] - corners[:, :2], axis=-1)
    steady = np.empty_like(clip)
    for frame, H, out in zip(clip, motion, steady, strict=True):
        frame = np.ascontiguousarray(frame)
        out[:] = cv2.warpPerspective(frame, H, (width, height), borderMode=cv2.BORDER_REPLICATE)
    if _spread(steady, edges) > STEADIER * _spread(clip, edges):
        return clip, 0.0
    return steady, float(shift.max())


def _spread(clip: Pixels, where: NDArray[np.bool_]) -> float:
    """Median over pixels of how far a pixel strays from its middle value."""
    if not where.any():
        return 0.0
    values = clip[:: max(1, len(clip) // 16), where].astype(np.float32)
    return float(np.median(np.abs(values - np.median(values, axis=0)).mean(axis=(0, 2))))


def calibrated(evidence: Evidence) -> tuple[Evidence, tuple[TraceStep, ...]]:
    """``evidence`` with its clip steadied and its camera refined, and what was done about them."""
    clip, camera = evidence.video, evidence.camera
    if clip is None or camera is None or len(clip) < 2 or not evidence.parts or not evidence.placed:
        return evidence, ()
    start = time.monotonic()
    steady, shift_px = steadied(clip, object_box(camera, evidence.parts))
    still, gain = refined_camera(steady, camera, evidence.parts, seed=evidence.seed)
    scene, better, moving = scene_of(steady, still, evidence.parts), still, 0.0
    if scene.change.any():  # one that is known to be off may be off by more
        better, moving = camera_of_motion(scene, HINT if gain else GAIN_OF_MOTION)
    if not shift_px and not gain and not moving:
        return evidence, ()
    told = better.T_wc[:3, 3] - camera.T_wc[:3, 3]
    step = TraceStep(
        title="where the camera stood",
        text="the camera was found anew from what does not move, and from what does",
        figures={
            "shake_px": shift_px,
            "explains_better": gain,
            "explains_motion_better": moving,
            "moved_m": float(np.linalg.norm(told)),
        },
        seconds=time.monotonic() - start,
    )
    return replace(evidence, video=steady, camera=better), (step,)
