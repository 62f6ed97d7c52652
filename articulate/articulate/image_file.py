"""Images from untrusted sources, read within bounds."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from articulate.errors import UsageError
from articulate.suppress_output import suppress_output
from articulate.untrusted import read_bounded

MAX_BYTES = 300_000_000
"""Largest image file."""


def read_image(
    path: Path,
    *,
    max_pixels: int,
    is_gray: bool = False,
    error: type[UsageError] = UsageError,
) -> NDArray[np.uint8]:
    """Return an image file's pixels, BGR (H, W, 3) or gray (H, W); its size is checked before.

    Args:
        path: Image file.
        max_pixels: Most pixels that are accepted.
        is_gray: Whether to return gray values.
        error: Class of the error that is raised.

    Raises:
        UsageError: It cannot be read, is too large, or is no image.
    """
    content = read_bounded(path, MAX_BYTES, error=error)
    no_image = f"{path}: cannot be read as an image; .png and .jpg are supported"
    too_large = f"{path}: has more than {max_pixels // 1_000_000} million pixels"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content)) as opened:
                width, height = opened.size
    except Image.DecompressionBombError:
        raise error(f"{too_large}; give a smaller image") from None
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError):
        raise error(no_image) from None
    if width * height > max_pixels:
        raise error(f"{too_large}; give a smaller image")
    flag = cv2.IMREAD_GRAYSCALE if is_gray else cv2.IMREAD_COLOR
    try:
        with suppress_output():  # libpng prints warnings
            pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flag)
    except cv2.error:
        pixels = None
    if pixels is None:
        raise error(no_image)
    return np.asarray(pixels, dtype=np.uint8)
