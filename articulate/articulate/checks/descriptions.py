"""Meaning, importance and remedy of each check; also the source of the reference page."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from articulate.errors import ConfigError, nearest


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """Description of a check."""

    means: str
    """Measured quantity and limit."""
    matters: str
    """Consequence for users of an object that fails it."""
    remedy: str
    """Steps that make an object pass."""


CHECKS: dict[str, Meaning] = {
    "loads": Meaning(
        means="MuJoCo compiles object.xml, and every link and joint of asset.json is in it.",
        matters="Nothing else can be measured on a model that the engine does not accept.",
        remedy="The message is that of the engine. In a folder that was edited by hand undo the "
        "last change; after a fresh conversion please report it.",
    ),
    "forward_kinematics": Meaning(
        means="At 100 random joint states every link is where yourdfpy and PyBullet put it when "
        "they read object.urdf, to 1e-6 m and rad. Every link and handle is also where asset.json "
        "puts it, at five positions of each joint with the others at 0.",
        matters="Otherwise a planner that reads the URDF and a simulator that reads the MJCF have "
        "two different objects. A gripper that follows asset.json would miss the handle.",
        remedy="The link that is named is the first in the tree that deviates. Compare origin and "
        "axis of its joint, and mimic factors, in object.xml, object.urdf and asset.json.",
    ),
    "input_kinematics": Meaning(
        means="At 100 random joint states every moving link is where yourdfpy or MuJoCo puts it, "
        "to 1e-6 m and rad. They read the input file; the listed scale, the object frame and "
        "normalized axes are taken into account.",
        matters="Otherwise the asset is another object than the input.",
        remedy="Check origin and axis of the joint that moves the named link. If the input "
        "itself is ambiguous (two roots, names used twice), make it unambiguous.",
    ),
    "visual_fidelity": Meaning(
        means="The visual surfaces of each link in input and asset agree: at least 99 % of points "
        "on either are on the other, to 0.1 % of the diagonal. The same holds for each mesh.",
        matters="A mesh that was lost, mirrored or scaled twice makes another object.",
        remedy="Compare the link on the page with the input; after a fresh conversion please "
        "report it.",
    ),
    "joint_limits": Meaning(
        means="Type, range, damping and dry friction of each joint are the same in object.xml, "
        "object.urdf and asset.json; the range is not empty and contains the closed and the open "
        "position.",
        matters="Swapped or absent limits let a simulator turn a drawer inside out: MuJoCo reads "
        "lower above upper as no limit at all, without a warning.",
        remedy="Give lower < upper in the input, or lower = upper = 0 for a part that is fixed. "
        "Apply a change in one of the three files to the others, too.",
    ),
    "inertia": Meaning(
        means="Every link has a mass above 0 and a positive definite inertia. Its largest moment "
        "is at most the sum of the others. The inertia fits into the bounding box, and the centre "
        "of mass is inside. All values agree with object.urdf and asset.json.",
        matters="An inertia that no body can have creates energy; a misplaced centre of mass "
        "makes doors swing by themselves.",
        remedy="Omit <inertial>: it is computed from the collision shapes and the density of "
        "the category. Or export it from a tool that has the material.",
    ),
    "mass": Meaning(
        means="Mass of the object and its ratio to the volume of the bounding box; reported "
        "only, never a reason for rejection.",
        matters="A drawer of 45 kg loads and simulates, but no arm opens it.",
        remedy="Give --category, which decides the density, or --size, which decides the volume.",
    ),
    "joint_sweep": Meaning(
        means="Each joint moves through its range, with the others closed, without a part "
        "penetrating another one more than 2 mm deeper than at rest. Distances are measured "
        "between collision shapes whatever their contact masks.",
        matters="A part that runs into the body is stuck, or passes only because contacts "
        "were switched off.",
        remedy="If the authored parts overlap as well (check authored_overlap), correct those "
        "first. If only the shapes overlap, they are too coarse: raise --max-geoms. Volume that "
        "covers less than 5 % of the visible surface is trimmed automatically.",
    ),
    "authored_overlap": Meaning(
        means="Collision shapes overlap on the travel of a joint because the authored surfaces "
        "cross as well, or because two joints each require the other one to be open first. It "
        "is listed only where it fails.",
        matters="No collision shape can correct an object whose parts run through each other.",
        remedy="Edges that hardly matter for the visible surface are trimmed, and a travel of "
        "which half or 75 degrees remain is shortened, automatically. Otherwise correct "
        "limits, axis or meshes of the two named parts. If every joint opens and closes, --accept "
        "authored_overlap turns the failure into a warning.",
    ),
    "joint_sweep_random": Meaning(
        means="Like joint_sweep, with the other joints anywhere in their ranges. States in which "
        "the authored parts themselves overlap are sampled again and counted.",
        matters="A robot does not close every other drawer first.",
        remedy="As for joint_sweep: limits, axes and meshes of the two parts, or finer shapes.",
    ),
    "trimming": Meaning(
        means="Repairs cut away at most a third of the collision volume of each part. It is "
        "listed only for parts that were trimmed.",
        matters="A part without much of its volume is another part: a gripper reaches through it.",
        remedy="Correct the limits, the axis or the meshes of the part so that it passes the "
        "others as authored.",
    ),
    "cavities": Meaning(
        means="Where a link is hollow, at least 85 % of the cavity is outside the collision "
        "shapes. Hollow means that more than 5 % of its convex hull is outside the material "
        "(winding number below 0.5) and visible from outside. Links thinner than 10 mm do not "
        "count. Links where a ball of 10 mm fits into less than 1 % of the hull do not either.",
        matters="A drawer that collides as a solid block cannot be filled, and a cabinet that "
        "does so cannot be opened.",
        remedy="Raise --max-geoms, or add <collision> elements: boxes for the walls.",
    ),
    "finger_clearance": Meaning(
        means="Free space beside each handle for the fingers of a gripper with all joints "
        "closed; reported only, never a reason for rejection.",
        matters="A flush handle has to be pushed or hooked, not grasped.",
        remedy="Name the handle's visual element `handle` if another part was detected as handle.",
    ),
    "collision_coverage": Meaning(
        means="Visual surface and collision shapes of each link agree: at least 95 % of points on "
        "either are within 3 mm, or 1 % of the diagonal, of the other. Where shapes touch "
        "each other inside the material there is no surface to compare.",
        matters="A gripper would reach through parts without a collision shape, and stop in the "
        "air at shapes without a visible part.",
        remedy="Raise --max-geoms, or remove the <collision> elements that do not fit.",
    ),
    "settling": Meaning(
        means="Under gravity only the object comes to rest and stays there for 2 s, at its time "
        "step and at half of it. No joint drifts by more than 1 % of its range. A lid that falls "
        "shut passes and is reported.",
        matters="An object that opens by itself, or trembles, cannot be a task.",
        remedy="Look for contacts between parts at rest; give the joint dry friction.",
    ),
    "energy": Meaning(
        means="Without external forces the mechanical energy of the object rises by at most 1 % "
        "of m g height.",
        matters="Spurious energy comes from overlapping parts that repel each other, or "
        "from impossible inertias; policies learn to exploit it.",
        remedy="Correct overlaps at rest, and failures of the check inertia.",
    ),
    "opening": Meaning(
        means="A force of at most 30 N at the handle, or its torque, opens at least 90 % of the "
        "range within 3 s. For hinges the range ends at 90 degrees. Contacts are active.",
        matters="A person, or an arm of a few kilograms, can apply this force.",
        remedy="Look at contacts on the travel, at friction and damping of the joint, and at the "
        "mass of the part.",
    ),
    "closing": Meaning(
        means="The same force closes it again.",
        matters="A part that jams on the way back ends an episode for good.",
        remedy="As for opening: contacts on the travel, friction, damping, mass.",
    ),
    "rigid": Meaning(
        means="The object has no joint that moves; it is checked as one rigid body.",
        matters="It can be grasped or placed, not opened.",
        remedy="If a part should move, its joint is of type fixed or has an empty range.",
    ),
}
"""Descriptions by name, in the order in which the checks run."""


def meanings() -> dict[str, str]:
    """Return the meaning of each check by name."""
    return {name: check.means for name, check in CHECKS.items()}


def meaning_of(name: str) -> Meaning:
    """Return the description of the check called ``name``.

    Raises:
        ConfigError: There is none.
    """
    check = CHECKS.get(name)
    if check is None:
        raise ConfigError(f"--explain {name}: no such check{nearest(name, CHECKS)}")
    return check


def explain(name: str) -> str:
    """Return the description of the check called ``name`` as text.

    Raises:
        ConfigError: There is none.
    """
    check = meaning_of(name)
    return (
        f"{name}\n\nMeaning. {check.means}\n\nImportance. {check.matters}\n\nRemedy. {check.remedy}"
    )


def explanation_content(name: str) -> dict[str, str]:
    """Return the description of the check called ``name`` as a JSON object.

    Raises:
        ConfigError: There is none.
    """
    return {"check": name, **dataclasses.asdict(meaning_of(name))}
