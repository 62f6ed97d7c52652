"""Settings of a benchmark run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from articulate.errors import ConfigError
from articulate.reconstruct.actors.modality import Modality

Task = Literal["joints", "placement"]
Condition = Literal["plain", "camera_off", "noisy"]
ImageState = Literal["open", "closed"]


@dataclass(frozen=True, kw_only=True)
class BenchmarkConfig:
    """All settings that determine the figures of a run, except the objects."""

    actor: str
    """Name of the actor, or ``module:Class``."""
    modality: Modality = "video"
    """Evidence for the actor: names and placed parts (text), with an image of the object (image),
    or with a video of one joint (video)."""
    task: Task = "joints"
    """``joints``: parts are placed; ``placement``: each part is moved so that the centre of its box
    is the origin, and joints count only if the parts are placed correctly."""
    condition: Condition = "plain"
    """``camera_off``: the camera of the evidence is wrong by 5 degrees and 5 %; ``noisy``: noise,
    changing light, and textures on all parts."""
    image_state: ImageState = "open"
    """Joint states in images: ``open``: each joint at 20 to 80 % of the travel from 0 to its
    farther limit; ``closed``: all joints at 0, as always in the task ``placement``."""
    width_px: int = 640
    """Width of images and videos [px]."""
    height_px: int = 480
    """Height of images and videos [px]."""
    n_frames: int = 50
    """Frames of a video."""
    fps: float = 24.0
    """Frames per second."""
    query_limit_s: float = 600.0
    """Processor time after which a query has no answer and its joints are wrong [s]."""
    seed: int = 0
    """Seed of the order and names of parts, of noise, and of the actor."""

    def __post_init__(self) -> None:
        """Check the combination of settings."""
        if self.n_frames < 2:
            raise ConfigError(f"--n-frames is {self.n_frames}; a video needs at least 2")
        if min(self.width_px, self.height_px) < 16:
            raise ConfigError(
                f"--width-px and --height-px are {self.width_px} and {self.height_px}; "
                "at least 16 are needed"
            )
        if self.task == "placement" and self.modality == "video":
            raise ConfigError(
                "--task placement has no video, as the parts are not placed yet; "
                "give --modality image or text"
            )
