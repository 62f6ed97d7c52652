"""Cabinets: drawers and doors in a carcass, from a seed and dimensions.

The object frame has its origin on the floor under the middle of the cabinet, z up. The front
faces -x: drawers open along -x, doors swing out that way. Drawers are numbered from the top,
doors from the left as seen from the front (from +y).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal, cast

import numpy as np

from articulate.errors import ConfigError, nearest
from articulate.files import write_json
from articulate.library.procedural.cabinet_parts import MATERIALS, CabinetSize, cabinet_parts
from articulate.library.procedural.urdf import write_urdf

Arrangement = Literal["drawers_above", "doors_above", "beside"]
HandleKind = Literal["bar", "knob"]
ARRANGEMENTS: tuple[Arrangement, ...] = ("drawers_above", "doors_above", "beside")
HANDLES: tuple[HandleKind, ...] = ("bar", "knob")

EMBEDDED = CabinetSize(
    width_m=0.45,
    depth_m=0.42,
    height_m=0.60,
    n_drawers=3,
    n_doors=0,
    arrangement="drawers_above",
    panel_m=0.016,
    handle="bar",
    handle_length_m=0.12,
    handle_thickness_m=0.012,
    handle_clear_m=0.038,
    travel_share=0.75,
    density_kg_m3=650.0,
)
"""The cabinet of the examples: an office pedestal of three drawers with bar handles."""

_ACCEPTED = {
    "width_m": (0.2, 2.0),
    "depth_m": (0.2, 1.0),
    "height_m": (0.2, 2.2),
    "n_drawers": (0, 8),
    "n_doors": (0, 2),
    "panel_m": (0.008, 0.03),
    "handle_length_m": (0.02, 0.6),
    "handle_thickness_m": (0.006, 0.05),
    "handle_clear_m": (0.01, 0.08),
    "travel_share": (0.1, 0.95),
    "density_kg_m3": (50.0, 3000.0),
}
"""Lowest and highest value accepted of each number."""


@dataclass(frozen=True, kw_only=True)
class CabinetConfig:
    """Dimensions of a cabinet. Fields that are None are sampled from the range in their docstring.

    With seed 0 they are those of ``EMBEDDED``, so that ``CabinetConfig()`` is the cabinet of the
    examples. The sample of a field does not depend on the other fields, except where the docstring
    states that one bounds the other.
    """

    seed: int = 0
    """Seed of the sampled fields, at least 0."""
    width_m: float | None = None
    """Width along y [m]; sampled from 0.35 to 0.65, 0.30 more with doors beside drawers."""
    depth_m: float | None = None
    """Depth along x without handles [m]; sampled from 0.36 to 0.55."""
    height_m: float | None = None
    """Height [m]; sampled from 0.45 to 0.80, more where the fronts would be under 0.15 high."""
    n_drawers: int | None = None
    """Number of drawers; sampled from 1 to 4."""
    n_doors: int | None = None
    """Number of doors, at most 2; sampled from 0 to 2, from 1 to 2 if there are no drawers."""
    arrangement: Arrangement | None = None
    """Position of the drawers relative to the doors; sampled; ``beside``: drawers on the left."""
    panel_m: float | None = None
    """Thickness of carcass and fronts [m]; sampled from 0.015 to 0.020."""
    handle: HandleKind | None = None
    """Kind of all handles; sampled, three bars to one knob."""
    handle_length_m: float | None = None
    """Length of a bar [m]; sampled from 0.10 to 0.18 and at most what the fronts hold."""
    handle_thickness_m: float | None = None
    """Side of a bar or of a knob's head [m]; bars 0.010 to 0.016, knobs 0.024 to 0.034."""
    handle_clear_m: float | None = None
    """Free space between front and handle [m]; bars 0.034 to 0.042, knobs 0.018 to 0.026."""
    travel_share: float | None = None
    """Travel of a drawer over the length of its tray; sampled from 0.65 to 0.80."""
    density_kg_m3: float | None = None
    """Density of the board [kg/m^3]; sampled from 550 to 750 (chipboard to MDF)."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"cabinet.seed is {self.seed}; it must be at least 0")
        for name, known in (("arrangement", ARRANGEMENTS), ("handle", HANDLES)):
            value = getattr(self, name)
            if value is not None and value not in known:
                raise ConfigError(f"cabinet.{name} is {value!r}{nearest(str(value), known)}")
        for name, (low, high) in _ACCEPTED.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ConfigError(f"cabinet.{name} is {value}; it must be in [{low}, {high}]")
        if self.n_drawers == 0 and self.n_doors == 0:
            raise ConfigError("cabinet has n_drawers 0 and n_doors 0; give it one or the other")

    def size(self) -> CabinetSize:
        """Return every dimension, sampled where it is None.

        Raises:
            ConfigError: The dimensions leave no room for the fronts or their handles.
        """
        fixed = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "seed"}
        fixed = {name: value for name, value in fixed.items() if value is not None}
        sampled = _embedded() if self.seed == 0 else _sampled(self.seed, fixed)
        size = CabinetSize(**(sampled | fixed))
        _check_fronts(size)
        if "handle_length_m" not in fixed:
            size = size.with_handle_length(min(size.handle_length_m, size.longest_handle_m))
        _check_handles(size)
        return size


def write_cabinet(config: CabinetConfig, folder: Path) -> Path:
    """Write the URDF, ``meshes/`` and ``source.json`` into ``folder``; return the URDF's path.

    The same configuration gives the same bytes.
    """
    path = write_urdf("cabinet", cabinet_parts(config.size()), folder, MATERIALS)
    origin = {"source": f"procedural cabinet, seed {config.seed}", "licence": "MIT"}
    write_json(folder / "source.json", {**origin, "category": "StorageFurniture"})
    return path


def embedded_cabinet(folder: Path) -> Path:
    """Write the cabinet of the examples into ``folder``; return the path of its URDF."""
    return write_cabinet(CabinetConfig(), folder)


def embedded_door_cabinet(folder: Path) -> Path:
    """Write the same cabinet with one drawer above two doors; return the path of its URDF."""
    return write_cabinet(CabinetConfig(n_drawers=1, n_doors=2), folder)


def _embedded() -> dict[str, float | int | str]:
    return {f.name: getattr(EMBEDDED, f.name) for f in fields(EMBEDDED)}


def _sampled(seed: int, fixed: dict[str, float | int | str]) -> dict[str, float | int | str]:
    """Sample every field, also those that are fixed."""
    share: Iterator[float] = iter(np.random.default_rng(seed).random(len(fields(CabinetSize))))

    def between(low: float, high: float) -> float:
        return round(low + (high - low) * float(next(share)), 3)

    n_drawers = int(fixed.get("n_drawers", 1 + int(4 * next(share))))
    doors_low = 0 if n_drawers else 1
    n_doors = int(fixed.get("n_doors", doors_low + int((3 - doors_low) * next(share))))
    arrangement = fixed.get("arrangement", ARRANGEMENTS[int(3 * next(share))])
    beside = arrangement == "beside" and n_drawers > 0 and n_doors > 0
    stacked = n_drawers > 0 and n_doors > 0 and not beside
    handle = cast(HandleKind, fixed.get("handle", HANDLES[int(next(share) > 0.75)]))
    bar = handle == "bar"
    height_low = max(0.45, 0.15 * n_drawers + 0.06 + (0.3 if stacked else 0.0))
    wider = 0.30 if beside else 0.0
    return {
        "n_drawers": n_drawers,
        "n_doors": n_doors,
        "arrangement": arrangement,
        "handle": handle,
        "width_m": between(0.35 + wider, 0.65 + wider),
        "depth_m": between(0.36, 0.55),
        "height_m": between(height_low, max(0.80, height_low + 0.1)),
        "panel_m": between(0.015, 0.020),
        "handle_length_m": between(0.10, 0.18),
        "handle_thickness_m": between(0.010, 0.016) if bar else between(0.024, 0.034),
        "handle_clear_m": between(0.034, 0.042) if bar else between(0.018, 0.026),
        "travel_share": between(0.65, 0.80),
        "density_kg_m3": between(550.0, 750.0),
    }


def _check_fronts(size: CabinetSize) -> None:
    for bay in size.bays():
        if min(bay.width_m, bay.height_m) < 0.08:
            raise ConfigError(
                f"cabinet of {size.width_m} x {size.height_m} m leaves {bay.name} a front of "
                f"{bay.width_m:.3f} x {bay.height_m:.3f} m; at least 0.08 m each way is needed: "
                f"make it larger or give it fewer drawers and doors"
            )


def _check_handles(size: CabinetSize) -> None:
    if size.handle == "bar" and size.handle_length_m > size.longest_handle_m:
        raise ConfigError(
            f"cabinet.handle_length_m is {size.handle_length_m}; the fronts of this cabinet hold "
            f"at most {size.longest_handle_m:.3f}"
        )
