"""``articulate studio``: a local page in which a person corrects a reconstructed object."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from articulate.cache import cache_folder, cache_in_use
from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError

MOST_PORT = 65535
SLACK_S = 0.2
"""Interval in which the server looks for an interrupt [s]."""


@dataclass(frozen=True, kw_only=True)
class StudioFlags:
    """View and correct an object in a local page: joints, limits, size, parts.

    Only this machine can open the page, with the address that is printed. Ctrl+C ends it.

    Example: articulate studio made/cabinet
    """

    source: Annotated[Path, POSITIONAL]
    """Folder of articulate make, asset folder, or URDF."""
    out: Path | None = None
    """Folder of the export; by default <source>-edited. An earlier asset there is replaced."""
    input: Path | None = None
    """Video or image to show beside the object; by default the images of its trace."""
    port: int = 0
    """Port; 0 chooses a free one."""
    browser: bool = True
    """Open the page in the browser."""
    limit: float = 300.0
    """Time limit of the checks [s]."""

    def __post_init__(self) -> None:
        """Check the values of the flags."""
        if not 0 <= self.port <= MOST_PORT:
            raise ConfigError(f"--port is {self.port}; it must be 0 to {MOST_PORT}")
        if not 0.0 < self.limit <= 1e6:
            raise ConfigError(f"--limit is {self.limit:g} s; it must be above 0, at most 1000000")


FLAGS = StudioFlags


def main(argv: Sequence[str]) -> int:
    """Serve the page until it is interrupted."""
    flags = parse(StudioFlags, argv, prog="articulate studio")
    return serve(flags)


def serve(flags: StudioFlags) -> int:
    """Serve the page of an object until an interrupt.

    Raises:
        UsageError: The object cannot be read, or the port is in use.
    """
    # These read meshes, which --help does without.
    from articulate.studio.checker import Checker
    from articulate.studio.server import StudioServer
    from articulate.studio.session import Session
    from articulate.studio.source import read_studio_source

    source = read_studio_source(flags.source, flags.input)
    cache = cache_folder()
    with cache_in_use(cache):
        checker = Checker(cache, flags.limit, dict(source.licence))
        try:
            session = Session(
                source=source, out=flags.out or default_out(flags.source), checker=checker
            )
            with StudioServer(session, flags.port) as server:
                console.emit(server.url)
                console.show_progress("the page is open until Ctrl+C")
                if flags.browser:
                    webbrowser.open(server.url)
                try:
                    server.serve_forever(SLACK_S)
                except KeyboardInterrupt:
                    if not session.exported and session.edits:
                        console.show_progress(f"not exported; kept in {session.autosave}")
        finally:
            checker.close()
    return 0


def default_out(source: Path) -> Path:
    """Return the folder beside ``source`` that an export is written to."""
    path = source.resolve()
    return path.parent / f"{path.name if path.is_dir() else path.stem}-edited"
