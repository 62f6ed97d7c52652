"""Encode images as PNG."""

from __future__ import annotations

import cv2
import numpy as np

from articulate.render.canvas import Pixels


def png(image: Pixels) -> bytes:
    """Encode an image (H, W, 3), 0 to 255, as PNG."""
    good, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    assert good
    return bytes(data.tobytes())


def as_png(content: bytes) -> bytes:
    """Convert a PNG or WebP to PNG."""
    if content.startswith(b"\x89PNG"):
        return content
    read = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert read is not None
    return png(np.asarray(cv2.cvtColor(read, cv2.COLOR_BGR2RGB), dtype=np.uint8))
