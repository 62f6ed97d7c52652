"""Suspects: parts that may be what moves, by where something changes in the picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.compositing import draw
from articulate.reconstruct.actors.geometric.image_pyramid import Look
from articulate.transforms import Ints

IN_PLACE, MOSTLY = 0.8, 0.6
"""Share of what changes that lies within the picture of a part that turns about its own middle; and
within that of one of which little is seen to change, as it hides in what holds it."""
SMALL = 0.05
"""Largest box of such a part, as a share of the object's."""

SPANS = 0.6
"""What changes is at least this share as wide and as high as that part."""


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


def in_place(look: Look, *, whole: bool = True) -> int | None:
    """The part in whose picture at 0 nearly all lies that changes: a wheel, a knob, a cap turns.

    Args:
        look: The clip.
        whole: What changes must reach over most of the part; else the part must be small.
    """
    ids = _seen_ids(look)
    total = max(1, int(look.change.sum()))
    for part in np.unique(ids[ids >= 0]):
        mask = cv2.dilate((ids == part).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
        inside = mask & look.change
        if float(inside.sum()) >= (IN_PLACE if whole else MOSTLY) * total and (
            _spans(look, int(part), inside) if whole else _is_small(look, int(part))
        ):
            return int(part)
    return None


def _spans(look: Look, part: int, inside: NDArray[np.bool_]) -> bool:
    """Whether what changes reaches over most of ``part`` in the picture, seen or not."""
    spots = look.shot.project(look.surface.only([part]).points_o)
    rows, columns = np.nonzero(inside)
    changed = np.array([np.ptp(columns), np.ptp(rows)]) + 1.0
    return bool((changed >= SPANS * np.ptp(spots, axis=0)).all())


def _is_small(look: Look, part: int) -> bool:
    """Whether ``part`` is small beside the object."""
    own, all_ = (np.ptp(s.points_o, axis=0) for s in (look.surface.only([part]), look.surface))
    return bool(np.prod(own) <= SMALL * np.prod(all_))


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
