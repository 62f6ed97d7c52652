"""Builder of furniture, desks and refrigerators whose front is divided into panels."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import Any

from articulate.errors import ConfigError, quote
from articulate.library.procedural.fridge import Fridge
from articulate.library.procedural.front_layout import (
    FrontLayout,
    FrontPanel,
    HandleKind,
)
from articulate.library.procedural.table_with_drawers import TableWithDrawers
from articulate.library.procedural.urdf import Part
from articulate.reconstruct.text.appearance import is_handle, palette_entry, recoloured
from articulate.reconstruct.text.description import (
    Description,
    PartGroup,
    Position,
    Relation,
    with_article,
)
from articulate.reconstruct.text.household import overrides, sampled, size_of_dimensions
from articulate.reconstruct.text.layout import FrontStyle, arrange, front_panels, grid_of
from articulate.reconstruct.text.vocabulary import CLASSES, ObjectClass

RANGES_M = {
    "furniture": ((0.15, 4.0), (0.15, 1.2), (0.12, 3.0)),
    "fridge": ((0.35, 1.3), (0.35, 0.95), (0.45, 2.3)),
    "table": ((0.4, 3.0), (0.3, 1.3), (0.3, 1.2)),
}
"""Smallest and largest width, depth and height [m]."""
DIMENSIONS = ("width", "depth", "height")
TABLE_SIZES_M = {
    "coffee table": (1.0, 0.6, 0.45),
    "side table": (0.5, 0.45, 0.55),
    "end table": (0.5, 0.45, 0.55),
    "console table": (1.2, 0.38, 0.8),
    "hall table": (1.0, 0.35, 0.8),
    "dining table": (1.6, 0.9, 0.75),
    "kitchen table": (1.4, 0.8, 0.75),
}
"""Usual width, depth and height of tables [m]."""
KINDS = frozenset({"drawer", "door", "flap", "open", "panel"})
MIN_SHARE_M = 0.09
"""Height of a drawer below which an object without a given height is made higher [m]."""
COLUMN_M = 0.28
"""Width of a column below which an object without a given width is made wider [m]."""


@dataclass(kw_only=True)
class Built:
    """Parts of an object and the values that the text does not give."""

    name: str
    category: str
    parts: list[Part]
    assumptions: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def class_of(description: Description) -> ObjectClass:
    """Return the class of the noun in the text; a cabinet without a noun."""
    for one in CLASSES:
        if any(re.fullmatch(noun, description.noun) for noun in one.nouns):
            return one
    return CLASSES[0]


def build_furniture(description: Description) -> Built:
    """Build storage furniture.

    Raises:
        ConfigError: The sizes or parts are not possible.
    """
    one = class_of(description)
    out = Built(name="furniture", category="StorageFurniture", parts=[])
    description = _with_usual_parts(description, one, out)
    _check_kinds(description, one.nouns[0] if not description.noun else description.noun, out)
    width, depth, height = _sizes(description, one, "furniture", out)
    thin = 0.018 if min(width, height) > 0.3 else 0.012
    style = FrontStyle(
        width_m=width,
        height_m=height,
        handle=_handle(description),
        doors_above=one.size_m[2] > 1.5,
        door_hinge=description.hinge,
    )
    for g in description.groups:
        if g.position == "ends" and (g.count or 2) % 2:
            out.doubts.append(f"{g.count} {g.kind}s are divided between two sides")
        if g.slides and (g.hinge or description.hinge) in {"top", "bottom"}:
            out.doubts.append("the doors are made with a hinge and do not slide")
    node = arrange(description, style)
    if (
        len(node.leaves()) > 1
        and not description.relations
        and not any(g.position or g.stack for g in description.groups)
    ):
        kinds = " and ".join(dict.fromkeys(g.kind for g in node.leaves()))
        out.assumptions.append(
            f"arrangement of {kinds}: usual for {with_article(description.noun)}"
        )
    panels = front_panels(description, style)
    base = one.base
    base_m = {"plinth": 0.05, "legs": 0.12, "none": 0.0}[base]
    base_m = min(base_m, 0.15 * height)
    layout = _layout(
        description,
        panels=panels,
        width_m=width,
        depth_m=depth,
        height_m=height,
        base=base,
        base_m=base_m,
        board_m=thin,
        worktop_m=thin,
        name=(description.noun or "cabinet").replace(" ", "_"),
    )
    out.parts = _coloured(layout.parts(), description, "white_lacquer", "furniture")
    if not description.material:
        out.assumptions.append("colour white: the text gives none")
    return out


def build_table(description: Description) -> Built:
    """Build a table or desk: drawers under its top, or pedestals beside a gap."""
    out = Built(name="table", category="Table", parts=[])
    noun = description.noun or "table"
    _check_kinds(description, noun, out)
    groups = [g for g in description.groups if g.kind in KINDS]
    drawers = [g for g in groups if g.kind == "drawer"]
    for g in groups:
        if g.position in {"top", "bottom"} or (g.position == "ends" and g.count == 2):
            g.position = ""
            g.stack = g.stack or "row"
    if not groups and "drawer" in description.absent:
        raise ConfigError(
            f"{quote(description.text)}: {with_article(noun)} without drawers has no moving part; "
            f'try "{with_article(noun)} with one drawer"'
        )
    simple = (
        all(g.kind == "drawer" for g in groups)
        and all(g.position in {"", "middle"} and g.stack != "column" for g in drawers)
        and not any(g.columns or (g.rows or 1) > 1 for g in drawers)
        and "pedestal" not in description.options
        and sum(g.count or 2 for g in drawers) <= 5
    )
    usual = TABLE_SIZES_M.get(noun)
    if simple:
        return _simple_table(description, out, usual)
    one = replace(CLASSES[0], size_m=usual or (1.4, 0.65, 0.75))
    if not groups:
        groups = [PartGroup(kind="drawer", count=3, position="right")]
        out.assumptions.append("3 drawers in a pedestal on the right: the text gives no number")
    elif all(not g.position and g.stack != "row" for g in groups) and not description.relations:
        for g in groups:
            count = g.count or 2
            g.position = "ends" if count >= 6 and count % 2 == 0 else "right"
        out.assumptions.append(f"pedestal on {groups[0].position}: the text gives no side")
    description = _with_gap(description, groups)
    width, depth, height = _sizes(description, one, "table", out)
    style = FrontStyle(
        width_m=width,
        height_m=height,
        handle=_handle(description),
        door_hinge=description.hinge,
    )
    layout = _layout(
        description,
        panels=front_panels(description, style),
        width_m=width,
        depth_m=depth,
        height_m=height,
        base="none",
        base_m=0.0,
        worktop_m=0.025,
        finish="oak",
        name=noun.replace(" ", "_"),
        category="Table",
    )
    out.parts = _coloured(layout.parts(), description, "oak", "furniture")
    return out


def _with_gap(description: Description, groups: list[PartGroup]) -> Description:
    """Add the space for legs, and free space below single drawers at the sides."""
    full, relations = [*groups], _relations_of(description, groups)
    for k, group in enumerate(groups):
        if group.kind == "drawer" and group.count == 1 and group.position in {"left", "right"}:
            full.append(PartGroup(kind="gap", count=1, weight=0.8, position=group.position))
            relations.append(Relation(first=k, link="above", second=len(full) - 1))
        if group.position == "":
            group.position = "middle"
    full.append(PartGroup(kind="gap", count=1, position="middle"))
    return replace(description, groups=full, relations=relations)


def _simple_table(
    description: Description, out: Built, usual: tuple[float, float, float] | None
) -> Built:
    values, assumed = overrides(description, "table_with_drawers")
    count = description.count("drawer")
    if count is not None:
        values["drawers"] = count
    elif description.of_kind("drawer"):
        values["drawers"] = 2
        out.assumptions.append("2 drawers: the text gives no number")
    for name, value in zip(DIMENSIONS, usual or (), strict=False):
        values.setdefault(f"{name}_m", value)
    if description.handles in {"bar", "knob"}:
        values["handle"] = description.handles
    table = sampled(TableWithDrawers, values, description)
    out.assumptions += assumed
    parts = table.parts()
    if description.handles == "none":
        parts = _without_handles(parts)
    out.parts = _coloured(parts, description, "oak", "furniture")
    return out


def build_fridge(description: Description) -> Built:
    """Build a refrigerator: doors above each other, side by side, or a grid with drawers."""
    out = Built(name="refrigerator", category="Refrigerator", parts=[])
    _check_kinds(description, description.noun, out, also=frozenset({"freezer"}))
    groups = [g for g in description.groups if g.kind in {"door", "drawer", "freezer", "flap"}]
    doors, drawers = description.count("door"), description.count("drawer")
    freezer = next((g for g in groups if g.kind == "freezer"), None)
    if freezer is not None and "door" in freezer.words and doors is not None:
        doors += 1
    freezer_drawer = next((g for g in groups if g.kind == "drawer"), None)
    row = any(g.stack == "row" for g in groups if g.kind == "door") or description.stack == "row"
    row = row or any(g.position in {"left", "right", "ends"} for g in groups)
    plain = (
        not row
        and not drawers
        and freezer_drawer is None
        and (doors in {2, None})
        and "door" not in description.absent
        and not any(g.hinge in {"top", "bottom"} for g in groups)
        and description.hinge not in {"top", "bottom"}
        and (description.noun not in {"freezer", "minibar", "ice box", "icebox"})
        and not any(w < 0.8 for w in description.scale.values())
        and len({g.hinge for g in groups if g.hinge}) <= 1
        and not any(r for r in description.relations)
    )
    height = description.sizes_m.get("height")
    small = height is not None and height < 1.2
    if plain and not (small and doors is None and freezer is None):
        return _two_doors(description, out, freezer)
    return _fridge_front(description, out, freezer, row)


def _two_doors(description: Description, out: Built, freezer: PartGroup | None) -> Built:
    values, assumed = overrides(description, "fridge")
    if freezer is not None and freezer.position in {"top", "bottom"}:
        values["freezer"] = "above" if freezer.position == "top" else "below"
    else:
        out.assumptions.append("freezer below: the text gives no position")
    side = next((g.hinge for g in description.groups if g.hinge), description.hinge)
    if side:
        values["hinges"] = side
    fridge = sampled(Fridge, values, description)
    out.assumptions += assumed
    parts = fridge.parts()
    if description.handles == "none":
        parts = _without_handles(parts)
    out.parts = _coloured(parts, description, "steel", "appliance")
    return out


def _fridge_front(
    description: Description, out: Built, freezer: PartGroup | None, row: bool
) -> Built:
    """Build a refrigerator with a divided front."""
    groups = [g for g in description.groups if g.kind in {"door", "drawer", "flap"}]
    if "door" in description.absent and not groups:
        noun = with_article(description.noun)
        raise ConfigError(
            f"{quote(description.text)}: {noun} without a door has no moving part; "
            "describe it with one"
        )
    if not any(g.kind == "door" for g in groups) and "door" not in description.absent:
        groups.insert(0, PartGroup(kind="door", count=2 if row else 1))
    for g in groups:
        if g.kind == "door" and g.count is None:
            g.count = 2
        if g.kind == "door" and row and (g.count or 1) > 1:
            g.stack = g.stack or "row"
    doors = sum(g.count or 1 for g in groups if g.kind == "door")
    if not any(g.kind == "drawer" for g in groups):
        _place_freezer(groups, freezer, doors, row, out)
    relations = _relations_of(description, groups)
    for g in groups:
        if g.kind == "drawer" and not g.position and not relations:
            g.position = "bottom"
        if g.kind == "door" and (g.count or 1) >= 4 and not (g.rows or g.columns or g.stack):
            g.columns = 2
    full = replace(description, groups=groups, relations=relations)
    single = all(g.count == 1 for g in groups if g.kind in {"door", "flap"}) and doors == 1
    one = replace(CLASSES[0], size_m=(0.6, 0.62, 1.7) if single else (0.9, 0.7, 1.78))
    width, depth, height = _sizes(full, one, "fridge", out)
    style = FrontStyle(
        width_m=width,
        height_m=height,
        handle=_handle(description),
        doors_above=True,
        middle_is_vertical=True,
        door_hinge=description.hinge,
    )
    layout = _layout(
        description,
        panels=front_panels(full, style),
        width_m=width,
        depth_m=depth,
        height_m=height,
        base="plinth",
        base_m=0.05,
        worktop_m=0.02,
        board_m=0.05 if width >= 0.5 else 0.035,
        finish="steel",
        handle_m=0.4,
        name="refrigerator",
        category="Refrigerator",
    )
    out.parts = _coloured(layout.parts(), description, "steel", "appliance")
    return out


def _place_freezer(
    groups: list[PartGroup], freezer: PartGroup | None, doors: int, row: bool, out: Built
) -> None:
    """Give the freezer a drawer, one of the doors, or space behind the only door."""
    position = "bottom" if freezer is None else freezer.position or "bottom"
    placed = len([g for g in groups if g.kind == "door"]) > 1
    if doors == 3 and not row and not placed:
        _freezer_door(groups, position)
        if freezer is None:
            out.assumptions.append("two doors above one: the text gives no arrangement")
    elif freezer is None:
        return
    elif doors == 1:
        out.assumptions.append("the freezer is behind the single door")
    elif row and freezer.position in {"left", "right"}:
        out.assumptions.append(f"the freezer is behind the {freezer.position} door")
    elif row:
        groups.append(PartGroup(kind="drawer", count=1, position=position))
        out.assumptions.append("the freezer is a drawer: the doors are beside each other")
    elif doors >= 3 and not placed:
        _freezer_door(groups, position)


def _relations_of(description: Description, groups: list[PartGroup]) -> list[Relation]:
    """Return the relations between those groups, with their indices."""
    index = {id(group): k for k, group in enumerate(groups)}
    found = []
    for relation in description.relations:
        ends = [id(description.groups[k]) for k in (relation.first, relation.second)]
        if all(end in index for end in ends):
            found.append(replace(relation, first=index[ends[0]], second=index[ends[1]]))
    return found


def _freezer_door(groups: list[PartGroup], position: str) -> None:
    """Take one of the doors for the freezer, above or below the others."""
    door = next(g for g in groups if g.kind == "door")
    door.count = (door.count or 3) - 1
    place: Position = "top" if position == "top" else "bottom"
    groups.append(PartGroup(kind="door", count=1, position=place))


def build_double_oven(description: Description) -> Built:
    """Build two ovens above each other with doors that are hinged at the bottom."""
    out = Built(name="oven", category="Oven", parts=[])
    doors = PartGroup(kind="flap", count=2, stack="column", hinge=description.hinge)
    full = replace(description, groups=[doors], relations=[])
    for g in description.groups:
        if g.kind not in {"door", "flap"}:
            out.doubts.append(f"not made: {g.kind} of a double oven")
    if any(g.hinge for g in description.groups):
        doors.hinge = next(g.hinge for g in description.groups if g.hinge)
    one = replace(CLASSES[0], size_m=(0.6, 0.58, 1.2))
    width, depth, height = _sizes(full, one, "furniture", out)
    style = FrontStyle(width_m=width, height_m=height, handle=description.handles or "bar")
    layout = _layout(
        description,
        panels=front_panels(full, style),
        width_m=width,
        depth_m=depth,
        height_m=height,
        base="plinth",
        worktop_m=0.06,
        board_m=0.04,
        handle_m=0.45,
        finish="steel",
        front_finish="dark_glass",
        name="oven",
        category="Oven",
    )
    out.parts = _coloured(layout.parts(), description, "steel", "appliance")
    return out


# -- shared ----------------------------------------------------------------------------------
def _with_usual_parts(description: Description, one: ObjectClass, out: Built) -> Description:
    """Add the usual parts of a class where the text names none that move."""
    groups = [g for g in description.groups if g.kind in KINDS]
    moving = [g for g in groups if g.kind in {"drawer", "door", "flap"}]
    for g in groups:
        if g.count is None and not (g.rows or g.columns):
            g.count = max(2, one.parts.get(g.kind, 2)) if g.kind != "open" else 2
            what = "open compartments" if g.kind == "open" else f"{g.kind}s"
            out.assumptions.append(f"{g.count} {what}: the text gives no number")
    if moving:
        return _with_rest(description, groups, one, out)
    usual = {k: n for k, n in one.parts.items() if k not in description.absent}
    if groups:
        usual = {k: n for k, n in usual.items() if k not in {"open"}}
    if not any(k in {"drawer", "door"} for k in usual):
        other = {"drawer", "door"} - description.absent
        if not other or groups:
            raise ConfigError(
                f"{quote(description.text)}: no part moves; name a drawer, door or flap, for "
                f'example "{with_article(description.noun or "cabinet")} with two doors"'
            )
        usual = {sorted(other)[0]: 2}
    if groups:
        out.doubts.append("the text names no moving part; the usual ones are assumed")
    names = " and ".join(f"{n} {k}{'s' * (n > 1)}" for k, n in usual.items())
    out.assumptions.append(f"{names}: usual for {with_article(description.noun or 'cabinet')}")
    added = [PartGroup(kind=k, count=n, stack=description.stack) for k, n in usual.items()]
    return replace(description, groups=[*description.groups, *added])


def _with_rest(
    description: Description, groups: list[PartGroup], one: ObjectClass, out: Built
) -> Description:
    """Leave the rest of the front open where all parts are at one edge."""
    places = {g.position for g in groups}
    if len(places) > 1 or not places <= {"top", "bottom", "left", "right"}:
        return description
    if description.relations:
        return description
    count = max(1, one.parts.get("open", 1) - 1)
    out.assumptions.append(f"{count} open compartments: all parts are at the {places.pop()}")
    rest = PartGroup(kind="open", count=count)
    return replace(description, groups=[*description.groups, rest])


def _check_kinds(
    description: Description, noun: str, out: Built, also: frozenset[str] = frozenset()
) -> None:
    """List parts that this builder does not make."""
    for g in description.groups:
        if g.kind not in KINDS | also:
            out.doubts.append(f"not made: {g.kind} of {with_article(noun)}")


def _handle(description: Description) -> HandleKind:
    return description.handles or "bar"


def _sizes(
    description: Description, one: ObjectClass, kind: str, out: Built
) -> tuple[float, float, float]:
    """Return width, depth and height: those of the text, or usual ones with room for the parts."""
    tall = one.size_m[2] > 1.5 and kind == "furniture"
    sizes = size_of_dimensions(
        description,
        two=("width", "depth" if kind == "table" else "height"),
        any_="height" if tall else "width",
    )
    values = []
    if description.seen is not None and description.seen.height_m is not None:
        sizes.setdefault("height", description.seen.height_m)
    usual = _usual_sizes(description, one, sizes.get("height"))
    for k, dimension in enumerate(DIMENSIONS):
        low, high = RANGES_M[kind][k]
        if dimension in sizes:
            value = sizes[dimension]
            if not low <= value <= high:
                raise ConfigError(
                    f"{quote(description.text)}: a {dimension} of {value:g} m is not possible for "
                    f"{with_article(description.noun or 'cabinet')}; it must be in "
                    f"[{low:g}, {high:g}] m, the nearest is {min(max(value, low), high):g} m"
                )
        else:
            factor = description.scale.get(dimension, description.scale.get("all", 1.0))
            value = min(max(usual[k] * factor, low), high)
        values.append(round(value, 4))
    rows, columns = _grid_extent(description, values)
    if "width" not in sizes and kind != "table":
        values[0] = max(values[0], round(min(COLUMN_M * columns, RANGES_M[kind][0][1]), 3))
    if "height" not in sizes and kind != "table":
        values[2] = max(values[2], round(min(MIN_SHARE_M * rows + 0.1, RANGES_M[kind][2][1]), 3))
    for k, dimension in enumerate(DIMENSIONS):
        if dimension not in sizes:
            noun = description.noun or "cabinet"
            seen = description.seen is not None and dimension != "height"
            origin = "proportions of the input" if seen else f"usual for {with_article(noun)}"
            out.assumptions.append(f"{dimension} {values[k]:g} m: {origin}")
    return values[0], values[1], values[2]


def _usual_sizes(
    description: Description, one: ObjectClass, height_m: float | None
) -> tuple[float, ...]:
    """Return the usual width, depth and height, with the proportions of an image if there is one.

    Args:
        description: Content of the text.
        one: Class of the object.
        height_m: Height, if the text or the user gives it [m].
    """
    if description.seen is None:
        return one.size_m
    height = height_m or one.size_m[2]
    return tuple(description.seen.size_m(dimension, height) for dimension in DIMENSIONS)


def _grid_extent(description: Description, values: list[float]) -> tuple[float, float]:
    """Return about how many rows and columns of parts the front has."""
    style = FrontStyle(width_m=values[0], height_m=values[2])
    grids = [
        (g, grid_of(g, (0.0, 1.0, 0.0, 1.0), style))
        for g in description.groups
        if g.kind in KINDS and g.count != 0
    ]
    side = any(g.position in {"left", "right", "ends", "middle"} for g, _ in grids) or any(
        r.link != "above" for r in description.relations
    )
    rows = [grid[0] * (2.5 if g.kind != "drawer" else 1.0) for g, grid in grids]
    columns = [float(grid[1]) for _, grid in grids]
    if side:
        return max(rows, default=1.0), sum(columns)
    return sum(rows), max(columns, default=1.0)


def _layout(description: Description, panels: tuple[FrontPanel, ...], **values: Any) -> FrontLayout:
    """Return the layout.

    Raises:
        ConfigError: The fronts are too small; the message gives a size at which they fit.
    """
    try:
        return FrontLayout(panels=panels, **values)
    except ConfigError as error:
        for step in range(1, 40):
            factor = 1.0 + 0.1 * step
            larger = {key: round(factor * values[key], 2) for key in ("width_m", "height_m")}
            try:
                FrontLayout(panels=panels, **(values | larger))
            except ConfigError:
                continue
            width, height = larger.values()
            reason = str(error).partition(": ")[2].partition(";")[0]
            raise ConfigError(
                f"{quote(description.text)}: {reason}; possible is {width:g} m wide and "
                f"{height:g} m high, or fewer parts"
            ) from None
        raise


def _without_handles(parts: list[Part]) -> list[Part]:
    return [replace(p, shapes=tuple(own for own in p.shapes if not is_handle(own))) for p in parts]


def _coloured(parts: list[Part], description: Description, finish: str, kind: str) -> list[Part]:
    """Apply the materials of the text: of the object, of groups of parts, of handles."""
    if description.material:
        target = palette_entry(description.material, kind)
        parts = recoloured(parts, target, lambda _, own: own.material == finish)
        finish = target
    for group in description.groups:
        if group.material:
            target = palette_entry(group.material, kind)
            prefix = "door" if group.kind == "door" else group.kind
            parts = recoloured(
                parts,
                target,
                lambda part, own, prefix=prefix: (  # type: ignore[misc]
                    (part.name.startswith(prefix) or part.name.endswith(prefix))
                    and not is_handle(own)
                    and "tray" not in own.name
                ),
            )
    if description.handle_material:
        target = palette_entry(description.handle_material, "small")
        parts = recoloured(parts, target, lambda _, own: is_handle(own))
    return parts
