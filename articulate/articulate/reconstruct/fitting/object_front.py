"""Front of a box-like object in an image: which visible side it is, and its cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.fitting.box_fit import BoxFit, SizePrior, fit_box, turned
from articulate.reconstruct.fitting.front_parse import (
    FrontCell,
    covered,
    edge_maps,
    find_handles,
    parse_front,
    rectify,
)
from articulate.render.raster import Pixels

SWAP_AZIMUTH_RAD = 0.45
"""Beyond this azimuth the other visible side may be the front [rad]."""
BORDER = 0.08
"""Border of a side that is ignored where contents are compared, as a share."""
NEAR_COST = 0.15
"""Optima up to this cost above the least are compared by their fronts."""
COST, ALIGNED = 6.0, 2.0
"""Weights of the cost of the fit, and of the share of edges parallel to the sides."""
ALIGNED_TAN = 0.07
"""Tangent of the largest angle between an edge and a side to which it is parallel."""
HANDLE_CONTENT, EDGE_CONTENT, AZIMUTH_CONTENT = 0.5, 6.0, 0.4
"""Weights of the number of handles, of the share of edges, and of the azimuth [1/rad]."""
MOST_HANDLES = 4


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
    image: Pixels, mask: NDArray[np.bool_], prior: SizePrior | None = None, seed: int = 0
) -> ObjectFront:
    """Fit a box to an object and parse its front.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).
        prior: Expected proportions.
        seed: Seed of the fit.
    """
    fits = fit_box(image, mask, prior, seed)
    fits = [fit for fit in fits if fit.cost < fits[0].cost + NEAR_COST]
    turns = [turned(fit) for fit in fits if abs(fit.parameters["azimuth"]) > SWAP_AZIMUTH_RAD]
    best = max([*fits, *turns], key=lambda fit: _content(image, fit) - COST * fit.cost)
    return front_of(image, mask, best)


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


def _content(image: Pixels, fit: BoxFit) -> float:
    """Return how much a side of the box looks like a front: handles and lines."""
    front = rectify(image, fit.front(), fit.width)
    height, width = front.shape[:2]
    y, x = max(2, int(BORDER * height)), max(2, int(BORDER * width))
    inner = np.ascontiguousarray(front[y : height - y, x : width - x])
    across, down = edge_maps(inner)
    share = 0.5 * float(across.mean() + down.mean())
    handles = min(MOST_HANDLES, len(find_handles(inner)))
    return (
        ALIGNED * aligned(inner)
        + HANDLE_CONTENT * handles
        + EDGE_CONTENT * share
        - AZIMUTH_CONTENT * abs(fit.parameters["azimuth"])
    )


def aligned(front: Pixels) -> float:
    """Return the share of the edges of a rectified front (H, W, 3) parallel to its sides."""
    grey = cv2.GaussianBlur(cv2.cvtColor(front, cv2.COLOR_RGB2GRAY), (0, 0), 1.0)
    across = np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3))
    down = np.abs(cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=3))
    strength = np.hypot(across, down)
    strong = strength > max(12.0, 2.5 * float(np.median(strength)))
    if not strong.any():
        return 0.5
    parallel = np.minimum(across, down) < ALIGNED_TAN * np.maximum(across, down)
    return float(strength[strong & parallel].sum() / strength[strong].sum())
