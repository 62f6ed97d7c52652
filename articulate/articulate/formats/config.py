"""Options of a conversion."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from articulate.errors import ConfigError, quote

ClosedChoice = Literal["auto", "lower", "upper", "zero"]

ACCEPTABLE = "authored_overlap"
"""The only check whose failure can be accepted; see :mod:`articulate.checks.accepted_overlap`."""


@dataclass(frozen=True, kw_only=True)
class ConvertConfig:
    """Options of reading and converting an object."""

    size_m: float | None = None
    """Longest side of the closed object [m]; None: by its category, or as in the file."""
    up: Literal["z", "y"] = "z"
    """Axis of the file that points up."""
    category: str | None = None
    """Category that decides presets; None: read from the source if it has one."""
    closed: ClosedChoice = "auto"
    """Closed position: a limit, or 0 inside the range; auto: the limit nearer to 0, and where 0
    is inside the range the position at which the part is most compact."""
    mesh_dirs: tuple[Path, ...] = ()
    """Further folders that are searched for meshes."""
    collada_up: Literal["auto", "file", "y"] = "auto"
    """Rotation of COLLADA meshes with z up: none, or to y up as Assimp does; auto: to y up where
    leaves would rotate in their plane otherwise."""
    allow_missing: bool = True
    """Continue without a missing mesh where its link has other geometry."""
    max_geoms: int = 48
    """Largest number of collision geoms of one link."""
    finer: tuple[str, ...] = ()
    """Links whose shapes may deviate half as far, and be twice as many; once more for each time a
    link is named."""
    decompose: bool = True
    """Decompose concave pieces; False: use their convex hulls."""
    decompose_s: float = 5.0
    """Time limit of one decomposition [s]."""
    cache_dir: Path | None = None
    """Cache folder of decompositions; None: no cache."""
    licence: str = "unknown"
    """Licence of the object."""
    accept: tuple[str, ...] = ()
    """Checks whose failure is a warning: ``authored_overlap`` or nothing."""
    name: str | None = None
    """Name of the asset; None: the name in the file."""

    def __post_init__(self) -> None:
        for check in self.accept:
            if check != ACCEPTABLE:
                raise ConfigError(f"accept is {quote(check)}; only {ACCEPTABLE} can be accepted")
        if self.size_m is not None and not 0.01 <= self.size_m <= 20.0:
            raise ConfigError(f"size is {self.size_m} m; it must lie in [0.01, 20]")
        if self.max_geoms < 1:
            raise ConfigError(f"max_geoms is {self.max_geoms}; it must be at least 1")
        if self.decompose_s <= 0.0:
            raise ConfigError(f"decompose_s is {self.decompose_s} s; it must be above 0")
