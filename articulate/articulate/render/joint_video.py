"""Clips: a joint that goes from end to end, drawn frame by frame, and written as a film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.errors import ConfigError, MissingError
from articulate.files import atomic_write
from articulate.render.camera import Camera
from articulate.render.raster import Pixels
from articulate.render.scene import PartScene
from articulate.transforms import Array

FULL_TURN_RAD = 2.0 * np.pi + 0.5
"""A joint without limits is turned by this much: less than a whole turn would hide its kind."""
CODECS = {
    ".mp4": ("libx264", "-f mp4 -crf 18 -preset veryfast -movflags +faststart"),
    ".webm": ("libvpx-vp9", "-f webm -crf 24 -b:v 0 -deadline realtime"),
}
"""Codec and what it is told, by the ending of the file's name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Video:
    """Frames and their times."""

    frames: Pixels
    """Frames (T, H, W, 3)."""
    times_s: Array
    """Time of each frame (T,) [s]."""

    @property
    def fps(self) -> float:
        """Frames in a second, in the mean; 0 for a single frame."""
        if len(self.times_s) < 2:
            return 0.0
        return float((len(self.times_s) - 1) / (self.times_s[-1] - self.times_s[0]))


def sweep_positions(lower: float | None, upper: float | None, n_frames: int) -> Array:
    """Positions (T,) [m or rad] of a joint from one end to the other, both included.

    Where the range reaches below 0 it goes from upper to lower, else from lower to upper, as
    Articulate-Anything does; without limits from 0 on by a full turn and half a radian.

    Raises:
        ConfigError: One limit is given alone, or there is no frame for each end.
    """
    if n_frames < 2:
        raise ConfigError(f"a clip of {n_frames} frames shows no motion; at least 2 are needed")
    if (lower is None) != (upper is None):
        raise ConfigError(f"limits {lower} and {upper}: give both, or none for a joint without")
    if lower is None or upper is None:
        return np.linspace(0.0, FULL_TURN_RAD, n_frames)
    start, stop = (upper, lower) if lower < 0.0 else (lower, upper)
    return np.linspace(start, stop, n_frames)


def render_video(
    scene: PartScene, camera: Camera, poses_w: Array, *, fps: float = 24.0, samples: int = 2
) -> Video:
    """The parts in motion.

    Args:
        scene: The parts.
        camera: Where from.
        poses_w: What is done to each part at each frame (T, P, 4, 4).
        fps: Frames in a second.
        samples: As in :meth:`PartScene.picture`.
    """
    frames = np.stack([scene.render_image(camera, pose, samples=samples) for pose in poses_w])
    return Video(frames=frames, times_s=np.arange(len(frames)) / fps)


def poses_of_parts(n_parts: int, moving: Sequence[int], motion_w: Array) -> Array:
    """Poses (T, P, 4, 4) in which the parts ``moving`` do ``motion_w`` (T, 4, 4), others none."""
    poses = np.broadcast_to(np.eye(4), (len(motion_w), n_parts, 4, 4)).copy()
    for index in moving:
        poses[:, index] = motion_w
    return poses


def write_video(path: Path, clip: Video) -> Path:
    """Write ``clip`` to ``path`` as ``.mp4`` (H.264) or ``.webm`` (VP9), whole or not at all.

    Frames of an odd width or height lose their last column or row: the codecs want even ones.

    Raises:
        ConfigError: The name ends otherwise.
        MissingError: There is no encoder.
    """
    if path.suffix.lower() not in CODECS:
        raise ConfigError(
            f"{path}: clips are written as {' or '.join(CODECS)}; give it such a name"
        )
    try:
        # Brings an encoder of its own; wanted for clips alone.
        import imageio_ffmpeg  # type: ignore[import-untyped]  # it ships no annotations
    except ImportError:
        raise MissingError(
            "no clips without imageio-ffmpeg; run: pip install imageio-ffmpeg"
        ) from None
    codec, told = CODECS[path.suffix.lower()]
    height, width = clip.frames.shape[1] // 2 * 2, clip.frames.shape[2] // 2 * 2
    with atomic_write(path) as temporary:
        writer = imageio_ffmpeg.write_frames(
            str(temporary),
            (width, height),
            fps=clip.fps or 1.0,
            codec=codec,
            macro_block_size=2,
            quality=None,
            output_params=told.split(),
        )
        writer.send(None)
        try:
            for frame in clip.frames:
                writer.send(np.ascontiguousarray(frame[:height, :width]))
        finally:
            writer.close()
    return path


def subsample(clip: Video, n_frames: int) -> Video:
    """At most ``n_frames`` of the clip, evenly spread, first and last included."""
    keep = np.unique(np.linspace(0, len(clip.frames) - 1, n_frames).round().astype(int))
    return Video(frames=clip.frames[keep], times_s=clip.times_s[keep])
