"""Object that a text, an image or a video describes, before it is checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from articulate.library.procedural.materials import PALETTE, Material
from articulate.library.procedural.urdf import Part
from articulate.reconstruct.actors.protocol import TraceStep

Source = Literal["text", "image", "video", "category"]
"""Origin of a joint; ``category``: it was not observed, objects of the category have it."""


@dataclass(frozen=True, kw_only=True)
class ObjectProposal:
    """Generated object and the reasons for it."""

    name: str
    """Name of the object and of its URDF."""
    category: str
    """PartNet-Mobility's name of the category."""
    parts: tuple[Part, ...]
    """Links, parents before children; z up, the front towards -x, on z = 0 [m]."""
    palette: Mapping[str, Material] = field(default_factory=lambda: PALETTE)
    """Materials by name."""
    confidence: float
    """Calibrated probability that category, parts and joints are those of the query, in [0, 1]."""
    evidence: Mapping[str, Source]
    """Origin of each joint, by the name of the link that it moves."""
    assumptions: tuple[str, ...] = ()
    """Values that the query does not give, and where they come from."""
    doubts: tuple[str, ...] = ()
    """Reasons why the object may not be the intended one; each makes the result doubtful."""
    trace: tuple[TraceStep, ...] = ()
    """Stages of the reconstruction, for the trace page."""
