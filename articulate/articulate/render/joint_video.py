"""Videos of a joint that moves from one limit to the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.errors import ConfigError
from articulate.render.camera import Camera
from articulate.render.encode_video import write_video
from articulate.render.raster import Pixels
from articulate.render.scene import PartScene
from articulate.transforms import Array

FULL_TURN_RAD = 2.0 * np.pi + 0.5
"""Travel of a joint without limits [rad]: less than a full turn would hide its kind."""
SUFFIXES = (".mp4", ".webm")


@dataclass(frozen=True, kw_only=True, eq=False)
class Video:
    """Frames and their times."""

    frames: Pixels
    """Colours (T, H, W, 3), 0 to 255."""
    times_s: Array
    """Time of each frame (T,) [s]."""

    @property
    def fps(self) -> float:
        """Mean frame rate [1/s]; 0 for a single frame."""
        if len(self.times_s) < 2:
            return 0.0
        return float((len(self.times_s) - 1) / (self.times_s[-1] - self.times_s[0]))

    def write(self, path: Path) -> Path:
        """Write the video to ``path`` as ``.mp4`` (H.264) or ``.webm`` (VP9) and return the path.

        Raises:
            ConfigError: The path has another suffix.
            MissingError: The encoder is not installed.
        """
        if path.suffix.lower() not in SUFFIXES:
            raise ConfigError(f"{path}: videos are written as {' or '.join(SUFFIXES)}")
        size = (self.frames.shape[2], self.frames.shape[1])
        return write_video(path, self.frames, size, self.fps or 1.0, "faithful")

    def subsample(self, n_frames: int) -> Video:
        """Return at most ``n_frames`` frames, evenly spread, first and last included."""
        keep = np.unique(np.linspace(0, len(self.frames) - 1, n_frames).round().astype(int))
        return Video(frames=self.frames[keep], times_s=self.times_s[keep])


def sweep_positions(lower: float | None, upper: float | None, n_frames: int) -> Array:
    """Return positions (T,) [m or rad] of a joint from one limit to the other, both included.

    A range that reaches below 0 is traversed from upper to lower, others from lower to upper, as in
    Articulate-Anything; a joint without limits from 0 by a full turn and half a radian.

    Raises:
        ConfigError: Only one limit is given, or there are fewer than two frames.
    """
    if n_frames < 2:
        raise ConfigError(f"a video of {n_frames} frames shows no motion; at least 2 are needed")
    if (lower is None) != (upper is None):
        raise ConfigError(f"limits {lower} and {upper}: give both, or none for a joint without")
    if lower is None or upper is None:
        return np.linspace(0.0, FULL_TURN_RAD, n_frames)
    start, stop = (upper, lower) if lower < 0.0 else (lower, upper)
    return np.linspace(start, stop, n_frames)


def render_video(
    scene: PartScene, camera: Camera, poses_w: Array, *, fps: float = 24.0, samples: int = 2
) -> Video:
    """Render parts in motion.

    Args:
        scene: The parts.
        camera: Camera of the video.
        poses_w: Motion of each part at each frame (T, P, 4, 4), homogeneous.
        fps: Frame rate [1/s].
        samples: As in :meth:`PartScene.render_image`.
    """
    frames = np.stack([scene.render_image(camera, pose, samples=samples) for pose in poses_w])
    return Video(frames=frames, times_s=np.arange(len(frames)) / fps)


def poses_of_parts(n_parts: int, moving: Sequence[int], motion_w: Array) -> Array:
    """Return poses (T, P, 4, 4): ``motion_w`` (T, 4, 4) for the parts ``moving``, else identity.

    All are homogeneous.
    """
    poses = np.broadcast_to(np.eye(4), (len(motion_w), n_parts, 4, 4)).copy()
    for index in moving:
        poses[:, index] = motion_w
    return poses
