"""What each clause means, why it matters, and how to mend what it finds."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from articulate.errors import ConfigError, nearest


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """A clause in words."""

    means: str
    """What is measured and what is allowed."""
    matters: str
    """What goes wrong for those who use an object that fails it."""
    mend: str
    """What can be done about it."""


CHECKS: dict[str, Meaning] = {
    "loads": Meaning(
        means="MuJoCo compiles object.xml, and every link and joint of asset.json is in it.",
        matters="Nothing else can be measured on a model that the engine does not accept.",
        mend="The message is the engine's own. In a folder edited by hand undo the last change; "
        "in a fresh one it is a fault of the conversion that is worth a report.",
    ),
    "forward_kinematics": Meaning(
        means="At 100 random joint states every link lies where yourdfpy and PyBullet put it when "
        "they read object.urdf: to 1e-6 m and rad. So does every link, and every handle, where "
        "asset.json puts it, at five positions of each joint with the others at 0.",
        matters="A planner that reads the URDF and a simulator that reads the MJCF would see two "
        "different objects, and a hand that asset.json leads would reach past the handle.",
        mend="The link that is named is the first in the tree that strays: compare the origin "
        "and axis of its joint, and mimic factors, in object.xml, object.urdf and asset.json.",
    ),
    "input_kinematics": Meaning(
        means="At 100 random joint states every moving link lies where yourdfpy or MuJoCo puts it "
        "when they read the input as it is, up to the listed scale, the object frame and axes "
        "made unit length: to 1e-6 m and rad.",
        matters="Otherwise another object was converted than the one that was given.",
        mend="Look at the origin and axis of the joint that moves the named link. If the input "
        "itself is ambiguous (two roots, names used twice), make it unambiguous.",
    ),
    "visual_fidelity": Meaning(
        means="At least 99 % of points on what each link shows in the input lie on what it shows "
        "in the asset, and the other way round, to 0.1 % of its diagonal; so do those on each of "
        "its meshes by itself.",
        matters="A mesh that was lost, mirrored or scaled once too often makes another object.",
        mend="Look at the link in the page and in the input; in a fresh conversion it is a "
        "fault that is worth a report.",
    ),
    "joint_limits": Meaning(
        means="Type, range, damping and dry friction of each joint are the same in object.xml, "
        "object.urdf and asset.json; the range is not empty and holds the closed and the open "
        "position.",
        matters="Swapped or absent limits let a simulator turn a drawer inside out: MuJoCo reads "
        "lower above upper as no limit at all and says nothing.",
        mend="Give lower < upper in the input, or lower = upper = 0 for a part that is fixed. "
        "What was changed in one of the three files goes into the others, too.",
    ),
    "inertia": Meaning(
        means="Every link has a mass above 0, an inertia that is positive definite, whose largest "
        "moment is at most the sum of the others and which fits into the link's box, and a centre "
        "of mass inside that box; the same as in object.urdf and asset.json.",
        matters="An inertia that no body can have makes energy from nothing; a misplaced centre "
        "of mass makes doors swing by themselves.",
        mend="Leave <inertial> out: it is computed from the collision shapes and the density of "
        "the category. Or export it from a tool that knows the material.",
    ),
    "mass": Meaning(
        means="The mass of the whole object and what that is for each m3 of its box; reported, "
        "and never a reason to refuse.",
        matters="A drawer of 45 kg loads and simulates, but no arm opens it.",
        mend="Give --category, which decides the density, or --size, which decides the volume.",
    ),
    "joint_sweep": Meaning(
        means="Each joint goes through its whole range, the others closed, without a part going "
        "more than 2 mm deeper into another than at rest, by distance queries on collision "
        "shapes whatever their contact masks.",
        matters="A part that runs into the body is stuck, or is let through only by contacts "
        "that were switched off.",
        mend="If the authored parts meet as well, which sweep_authored says, mend those first. "
        "If only the shapes meet, they are too coarse: raise --max-geoms. What less than 5 % of "
        "the visible surface costs is cut away by itself.",
    ),
    "authored_overlap": Meaning(
        means="Where collision shapes meet on the way of a joint, the parts as they were authored "
        "meet there, too, or two joints each need the other one open first. It is listed only "
        "where it fails.",
        matters="No collision shape can mend an object whose parts run through each other.",
        mend="Edges that hardly matter to what is seen are cut away, and a way of which half or 75 "
        "degrees are left then is shortened, by itself; otherwise mend the limits, the axis or "
        "the meshes of the two parts that are named.",
    ),
    "joint_sweep_random": Meaning(
        means="The same with the other joints anywhere in their ranges. States in which the "
        "authored parts themselves meet are drawn again and counted.",
        matters="A robot does not close every other drawer first.",
        mend="As for sweep: limits, axes and meshes of the two parts, or finer shapes.",
    ),
    "cavities": Meaning(
        means="Where a link is hollow (more than 5 % of its convex hull lies outside its "
        "material, at winding numbers below 0.5, and can be seen from outside), at least 85 % of "
        "that cavity is outside the collision shapes, too. Links thinner than 10 mm do not count, "
        "nor do those where a ball of 10 mm has room in less than 1 % of the hull.",
        matters="A drawer that collides as a solid block cannot be filled, and a cabinet that "
        "does so cannot be opened.",
        mend="Raise --max-geoms, or give <collision> elements of your own: boxes for the walls.",
    ),
    "finger_clearance": Meaning(
        means="How much room there is beside each handle for the fingers of a gripper with "
        "everything closed; said, and not a reason to refuse.",
        matters="A handle that lies flush has to be pushed or hooked, not held.",
        mend="Name the handle's visual element `handle` if another part was taken for it.",
    ),
    "collision_coverage": Meaning(
        means="At least 95 % of points on each link's visual surface lie within 3 mm, or 1 % of "
        "its diagonal, of its collision shapes, and the other way round. Where shapes lie against "
        "each other inside the material there is no surface to compare.",
        matters="A hand would reach through what has no collision shape, and stop in the air "
        "where a shape stands for nothing.",
        mend="Raise --max-geoms, or remove the <collision> elements that do not fit.",
    ),
    "settling": Meaning(
        means="Left alone under gravity the object comes to rest, and stays there for 2 s at its "
        "time step and at half of it: no joint strays by more than 1 % of its range. A lid that "
        "falls shut is right, and said.",
        matters="An object that opens by itself, or trembles, cannot be a task.",
        mend="Look for contacts between parts at rest; give the joint dry friction.",
    ),
    "energy": Meaning(
        means="Left alone, the mechanical energy of the object rises by at most 1 % of its "
        "m g height.",
        matters="Energy out of nothing comes from overlapping parts that throw each other, or "
        "from inertias that no body can have; policies learn to exploit it.",
        mend="Mend the overlaps at rest, and what the clause inertia says.",
    ),
    "opening": Meaning(
        means="At most 30 N at the handle, or the torque they make, open at least 90 % of the "
        "range (hinges up to 90 degrees) within 3 s, contacts as they are.",
        matters="That is what a person, or an arm of a few kilograms, can do.",
        mend="Look at what the joint touches on its way, at its friction and damping, and at the "
        "mass of the part.",
    ),
    "closing": Meaning(
        means="The same force closes it again.",
        matters="A part that catches on the way back ends an episode for good.",
        mend="As for open: what it touches on its way, friction, damping, mass.",
    ),
    "rigid": Meaning(
        means="The object has no joint that moves; it is proven as one rigid body.",
        matters="It can be grasped or placed, not opened.",
        mend="If something should move, its joint is of type fixed or has an empty range.",
    ),
}
"""By name, in the order in which they are measured."""


def meanings() -> dict[str, str]:
    """What each clause means, by name."""
    return {name: check.means for name, check in CHECKS.items()}


def meaning_of(name: str) -> Meaning:
    """The clause called ``name`` in words.

    Raises:
        ConfigError: There is none.
    """
    check = CHECKS.get(name)
    if check is None:
        raise ConfigError(f"--explain {name}: no such clause{nearest(name, CHECKS)}")
    return check


def explained(name: str) -> str:
    """All that is to be said about the clause called ``name``.

    Raises:
        ConfigError: There is none.
    """
    check = meaning_of(name)
    return (
        f"{name}\n\nWhat it means. {check.means}\n\nWhy it matters. {check.matters}\n\n"
        f"How to mend it. {check.mend}"
    )


def explained_content(name: str) -> dict[str, str]:
    """The same for programs: the name and the texts by what they tell.

    Raises:
        ConfigError: There is none.
    """
    return {"clause": name, **dataclasses.asdict(meaning_of(name))}
