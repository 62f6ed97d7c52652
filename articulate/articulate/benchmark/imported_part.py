"""Parts and joints of another method's output, in the frame of that output."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from articulate.errors import AssetError
from articulate.reconstruct.actors.protocol import JointKind
from articulate.transforms import Array

Reason = Literal["syntax", "repeated_link", "cycle"]
"""Kinds of invalid outputs that the publication counts."""
REASONS: tuple[Reason, ...] = ("syntax", "repeated_link", "cycle")
MAX_BYTES = 5_000_000
"""Largest file of predictions of one object."""
MAX_PARTS = 500
"""Most parts of one object."""


class InvalidOutputError(AssetError):
    """An output describes no tree of links."""

    def __init__(self, reason: Reason, path: Path, message: str) -> None:
        super().__init__(f"{path.name}: {reason.replace('_', ' ')}: {message}")
        self.reason = reason


@dataclass(frozen=True, kw_only=True, eq=False)
class ImportedPart:
    """A link and the joint that moves it, every joint at 0."""

    name: str
    corners: Array
    """Corners of its box (8, 3) in the frame of the output."""
    kind: JointKind = "fixed"
    axis: Array | None = None
    """Direction of the joint (3,); None for fixed parts."""
    pivot: Array | None = None
    """Point on the axis (3,); None for fixed parts."""
    lower: float | None = None
    upper: float | None = None
    box_px: tuple[float, float, float, float] | None = None
    """Row, column, height and width of the part in the image, as shares of its height and width;
    None if unknown."""


def box_corners(low: Array, high: Array) -> Array:
    """Return the corners (8, 3) of a box from its lowest and highest corner (3,)."""
    grid = np.array(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij")).reshape(3, -1).T
    return np.asarray(low + grid * (high - low))
