"""Protocol of a source of objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from articulate.library.partnet import PartNetLibrary
from articulate.library.procedural.library import ProceduralLibrary


class Library(Protocol):
    """Source of articulated objects, each with an id and written as a URDF."""

    @property
    def source(self) -> str:
        """Origin of the objects, for ``Asset.source``."""
        ...

    @property
    def licence(self) -> str:
        """Licence of the objects, inherited by everything made from them."""
        ...

    def ids(self) -> Sequence[str]:
        """Return the ids of all objects, in a fixed order."""
        ...

    def category(self, object_id: str) -> str:
        """Return PartNet-Mobility's name of the category, ``"unknown"`` without one.

        Raises:
            AssetError: The object does not exist.
        """
        ...

    def write(self, object_id: str, folder: Path) -> Path:
        """Write the object into ``folder`` and return the path of its URDF.

        Raises:
            AssetError: The object does not exist.
        """
        ...


def open_library(folder: Path | None = None) -> Library:
    """Open the objects of PartNet-Mobility in ``folder``; without a folder the procedural ones.

    Raises:
        UsageError: ``folder`` contains no object.
    """
    return ProceduralLibrary() if folder is None else PartNetLibrary(folder)
