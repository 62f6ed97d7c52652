"""Input of a conversion, for the checks that compare an asset with it."""

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
    """Input of an asset."""

    source: Path
    """URDF or MJCF file."""
    frame: InputFrame
    root: str
    """Part that does not move."""
    visuals: Mapping[str, tuple[Array, ...]]
    """Triangles (F, 3, 3) of the visual pieces of each part [m]; of the root in the object
    frame, of others in their link frames."""


def origin_of_reading(reading: Reading, config: ConvertConfig) -> Origin:
    """Return the input that was read, with the scale and frame of ``config``."""
    place = placement_of(reading, config)
    visuals = {}
    for part in reading.parts:
        geometry = reading.geometry[part.name].scaled(place.scale)
        if part.joint is None:
            T_sp = np.array(part.T_sp)
            T_sp[:3, 3] *= place.scale
            geometry = geometry.moved(place.T_os @ T_sp)
        visuals[part.name] = _triangles(geometry)
    return Origin(
        source=reading.source.path,
        frame=InputFrame(scale=place.scale, T_os=place.T_os),
        root=reading.parts[0].name,
        visuals=visuals,
    )


def _triangles(geometry: PartGeometry) -> tuple[Array, ...]:
    return tuple(np.asarray(piece.mesh.triangles, dtype=np.float64) for piece in geometry.visible)
