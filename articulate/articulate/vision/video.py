"""Video: a film as frames, or one line that says why it is none."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from articulate.errors import UsageError
from articulate.render.clip import Clip
from articulate.render.raster import Pixels
from articulate.transforms import Array

MOST_FRAMES = 240
"""Frames that are kept of a long film, evenly spread."""
LONGEST = 20_000
"""Frames of a film that is read at all."""
MOST_PIXELS = 4096 * 4096
"""Pixels of a frame that is read at all."""
STILL = 1.5
"""Mean change between frames below which nothing moves, of the hundredth of pixels that change
most, less what changes everywhere, 0 to 255."""


class ClipError(UsageError):
    """A clip that cannot be read or shows no motion."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a film is read."""

    longest_side_px: int = 0
    """Frames are made smaller so that no side is longer; 0: as they are."""
    most_frames: int = MOST_FRAMES
    """Frames that are kept, evenly spread."""


def read_clip(path: Path, reading: Reading | None = None) -> Clip:
    """The film at ``path``, its frames in RGB.

    Raises:
        ClipError: It cannot be read, is empty, or has one frame only.
    """
    reading = reading or Reading()
    if not path.is_file():
        raise ClipError(f"{path}: no such file; give a film, e.g. an .mp4")
    if path.stat().st_size == 0:
        raise ClipError(f"{path}: is empty; give a film of two frames or more")
    film = cv2.VideoCapture(str(path))
    try:
        if not film.isOpened():
            raise ClipError(f"{path}: cannot be read as a film; H.264 in .mp4 can")
        frames, fps = _frames(film, path, reading)
    except cv2.error as error:
        line = (str(error).strip().splitlines() or ["unknown fault"])[0]
        raise ClipError(f"{path}: cannot be read as a film ({line})") from None
    finally:
        film.release()
    if not frames:
        raise ClipError(f"{path}: no frame can be read; H.264 in .mp4 can be")
    if len(frames) == 1:
        raise ClipError(f"{path}: has one frame; motion needs two or more")
    keep = np.linspace(0, len(frames) - 1, min(len(frames), reading.most_frames)).round()
    keep = np.unique(keep.astype(int))
    times: Array = keep / fps
    return Clip(frames=np.stack([frames[k] for k in keep]), times_s=times)


def check_moves(frames: Pixels, source: str) -> None:
    """Refuse frames (T, H, W, 3) in which nothing moves.

    Raises:
        ClipError: All frames are alike.
    """
    picks = np.unique(np.linspace(0, len(frames) - 1, 12).round().astype(int))
    soft = [cv2.GaussianBlur(frames[k].astype(np.float32), (0, 0), 1.5) for k in picks]
    spread = np.stack([np.abs(one - soft[0]).mean(axis=-1) for one in soft]).max(axis=0)
    top = np.sort(spread.reshape(-1))[-max(20, spread.size // 100) :]
    if float(top.mean() - np.median(spread)) < STILL:
        raise ClipError(
            f"{source}: nothing moves (frames differ by {top.mean():.1f} of 255 where they differ "
            "most); give a film in which a part is operated"
        )


def _frames(film: cv2.VideoCapture, path: Path, reading: Reading) -> tuple[list[Pixels], float]:
    """All frames in RGB, made smaller, and frames per second."""
    width, height = film.get(cv2.CAP_PROP_FRAME_WIDTH), film.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if width * height > MOST_PIXELS:
        raise ClipError(
            f"{path}: frames of {width:.0f}x{height:.0f} px; at most 4096x4096 are read"
        )
    fps = film.get(cv2.CAP_PROP_FPS)
    if not np.isfinite(fps) or not 0.1 <= fps <= 1000.0:
        fps = 30.0
    frames: list[Pixels] = []
    while len(frames) < LONGEST:
        good, frame = film.read()
        if not good:
            break
        frames.append(_smaller(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB), reading.longest_side_px))
    return frames, float(fps)


def _smaller(frame: np.ndarray, longest_px: int) -> Pixels:
    factor = longest_px / max(frame.shape[:2]) if longest_px else 1.0
    if factor >= 1.0:
        return np.asarray(frame, dtype=np.uint8)
    size = (max(1, round(frame.shape[1] * factor)), max(1, round(frame.shape[0] * factor)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
