"""Objects made from a category and a seed, as a library."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from articulate.errors import AssetError
from articulate.library.procedural.categories import (
    CATEGORIES,
    LICENCE,
    category_named,
    write_object,
)

_ID = re.compile(r"(?P<name>[A-Za-z_]+)-(?P<seed>[0-9]{1,9})")


class ProceduralLibrary:
    """Objects ``<category>-<seed>`` such as ``box_with_lid-0003``: ``count`` of each category."""

    source = "procedural library"
    licence = LICENCE

    def __init__(self, count: int = 100) -> None:
        self.count = count

    def ids(self) -> Sequence[str]:
        """Ids of all objects, by category and seed."""
        return [f"{name}-{seed:04d}" for name in CATEGORIES for seed in range(self.count)]

    def category(self, object_id: str) -> str:
        """PartNet-Mobility's name of the object's category."""
        return category_named(self.parse(object_id)[0]).partnet

    def write(self, object_id: str, folder: Path) -> Path:
        """Write the object into ``folder`` and return the path of its URDF."""
        name, seed = self.parse(object_id)
        return write_object(name, seed, folder)

    def parse(self, object_id: str) -> tuple[str, int]:
        """Category and seed of an id; zeros before the seed may be left out.

        Raises:
            AssetError: There is no such object; the message names the nearest category.
        """
        found = _ID.fullmatch(object_id)
        if found is None:
            category_named(object_id)  # the commonest slip is another name
            raise AssetError(
                f"{object_id!r} names no object; give a seed as well: {object_id}-0000"
            )
        category_named(found["name"])
        seed = int(found["seed"])
        if seed >= self.count:
            raise AssetError(
                f"no object {object_id!r} in the procedural library; "
                f"seeds of {found['name']} go from 0 to {self.count - 1}"
            )
        return found["name"], seed
