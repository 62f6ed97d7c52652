"""What can be asked of an object: its joints, their ranges and handles, the tasks that match."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from articulate.assets.asset import Asset
from articulate.task.part_kinds import part_kind
from articulate.task.task import TASK_RULES, matching_tasks

PART_TEXT = {
    "drawer": "a part that slides level",
    "door": "a part that turns about an upright axis, or stands upright when closed",
    "lid": "a part that lies flat when closed and turns about a level axis, or lifts off",
    "joint": "any movable part",
}
"""What the parts of :data:`articulate.task.task.TASK_RULES` are, where a link's name says nothing."""


@dataclass(frozen=True, kw_only=True)
class JointRow:
    """One movable joint of an object."""

    name: str
    """Name of the joint."""
    link: str
    """Link that it moves."""
    kind: str
    """``slide`` or ``hinge``."""
    part: str
    """What a person would call the part: drawer, door, lid or other."""
    lower: float | None
    """Lower limit [m or rad]; None if it turns without end."""
    upper: float | None
    """Upper limit [m or rad]; None if it turns without end."""
    closed: float
    """Where it is closed [m or rad]."""
    handle: str | None
    """Kind of its handle; None if it has none, and then the arm cannot take it."""
    tasks: tuple[str, ...]
    """Tasks that can be asked of it."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def joint_rows(asset: Asset) -> list[JointRow]:
    """The movable joints of ``asset`` in their order."""
    rows = []
    for joint in asset.joints:
        handle = asset.handle_of(joint.name)
        rows.append(
            JointRow(
                name=joint.name,
                link=joint.link,
                kind=joint.kind,
                part=part_kind(asset, joint),
                lower=joint.lower,
                upper=joint.upper,
                closed=joint.closed,
                handle=None if handle is None else handle.kind,
                tasks=matching_tasks(asset, joint),
            )
        )
    return rows


def task_rows() -> list[dict[str, str]]:
    """Every task: its name, its verb, its part, and what the part is."""
    return [
        {"name": name, "verb": rule.verb, "part": rule.part, "of": PART_TEXT[rule.part]}
        for name, rule in TASK_RULES.items()
    ]
