"""Front of a box-like object in an image, and its cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.fitting.box_fit import BoxFit, SizePrior, fit_box
from articulate.reconstruct.fitting.front_parse import (
    FrontCell,
    covered,
    parse_front,
    rectify,
)
from articulate.render.raster import Pixels


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectFront:
    """Fitted box with its front."""

    fit: BoxFit
    image: Pixels
    """Rectified front without legs (H, W, 3)."""
    cells: tuple[FrontCell, ...]
    base_share: float
    """Height of legs or of an open space below the front, as a share of the object's height."""
    visible: float
    """Share of the front that the object covers in the image."""

    @property
    def aspect(self) -> float:
        """Width over height of the front."""
        height, width = self.image.shape[:2]
        return float(width / height)


def find_front(
    image: Pixels, mask: NDArray[np.bool_], prior: SizePrior | None = None
) -> ObjectFront:
    """Fit a box to an object and parse its front.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).
        prior: Expected proportions.
    """
    return front_of(image, mask, fit_box(image, mask, prior))


def front_of(image: Pixels, mask: NDArray[np.bool_], fit: BoxFit) -> ObjectFront:
    """Rectify and parse the front of a fitted box."""
    front = rectify(image, fit.front(), fit.width)
    covered_px = np.repeat(mask[..., None], 3, axis=2).astype(np.uint8) * 255
    rows, columns = covered(rectify(covered_px, fit.front(), fit.width)[..., 0] > 127)
    height, width = front.shape[:2]
    kept = np.ascontiguousarray(front[rows, columns])
    return ObjectFront(
        fit=fit,
        image=kept,
        cells=parse_front(kept),
        base_share=1.0 - rows.stop / height,
        visible=(columns.stop - columns.start) / width * (rows.stop - rows.start) / height,
    )
