"""What a run of the benchmark does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from articulate.errors import ConfigError
from articulate.reconstruct.actors.modality import Modality

Task = Literal["joints", "placement"]
Condition = Literal["plain", "camera_off", "noisy"]


@dataclass(frozen=True, kw_only=True)
class BenchmarkConfig:
    """Everything that decides the figures of a run, but for the objects."""

    actor: str
    """Name of the actor, or ``module:Class``."""
    modality: Modality = "video"
    """What the actor is given: names and placed parts (text), also a picture (image), also a clip
    of one joint (video)."""
    task: Task = "joints"
    """``joints``: parts are in their places; ``placement``: each part is moved so that the middle
    of its box is the origin, and joints count only where the object is put together rightly."""
    condition: Condition = "plain"
    """``camera_off``: the camera told is not the camera of the pictures, by 5 degrees and 5 %;
    ``noisy``: noise, changing light, and texture on everything."""
    width_px: int = 640
    """Width of pictures."""
    height_px: int = 480
    """Height of pictures."""
    n_frames: int = 50
    """Frames of a clip."""
    fps: float = 24.0
    """Frames in a second."""
    seed: int = 0
    """Seed of order, names, noise, and of the actor."""

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        if self.n_frames < 2:
            raise ConfigError(f"--n-frames is {self.n_frames}; a clip needs at least 2")
        if min(self.width_px, self.height_px) < 16:
            raise ConfigError(
                f"--width-px and --height-px are {self.width_px} and {self.height_px}; "
                "at least 16 are needed"
            )
        if self.task == "placement" and self.modality == "video":
            raise ConfigError(
                "--task placement has no clip: parts have no place before they are put together; "
                "give --modality image or text"
            )
