"""Printable sheets: markers and calibration boards in exact sizes, with a ruler, as PDF."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.errors import ConfigError, MissingError
from articulate.markers.charuco import Board
from articulate.markers.layout import DICTIONARIES, dictionary_size

PAPERS_MM = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
"""Width and height of papers [mm]."""
MARGIN_MM = 12.0
"""Margin that printers leave white [mm]."""
FOOT_MM = 26.0
"""Height of the ruler and its text [mm]."""
RULER_MM = 100.0
"""Length of the ruler [mm]."""
LABEL_MM = 6.0
"""Height of the text below a marker [mm]."""
Pixels = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Print:
    """One marker or board on a page."""

    pattern: Pixels
    """Modules (H, W), 0 black and 255 white."""
    left_mm: float
    """Left edge from the left edge of the page [mm]."""
    bottom_mm: float
    """Lower edge from the lower edge of the page [mm]."""
    width_mm: float
    """Width [mm]."""
    height_mm: float
    """Height [mm]."""
    label: str
    """Text below it."""


def marker_pages(
    ids: Sequence[int], size_mm: float, dictionary: str, paper: str
) -> list[list[Print]]:
    """Return the prints of each page, with a white margin around every marker.

    Args:
        ids: Identifiers of the markers.
        size_mm: Side of the black square [mm].
        dictionary: Dictionary of the markers.
        paper: One of :data:`PAPERS_MM`.

    Raises:
        ConfigError: An identifier is not in the dictionary, or a marker does not fit on the paper.
    """
    count, modules = dictionary_size(dictionary), DICTIONARIES[dictionary][2]
    for number in ids:
        if not 0 <= number < count:
            raise ConfigError(
                f"marker {number}: dictionary {dictionary} has markers 0 to {count - 1}"
            )
    width, height = PAPERS_MM[paper]
    cell = size_mm * (modules + 4) / (modules + 2)
    columns = int((width - 2 * MARGIN_MM) // cell)
    rows = int((height - 2 * MARGIN_MM - FOOT_MM) // (cell + LABEL_MM))
    if not (size_mm > 0.0 and columns > 0 and rows > 0):
        raise ConfigError(f"a marker of {size_mm:g} mm does not fit on {paper} paper")
    pages: list[list[Print]] = []
    name = DICTIONARIES[dictionary][0]
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    for k, number in enumerate(ids):
        at = k % (columns * rows)
        if at == 0:
            pages.append([])
        row, column = divmod(at, columns)
        pattern = cv2.aruco.generateImageMarker(known, number, modules + 2)
        pages[-1].append(
            Print(
                np.asarray(pattern, dtype=np.uint8),
                MARGIN_MM + (column + 0.5) * cell - 0.5 * size_mm,
                height - MARGIN_MM - row * (cell + LABEL_MM) - 0.5 * (cell + size_mm),
                size_mm,
                size_mm,
                f"{dictionary} id {number}, {size_mm:g} mm",
            )
        )
    return pages


def board_pages(board: Board, paper: str) -> list[list[Print]]:
    """Return the page of a calibration board.

    Raises:
        ConfigError: The board does not fit on the paper.
    """
    width, height = PAPERS_MM[paper]
    square = 1000.0 * board.square_m
    wide, high = board.columns * square, board.rows * square
    turned = wide > width - 2 * MARGIN_MM
    w, h = (high, wide) if turned else (wide, high)
    if w > width - 2 * MARGIN_MM or h > height - 2 * MARGIN_MM - FOOT_MM:
        raise ConfigError(
            f"a board of {wide:g}x{high:g} mm does not fit on {paper} paper; print smaller or "
            "fewer squares"
        )
    px = 60
    pattern = board.opencv().generateImage((board.columns * px, board.rows * px), marginSize=0)
    pattern = np.rot90(pattern) if turned else pattern
    label = (
        f"ChArUco {board.columns}x{board.rows}, squares {square:g} mm, markers "
        f"{1000.0 * board.marker_m:g} mm, {board.dictionary}"
    )
    page = Print(
        np.asarray(pattern, dtype=np.uint8),
        0.5 * (width - w),
        height - MARGIN_MM - h,
        w,
        h,
        label,
    )
    return [[page]]


def pdf_of(pages: Sequence[Sequence[Print]], paper: str) -> bytes:
    """Return pages as PDF in exact sizes, each with a ruler of 100 mm.

    Raises:
        MissingError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_pdf import PdfPages
        from matplotlib.figure import Figure
    except ModuleNotFoundError:
        raise MissingError(
            'printing needs matplotlib: pip install "articulate-robots[markers]"'
        ) from None
    width, height = PAPERS_MM[paper]
    stream = io.BytesIO()
    # Without a date the same call gives the same bytes.
    with (
        mpl.rc_context({"pdf.fonttype": 42}),
        PdfPages(stream, metadata={"CreationDate": None}) as pdf,
    ):
        for prints in pages:
            figure = Figure(figsize=(width / 25.4, height / 25.4))
            axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
            axes.set_axis_off()
            for item in prints:
                right, top = item.left_mm + item.width_mm, item.bottom_mm + item.height_mm
                axes.imshow(
                    item.pattern,
                    cmap="gray",
                    vmin=0,
                    vmax=255,
                    interpolation="none",
                    extent=(item.left_mm, right, item.bottom_mm, top),
                )
                below = item.bottom_mm - 0.5 * LABEL_MM
                axes.text(item.left_mm, below, item.label, fontsize=6, va="top")
            _ruler(axes)
            axes.set_xlim(0.0, width)
            axes.set_ylim(0.0, height)
            axes.set_aspect("equal")
            pdf.savefig(figure)
    return stream.getvalue()


def _ruler(axes: object) -> None:
    """Add a ruler at the foot of a page."""
    plot = axes.plot  # type: ignore[attr-defined]  # matplotlib has no stubs
    y = MARGIN_MM + 8.0
    plot([MARGIN_MM, MARGIN_MM + RULER_MM], [y, y], color="black", linewidth=0.5)
    for k in range(11):
        x = MARGIN_MM + 10.0 * k
        plot([x, x], [y, y + (4.0 if k % 5 == 0 else 2.5)], color="black", linewidth=0.5)
    axes.text(  # type: ignore[attr-defined]
        MARGIN_MM,
        y - 2.0,
        "Print at 100 %, without scaling. This ruler must measure 100 mm; if not, use the measured "
        "sizes.",
        fontsize=6,
        va="top",
    )
