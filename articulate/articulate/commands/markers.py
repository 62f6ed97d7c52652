"""``articulate markers``: printable markers and calibration boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from articulate.commands import console
from articulate.commands.flags import parse
from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class MarkersFlags:
    """Write markers or a calibration board as PDF, in exact sizes, with a ruler to check the print.

    Example: articulate markers --ids 0 1 --size-mm 40 --out markers.pdf
    """

    ids: tuple[int, ...] = (0, 1)
    """Identifiers of the markers."""
    size_mm: float = 40.0
    """Side of the black square of a marker [mm]."""
    dictionary: Literal["4x4_50", "5x5_100", "6x6_250", "apriltag_36h11"] = "4x4_50"
    """Dictionary of the markers."""
    board: bool = False
    """Write a ChArUco board for `articulate calibrate camera` instead."""
    columns: int = 5
    """Squares in a row of the board."""
    rows: int = 7
    """Squares in a column of the board."""
    square_mm: float = 35.0
    """Side of a square of the board [mm]."""
    board_marker_mm: float = 26.0
    """Side of a marker of the board [mm]."""
    paper: Literal["a4", "a3", "letter"] = "a4"
    """Size of the paper."""
    out: Path = Path("markers.pdf")
    """PDF file to write."""

    def __post_init__(self) -> None:
        if not self.ids:
            raise ConfigError("--ids: a value is missing; give the identifiers of the markers")
        if not 5.0 <= self.size_mm <= 250.0:
            raise ConfigError(f"--size-mm is {self.size_mm:g}; it must be in [5, 250] mm")


FLAGS = MarkersFlags


def main(argv: Sequence[str]) -> int:
    """Write the PDF."""
    flags = parse(MarkersFlags, argv, prog="articulate markers")
    from articulate.files import write_bytes
    from articulate.markers.charuco import Board
    from articulate.markers.sheets import board_pages, marker_pages, pdf_of

    if flags.board:
        board = Board(
            columns=flags.columns,
            rows=flags.rows,
            square_m=flags.square_mm / 1000.0,
            marker_m=flags.board_marker_mm / 1000.0,
            dictionary=flags.dictionary,
        )
        pages = board_pages(board, flags.paper)
    else:
        pages = marker_pages(flags.ids, flags.size_mm, flags.dictionary, flags.paper)
    write_bytes(flags.out, pdf_of(pages, flags.paper))
    count = f"{len(pages)} page{'s' * (len(pages) != 1)}"
    console.emit(f"{flags.out}: {count}; print at 100 % and check the ruler of 100 mm")
    return 0
