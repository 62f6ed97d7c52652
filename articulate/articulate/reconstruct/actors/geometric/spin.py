"""Spin: how far a round part turned about its own axis, told by the marks on it alone.

What turns in its own picture shows no edge that moves, and what is known of its looks may be wrong
by more than it shows. So its own picture is compared with itself: each pixel's mean over the clip
is taken off, which is the shape and the light, and what is left are marks that go round. Laid out
around the axis, turned back by the right motion, they fall on each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.candidates import Motion, plane_of
from articulate.reconstruct.actors.geometric.compositing import draw
from articulate.reconstruct.actors.geometric.image_pyramid import FINE_PX, Look, Scene
from articulate.transforms import Array, Ints

MOST_PIXELS, FEWEST_PIXELS = 2000, 6
"""Pixels of the part that are looked at, at most; fewer than the second tell nothing."""
BINS = 96
"""Marks are laid out in so many places around the axis."""
RING_PX = 1.5
"""Rings about the axis are so wide [px]."""
LEAST_RAD, MOST_RAD, STEP_RAD, FINE_RAD = 0.3, 7.5, 0.1, 0.02
"""Even turns that are tried: from, to, how far apart, and how far apart near the best."""
CLEAR = 0.15
"""The best turn has to explain this share more of what the usual one leaves unexplained."""
AS_GOOD = 0.25
"""A whole turn and more is taken where it is worse by this share of that advantage at most."""
BESIDE_RAD, SHARP, NEARLY_ALL = 0.6, 0.6, 0.8
"""So far beside the best turn others may keep the second share of its advantage, if it does not
explain the third of what changes: blurred marks, or a shape that is not quite round, tell that it
turns and not how far."""
MARGIN_PX = 8
"""Margin around a part that is looked at [px]."""
WHOLE_RAD = 2.0 * np.pi + 0.25
"""Turns of this or more have no limits: many limited ones have nearly a full turn [rad]."""


@dataclass(frozen=True, eq=False)
class Marks:
    """What changes in the picture of a part, around an axis."""

    angle: Array
    """Place of each pixel around the axis (P,) [rad]."""
    ring: Ints
    """Number of the ring that it is in (P,)."""
    change: Array
    """Its colour in each frame less the mean over frames (T, P, 3), 0 to 255."""

    @property
    def strength(self) -> float:
        """Standard deviation of what changes, 0 to 255."""
        return float(self.change.std())

    def explained(self, end_rad: float) -> float:
        """Share of what changes that an even turn by ``end_rad`` explains."""
        frames, pixels, _ = self.change.shape
        turned = self.angle - np.linspace(0.0, end_rad, frames)[:, None]
        place = np.floor(turned / (2.0 * np.pi) * BINS).astype(np.int64) % BINS
        key = (self.ring * BINS + place).ravel()
        count = np.maximum(np.bincount(key), 1)
        sums = [
            np.bincount(key, weights=self.change[..., k].reshape(frames * pixels)) for k in range(3)
        ]
        return float(sum(((s * s) / count).sum() for s in sums) / (self.change**2).sum())


@dataclass(frozen=True)
class Spin:
    """The even turn that explains the marks best."""

    end_rad: float
    """How far it goes in the clip, positive about the axis."""
    clear: bool
    """Whether it explains them much better than other turns do."""
    sharp: bool
    """Whether it does so than turns that are little shorter or longer, or makes a whole turn."""

    @property
    def whole(self) -> bool:
        """Whether it goes round and farther."""
        return abs(self.end_rad) >= WHOLE_RAD


def marks_of(scene: Scene, part: int, motion: Motion) -> Marks | None:
    """What changes in the picture of ``part``, around the axis of ``motion``.

    None if too little of the part is seen at rest.
    """
    look = scene.look(FINE_PX, 0, np.arange(len(scene.video)))
    mask, points_o = _seen(look, part)
    if len(points_o) < FEWEST_PIXELS:
        return None
    kept = np.unique(np.linspace(0, len(points_o) - 1, MOST_PIXELS).astype(np.int64))
    rows, columns = (index[kept] for index in np.nonzero(mask))
    arm = points_o[kept] - motion.pivot_o
    x, y = plane_of(motion.axis_o) @ arm.T
    width = RING_PX * look.shot.pixel_m(points_o.mean(axis=0))
    profile = np.stack([arm @ motion.axis_o, np.hypot(x, y)], axis=1)
    _, ring = np.unique(np.round(profile / width), axis=0, return_inverse=True)
    colours = look.shot.frames[:, rows, columns].astype(np.float64)
    return Marks(np.arctan2(y, x), ring.reshape(-1), colours - colours.mean(axis=0))


def spin_of(marks: Marks) -> Spin | None:
    """The even turn that explains ``marks``; None where nothing changes."""
    if marks.strength == 0.0:
        return None
    one_way = np.arange(LEAST_RAD, MOST_RAD, STEP_RAD)
    ends = np.concatenate([-one_way[::-1], one_way])
    shares = np.array([marks.explained(float(end)) for end in ends])
    usual = float(np.median(shares))
    best = _refined(marks, float(ends[np.argmax(shares)]))
    advantage = marks.explained(best) - usual
    whole = np.abs(ends) >= WHOLE_RAD
    near = float(shares[whole].max()) >= usual + (1.0 - AS_GOOD) * advantage
    end = float(ends[whole][np.argmax(shares[whole])]) if near else best
    beside = max(marks.explained(best - BESIDE_RAD), marks.explained(best + BESIDE_RAD))
    return Spin(
        end_rad=end,
        clear=advantage >= CLEAR * (1.0 - usual),
        sharp=near or beside <= usual + SHARP * advantage or usual + advantage >= NEARLY_ALL,
    )


def clear_spin(scene: Scene, look: Look, part: int, motion: Motion) -> Spin | None:
    """How far ``part`` turned about the axis of ``motion``; None where no marks tell clearly.

    Args:
        scene: The clip and the object.
        look: One of it.
        part: What turns.
        motion: About which axis it is round.
    """
    marks = marks_of(around(scene, look, part), part, motion)
    spin = None if marks is None else spin_of(marks)
    return spin if spin is not None and spin.clear else None


def _refined(marks: Marks, end_rad: float) -> float:
    near = end_rad + np.arange(-STEP_RAD, STEP_RAD + FINE_RAD / 2.0, FINE_RAD)
    return float(max(near, key=lambda end: marks.explained(float(end))))


def _seen(look: Look, part: int) -> tuple[NDArray[np.bool_], Array]:
    """Where ``part`` is seen at rest (H, W), and which of its points (P, 3) [m] are there."""
    seen = draw(look.surface, look.shot)
    ids = np.where(seen.face_ids >= 0, look.surface.part_ids[seen.face_ids], -1)
    mask = ids == part
    rows, columns = np.nonzero(mask)
    depth = 1.0 / seen.nearness[mask].astype(np.float64)
    spots = np.stack([columns, rows], axis=1)
    rays = (spots - look.shot.pinhole[2:]) / look.shot.pinhole[:2]
    points_c = np.column_stack([rays * depth[:, None], depth])
    R, t = look.shot.T_co[:3, :3], look.shot.T_co[:3, 3]
    return mask, (points_c - t) @ R


def around(scene: Scene, look: Look, part: int) -> Scene:
    """``scene`` with the box around ``part`` at rest; ``look`` is one of it."""
    left, right, top, bottom = scene.box
    enlarged = look.shot.size[1] / (right - left)
    spots = look.shot.project(look.surface.only([part]).points_o) / enlarged + (left, top)
    low = np.floor(spots.min(axis=0)).astype(int) - MARGIN_PX
    high = np.ceil(spots.max(axis=0)).astype(int) + MARGIN_PX
    height, width = scene.video.shape[1:3]
    (left, top), (right, bottom) = np.maximum(low, 0), np.minimum(high, (width, height))
    return replace(scene, box=(int(left), int(right), int(top), int(bottom)))
