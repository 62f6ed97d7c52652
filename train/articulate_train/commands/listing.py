"""``train --list-tasks`` and ``train --list-joints ASSET``: what can be asked, and of what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from articulate.cache import cache_folder
from articulate.commands import console
from articulate.commands.flags import parse

if TYPE_CHECKING:
    from articulate_train.list_joints import JointRow

LISTS = ("--list-tasks", "--list-joints")
"""Flags that ask for a list instead of a training."""


@dataclass(frozen=True, kw_only=True)
class ListFlags:
    """List the tasks, or the joints of an object and the tasks that can be asked of them.

    Example: train --list-joints cabinet.urdf
    """

    list_tasks: bool = False
    """Print the names of the tasks and what they ask."""
    list_joints: str | None = None
    """Print the joints of this object: URDF or MJCF file, a folder that holds one, or an asset
    folder."""
    closed: Literal["auto", "lower", "upper"] = "auto"
    """Which limit of a joint is its closed end."""
    size: float | None = None
    """Longest side of the object [m]; by default its own size, or that of its category."""
    category: str | None = None
    """Category of the object, for its size and material; by default what its folder says."""
    json: bool = False
    """Print the lists as JSON and nothing else on standard output."""


def asks_for_a_list(argv: Sequence[str]) -> bool:
    """Whether ``argv`` asks for a list and not for help."""
    flags = {word.split("=", 1)[0].replace("_", "-") for word in argv}
    return not flags.isdisjoint(LISTS) and flags.isdisjoint(("--help", "-h"))


def show_list(argv: Sequence[str]) -> int:
    """Print the lists that ``argv`` asks for."""
    flags = parse(ListFlags, argv, prog="train")
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
            size=flags.size,
            category=flags.category,
        )
        asset = prepare_asset(config, cache_folder())
        rows = joint_rows(asset)
        content |= {"asset": asset.name, "joints": [row.as_dict() for row in rows]}
        lines += [line(row) for row in rows] or [f"{asset.name} has no movable joint"]
    console.emit_json(content) if flags.json else console.emit("\n".join(lines))
    return 0


def line(row: JointRow) -> str:
    """A joint as people read it."""
    unit = "m" if row.kind == "slide" else "rad"
    span = "without end" if row.lower is None else f"{row.lower:.3g} to {row.upper:.3g} {unit}"
    handle = "no handle" if row.handle is None else f"handle: {row.handle}"
    return f"{row.name}  {row.kind}, {row.part}  {span}  {handle}  {' '.join(row.tasks)}"
