"""Corners of an object's box in an image, from a network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.fitting.box_cost import SIGNS
from articulate.reconstruct.fitting.decoder import read_network
from articulate.reconstruct.recognition.classifier import PAD_COLOUR, SIDE_PX, feature_maps
from articulate.render.raster import Pixels
from articulate.transforms import Array

CORNERS = SIGNS
"""Order of the corners (8, 3), in half sides along depth, width and height."""
GRID = 14
"""Side of the heat maps."""
GRID_LOW, GRID_HIGH = 0.5 / GRID, 1.0 - 0.5 / GRID
"""First and last position of the heat maps, in shares of the crop."""
SPREAD_FACTOR = 2.0
"""Spread of the corners of other objects than those of the training over the predicted one."""
EXTENT = (0.5, 99.5)
"""Percentiles of the pixels of the object between which it extends."""
WEIGHTS_FILE = Path(__file__).with_name("box_weights.npz")
"""Weights, trained on renders of the procedural library by ``benchmarks/photo_networks.py``."""
CROP_SIDE = 1.45
"""Side of the square crop over the longer side of the object."""


def square_crop(image: Pixels, box_px: Array) -> tuple[Pixels, Array]:
    """Return the square around an object (S, S, 3) and its transform (scale, shift u, shift v).

    A point at ``uv`` [px], counted from the corner of the first pixel, is at ``scale * uv + shift``
    in the square, in shares of its side.

    Args:
        image: Colours (H, W, 3).
        box_px: Left, top, right and bottom of the object (4,) [px].
    """
    side = CROP_SIDE * max(float(box_px[2] - box_px[0]), float(box_px[3] - box_px[1]), 8.0)
    centre = 0.5 * (box_px[:2] + box_px[2:]) + 0.5
    transform = np.array([1.0 / side, *(0.5 - centre / side)])
    scale = SIDE_PX / side
    A = np.array([[scale, 0.0, 0.0], [0.0, scale, 0.0]])
    A[:, 2] = transform[1:] * SIDE_PX + 0.5 * scale - 0.5
    if scale < 0.7:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), 0.35 / scale), dtype=np.uint8)
    crop = cv2.warpAffine(
        image, A, (SIDE_PX, SIDE_PX), flags=cv2.INTER_LINEAR, borderValue=(PAD_COLOUR,) * 3
    )
    return np.asarray(crop, dtype=np.uint8), transform


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxPrediction:
    """Corners of a box in an image with sizes and view, and the spread of each."""

    corners: Array
    """Corners (8, 2) [px], in the order of ``CORNERS``, from the corner of the first pixel."""
    corner_spread: Array
    """Spread of each corner (8,) [px]."""
    values: Array
    """Logarithms of width and depth over height, azimuth and elevation of the camera [rad], and
    logarithm of the focal length [px] (5,)."""
    spread: Array
    """Spread of the values (5,)."""


def predict_box(image: Pixels, mask: NDArray[np.bool_]) -> BoxPrediction:
    """Predict the box of an object.

    Args:
        image: Colours (H, W, 3).
        mask: Pixels of the object (H, W).

    Raises:
        UsageError: The package with the weights of the ImageNet network is not installed.
    """
    rows, columns = np.nonzero(mask)
    left, right = np.percentile(columns, EXTENT)
    top, bottom = np.percentile(rows, EXTENT)
    crop, transform = square_crop(image, np.array([left, top, right, bottom]))
    network = read_network(WEIGHTS_FILE)
    maps, context = network.decode(feature_maps([crop]))
    heat = network.layer("heat", maps, relu=False).reshape(8, -1).astype(np.float64)
    heat = np.exp(heat - heat.max(axis=1, keepdims=True))
    share = (heat / heat.sum(axis=1, keepdims=True)).reshape(8, GRID, GRID)
    grid = np.linspace(GRID_LOW, GRID_HIGH, GRID)
    mean = np.stack([share.sum(axis=1) @ grid, share.sum(axis=2) @ grid], axis=1)
    spread = np.exp(np.clip(network.linear("spread", context), -4.0, 2.0) - 3.0)
    values = network.linear("values", np.maximum(network.linear("hidden", context), 0.0))
    values = values.astype(np.float64)
    values[4] -= np.log(transform[0])
    return BoxPrediction(
        corners=(mean - transform[1:]) / transform[0],
        corner_spread=SPREAD_FACTOR * spread.astype(np.float64) / transform[0],
        values=values[:5],
        spread=np.exp(np.clip(values[5:], -4.0, 1.0)),
    )
