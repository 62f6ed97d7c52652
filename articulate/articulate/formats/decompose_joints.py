"""Convert joints of several degrees of freedom to hinges and slides between helper links."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from articulate.formats.link_tree import unit_axis
from articulate.formats.source_object import SourceJoint, SourceLink, SourceObject, free_name
from articulate.transforms import Array, normalised

PLANAR_REACH = 0.5
"""Travel of a planar joint without limits, to both sides, in units of the source."""


def decompose_joints(source: SourceObject) -> SourceObject:
    """Return the object with hinges, slides and fixed joints only.

    A planar joint becomes two slides and a hinge, a screw a hinge and a slide that follows it. A
    floating joint is fixed: a loose part is not articulated.

    Raises:
        AssetError: An axis is zero.
    """
    if not any(joint.kind in _KINDS for joint in source.joints):
        return source
    links, joints = dict(source.links), list[SourceJoint]()
    names = {joint.name for joint in source.joints}
    for joint in source.joints:
        if joint.kind not in _KINDS:
            joints.append(joint)
            continue
        for made in _KINDS[joint.kind](joint, source, links, names):
            names.add(made.name)
            joints.append(made)
    return replace(source, links=links, joints=tuple(joints))


def _planar(
    joint: SourceJoint, source: SourceObject, links: dict[str, SourceLink], names: set[str]
) -> list[SourceJoint]:
    limited = joint.lower is not None or joint.upper is not None
    reach = "its limits" if limited else f"{PLANAR_REACH:g} to both sides, for it had no limits"
    source.repairs.note(
        f"joint {joint.name} is planar: two slides and a hinge through helper links; {reach}"
    )
    lower = joint.lower if limited else -PLANAR_REACH
    upper = joint.upper if limited else PLANAR_REACH
    out, parent, T_pc = [], joint.parent, joint.T_pc
    for letter, axis in zip("xy", plane_axes(unit_axis(joint)), strict=True):
        helper = _helper(f"{joint.child}_{letter}", links)
        slide = replace(
            joint,
            name=free_name(f"{joint.name}_{letter}", names),
            kind="prismatic",
            parent=parent,
            child=helper,
            T_pc=T_pc,
            axis=(float(axis[0]), float(axis[1]), float(axis[2])),
            lower=lower,
            upper=upper,
            mimic=None,
        )
        out.append(slide)
        parent, T_pc = helper, np.eye(4)
    turn = replace(joint, kind="continuous", parent=parent, T_pc=T_pc, lower=None, upper=None)
    return [*out, turn]


def _screw(
    joint: SourceJoint, source: SourceObject, links: dict[str, SourceLink], names: set[str]
) -> list[SourceJoint]:
    if not joint.pitch:
        source.repairs.add(f"joint {joint.name} is a screw without a pitch: it only turns")
        kind = "continuous" if joint.lower is None and joint.upper is None else "revolute"
        return [replace(joint, kind=kind)]
    lower, upper = joint.lower or 0.0, joint.upper or 0.0
    if lower == upper:
        lower, upper = 0.0, 2.0 * math.pi
        source.repairs.add(f"joint {joint.name} is a screw without limits: one turn")
    source.repairs.note(
        f"joint {joint.name} is a screw: a hinge, and a slide of {joint.pitch:g} for each turn "
        "that follows it through a helper link"
    )
    rate = joint.pitch / (2.0 * math.pi)
    helper = _helper(f"{joint.child}_slide", links)
    slide = replace(
        joint,
        name=free_name(f"{joint.name}_slide", names),
        kind="prismatic",
        child=helper,
        lower=min(rate * lower, rate * upper),
        upper=max(rate * lower, rate * upper),
        mimic=(joint.name, rate, 0.0),
        pitch=None,
    )
    turn = replace(
        joint, kind="revolute", parent=helper, T_pc=np.eye(4), lower=lower, upper=upper, pitch=None
    )
    return [slide, turn]


def _floating(
    joint: SourceJoint, source: SourceObject, links: dict[str, SourceLink], names: set[str]
) -> list[SourceJoint]:
    source.repairs.add(f"joint {joint.name} is floating: link {joint.child} is fixed at its pose")
    return [replace(joint, kind="fixed")]


_KINDS = {"planar": _planar, "screw": _screw, "floating": _floating}


def plane_axes(normal: Array) -> tuple[Array, Array]:
    """Return the x and y axes (3,), turned with z onto the unit vector ``normal`` (3,).

    The rotation is the smallest one.
    """
    z = np.array([0.0, 0.0, 1.0])
    cross, cosine = np.cross(z, normal), float(normal[2])
    if cosine < -1.0 + 1e-9:
        return np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])
    skew = np.array(
        [[0.0, -cross[2], cross[1]], [cross[2], 0.0, -cross[0]], [-cross[1], cross[0], 0.0]]
    )
    turn = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    return normalised(turn[:, 0]), normalised(turn[:, 1])


def _helper(name: str, links: dict[str, SourceLink]) -> str:
    free = free_name(name, links)
    links[free] = SourceLink(name=free)
    return free
