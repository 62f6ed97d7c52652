"""Builder of objects of the procedural categories, from their dimensions."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from articulate.errors import ConfigError, quote
from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.dimensions import Dimensions
from articulate.library.procedural.urdf import Part
from articulate.reconstruct.text.appearance import (
    fixed,
    is_handle,
    palette_entry,
    recoloured,
    rehinged,
    without,
)
from articulate.reconstruct.text.description import Description, with_article
from articulate.reconstruct.text.volume import OUTER_VOLUME, VolumeRange, sizes_of_volume

Values = dict[str, Any]
D = TypeVar("D", bound=Dimensions)
DEFAULT_NAMES = {"door": "door", "leaf": "door", "front": "lid", "sash": "window", "bail": "handle"}
LINK_KINDS: Mapping[str, Mapping[str, str]] = {
    "door": {"leaf": "door"},
    "sliding_window": {"sash": "window"},
    "bucket": {"bail": "handle"},
    "suitcase": {"front": "lid", "pull": "pull"},
    "faucet": {"hot": "handle", "cold": "handle"},
    "microwave": {"power_knob": "knob", "time_knob": "knob"},
    "fridge": {"fridge_door": "door", "freezer_door": "door"},
}
"""Kind of part of links whose name is another word."""
SYNONYMS: Mapping[str, Mapping[str, str]] = {
    "oven": {"dial": "knob", "flap": "door"},
    "microwave": {"dial": "knob", "flap": "door", "cover": "door"},
    "dishwasher": {"flap": "door"},
    "washing_machine": {"knob": "dial", "lid": "door", "cover": "door"},
    "toilet": {"lid": "cover", "handle": "lever"},
    "door": {"handle": "lever", "knob": "lever"},
    "sliding_window": {"door": "window"},
    "safe": {"knob": "dial", "lever": "wheel"},
    "suitcase": {"handle": "pull", "door": "lid", "cover": "lid", "flap": "lid"},
    "laptop": {"cover": "lid", "flap": "lid"},
    "trash_can": {"cover": "lid", "flap": "lid", "cap": "lid"},
    "bottle": {"lid": "cap", "cover": "cap"},
    "kettle": {"cover": "lid", "cap": "lid"},
    "kitchen_pot": {"cover": "lid"},
    "faucet": {"knob": "handle"},
    "switch": {"handle": "lever", "knob": "dial", "wheel": "dial"},
    "box_with_lid": {"cover": "lid", "flap": "lid", "door": "lid"},
}
"""Other kinds of part by which a text may name one of this object."""
REMOVABLE: Mapping[str, frozenset[str]] = {
    "trash_can": frozenset({"pedal"}),
    "oven": frozenset({"knob"}),
    "microwave": frozenset({"knob"}),
    "washing_machine": frozenset({"dial"}),
    "safe": frozenset({"wheel", "dial"}),
    "door": frozenset({"lever"}),
    "toilet": frozenset({"lever", "cover"}),
    "bucket": frozenset(),
}
"""Kinds that are left out where the text excludes them; others are fixed."""
NO_PEDAL = ("hamper", "basket")
"""Words of nouns for bins without a pedal."""
FINISH_FIELDS = ("finish", "wood", "cover", "seat")
ROUND = frozenset({"trash_can", "bucket", "bottle", "kettle", "kitchen_pot"})
FURNITURE_SURFACE = frozenset({"door", "box_with_lid", "table_with_drawers", "office_chair"})
APPLIANCES = frozenset({"oven", "microwave", "dishwasher", "washing_machine", "safe", "fridge"})
TWO_SIZES = {"sliding_window": ("width", "height"), "door": ("width", "height")}
MOST_FRIDGE_WIDTH_M = 1.1
"""A longer side of a refrigerator without a name is its height [m]."""
HINGE_FIELD = frozenset({"washing_machine", "door", "safe", "suitcase", "fridge"})
HINGED_BY_EDGE = frozenset({"oven", "microwave", "dishwasher"})


@dataclass(kw_only=True)
class Household:
    """Parts of an object and the values that the text does not give."""

    name: str
    category: str
    parts: list[Part]
    assumptions: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def size_of_dimensions(
    description: Description, *, two: tuple[str, str] = ("width", "depth"), any_: str = "width"
) -> dict[str, float]:
    """Return the sizes of a text with names for all of them [m].

    Three lengths without names are width, depth and height.
    """
    sizes = dict(description.sizes_m)
    numbers = [sizes.pop(name) for name in ("first", "second", "third") if name in sizes]
    if numbers:
        names: tuple[str, ...] = two if len(numbers) == 2 else ("width", "depth", "height")
        if description.category == "suitcase":
            names = ("height", "width", "depth") if len(numbers) == 3 else ("height", "width")
            numbers.sort(reverse=True)
        if description.category == "door":
            names = ("height", "width", "depth")[: len(numbers)]
            numbers.sort(reverse=True)
        if description.category == "sliding_window" and len(numbers) == 3:
            names = ("width", "height", "depth")
        sizes |= dict(zip(names, numbers, strict=True))
    if description.category == "fridge" and sizes.get("any", 0.0) > MOST_FRIDGE_WIDTH_M:
        any_ = "height"
    if "any" in sizes:
        sizes.setdefault(any_, sizes.pop("any"))
    return sizes


# -- sizes: from the text's to the fields of the dimensions -----------------------------------
def _plain(sizes: dict[str, float], values: Values, _: Dimensions) -> None:
    for name in ("width", "depth", "height"):
        if name in sizes:
            values[f"{name}_m"] = sizes.pop(name)


def _round(sizes: dict[str, float], values: Values, _: Dimensions) -> None:
    wide = sizes.pop("diameter", None)
    for name in ("width", "depth"):
        wide = sizes.pop(name, wide) if wide is None else (sizes.pop(name, None), wide)[1]
    if wide is not None:
        values["radius_m"] = wide / 2
    if "height" in sizes:
        values["height_m"] = sizes.pop("height")


def _bottle(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    _round(sizes, values, usual)
    if "height_m" in values:
        values["height_m"] -= getattr(usual, "cap_m") + 0.001  # noqa: B009 - field of a subclass


def _kettle(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    _round(sizes, values, usual)
    if "height_m" in values:
        values["height_m"] -= 0.02 + getattr(usual, "lid_m") + 0.001  # noqa: B009


def _chair(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    for name in ("width", "depth"):
        if name in sizes:
            values[f"{name}_m"] = sizes.pop(name)
    if "height" in sizes:
        high = sizes.pop("height")
        if high < 0.62:
            values["seat_m"] = high
        else:
            values["back_m"] = high - getattr(usual, "seat_m") - 0.08  # noqa: B009


def _suitcase(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    _plain(sizes, values, usual)
    if "height_m" in values:
        values["height_m"] -= 2 * getattr(usual, "wheel_m") + 0.01  # noqa: B009


def _toilet(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    if "height" in sizes:
        high = sizes.pop("height")
        if high < 0.5:
            values["height_m"] = high
        else:
            values["tank_height_m"] = high - getattr(usual, "height_m") - 0.025  # noqa: B009
    if "width" in sizes:
        values["tank_width_m"] = sizes.pop("width") - 0.02


def _faucet(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    if "height" in sizes:
        rest = [getattr(usual, name) for name in ("column_m", "reach_m")]
        values["riser_m"] = sizes.pop("height") - rest[0] - rest[1] / 2 - 0.025


def _switch(sizes: dict[str, float], values: Values, _: Dimensions) -> None:
    if "height" in sizes:
        values["height_m"] = sizes.pop("height")


def _laptop(sizes: dict[str, float], values: Values, usual: Dimensions) -> None:
    diagonal = sizes.pop("diagonal", None)
    if diagonal is not None:
        sizes.setdefault("width", 0.85 * diagonal + 0.024)
        sizes.setdefault("depth", 0.55 * diagonal + 0.024)
    _plain(sizes, values, usual)


SIZES: Mapping[str, Callable[[dict[str, float], Values, Dimensions], None]] = {
    "bottle": _bottle,
    "kettle": _kettle,
    "office_chair": _chair,
    "suitcase": _suitcase,
    "toilet": _toilet,
    "faucet": _faucet,
    "switch": _switch,
    "laptop": _laptop,
}
ANY_SIZE = {
    "laptop": "diagonal",
    "bottle": "height",
    "kettle": "height",
    "door": "width",
    "trash_can": "height",
    "bucket": "height",
    "suitcase": "height",
    "kitchen_pot": "diameter",
    "switch": "height",
    "faucet": "height",
    "toilet": "height",
    "office_chair": "height",
}


def overrides(description: Description, name: str) -> tuple[Values, list[str]]:
    """Return the fields that the sizes of a text set, and assumptions.

    Raises:
        ConfigError: A size has no field.
    """
    dimensions = CATEGORIES[name].dimensions
    assert dimensions is not None
    usual = dimensions.sample(0)
    sizes = size_of_dimensions(
        description,
        two=TWO_SIZES.get(name, ("width", "depth")),
        any_=ANY_SIZE.get(name, "width"),
    )
    values: Values = {}
    assumed: list[str] = []
    if name in ROUND and name not in SIZES:
        _round(sizes, values, usual)
    else:
        SIZES.get(name, _plain)(sizes, values, usual)
    fields = {one.name for one in dataclasses.fields(dimensions)}
    for key in [key for key in values if key not in fields]:
        sizes[key.removesuffix("_m")] = values.pop(key)
    if set(sizes) == {"depth"} and name in {"door", "sliding_window"}:
        assumed.append("depth: that of the frame")
        sizes.clear()
    if set(sizes) == {"height"} and name == "laptop":
        assumed.append("thickness: the usual one")
        sizes.clear()
    if sizes:
        names = ", ".join(sizes)
        raise ConfigError(
            f"{quote(description.text)}: the {names} of {with_article(description.noun)} cannot be "
            "set; omit it"
        )
    _filled(description, name, usual, values, assumed)
    _scaled(description, dimensions, values, assumed)
    if SIZES.get(name, _plain) is _plain and name not in ROUND:
        _seen(description, usual, values, assumed)
    for key in values:
        if isinstance(values[key], float):
            values[key] = round(values[key], 5)
    return values, assumed


def _filled(
    description: Description, name: str, usual: Dimensions, values: Values, assumed: list[str]
) -> None:
    """Scale the usual sizes to the volume of the text, where it gives no size.

    Raises:
        ConfigError: The volume is not possible.
    """
    if description.volume_m3 is None or name not in OUTER_VOLUME:
        return
    text = description.volume_text
    if values:
        assumed.append(f"volume of {text}: the text gives sizes")
        return
    found = sizes_of_volume(usual, name, description.volume_m3)
    if isinstance(found, VolumeRange):
        raise ConfigError(
            f"{quote(description.text)}: a volume of {text} is not possible for "
            f"{with_article(description.noun)}; it must be in {found.text}"
        )
    values |= found
    sizes = ", ".join(f"{n.removesuffix('_m')} {value:.2g} m" for n, value in found.items())
    assumed.append(f"{sizes}: usual proportions for {text}")


def _seen(description: Description, usual: Dimensions, values: Values, assumed: list[str]) -> None:
    """Set the sizes that only an image or video gives, within the accepted range."""
    seen = description.seen
    fields = {one.name: one.metadata for one in dataclasses.fields(usual)}
    if seen is None or "height_m" not in fields:
        return
    if seen.height_m is not None:
        values.setdefault("height_m", seen.height_m)
    height_m = values.get("height_m", getattr(usual, "height_m"))  # noqa: B009
    for dimension in ("width", "depth"):
        name = f"{dimension}_m"
        if name in fields and name not in values:
            low, high = fields[name].get("accepted", (-np.inf, np.inf))
            values[name] = float(np.clip(seen.size_m(dimension, height_m), low, high))
            assumed.append(f"{dimension} {values[name]:.3g} m: proportions of the input")


def _scaled(
    description: Description, dimensions: type[Dimensions], values: Values, assumed: list[str]
) -> None:
    """Apply words such as ``small``: an end of the sampled range."""
    for one in dataclasses.fields(dimensions):
        about = one.metadata
        if "between" not in about or one.name in values or not one.name.endswith("_m"):
            continue
        base = one.name.removesuffix("_m")
        if base not in {"width", "depth", "height", "radius"}:
            continue
        dimension = "width" if base == "radius" else base
        factor = description.scale.get(dimension, description.scale.get("all"))
        if factor is None:
            continue
        low, high = about["between"]
        values[one.name] = low if factor < 1.0 else high
        assumed.append(f"{base} {values[one.name]:g} m, an end of the usual range")


def sampled(kind: type[D], values: Values, description: Description) -> D:
    """Return the usual dimensions with those values.

    Raises:
        ConfigError: A value is not possible; the message gives the range.
    """
    usual = kind.sample(0)
    noun = description.noun
    for one in dataclasses.fields(kind):
        if one.name not in values or "accepted" not in one.metadata:
            continue
        low, high = one.metadata["accepted"]
        value = values[one.name]
        if not low <= value <= high:
            what = one.name.removesuffix("_m").replace("_", " ").replace("count", "lever count")
            unit = " m" if one.name.endswith("_m") else ""
            best = min(max(value, low), high)
            raise ConfigError(
                f"{quote(description.text)}: {what} {value:g}{unit} is not possible for "
                f"{with_article(noun)}; it must be in [{low:g}, {high:g}]{unit}, "
                f"the nearest is {best:g}{unit}"
            )
    return dataclasses.replace(usual, **values)


# -- counts and variants -----------------------------------------------------------------------
def kind_of(name: str, link: str) -> str:
    """Return the kind of part of a link of an object of category ``name``."""
    known = LINK_KINDS.get(name, {})
    if link in known:
        return known[link]
    plain = link.rstrip("0123456789").rstrip("_")
    return known.get(plain, plain)


def _wanted(description: Description) -> dict[str, int | None]:
    """Return the number of each kind that the text gives; None: a plural without a number."""
    name = description.category
    same = SYNONYMS.get(name, {})
    wanted: dict[str, int | None] = {}
    for group in description.groups:
        kind = same.get(group.kind, group.kind)
        if name == "faucet" and group.kind == "handle" and group.count == 1:
            kind = "lever"
        if name == "faucet" and group.kind == "lever" and group.count == 2:
            kind = "handle"
        before = wanted.get(kind, 0)
        wanted[kind] = None if before is None or group.count is None else before + group.count
    for kind in description.absent:
        wanted[same.get(kind, kind)] = 0
    for option in description.options:
        if option.startswith("times_") and name == "switch":
            wanted.setdefault("lever", int(option[6:]))
    if name == "trash_can" and any(word in description.noun for word in NO_PEDAL):
        wanted.setdefault("pedal", 0)
    return wanted


def _variants(description: Description, wanted: dict[str, int | None], values: Values) -> None:
    """Set the fields that select variants of a category."""
    name, options = description.category, description.options
    if name in {"oven", "microwave"} and wanted.get("knob"):
        values["knobs"] = wanted["knob"]
    if name == "switch":
        _switch_variants(description, wanted, values)
    if name == "faucet" and "handle" in wanted and wanted["handle"] != 0:
        values["handles"] = "two"
    panels = next((o for o in options if o.startswith("panels_")), "")
    if panels:
        values["panels"] = int(panels.partition("_")[2])
    if name == "dishwasher":  # a large door of the usual thickness is too heavy for 30 N
        values["door_m"] = 0.040
    if name == "bottle" and "flip" in options:
        values["cap"] = "flip"
    if name == "box_with_lid" and "deep" in options:
        values["lid"] = "deep"
    if name == "box_with_lid" and "depth_m" in values:
        values["lip_length_m"] = round(min(0.12, max(0.04, 0.5 * values["depth_m"])), 3)
    side = _side(description)
    if side and name in HINGE_FIELD:
        if side in {"top", "bottom"}:
            raise ConfigError(
                f"{quote(description.text)}: {with_article(description.noun)} is hinged left or "
                f"right, not at the {side}"
            )
        values["hinges"] = side


def _switch_variants(
    description: Description, wanted: dict[str, int | None], values: Values
) -> None:
    """Select levers and their number, or a dial."""
    dial = description.noun.startswith("dimmer") or description.noun in {
        "rotary switch",
        "thermostat",
    }
    if not wanted.get("lever") and (dial or wanted.get("dial")):
        values["kind"] = "dial"
        return
    levers = wanted.get("lever", 1)
    values["count"] = 2 if levers is None else levers


def _side(description: Description) -> str:
    sides = [g.hinge for g in description.groups if g.hinge]
    return sides[0] if sides else description.hinge


def build_household(description: Description) -> Household:
    """Build an object of a procedural category other than furniture and refrigerators.

    Raises:
        ConfigError: A size or a number of parts is not possible.
    """
    name = description.category
    category = CATEGORIES[name]
    dimensions = category.dimensions
    assert dimensions is not None
    values, assumed = overrides(description, name)
    wanted = _wanted(description)
    _variants(description, wanted, values)
    usual_finish = _finish_field(dimensions)
    target = _finish(description, dimensions, values, usual_finish)
    size = sampled(dimensions, values, description)
    parts = size.parts()
    out = Household(name=name, category=category.partnet, parts=parts, assumptions=assumed)
    _report_sizes(description, size, values, out)
    if target and usual_finish:
        base = getattr(size, usual_finish)
        out.parts = recoloured(out.parts, target, lambda _, own: own.material == base)
    _apply_counts(description, wanted, out)
    side = _side(description)
    if side and name in HINGED_BY_EDGE:
        out.parts = rehinged(out.parts, "door", side)
    elif side and name not in HINGE_FIELD:
        out.doubts.append(
            f"the hinge of {with_article(description.noun)} cannot be set to the {side}"
        )
    _part_materials(description, out)
    if name != "switch" and any(option.startswith("times_") for option in description.options):
        out.doubts.append(f"{with_article(description.noun)} is made once, not several times")
    return out


def _finish_field(dimensions: type[Dimensions]) -> str:
    names = {one.name for one in dataclasses.fields(dimensions)}
    return next((name for name in FINISH_FIELDS if name in names), "")


def _finish(
    description: Description, dimensions: type[Dimensions], values: Values, finish: str
) -> str:
    """Set the finish among those of the category; return another one to apply afterwards."""
    word, name = description.material, description.category
    seat = next((g.material for g in description.groups if g.kind in {"seat"} and g.material), "")
    word = word or (seat if name in {"toilet", "office_chair"} else "")
    if not word or not finish:
        return ""
    kind = (
        "furniture" if name in FURNITURE_SURFACE else "appliance" if name in APPLIANCES else "small"
    )
    entry = palette_entry(word, kind)
    one = next(o for o in dataclasses.fields(dimensions) if o.name == finish)
    choices: tuple[str, ...] = one.metadata["choices"]
    if entry in choices:
        values[finish] = entry
        return ""
    colour = entry.split("_")[0]
    near = [c for c in choices if c.startswith(f"{colour}_")]
    if near:
        values[finish] = near[0]
        return ""
    return entry


def _report_sizes(
    description: Description, size: Dimensions, values: Values, out: Household
) -> None:
    """List the main sizes that the text does not give."""
    for one in dataclasses.fields(size):
        base = one.name.removesuffix("_m")
        if base in {"width", "depth", "height", "radius"} and one.name not in values:
            out.assumptions.append(
                f"{base} {getattr(size, one.name):g} m: middle of the usual range"
            )


def _report_parts(
    wanted: dict[str, int | None], have: Counter[str], out: Household, noun: str
) -> None:
    """List the moving parts that the text does not name, beside those that it does."""
    added = [(kind, n) for kind, n in have.items() if kind not in wanted]
    if len(have) > 1 and added:
        names = " and ".join(f"{n} {kind}{'s' * (n > 1)}" for kind, n in added)
        out.assumptions.append(f"{names}: usual for {with_article(noun)}")


def _apply_counts(description: Description, wanted: dict[str, int | None], out: Household) -> None:
    """Fix or leave out parts that the text excludes; reject other differences."""
    name, noun = out.name, description.noun
    links: dict[str, list[str]] = {}
    for part in out.parts:
        if part.motion is not None:
            links.setdefault(kind_of(name, part.name), []).append(part.name)
    have = Counter({kind: len(found) for kind, found in links.items()})
    _report_parts(wanted, have, out, noun)
    for kind, count in wanted.items():
        if count == 0:
            found = links.get(kind, [])
            if kind in REMOVABLE.get(name, frozenset()):
                out.parts = without(out.parts, found)
            elif found and len(found) == sum(have.values()):
                raise ConfigError(
                    f"{quote(description.text)}: {with_article(noun)} without {with_article(kind)} "
                    f"has no moving part; describe it with one"
                )
            else:
                out.parts = fixed(out.parts, found)
            continue
        if kind not in have:
            out.doubts.append(f"not made: {kind} of {with_article(noun)}")
        elif count is not None and count != have[kind]:
            raise ConfigError(
                f"{quote(description.text)}: {with_article(noun)} has {have[kind]} {kind}"
                f"{'s' * (have[kind] != 1)}, {count} are not possible; give {have[kind]}"
            )


def _part_materials(description: Description, out: Household) -> None:
    """Apply materials that the text gives to one kind of part."""
    name = out.name
    kind = "appliance" if name in APPLIANCES else "small"
    if name in FURNITURE_SURFACE or name == "toilet":
        kind = "furniture"
    same = SYNONYMS.get(name, {})
    for group in description.groups:
        if not group.material or (group.kind == "seat" and name in {"toilet", "office_chair"}):
            continue
        target = palette_entry(group.material, kind)
        wanted = same.get(group.kind, group.kind)
        out.parts = recoloured(
            out.parts,
            target,
            lambda part, _, wanted=wanted: kind_of(name, part.name) == wanted,  # type: ignore[misc]
        )
    if description.handle_material:
        target = palette_entry(description.handle_material, "small")
        out.parts = recoloured(out.parts, target, lambda _, own: is_handle(own))
