"""``articulate watch``: show an episode of a policy."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError, UsageError

if TYPE_CHECKING:
    from articulate.render.playback import EpisodePlayback

GROUP = "articulate.watchers"
"""Entry points by kind of source: functions ``(path, seed, episode, randomise)``."""
SUFFIXES = (".mp4", ".rrd")


@dataclass(frozen=True, kw_only=True)
class WatchFlags:
    """Show an episode of a policy: a video, a recording for rerun, or MuJoCo's window.

    Example: articulate watch runs/cabinet --episode 3
    """

    source: Annotated[Path, POSITIONAL]
    """Folder of a run, or a bundle."""
    seed: int | None = None
    """Seed of the run; by default the best. A bundle holds one policy."""
    episode: int = 0
    """Index of the episode; the same index gives the same episode."""
    randomise: bool = True
    """Sample parameters as in training."""
    out: Path | None = None
    """File to write, .mp4 or .rrd; by default watched/<name>-<time>.mp4. Nothing is overwritten."""
    viewer: bool = False
    """Open MuJoCo's window instead; needs a display."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if self.episode < 0:
            raise ConfigError(f"--episode is {self.episode}; it must be 0 or more")
        if self.out is None:
            return
        if self.viewer:
            raise ConfigError("--viewer writes no file; omit it or --out")
        if self.out.suffix.lower() not in SUFFIXES:
            raise ConfigError(f"--out is {str(self.out)!r}; it must end in {' or '.join(SUFFIXES)}")
        if self.out.exists():
            raise ConfigError(f"{self.out}: exists; choose another --out")


FLAGS = WatchFlags


def main(argv: Sequence[str]) -> int:
    """Run an episode, write or show it, and print its outcome."""
    flags = parse(WatchFlags, argv, prog="articulate watch")
    kind = kind_of(flags.source)
    if kind == "bundle" and flags.seed is not None:
        raise ConfigError(f"{flags.source}: a bundle holds one policy; omit --seed")
    play = _acted(kind, flags)
    file = None if flags.viewer else _written(play, flags)
    if file is None:
        from articulate.render.playback import show_in_viewer  # MuJoCo; --help does without

        show_in_viewer(play)
    content = _content(play, flags.source, file)
    where = "" if file is None else f"{file}: "
    opened = f"{content['opened']:.0%} of the way"
    text = f"{where}{play.title}, {play.reason}, {opened} after {content['seconds']:g} s"
    console.emit_json(content) if flags.json else console.emit(text)
    return 0


def kind_of(source: Path) -> str:
    """Return the kind of ``source``: ``run`` or ``bundle``.

    Raises:
        UsageError: It is neither.
    """
    if (source / "scene.json").is_file():
        return "run"
    if source.is_file() or (source / "manifest.json").is_file():
        return "bundle"
    what = "neither a run nor a bundle" if source.exists() else "does not exist"
    raise UsageError(
        f"{source}: {what}; give a folder that train made, or a bundle that export-policy made"
    )


def _acted(kind: str, flags: WatchFlags) -> EpisodePlayback:
    """Run one episode with the package for this kind of source."""
    found = [entry for entry in metadata.entry_points(group=GROUP) if entry.name == kind]
    if not found:
        raise UsageError(f"{flags.source}: no installed package can watch a {kind}; reinstall it")
    act: Any = found[0].load()
    play: EpisodePlayback = act(
        flags.source, seed=flags.seed, episode=flags.episode, randomise=flags.randomise
    )
    return play


def _written(play: EpisodePlayback, flags: WatchFlags) -> Path:
    from articulate.render.playback import write_rerun  # MuJoCo; --help does without

    if flags.out is not None and flags.out.suffix.lower() == ".rrd":
        return write_rerun(flags.out, play)
    name = f"{flags.source.resolve().stem}-{time.strftime('%Y%m%d-%H%M%S')}"
    return play.write_video(flags.out or Path("watched") / f"{name}.mp4")


def _content(play: EpisodePlayback, source: Path, file: Path | None) -> dict[str, Any]:
    return {
        "source": str(source),
        "file": None if file is None else str(file),
        "title": play.title,
        "reason": play.reason,
        "opened": float(play.curves["opened"][-1]),
        "seconds": round(len(play.qpos) * play.step_s, 6),
    }
