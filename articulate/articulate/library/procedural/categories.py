"""All categories of the procedural library, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from articulate.errors import AssetError, nearest
from articulate.files import write_json
from articulate.library.procedural.box_with_lid import BoxWithLid
from articulate.library.procedural.cabinet import CabinetConfig
from articulate.library.procedural.cabinet_parts import COLOURS, cabinet_parts
from articulate.library.procedural.dimensions import Dimensions
from articulate.library.procedural.urdf import Colour, Part, write_urdf

LICENCE = "MIT"
"""Licence of everything that is made here."""


@dataclass(frozen=True, kw_only=True)
class Category:
    """What is made under one name."""

    partnet: str
    """PartNet-Mobility's name of the category."""
    parts: Callable[[int], list[Part]]
    """Links of the object of a seed, parents before children."""
    colours: Mapping[str, Colour]
    """Red, green, blue and opacity of each material."""


def _of(dimensions: type[Dimensions]) -> Category:
    return Category(
        partnet=dimensions.category,
        parts=lambda seed: dimensions.sample(seed).parts(),
        colours=dimensions.colours,
    )


CATEGORIES: dict[str, Category] = {
    "cabinet": Category(
        partnet="StorageFurniture",
        parts=lambda seed: cabinet_parts(CabinetConfig(seed=seed).size()),
        colours=COLOURS,
    ),
    "box_with_lid": _of(BoxWithLid),
}
"""Categories by the first part of an object's id."""


def category_named(name: str) -> Category:
    """The category called ``name``.

    Raises:
        AssetError: There is none; the message says what is nearest.
    """
    if name not in CATEGORIES:
        raise AssetError(f"no procedural category {name!r}{nearest(name, CATEGORIES)}")
    return CATEGORIES[name]


def write_object(name: str, seed: int, folder: Path) -> Path:
    """Write the object of category ``name`` and ``seed`` into ``folder``; return its URDF.

    The same name and seed give the same bytes.

    Raises:
        AssetError: There is no such category.
    """
    category = category_named(name)
    parts: Sequence[Part] = category.parts(seed)
    path = write_urdf(name, parts, category.colours, folder)
    origin = {"source": f"procedural {name}, seed {seed}", "licence": LICENCE}
    write_json(folder / "source.json", {**origin, "category": category.partnet})
    return path
