"""``train --list-tasks`` and ``train --list-joints ASSET``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from articulate.cache import cache_folder
from articulate.commands import console
from articulate.commands.flags import HELP, parse

if TYPE_CHECKING:
    from articulate_train.list_joints import JointRow

LISTS = ("--list-tasks", "--list-joints")
"""Flags that print a list instead of training."""


@dataclass(frozen=True, kw_only=True)
class ListFlags:
    """List the tasks, or the joints of an object with their tasks and feasibility.

    Example: train --list-joints cabinet.urdf
    """

    list_tasks: bool = False
    """List the tasks."""
    list_joints: str | None = None
    """List the joints of this object: URDF, MJCF or SDF file, a folder that holds one, or an asset
    folder. The feasibility is the success rate of the scripted expert."""
    closed: Literal["auto", "lower", "upper", "zero"] = "auto"
    """Closed position: a joint limit, or 0 inside the range."""
    up: Literal["z", "y"] = "z"
    """Axis of the file that points up."""
    size: float | None = None
    """Longest side of the object [m]; by default its size in the file, or that of its category."""
    category: str | None = None
    """Category of the object, for its size and material; by default read from its folder."""
    json: bool = False
    """Print only the lists, as JSON, on standard output."""


def requests_list(argv: Sequence[str]) -> bool:
    """Return whether ``argv`` has a list flag and no help flag."""
    flags = {word.split("=", 1)[0].replace("_", "-") for word in argv}
    return not flags.isdisjoint(LISTS) and flags.isdisjoint(HELP)


def show_list(argv: Sequence[str]) -> int:
    """Print the lists of the flags in ``argv``; ``--asset X --list-joints`` is accepted too."""
    words = list(argv)
    if "--asset" in words and "--list-joints" in words:
        at = words.index("--list-joints")
        if at + 1 == len(words) or words[at + 1].startswith("-"):
            words[words.index("--asset")] = "--list-joints"
            del words[at]
    flags = parse(ListFlags, words, prog="train")
    from articulate_train.list_joints import joint_rows, task_rows  # see commands/train.py

    content: dict[str, object] = {}
    lines: list[str] = []
    if flags.list_tasks:
        tasks = task_rows()
        content["tasks"] = tasks
        lines += [f"{row['name']:13s} {row['verb']} {row['of']}" for row in tasks]
    if flags.list_joints is not None:
        from articulate_train.config import TrainConfig
        from articulate_train.run import prepare_asset

        config = TrainConfig(
            asset=flags.list_joints,
            closed=flags.closed,
            up=flags.up,
            size=flags.size,
            category=flags.category,
        )
        asset = prepare_asset(config, cache_folder())
        rows = joint_rows(asset, config, console.show_waiting)
        content |= {"asset": asset.name, "joints": [row.as_dict() for row in rows]}
        lines += [line(row) for row in rows] or [f"{asset.name} has no movable joint"]
    console.emit_json(content) if flags.json else console.emit("\n".join(lines))
    return 0


def line(row: JointRow) -> str:
    """Format a joint as one line."""
    unit = "m" if row.kind == "slide" else "rad"
    span = "continuous" if row.lower is None else f"{row.lower:.3g} to {row.upper:.3g} {unit}"
    handle = "no handle" if row.handle is None else f"handle: {row.handle}"
    text = f"{row.name}  {row.kind}, {row.part}  {span}  {handle}  {' '.join(row.tasks)}"
    return f"{text}  {row.feasibility_text}".rstrip()
