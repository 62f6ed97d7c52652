"""Encode images as a video that browsers play."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np

from articulate.errors import MissingError
from articulate.files import atomic_write
from articulate.render.canvas import Pixels

H264_SMALL = "-crf 25 -preset medium -threads 1 -movflags +faststart -f mp4"
"""Small files that play while they load; one thread, so that the bytes are reproducible."""
H264_FAITHFUL = "-f mp4 -crf 18 -preset veryfast -movflags +faststart"
VP9 = "-f webm -crf 24 -b:v 0 -deadline realtime"


def write_video(
    path: Path,
    frames: Iterable[Pixels],
    size: tuple[int, int],
    fps: float,
    quality: Literal["small", "faithful"] = "small",
) -> Path:
    """Write ``frames`` to ``path`` as ``.mp4`` (H.264) or ``.webm`` (VP9) and return the path.

    The file is replaced atomically. Frames of an odd width or height lose their last column or row,
    since the codecs require even sizes.

    Args:
        path: File to write; another suffix than ``.webm`` means H.264.
        frames: Images (height, width, 3), 0 to 255.
        size: Width and height [px].
        fps: Frame rate [1/s].
        quality: ``faithful`` for videos that are measured, ``small`` for videos that are watched.

    Raises:
        MissingError: The encoder is not installed.
    """
    try:
        import imageio_ffmpeg  # type: ignore[import-untyped]  # no annotations; on demand
    except ImportError:
        raise MissingError(
            "writing videos needs imageio-ffmpeg; run: pip install imageio-ffmpeg"
        ) from None
    if path.suffix.lower() == ".webm":
        codec, options = "libvpx-vp9", VP9
    else:
        codec, options = "libx264", H264_SMALL if quality == "small" else H264_FAITHFUL
    width, height = size[0] // 2 * 2, size[1] // 2 * 2
    with atomic_write(path) as temporary:
        writer = imageio_ffmpeg.write_frames(
            str(temporary),
            (width, height),
            fps=fps,
            codec=codec,
            macro_block_size=2,
            quality=None,
            output_params=options.split(),
        )
        writer.send(None)
        try:
            for frame in frames:
                writer.send(np.ascontiguousarray(frame[:height, :width]))
        finally:
            writer.close()
    return path
