"""Read videos into arrays; files may be damaged or hostile."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from articulate.errors import UsageError, shorten
from articulate.render.joint_video import Video
from articulate.render.raster import Pixels
from articulate.suppress_output import suppress_output
from articulate.transforms import Array
from articulate.untrusted import memory_limit, open_regular

MAX_KEPT_FRAMES = 240
"""Frames that are kept of a long video, evenly spread."""
MAX_FRAMES = 20_000
"""Longest video that is accepted [frames]."""
MAX_PIXELS = 4096 * 4096
"""Largest frame that is accepted [px]."""
MAX_BYTES = 1_200_000_000
"""Most memory of the kept frames."""
MAX_FILE_BYTES = 4_000_000_000
"""Largest file that is accepted."""
MAX_DECODER_BYTES = 1_500_000_000
"""Most memory that the decoder may allocate: headers may announce any size."""
MAX_DECODE_S = 50.0
"""Most processor time for decoding [s]."""
FORMATS = (
    (4, b"ftyp"), (4, b"moov"), (4, b"mdat"), (4, b"wide"), (4, b"free"), (4, b"skip"),  # mp4, mov
    (0, b"\x1aE\xdf\xa3"),  # Matroska, WebM
    (8, b"AVI "), (0, b"GIF8"), (0, b"OggS"), (0, b"FLV"), (0, b"0&\xb2u"),
    (0, b"\x00\x00\x01\xba"), (0, b"\x00\x00\x01\xb3"),  # MPEG
)  # fmt: skip
"""Signatures of videos: offset, bytes. The decoder itself accepts more: plain text, which it
renders letter by letter, and playlists, whose files and addresses it would open."""
PACKETS = ((0, 188, 376), (4, 196, 388))
"""Offsets of the sync byte of an MPEG transport stream, one for each packet."""
MIN_MOTION = 1.5
"""Mean change between frames below which nothing moves: of the hundredth of the pixels that changes
most, less the median change, 0 to 255."""


class VideoError(UsageError):
    """A video that cannot be read or shows no motion."""


@dataclass(frozen=True, kw_only=True)
class VideoReadOptions:
    """Resolution and number of frames to read."""

    longest_side_px: int = 0
    """Larger frames are reduced to this longest side [px]; 0: never."""
    most_frames: int = MAX_KEPT_FRAMES
    """Frames to keep, evenly spread."""


def read_video(path: Path, options: VideoReadOptions | None = None) -> Video:
    """Read the video at ``path``, frames in RGB.

    Raises:
        VideoError: It cannot be read, is too large, is empty, or has one frame only.
    """
    options = options or VideoReadOptions()
    if not _exists(path):
        raise VideoError(f"{path}: no such file; give a video, e.g. an .mp4")
    _check_format(path)
    deadline_s = time.process_time() + MAX_DECODE_S
    try:
        length, fps = _length(path, deadline_s)
        if length == 0:
            raise VideoError(f"{path}: no frame can be decoded; H.264 in .mp4 is supported")
        if length == 1:
            raise VideoError(f"{path}: has one frame; motion requires two or more")
        keep = np.linspace(0, length - 1, min(length, options.most_frames)).round()
        keep = np.unique(keep.astype(int))
        frames = _frames(path, keep, options.longest_side_px, deadline_s)
    except (cv2.error, MemoryError) as error:
        line = (shorten(error).strip().splitlines() or ["out of memory"])[0]
        raise VideoError(f"{path}: cannot be decoded as a video ({line})") from None
    times: Array = keep / fps
    return Video(frames=frames, times_s=times)


def check_motion(frames: Pixels, source: str) -> None:
    """Check that something moves in frames (T, H, W, 3), 0 to 255.

    Raises:
        VideoError: All frames are alike.
    """
    picks = np.unique(np.linspace(0, len(frames) - 1, 12).round().astype(int))
    soft = [cv2.GaussianBlur(frames[k].astype(np.float32), (0, 0), 1.5) for k in picks]
    spread = np.stack([np.abs(one - soft[0]).mean(axis=-1) for one in soft]).max(axis=0)
    top = np.sort(spread.reshape(-1))[-max(20, spread.size // 100) :]
    if float(top.mean() - np.median(spread)) < MIN_MOTION:
        raise VideoError(
            f"{source}: nothing moves (frames differ by {top.mean():.1f} of 255 where they differ "
            "most); give a video in which a part is operated"
        )


def _exists(path: Path) -> bool:
    try:
        path.stat()
    except FileNotFoundError:
        return False
    except (OSError, ValueError):  # for example a name that is too long
        return True
    return True


def _check_format(path: Path) -> None:
    """Reject files that are not regular, too large, empty, or do not start as videos do."""
    with open_regular(path, limit_bytes=MAX_FILE_BYTES, error=VideoError) as stream:
        try:
            begin = stream.read(PACKETS[-1][-1] + 1)
        except OSError as error:
            raise VideoError(f"{path}: cannot be read ({error.strerror})") from None
    if not begin:
        raise VideoError(f"{path}: is empty; give a video of two frames or more")
    packets = any(all(begin[at : at + 1] == b"\x47" for at in places) for places in PACKETS)
    if not packets and not any(begin[at : at + len(kind)] == kind for at, kind in FORMATS):
        raise VideoError(f"{path}: cannot be read as a video; H.264 in .mp4 is supported")


@contextmanager
def _opened(path: Path, extra_bytes: int = 0) -> Iterator[cv2.VideoCapture]:
    # Decoders print warnings about damaged videos from C; each thread reserves address space.
    with suppress_output(), memory_limit(MAX_DECODER_BYTES + extra_bytes):
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        try:
            if not video.isOpened():
                raise VideoError(f"{path}: cannot be read as a video; H.264 in .mp4 is supported")
            yield video
        finally:
            video.release()


def _check_time(path: Path, deadline_s: float) -> None:
    if time.process_time() > deadline_s:
        raise VideoError(
            f"{path}: decoding takes more than {MAX_DECODE_S:.0f} s of processor time; give a "
            "shorter or smaller video"
        )


def _length(path: Path, deadline_s: float) -> tuple[int, float]:
    """Count the frames that can be decoded (headers may be wrong); return frames per second too."""
    with _opened(path) as video:
        width, height = video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)
        if width * height > MAX_PIXELS:
            raise VideoError(
                f"{path}: frames of {width:.0f}x{height:.0f} px; at most 4096x4096 are accepted"
            )
        fps = video.get(cv2.CAP_PROP_FPS)
        if not np.isfinite(fps) or not 0.1 <= fps <= 1000.0:
            fps = 30.0
        length = 0
        while video.grab():
            length += 1
            _check_time(path, deadline_s)
            if length > MAX_FRAMES:
                raise VideoError(
                    f"{path}: has more than {MAX_FRAMES} frames; give the section in which the "
                    "part is operated"
                )
    return length, float(fps)


def _frames(path: Path, keep: np.ndarray, longest_px: int, deadline_s: float) -> Pixels:
    """Decode the frames ``keep`` (T,) to RGB, reduced in size (T, H, W, 3).

    Only these are held: a minute of a phone's video takes 11 GB in full.
    """
    frames: Pixels = np.empty((0, 0, 0, 3), dtype=np.uint8)
    count, wanted = 0, set(keep.tolist())
    with _opened(path, MAX_BYTES) as video:
        for k in range(int(keep[-1]) + 1):
            good = video.grab()
            _check_time(path, deadline_s)
            if not good or k not in wanted:
                continue
            good, frame = video.retrieve()
            if not good:
                break
            small = _reduced(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB), longest_px)
            if count == 0:
                height, width = small.shape[:2]
                if small.nbytes * len(keep) > MAX_BYTES:
                    raise VideoError(
                        f"{path}: {len(keep)} frames of {width}x{height} px take "
                        f"{small.nbytes * len(keep) / 1e9:.1f} GB; give a video of smaller frames"
                    )
                frames = np.empty((len(keep), *small.shape), dtype=np.uint8)
            if small.shape != frames.shape[1:]:
                break
            frames[count] = small
            count += 1
    if count != len(keep):
        raise VideoError(f"{path}: decoding is not repeatable; give H.264 in .mp4")
    return frames


def _reduced(frame: np.ndarray, longest_px: int) -> Pixels:
    factor = longest_px / max(frame.shape[:2]) if longest_px else 1.0
    if factor >= 1.0:
        return np.asarray(frame, dtype=np.uint8)
    size = (max(1, round(frame.shape[1] * factor)), max(1, round(frame.shape[0] * factor)))
    return np.asarray(cv2.resize(frame, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
