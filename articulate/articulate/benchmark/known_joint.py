"""True joints as their source states them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from articulate.reconstruct.actors.protocol import JointKind

Status = Literal["plain", "frozen", "compound"]
"""``frozen``: fixed in the URDF of the data set although the object has the joint; ``compound``:
the part turns and slides, which no single joint describes."""


@dataclass(frozen=True, kw_only=True)
class KnownJoint:
    """A joint in the frame ``s`` of the URDF's root."""

    link: str
    kind: JointKind
    axis_s: tuple[float, float, float]
    origin_s: tuple[float, float, float]
    lower: float | None
    upper: float | None
    status: Status = "plain"
