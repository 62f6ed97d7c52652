"""Front of a box-like object in an image, and its parts."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.fitting.box_fit import BoxFit, SizePrior, fit_box
from articulate.reconstruct.fitting.front_network import FrontPart, find_parts, front_square
from articulate.render.raster import Pixels
from articulate.transforms import Array

FRONT_PX = 256
"""Longest side of the rectified front [px]."""
MIN_COVERED = 0.7
"""Share of a row that a front covers at least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectFront:
    """Fitted box with its front."""

    fit: BoxFit
    image: Pixels
    """Rectified front (H, W, 3)."""
    parts: tuple[FrontPart, ...]
    base_share: float
    """Height of legs or of an open space below the front, as a share of the object's height."""
    visible: float
    """Share of the front that the object covers in the image."""


def find_front(
    image: Pixels, mask: NDArray[np.bool_], prior: SizePrior | None = None
) -> ObjectFront:
    """Fit a box to an object and find the parts of its front.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).
        prior: Expected proportions.
    """
    return front_of(image, mask, fit_box(image, mask, prior))


def front_of(image: Pixels, mask: NDArray[np.bool_], fit: BoxFit) -> ObjectFront:
    """Rectify the front of a fitted box and find its parts."""
    covered_px = np.repeat(mask[..., None], 3, axis=2).astype(np.uint8) * 255
    inside = rectify(covered_px, fit.front(), fit.width)[..., 0] > 127
    rows, columns = covered(inside)
    height, width = inside.shape
    return ObjectFront(
        fit=fit,
        image=rectify(image, fit.front(), fit.width),
        parts=find_parts(front_square(image, fit.front())[0], fit.width),
        base_share=1.0 - rows.stop / height,
        visible=(columns.stop - columns.start) / width * (rows.stop - rows.start) / height,
    )


def rectify(image: Pixels, corners: Array, aspect: float) -> Pixels:
    """Return the front (H, W, 3) seen straight on, with ``aspect`` of width to height.

    Args:
        image: Colours (H, W, 3).
        corners: Corners in the image (4, 2) [px], from top left clockwise.
        aspect: Width over height.
    """
    width = max(24, round(FRONT_PX * min(1.0, aspect)))
    height = max(24, round(FRONT_PX * min(1.0, 1.0 / aspect)))
    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32) - 0.5
    H = cv2.getPerspectiveTransform(corners.astype(np.float32), target)
    return np.asarray(cv2.warpPerspective(image, H, (width, height), flags=cv2.INTER_LINEAR))


def covered(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and columns of a rectified mask (H, W), boolean, that the object covers.

    Legs leave the lower rows mostly empty.
    """
    out = []
    for axis in (1, 0):
        lines = np.flatnonzero(mask.mean(axis=axis) >= MIN_COVERED)
        all_lines = slice(0, mask.shape[1 - axis])
        out.append(slice(int(lines[0]), int(lines[-1]) + 1) if len(lines) else all_lines)
    return out[0], out[1]
