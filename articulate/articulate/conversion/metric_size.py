"""Metric size: as the file says, by a table of categories, or as asked for."""

from __future__ import annotations

from pathlib import Path

from articulate.errors import ConfigError, nearest
from articulate.files import read_json_object
from articulate.formats.config import ConvertConfig

LONGEST_SIDE_M: dict[str, float] = {
    "StorageFurniture": 0.8,  # base cabinets and chests of drawers, 0.7 to 0.9 high
    "Table": 1.0,  # desks and side tables with drawers, 0.5 to 1.6 long
    "Refrigerator": 1.7,  # free-standing, 1.5 to 1.9 high
    "Dishwasher": 0.85,  # fits under a 0.9 counter
    "Oven": 0.85,  # range with oven, same counter height
    "WashingMachine": 0.85,  # same counter height
    "Microwave": 0.5,  # 0.45 to 0.55 wide
    "Laptop": 0.35,  # a 15 inch screen
    "Door": 2.05,  # leaf of 1.98 with its frame
    "Window": 1.2,  # a casement
    "Safe": 0.45,  # home safe
    "TrashCan": 0.5,  # kitchen bin
    "Box": 0.4,  # parcel
    "Suitcase": 0.65,  # medium
    "Kettle": 0.25,  # 1.7 litres with its handle
    "KitchenPot": 0.35,  # with both handles
    "CoffeeMachine": 0.35,  # counter-top
    "Toaster": 0.3,  # two slices
    "Faucet": 0.3,  # spout of a kitchen tap
    "Toilet": 0.75,  # close-coupled
    "Switch": 0.12,  # wall plate
    "Lamp": 0.5,  # desk lamp
    "Chair": 0.9,  # back height
    "FoldingChair": 0.9,  # back height
    "Display": 0.55,  # 24 inch monitor
    "Keyboard": 0.45,  # full size
    "Mouse": 0.12,  # computer mouse
    "Phone": 0.16,  # smartphone
    "Camera": 0.14,  # compact to SLR
    "Bottle": 0.25,  # 0.75 litres
    "Bucket": 0.35,  # 10 litres
    "Cart": 1.0,  # trolley
    "Clock": 0.3,  # wall clock
    "Dispenser": 0.2,  # soap
    "Eyeglasses": 0.15,  # width
    "Fan": 0.5,  # table fan
    "Globe": 0.35,  # with its stand
    "Knife": 0.22,  # folding knife open
    "Lighter": 0.08,  # pocket
    "Pen": 0.14,  # ball pen
    "Pliers": 0.2,  # combination
    "Printer": 0.45,  # desktop
    "Remote": 0.18,  # television
    "Scissors": 0.2,  # household
    "Stapler": 0.16,  # desktop
    "USB": 0.06,  # stick
}
"""Longest side [m] of the closed object by PartNet-Mobility category, with the reason."""
OTHER_M = 0.5
"""Longest side [m] of a normalised object of another category: something for a table top."""


def is_normalised(urdf: Path) -> bool:
    """Whether the object comes from a set that scales everything to one size.

    PartNet-Mobility's objects are called ``mobility.urdf``; where one was renamed, its
    ``meta.json`` still says the category.
    """
    category = read_json_object(urdf.parent / "meta.json").get("model_cat")
    return urdf.name == "mobility.urdf" or (isinstance(category, str) and bool(category))


def category_of(urdf: Path, config: ConvertConfig) -> str:
    """PartNet-Mobility's name of the category, or ``"unknown"``.

    It stands in PartNet-Mobility's ``meta.json``, or in a ``source.json`` beside the file.
    """
    if config.category:
        return config.category
    for name, key in (("meta.json", "model_cat"), ("source.json", "category")):
        found = read_json_object(urdf.parent / name).get(key)
        if isinstance(found, str) and found:
            return found
    return "unknown"


def check_category(name: str | None) -> None:
    """Refuse a category of which no table tells anything.

    Raises:
        ConfigError: ``name`` is none of PartNet-Mobility's.
    """
    if name not in {None, "unknown", *LONGEST_SIDE_M}:
        raise ConfigError(
            f"category {name!r} is none of PartNet-Mobility's; leave it out for other objects"
            f"{nearest(str(name), LONGEST_SIDE_M)}"
        )


def scale_of(urdf: Path, config: ConvertConfig, longest: float) -> tuple[float, str]:
    """Factor from units of the source to metres, and the sentence that says why.

    Args:
        urdf: File that was read.
        config: What was asked for.
        longest: Longest side of the closed object in units of the source.
    """
    if config.size_m is not None:
        return config.size_m / longest, f"longest side {config.size_m:g} m as asked for"
    category = category_of(urdf, config)
    if is_normalised(urdf):
        size = LONGEST_SIDE_M.get(category, OTHER_M)
        return size / longest, f"normalised source; longest side of a {category} is {size:g} m"
    return 1.0, f"metric as it is (longest side {longest:.3g} m)"
