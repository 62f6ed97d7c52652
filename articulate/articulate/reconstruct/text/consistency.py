"""Consistency of a description: sizes, subsets, repetitions, contradictory counts."""

from __future__ import annotations

from collections.abc import Sequence

from articulate.errors import ConfigError, quote
from articulate.reconstruct.text.description import Description, Relation
from articulate.reconstruct.text.measures import guessed_unit

MAX_PARTS = 60
"""Most parts of one kind."""


def set_sizes(out: Description, sizes: Sequence[tuple[str, float, float | None]]) -> None:
    """Convert lengths to metres.

    Args:
        out: Description whose ``sizes_m`` are set.
        sizes: Dimension, number and unit [m] of each length; None: the text gives no unit.

    Raises:
        ConfigError: A dimension has two lengths.
    """
    unitless = [value for _, value, unit in sizes if unit is None]
    units = [unit for _, _, unit in sizes if unit is not None]
    guess = 1.0
    if unitless:
        guess = units[0] if units else guessed_unit(unitless)
        name = {0.001: "mm", 0.01: "cm", 1.0: "m"}.get(guess, f"{guess:g} m")
        values = ", ".join(f"{value:g}" for value in unitless)
        out.assumptions.append(f"{values} without a unit: {name}")
    flat = "height" if out.category == "laptop" else "depth"
    for name, value, unit in sizes:
        dimension = flat if name == "thickness" else name
        length = value * (guess if unit is None else unit)
        known = out.sizes_m.get(dimension)
        if known is not None and abs(known - length) > 1e-3 * known:
            raise ConfigError(
                f"{quote(out.text)}: the {dimension} is given twice, {known:g} m and "
                f"{length:g} m; give one"
            )
        out.sizes_m[dimension] = length
    if "length" in out.sizes_m:  # the longer horizontal side
        longer = out.sizes_m.pop("length")
        if "width" in out.sizes_m and "depth" not in out.sizes_m:
            out.sizes_m["depth"] = out.sizes_m.pop("width")
        out.sizes_m.setdefault("width", longer)


def check_counts(out: Description) -> None:
    """Check the numbers of parts, and merge repetitions.

    Raises:
        ConfigError: Numbers contradict each other.
    """
    text = quote(out.text)
    _resolve_subsets(out)
    for group in out.groups:
        if group.kind in out.absent:
            raise ConfigError(
                f"{text}: {group.kind}s are both given and excluded; give one of them"
            )
        if out.only in {"door", "drawer"} and group.kind in {"door", "drawer"} - {out.only}:
            raise ConfigError(
                f"{text}: only {out.only}s and {group.kind}s are given; give one of them"
            )
        if group.count is not None and group.count > MAX_PARTS:
            raise ConfigError(
                f"{text}: {group.count} {group.kind}s are too many; at most {MAX_PARTS}"
            )
        cells = (group.rows or 0) * (group.columns or 0)
        if cells and group.count not in {None, cells}:
            raise ConfigError(
                f"{text}: {group.rows} x {group.columns} is not {group.count}; give one number"
            )
    if out.only == "door":
        out.absent.add("drawer")
    if out.only == "drawer":
        out.absent.add("door")
    _merge_repeats(out)


def _resolve_subsets(out: Description) -> None:
    """Replace a group by its parts where the text divides it."""
    divided_groups = {int(g.subset_of) for g in out.groups if g.subset_of}
    for index in sorted(divided_groups):
        divided = out.groups[index]
        subsets = [g for g in out.groups if g.subset_of == str(index)]
        total = sum(g.count or 0 for g in subsets)
        if divided.count is not None and total > divided.count:
            raise ConfigError(
                f"{quote(out.text)}: {total} {divided.kind}s are placed and {divided.count} are "
                "given; give one number"
            )
        if divided.count is not None and not divided.position:
            divided.count -= total
        elif divided.count is None:
            divided.count = 0
    _drop(out, [k for k in divided_groups if out.groups[k].count == 0])


def _merge_repeats(out: Description) -> None:
    """Drop a group that repeats an earlier one: ``two-drawer cabinet with two drawers``."""
    repeated: list[int] = []
    for k, group in enumerate(out.groups):
        for before in out.groups[:k]:
            if before.kind != group.kind or group.subset_of:
                continue
            if before.is_adjective and before.count in {group.count, None}:
                before.count = group.count
                before.position = before.position or group.position
                before.stack = before.stack or group.stack
                before.rows = before.rows or group.rows
                before.columns = before.columns or group.columns
                before.hinge = before.hinge or group.hinge
                repeated.append(k)
                break
            undefined = before.count is None and group.count is not None
            if undefined and not (before.position or group.position) and k == len(out.groups) - 1:
                before.count = group.count
                before.stack = before.stack or group.stack
                repeated.append(k)
                break
            if before.is_adjective and group.count is None:
                repeated.append(k)
                break
            if before.is_adjective and group.count is not None:
                raise ConfigError(
                    f"{quote(out.text)}: {before.count} and {group.count} {group.kind}s are "
                    "given; give one number"
                )
    _drop(out, repeated)


def _drop(out: Description, indices: list[int]) -> None:
    """Remove groups; relations refer to the others afterwards."""
    keep = [k for k in range(len(out.groups)) if k not in indices]
    moved = {old: new for new, old in enumerate(keep)}
    kinds = {k: out.groups[k].kind for k in range(len(out.groups))}
    for old in indices:  # a relation to a repeated group is one to the first of its kind
        moved[old] = next((moved[k] for k in keep if kinds[k] == kinds[old]), -1)
    out.groups = [out.groups[k] for k in keep]
    out.relations = [
        Relation(first=moved[r.first], link=r.link, second=moved[r.second])
        for r in out.relations
        if min(moved[r.first], moved[r.second]) >= 0 and moved[r.first] != moved[r.second]
    ]
