"""``articulate observe``: estimate joint type and axis from a video, without geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.commands.success import MISSED
from articulate.errors import ConfigError

if TYPE_CHECKING:
    from articulate.video.observe import Observation


@dataclass(frozen=True, kw_only=True)
class ObserveFlags:
    """Estimate the motion of the operated part in a video: joint type, axis and path in the image.

    Example: articulate observe drawer.mp4 --json
    """

    clip: Annotated[Path, POSITIONAL]
    """Video, e.g. an .mp4, in which one part is operated."""
    side: int = 480
    """Longest side of the frames after scaling down [px]."""
    frames: int = 72
    """Number of evenly spaced frames."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""

    def __post_init__(self) -> None:
        """Check the values of the flags."""
        if self.side < 64:
            raise ConfigError(f"--side is {self.side}; it must be 64 px or more")
        if self.frames < 8:
            raise ConfigError(f"--frames is {self.frames}; it must be 8 or more")


FLAGS = ObserveFlags


def main(argv: Sequence[str]) -> int:
    """Track points, estimate the motion and print it; 3 if it is doubtful."""
    flags = parse(ObserveFlags, argv, prog="articulate observe")
    from articulate.video.observe import observe_joint
    from articulate.video.read_video import (  # OpenCV; --help does without
        VideoReadOptions,
        read_video,
    )

    clip = read_video(
        flags.clip, VideoReadOptions(longest_side_px=flags.side, most_frames=flags.frames)
    )
    console.show_progress(f"{flags.clip}: tracking points over {len(clip.frames)} frames")
    seen = observe_joint(clip, str(flags.clip))
    console.emit_json(seen.as_json()) if flags.json else console.emit(_text(seen))
    if seen.doubtful:
        several = seen.moving_parts > 1
        reason = (
            f"{seen.moving_parts} parts seem to move; give a video in which one part is operated"
            if several
            else f"the joint type has a probability of {seen.confidence:.2f}; a video from another "
            "side, with a still camera and a full stroke, may distinguish revolute from prismatic"
        )
        console.show_progress(f"{flags.clip}: doubtful: {reason}")
        return MISSED
    return 0


def _text(seen: Observation) -> str:
    x, y, z = seen.axis_c
    what = "slides along" if seen.kind == "prismatic" else "turns about"
    first, last = seen.path_px[0], seen.path_px[-1]
    side = f", hinged at the {seen.side}" if seen.side else ""
    return (
        f"{seen.kind} with probability {seen.confidence:.2f}: a part {what} ({x:.2f}, {y:.2f}, "
        f"{z:.2f}) (x right, y down, z ahead){side}\n"
        f"a point of it moves from ({first[0]:.0f}, {first[1]:.0f}) to ({last[0]:.0f}, "
        f"{last[1]:.0f}) px; the moving region spans columns {seen.box_px[0]:.0f} to "
        f"{seen.box_px[1]:.0f}, rows {seen.box_px[2]:.0f} to {seen.box_px[3]:.0f}"
    )
