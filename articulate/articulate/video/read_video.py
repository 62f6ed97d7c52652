"""Video: a film as frames, or one line that says why it is none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from articulate.errors import UsageError
from articulate.render.joint_video import Video
from articulate.render.raster import Pixels
from articulate.suppress_output import suppress_output
from articulate.transforms import Array

MOST_FRAMES = 240
"""Frames that are kept of a long film, evenly spread."""
LONGEST = 20_000
"""Most frames of a film that is read at all."""
MOST_PIXELS = 4096 * 4096
"""Pixels of a frame that is read at all."""
MOST_BYTES = 2_000_000_000
"""Frames that are kept take less than this."""
KINDS = (
    (4, b"ftyp"), (4, b"moov"), (4, b"mdat"), (4, b"wide"), (4, b"free"), (4, b"skip"),  # mp4, mov
    (0, b"\x1aE\xdf\xa3"),  # Matroska, WebM
    (8, b"AVI "), (0, b"GIF8"), (0, b"OggS"), (0, b"FLV"), (0, b"0&\xb2u"),
    (0, b"\x00\x00\x01\xba"), (0, b"\x00\x00\x01\xb3"),  # MPEG
)  # fmt: skip
"""How films begin: place, bytes. The decoder would take more for films: plain text, which it draws
letter by letter, and lists that name other files and addresses, which it would open."""
PACKETS = ((0, 188, 376), (4, 196, 388))
"""Where an MPEG transport stream has its sign, one letter for each packet."""
STILL = 1.5
"""Mean change between frames below which nothing moves, of the hundredth of pixels that change
most, less what changes everywhere, 0 to 255."""


class VideoError(UsageError):
    """A clip that cannot be read or shows no motion."""


@dataclass(frozen=True, kw_only=True)
class VideoReadOptions:
    """How a film is read."""

    longest_side_px: int = 0
    """Frames are made smaller so that no side is longer; 0: as they are."""
    most_frames: int = MOST_FRAMES
    """Frames that are kept, evenly spread."""


def read_video(path: Path, reading: VideoReadOptions | None = None) -> Video:
    """The film at ``path``, its frames in RGB.

    Raises:
        ClipError: It cannot be read, is empty, or has one frame only.
    """
    reading = reading or VideoReadOptions()
    try:
        size = path.stat().st_size if path.is_file() else None
    except OSError as error:
        raise VideoError(f"{path}: cannot be read ({error.strerror}); give a film") from None
    if size is None:
        raise VideoError(f"{path}: no such file; give a film, e.g. an .mp4")
    if size == 0:
        raise VideoError(f"{path}: is empty; give a film of two frames or more")
    _check_kind(path)
    try:
        length, fps = _length(path)
        if length == 0:
            raise VideoError(f"{path}: no frame can be read; H.264 in .mp4 can be")
        if length == 1:
            raise VideoError(f"{path}: has one frame; motion needs two or more")
        keep = np.linspace(0, length - 1, min(length, reading.most_frames)).round()
        keep = np.unique(keep.astype(int))
        frames = _frames(path, keep, reading.longest_side_px)
    except cv2.error as error:
        line = (str(error).strip().splitlines() or ["unknown fault"])[0]
        raise VideoError(f"{path}: cannot be read as a film ({line})") from None
    times: Array = keep / fps
    return Video(frames=frames, times_s=times)


def check_motion(frames: Pixels, source: str) -> None:
    """Refuse frames (T, H, W, 3) in which nothing moves.

    Raises:
        ClipError: All frames are alike.
    """
    picks = np.unique(np.linspace(0, len(frames) - 1, 12).round().astype(int))
    soft = [cv2.GaussianBlur(frames[k].astype(np.float32), (0, 0), 1.5) for k in picks]
    spread = np.stack([np.abs(one - soft[0]).mean(axis=-1) for one in soft]).max(axis=0)
    top = np.sort(spread.reshape(-1))[-max(20, spread.size // 100) :]
    if float(top.mean() - np.median(spread)) < STILL:
        raise VideoError(
            f"{source}: nothing moves (frames differ by {top.mean():.1f} of 255 where they differ "
            "most); give a film in which a part is operated"
        )


def _check_kind(path: Path) -> None:
    """Refuse what does not begin as films do."""
    try:
        with path.open("rb") as stream:
            begin = stream.read(PACKETS[-1][-1] + 1)
    except OSError as error:
        raise VideoError(f"{path}: cannot be read ({error.strerror})") from None
    packets = any(all(begin[at : at + 1] == b"\x47" for at in places) for places in PACKETS)
    if not packets and not any(begin[at : at + len(kind)] == kind for at, kind in KINDS):
        raise VideoError(f"{path}: cannot be read as a film; H.264 in .mp4 can")


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    with suppress_output():  # decoders print below Python what they think of a broken film
        film = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        try:
            if not film.isOpened():
                raise VideoError(f"{path}: cannot be read as a film; H.264 in .mp4 can")
            yield film
        finally:
            film.release()


def _length(path: Path) -> tuple[int, float]:
    """How many frames can be read (the head of a film may lie), and frames per second."""
    with _opened(path) as film:
        width, height = film.get(cv2.CAP_PROP_FRAME_WIDTH), film.get(cv2.CAP_PROP_FRAME_HEIGHT)
        if width * height > MOST_PIXELS:
            raise VideoError(
                f"{path}: frames of {width:.0f}x{height:.0f} px; at most 4096x4096 are read"
            )
        fps = film.get(cv2.CAP_PROP_FPS)
        if not np.isfinite(fps) or not 0.1 <= fps <= 1000.0:
            fps = 30.0
        length = 0
        while film.grab():
            length += 1
            if length > LONGEST:
                raise VideoError(
                    f"{path}: has more than {LONGEST} frames; give the piece of it in which the "
                    "part is operated"
                )
    return length, float(fps)


def _frames(path: Path, keep: np.ndarray, longest_px: int) -> Pixels:
    """The frames ``keep`` (T,) in RGB, made smaller (T, H, W, 3).

    Only they are held: a minute of a phone's film takes 11 GB as a whole.
    """
    frames: list[Pixels] = []
    wanted = set(keep.tolist())
    with _opened(path) as film:
        for k in range(int(keep[-1]) + 1):
            good = film.grab()
            if not good or k not in wanted:
                continue
            good, frame = film.retrieve()
            if not good:
                break
            frames.append(_smaller(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB), longest_px))
            if frames[0].nbytes * len(keep) > MOST_BYTES:
                height, width = frames[0].shape[:2]
                raise VideoError(
                    f"{path}: {len(keep)} frames of {width}x{height} px take "
                    f"{frames[0].nbytes * len(keep) / 1e9:.1f} GB; give a film of smaller frames"
                )
    if len(frames) != len(keep) or len({frame.shape for frame in frames}) != 1:
        raise VideoError(f"{path}: frames cannot be read twice alike; give H.264 in .mp4")
    return np.stack(frames)


def _smaller(frame: np.ndarray, longest_px: int) -> Pixels:
    factor = longest_px / max(frame.shape[:2]) if longest_px else 1.0
    if factor >= 1.0:
        return np.asarray(frame, dtype=np.uint8)
    size = (max(1, round(frame.shape[1] * factor)), max(1, round(frame.shape[0] * factor)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
