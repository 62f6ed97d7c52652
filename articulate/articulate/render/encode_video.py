"""Pictures one after the other as a clip (MP4, H.264) that browsers play."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from articulate.errors import MissingError
from articulate.files import atomic_write
from articulate.render.canvas import Pixels

H264 = "-crf 25 -preset medium -threads 1 -movflags +faststart -f mp4"
"""How clips are encoded: small, and played while they load."""


def write_video(path: Path, frames: Iterable[Pixels], size: tuple[int, int], rate_hz: int) -> Path:
    """Write ``frames`` to ``path``, whole or not at all, and return it.

    Args:
        path: File to write.
        frames: Pictures of shape (height, width, 3).
        size: Width and height [px]; even numbers, as H.264 wants them.
        rate_hz: Frames in a second.

    Raises:
        MissingError: The encoder is not installed.
    """
    try:
        # Brings an encoder of its own; wanted for clips alone.
        import imageio_ffmpeg  # type: ignore[import-untyped]  # it ships no annotations
    except ImportError:
        raise MissingError(
            "no clips without imageio-ffmpeg; run: pip install imageio-ffmpeg"
        ) from None
    with atomic_write(path) as temporary:
        writer = imageio_ffmpeg.write_frames(
            str(temporary),
            size,
            fps=rate_hz,
            codec="libx264",
            macro_block_size=2,
            quality=None,
            output_params=H264.split(),
        )
        writer.send(None)
        try:
            for frame in frames:
                writer.send(np.ascontiguousarray(frame))
        finally:
            writer.close()
    return path
