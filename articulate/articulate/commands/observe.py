"""``articulate observe``: what moves in a film, and how, without any geometry."""

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
    """Say how the part that is operated in a film moves: kind of joint, axis, path in the picture.

    Example: articulate observe drawer.mp4 --json
    """

    clip: Annotated[Path, POSITIONAL]
    """Film, e.g. an .mp4, in which one part is operated."""
    side: int = 480
    """Frames are made smaller so that no side is longer [px]."""
    frames: int = 72
    """Frames that are looked at, evenly spread."""
    json: bool = False
    """Print the result as JSON and nothing else on standard output."""

    def __post_init__(self) -> None:
        """Refuse what cannot be watched."""
        if self.side < 64:
            raise ConfigError(f"--side is {self.side}; it must be 64 px or more")
        if self.frames < 8:
            raise ConfigError(f"--frames is {self.frames}; it must be 8 or more")


FLAGS = ObserveFlags


def main(argv: Sequence[str]) -> int:
    """Watch and print."""
    flags = parse(ObserveFlags, argv, prog="articulate observe")
    from articulate.video.observe import observe_joint
    from articulate.video.read_video import (  # OpenCV; --help does without
        VideoReadOptions,
        read_video,
    )

    clip = read_video(
        flags.clip, VideoReadOptions(longest_side_px=flags.side, most_frames=flags.frames)
    )
    console.show_progress(f"{flags.clip}: following points over {len(clip.frames)} frames")
    seen = observe_joint(clip, str(flags.clip))
    console.emit_json(seen.as_json()) if flags.json else console.emit(_told(seen))
    if seen.doubtful:
        console.show_progress(
            f"{flags.clip}: doubtful: what was measured lies next to the border between sliding "
            "and turning; a film from another side tells them apart"
        )
        return MISSED
    return 0


def _told(seen: Observation) -> str:
    x, y, z = seen.axis_c
    what = "slides along" if seen.kind == "prismatic" else "turns about"
    first, last = seen.path_px[0], seen.path_px[-1]
    return (
        f"{seen.kind}: a part {what} ({x:.2f}, {y:.2f}, {z:.2f}) (x right, y down, z ahead), "
        f"clear by {seen.confidence:.2f}\n"
        f"a point of it goes from ({first[0]:.0f}, {first[1]:.0f}) to ({last[0]:.0f}, "
        f"{last[1]:.0f}) px; what moves lies in columns {seen.box_px[0]:.0f} to "
        f"{seen.box_px[1]:.0f}, rows {seen.box_px[2]:.0f} to {seen.box_px[3]:.0f}"
    )
