"""What an asset was made from, as far as a proof compares the two."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.checks.forward_kinematics import InputFrame
from articulate.conversion.convert import Reading, placement_of
from articulate.formats.config import ConvertConfig
from articulate.formats.load_meshes import PartGeometry
from articulate.transforms import Array


@dataclass(frozen=True, kw_only=True)
class Origin:
    """The input of an asset."""

    source: Path
    """URDF or MJCF file."""
    frame: InputFrame
    root: str
    """Part that does not move."""
    shown: Mapping[str, tuple[Array, ...]]
    """Triangles (F, 3, 3) of each piece that a part shows, in metres; the root's in the object
    frame, those of the others in their own."""


def origin_of_reading(reading: Reading, config: ConvertConfig) -> Origin:
    """The input that was read, placed as ``config`` asks for."""
    place = placement_of(reading, config)
    shown = {}
    for part in reading.parts:
        geometry = reading.geometry[part.name].scaled(place.scale)
        if part.joint is None:
            T_sp = np.array(part.T_sp)
            T_sp[:3, 3] *= place.scale
            geometry = geometry.moved(place.T_os @ T_sp)
        shown[part.name] = _triangles(geometry)
    return Origin(
        source=reading.source.path,
        frame=InputFrame(scale=place.scale, T_os=place.T_os),
        root=reading.parts[0].name,
        shown=shown,
    )


def _triangles(geometry: PartGeometry) -> tuple[Array, ...]:
    return tuple(np.asarray(piece.mesh.triangles, dtype=np.float64) for piece in geometry.shown)
