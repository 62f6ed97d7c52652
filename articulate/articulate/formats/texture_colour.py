"""The one colour that a texture gives its surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from articulate.errors import AssetError

MAX_PIXELS = 40_000_000
"""Largest picture that is opened."""


def mean_colour(path: Path) -> tuple[float, float, float]:
    """Mean red, green and blue of a picture, each in [0, 1].

    Raises:
        AssetError: It cannot be read.
    """
    try:
        with Image.open(path) as image:
            if image.width * image.height > MAX_PIXELS:
                raise AssetError(f"texture {path.name}: more than {MAX_PIXELS} pixels")
            pixels = np.asarray(image.convert("RGBA").resize((8, 8)), dtype=np.float64)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        text = (str(error).splitlines() or [""])[0][:100]
        raise AssetError(f"texture {path.name}: cannot be read ({text})") from None
    red, green, blue = pixels[..., :3].reshape(-1, 3).mean(axis=0) / 255.0
    return float(red), float(green), float(blue)
