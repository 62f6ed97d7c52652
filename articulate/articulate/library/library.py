"""What a source of objects offers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from articulate.library.partnet import PartNetLibrary
from articulate.library.procedural.library import ProceduralLibrary


class Library(Protocol):
    """A source of articulated objects, each known by an id and written out as a URDF."""

    @property
    def source(self) -> str:
        """Where the objects come from; goes into ``Asset.source``."""
        ...

    @property
    def licence(self) -> str:
        """Licence of the objects; what is made from them inherits it."""
        ...

    def ids(self) -> Sequence[str]:
        """Ids of all objects, in a fixed order."""
        ...

    def category(self, object_id: str) -> str:
        """PartNet-Mobility's name of the object's category, ``"unknown"`` if it has none.

        Raises:
            AssetError: There is no such object.
        """
        ...

    def write(self, object_id: str, folder: Path) -> Path:
        """Write the object into ``folder`` and return the path of its URDF.

        Raises:
            AssetError: There is no such object.
        """
        ...


def open_library(folder: Path | None = None) -> Library:
    """The objects of PartNet-Mobility in ``folder``; without a folder the procedural ones.

    Raises:
        UsageError: ``folder`` holds no object.
    """
    return ProceduralLibrary() if folder is None else PartNetLibrary(folder)
