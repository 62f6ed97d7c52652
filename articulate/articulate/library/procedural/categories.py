"""All categories of the procedural library, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from articulate.errors import AssetError, nearest
from articulate.files import write_json
from articulate.library.procedural.bottle import Bottle
from articulate.library.procedural.box_with_lid import BoxWithLid
from articulate.library.procedural.bucket import Bucket
from articulate.library.procedural.cabinet import CabinetConfig
from articulate.library.procedural.cabinet_parts import MATERIALS, cabinet_parts
from articulate.library.procedural.chest_of_drawers import ChestOfDrawers
from articulate.library.procedural.dimensions import Dimensions
from articulate.library.procedural.dishwasher import Dishwasher
from articulate.library.procedural.door import Door
from articulate.library.procedural.faucet import Faucet
from articulate.library.procedural.fridge import Fridge
from articulate.library.procedural.kettle import Kettle
from articulate.library.procedural.kitchen_pot import KitchenPot
from articulate.library.procedural.laptop import Laptop
from articulate.library.procedural.materials import PALETTE, Material
from articulate.library.procedural.microwave import Microwave
from articulate.library.procedural.office_chair import OfficeChair
from articulate.library.procedural.oven import Oven
from articulate.library.procedural.safe import Safe
from articulate.library.procedural.sliding_window import SlidingWindow
from articulate.library.procedural.suitcase import Suitcase
from articulate.library.procedural.switch import Switch
from articulate.library.procedural.table_with_drawers import TableWithDrawers
from articulate.library.procedural.toilet import Toilet
from articulate.library.procedural.trash_can import TrashCan
from articulate.library.procedural.urdf import Part, write_urdf
from articulate.library.procedural.washing_machine import WashingMachine

LICENCE = "MIT"
"""Licence of all generated objects."""


@dataclass(frozen=True, kw_only=True)
class Category:
    """Generator of one category."""

    partnet: str
    """PartNet-Mobility's name of the category."""
    parts: Callable[[int], list[Part]]
    """Links of the object of a seed, parents before children."""
    dimensions: type[Dimensions] | None = None
    """Its dimensions with their ranges; a cabinet has a separate configuration."""
    palette: Mapping[str, Material] = field(default_factory=lambda: PALETTE)
    """Materials by name."""


def _of(dimensions: type[Dimensions]) -> Category:
    return Category(
        partnet=dimensions.category,
        parts=lambda seed: dimensions.sample(seed).parts(),
        dimensions=dimensions,
    )


CATEGORIES: dict[str, Category] = {
    "cabinet": Category(
        partnet="StorageFurniture",
        parts=lambda seed: cabinet_parts(CabinetConfig(seed=seed).size()),
        palette=MATERIALS,
    ),
    "chest_of_drawers": _of(ChestOfDrawers),
    "table_with_drawers": _of(TableWithDrawers),
    "box_with_lid": _of(BoxWithLid),
    "fridge": _of(Fridge),
    "microwave": _of(Microwave),
    "oven": _of(Oven),
    "dishwasher": _of(Dishwasher),
    "washing_machine": _of(WashingMachine),
    "toilet": _of(Toilet),
    "door": _of(Door),
    "sliding_window": _of(SlidingWindow),
    "office_chair": _of(OfficeChair),
    "safe": _of(Safe),
    "suitcase": _of(Suitcase),
    "laptop": _of(Laptop),
    "trash_can": _of(TrashCan),
    "bucket": _of(Bucket),
    "bottle": _of(Bottle),
    "kettle": _of(Kettle),
    "kitchen_pot": _of(KitchenPot),
    "faucet": _of(Faucet),
    "switch": _of(Switch),
}
"""Categories by the first part of an object's id."""


def category_named(name: str) -> Category:
    """Return the category called ``name``.

    Raises:
        AssetError: There is none; the message gives the nearest.
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
    path = write_urdf(name, parts, folder, category.palette)
    origin = {"source": f"procedural {name}, seed {seed}", "licence": LICENCE}
    write_json(folder / "source.json", {**origin, "category": category.partnet})
    return path
