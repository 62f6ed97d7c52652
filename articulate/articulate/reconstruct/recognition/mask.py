"""Salient object of an image (U2-Net-p: Qin et al., Pattern Recognition 2020), and its crops."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.reconstruct.recognition.weights import SALIENCY
from articulate.render.raster import Pixels
from articulate.transforms import Array

SIDE_PX = 320
MEAN, SCALE = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
CROP_MARGIN, BACKGROUND_MARGIN = 0.08, 0.12
"""Margins of the crops on white and with background, as shares of the object's larger side."""
WHITE = 255


def saliency(image: Pixels) -> Array:
    """Return the saliency (H, W) of an image (H, W, 3), in [0, 1].

    Raises:
        UsageError: The package with the weights is not installed.
    """
    height, width = image.shape[:2]
    small = cv2.resize(image, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA).astype(np.float32)
    small /= max(float(small.max()), 1.0)
    pixels = ((small - MEAN) / SCALE).transpose(2, 0, 1)[None].astype(np.float32)
    session = _session()
    found = session.run(None, {session.get_inputs()[0].name: pixels})[0][0, 0]
    low, high = float(found.min()), float(found.max())
    scaled = (found - low) / max(high - low, 1e-6)
    return np.asarray(
        cv2.resize(scaled, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float64
    )


def crop_on_white(image: Pixels, mask: NDArray[np.bool_]) -> Pixels:
    """Return the object of an image (H, W, 3) on a white background, with a margin.

    Raises:
        UsageError: The mask (H, W) is empty.
    """
    on_white = np.where(mask[..., None], image, WHITE)[_window(mask)].astype(np.uint8)
    border = round(CROP_MARGIN * max(on_white.shape[:2]))
    ends = (border, border, border, border)
    colour = (WHITE, WHITE, WHITE)
    bordered = cv2.copyMakeBorder(on_white, *ends, cv2.BORDER_CONSTANT, value=colour)
    return np.asarray(bordered, dtype=np.uint8)


def crop_with_background(image: Pixels, mask: NDArray[np.bool_]) -> Pixels:
    """Return the region of an image (H, W, 3) around the object, with a margin inside the image.

    Raises:
        UsageError: The mask (H, W) is empty.
    """
    return image[_window(mask, BACKGROUND_MARGIN)]


def _window(mask: NDArray[np.bool_], margin: float = 0.0) -> tuple[slice, slice]:
    """Return rows and columns of the mask, with a margin as a share of the larger side."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        raise UsageError("no object is in the image")
    border = round(margin * (1 + max(np.ptp(rows), np.ptp(columns))))
    return (
        slice(max(0, rows.min() - border), rows.max() + 1 + border),
        slice(max(0, columns.min() - border), columns.max() + 1 + border),
    )


@lru_cache(maxsize=1)
def _session() -> Any:
    from articulate.onnx_runtime import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(
        SALIENCY.read(), options, providers=["CPUExecutionProvider"]
    )
