"""Relief: a hinge moved by what a picture leaves open, where parts graze each other as it was said.

Real parts do not go through each other. Where they do by a little, about an axis that was read from
a picture, the axis lies a little beside: a pixel of a clip is some thousandths of an object. Only
what the proof refuses for that is tried elsewhere, and only so far.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from articulate.assets.check_report import CheckReport
from articulate.reconstruct.actors.geometric.candidates import plane_of
from articulate.reconstruct.actors.protocol import PredictedJoint, TraceStep
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, normalised

STEP = 0.00175
"""A pivot is moved by this share of the object's diagonal in each of four directions, then where
that helped by as much in two at once, and by twice that: 0.5 % at most, a fifth of the error that
the publication's protocol allows."""

Held = Mapping[str, PredictedJoint]
"""The joint of every part but the one that stands still, by part."""


def relieved(
    held: Held, rejection: CheckReport, run_checks: Callable[[Held], CheckReport], size_m: float
) -> Held | None:
    """``held`` with one hinge moved so that the object is proven; None if that is not to be had.

    Args:
        held: Joints as they were said.
        refusal: The proof of what was made of them.
        prove: Makes the object of other joints and proves it.
        size_m: Diagonal of the object, in the units of the joints.
    """
    depth_m = graze_m(rejection)
    part = max(depth_m, key=lambda name: depth_m[name], default="")
    if part not in held or held[part].kind not in {"revolute", "continuous"}:
        return None
    towards = np.zeros(3)
    for way in plane_of(normalised(held[part].axis_o)):
        for sign in (1.0, -1.0):
            moved = _moved(held, part, sign * STEP * size_m * way)
            check_report = run_checks(moved)
            if check_report.is_usable:
                return moved
            if check_report.verdict == "undecided":
                continue
            gain = depth_m[part] - graze_m(check_report).get(part, 0.0)
            if set(graze_m(check_report)) <= {part} and gain > 0.0:
                towards += sign * way
    for factor in (1.0, 2.0) if towards.any() else ():
        moved = _moved(held, part, factor * STEP * size_m * towards)
        if run_checks(moved).is_usable:
            return moved
    return None


def graze_m(check_report: CheckReport) -> dict[str, float]:
    """How deep each part goes into others as authored, by part [m]; empty where more is wrong."""
    failed = [check for check in check_report.checks if check.outcome == "failed"]
    if any(check.name != "authored_overlap" or check.measured is None for check in failed):
        return {}
    return {check.subject.removesuffix("_joint"): float(check.measured or 0.0) for check in failed}


def diagonal_of(meshes: Sequence[PartMesh]) -> float:
    """Diagonal of the box around all parts, in their units."""
    return float(np.linalg.norm(np.ptp(joint_bounds(meshes), axis=0)))


def told(said: Held, moved: Held) -> TraceStep:
    """What was moved, for people to read."""
    off = {
        part: float(np.linalg.norm(np.subtract(moved[part].pivot_o, said[part].pivot_o)))
        for part in said
        if moved[part] != said[part]
    }
    names = ", ".join(off)
    text = (
        f"the hinge of {names} lies a little beside where it was said: parts graze each other there"
    )
    return TraceStep(title="where parts pass each other", text=text, figures=off)


def _moved(held: Held, part: str, shift: Array) -> Held:
    x, y, z = (float(v) for v in np.asarray(held[part].pivot_o) + shift)
    return {**held, part: replace(held[part], pivot_o=(x, y, z))}
