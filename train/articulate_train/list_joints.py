"""List the joints of an object, their ranges and handles, and the matching tasks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

from articulate.assets.asset import Asset
from articulate.errors import UsageError
from articulate.task.part_kinds import part_kind
from articulate.task.task import TASK_RULES, matching_tasks
from articulate_envs.feasibility import Feasibility
from articulate_train.config import TrainConfig
from articulate_train.feasibility_check import best_scene, describe_feasibility, feasibility_of

PART_TEXT = {
    "drawer": "a part that slides horizontally",
    "door": "a part that turns about a vertical axis, or is vertical when closed",
    "lid": "a part that is flat when closed and turns about a horizontal axis, or lifts off",
    "joint": "any movable part",
}
"""Definition of the parts of :data:`articulate.task.task.TASK_RULES` without a telling name."""


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
    """Kind of the part: drawer, door, lid or joint."""
    lower: float | None
    """Lower limit [m or rad]; None if it is continuous."""
    upper: float | None
    """Upper limit [m or rad]; None if it is continuous."""
    closed: float
    """Closed position [m or rad]."""
    handle: str | None
    """Kind of its handle; None without a handle that the arm can grasp."""
    tasks: tuple[str, ...]
    """Matching tasks."""
    feasibility: Feasibility | None
    """Success rate of the scripted expert in the first task; None if it was not run."""
    note: str
    """Reason why it was not run."""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return asdict(self)

    @property
    def feasibility_text(self) -> str:
        """Description of the feasibility, or the reason why it is unknown."""
        return self.note if self.feasibility is None else describe_feasibility(self.feasibility)


def joint_rows(
    asset: Asset, config: TrainConfig, show_progress: Callable[[str], None] = lambda _: None
) -> list[JointRow]:
    """Return the movable joints of ``asset`` in order.

    Args:
        asset: The object.
        config: Randomization, control and physics of the feasibility estimate.
        show_progress: Called with one line before each estimate.
    """
    rows = []
    for joint in asset.joints:
        handle = asset.handle_of(joint.name)
        tasks = matching_tasks(asset, joint)
        found, note = None, ""
        if tasks and handle is not None:
            show_progress(f"{joint.name}: running the scripted expert on sampled episodes")
            each = replace(config, joint=joint.name, task=tasks[0])
            found, note = _feasibility(asset, each, show_progress)
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
                tasks=tasks,
                feasibility=found,
                note=note,
            )
        )
    return rows


def _feasibility(
    asset: Asset, config: TrainConfig, show_progress: Callable[[str], None]
) -> tuple[Feasibility | None, str]:
    """Estimate the feasibility of a joint, or return the reason why that is not possible."""
    try:
        scene = best_scene(config, asset, show_progress)
        return feasibility_of(scene, config), ""
    except UsageError as error:
        return None, f"not trainable: {error}"


def task_rows() -> list[dict[str, str]]:
    """Return all tasks: name, verb, part and definition of the part."""
    return [
        {"name": name, "verb": rule.verb, "part": rule.part, "of": PART_TEXT[rule.part]}
        for name, rule in TASK_RULES.items()
    ]
