"""Metric size of an object: from its file, by its category, or as requested."""

from __future__ import annotations

from pathlib import Path

from articulate.errors import AssetError, ConfigError, nearest
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
"""Longest side [m] of a normalised object of another category: a table-top object."""
UNITS_M = {"mm": 0.001, "cm": 0.01, "inch": 0.0254}
"""Units that files use instead of metres [m]."""
LEAST_M = 0.005
"""Shortest object [m] that is read as metric."""
MOST_M = 8.0
"""Longest object [m] that is read as metric: a car is 4 m long, a wall of cabinets 6 m."""
UNLIKELY_M = 25.0
"""Longest side [m] above which the unit of an object of unknown category is guessed."""
LIKELY_M = (0.1, 3.0)
"""Longest side [m] of an object of unknown category in the guessed unit."""
LIKELY_FACTOR = 3.0
"""Largest factor between the size of an object and that of its category."""
DOUBTFUL_FACTOR = 12.0
"""Factor to the size of the category above which a file is not metric; an inch is 39 per metre."""


def is_normalised(urdf: Path) -> bool:
    """Return whether the object comes from a data set that scales all objects to one size.

    PartNet-Mobility's objects are called ``mobility.urdf``; ``meta.json`` beside a renamed one
    has their category.
    """
    category = read_json_object(urdf.parent / "meta.json").get("model_cat")
    return urdf.name == "mobility.urdf" or (isinstance(category, str) and bool(category))


def category_of(urdf: Path, config: ConvertConfig) -> str:
    """Return PartNet-Mobility's name of the category, or ``"unknown"``.

    It is read from PartNet-Mobility's ``meta.json`` or from a ``source.json`` beside the file.
    """
    if config.category:
        return config.category
    for name, key in (("meta.json", "model_cat"), ("source.json", "category")):
        found = read_json_object(urdf.parent / name).get(key)
        if isinstance(found, str) and found:
            return found
    return "unknown"


def check_category(name: str | None) -> None:
    """Reject a category that no table lists.

    Raises:
        ConfigError: ``name`` is not a category of PartNet-Mobility.
    """
    if name not in {None, "unknown", *LONGEST_SIDE_M}:
        raise ConfigError(
            f"category {name!r} is not a category of PartNet-Mobility; leave it out for other "
            f"objects{nearest(str(name), LONGEST_SIDE_M)}"
        )


def scale_of(urdf: Path, config: ConvertConfig, longest: float) -> tuple[float, str]:
    """Return the factor from source units to metres and the rule that chose it.

    Args:
        urdf: File that was read.
        config: Options of the conversion; ``size_m`` and ``category`` are used.
        longest: Longest side of the closed object in source units.

    Raises:
        AssetError: The unit of the file cannot be guessed, or the object is too small.
    """
    if config.size_m is not None:
        return config.size_m / longest, f"longest side {config.size_m:g} m as requested"
    category = category_of(urdf, config)
    if is_normalised(urdf):
        size = LONGEST_SIDE_M.get(category, OTHER_M)
        return size / longest, f"normalised source; longest side of a {category} is {size:g} m"
    typical = LONGEST_SIDE_M.get(category)
    unit = likely_unit(longest, typical)
    if unit is not None:
        size = UNITS_M[unit] * longest
        what = "an object of unknown category" if typical is None else f"a {category}"
        return UNITS_M[unit], (
            f"numbers are {unit}: {what} of {longest:.3g} m is unlikely, {size:.3g} m is not "
            "(else give --size)"
        )
    if not LEAST_M <= longest <= MOST_M:
        guesses = ", ".join(f"{scale * longest:.3g} m in {u}" for u, scale in UNITS_M.items())
        raise AssetError(
            f"{urdf}: the closed object is {longest:.3g} m long if its numbers are metres "
            f"({guesses}); {LEAST_M:g} to {MOST_M:g} m are accepted: give its longest side in "
            "metres with --size"
        )
    return 1.0, f"metric as it is (longest side {longest:.3g} m)"


def likely_unit(longest: float, typical: float | None) -> str | None:
    """Return the unit of a file that is not metric, None if it is or if several are likely.

    Args:
        longest: Longest side in source units.
        typical: Longest side of the category [m], if that is known.
    """
    if typical is None:
        low, high, metric = *LIKELY_M, UNLIKELY_M
    else:
        low, high = typical / LIKELY_FACTOR, typical * LIKELY_FACTOR
        metric = DOUBTFUL_FACTOR * typical
    if longest <= metric:
        return None
    likely = [unit for unit, scale in UNITS_M.items() if low <= scale * longest <= high]
    if likely == ["cm", "inch"]:  # files in cm are far more common
        return "cm"
    return likely[0] if len(likely) == 1 else None
