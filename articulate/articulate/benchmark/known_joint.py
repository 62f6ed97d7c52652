"""KnownJoint: a true joint as its source states it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from articulate.reconstruct.actors.protocol import JointKind

Status = Literal["plain", "frozen", "compound"]
"""``frozen``: fixed in the data set's URDF, though the object has it; ``compound``: the part turns
as well as slides, which no single joint tells."""


@dataclass(frozen=True, kw_only=True)
class KnownJoint:
    """A joint as a source states it: in the frame ``s`` of the URDF's root."""

    link: str
    kind: JointKind
    axis_s: tuple[float, float, float]
    origin_s: tuple[float, float, float]
    lower: float | None
    upper: float | None
    status: Status = "plain"
