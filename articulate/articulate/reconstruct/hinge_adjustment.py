"""Move a hinge within its estimation error so that parts no longer collide.

Real parts do not penetrate each other. A slight penetration about an axis that was estimated from
an image is an error of the axis: one pixel of a video is a few thousandths of the object. Only
objects that the checks reject for such a penetration are adjusted, and only that far.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from articulate.assets.check_report import CheckReport
from articulate.reconstruct.actors.geometric.surface import perpendicular_axes
from articulate.reconstruct.actors.protocol import PredictedJoint, TraceStep
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, normalised

STEP = 0.00175
"""Shift of a pivot as a share of the object's diagonal, in each of four directions. Directions that
help are then combined, once and twice as far: at most 0.5 %, a fifth of the error that the
publication's protocol accepts."""

LARGEST = 4.0 * 2.0**0.5
"""Largest motion of a point of the part, in steps: twice the shift of the pivot, which is two steps
in each of two directions. No deeper penetration is adjusted."""

PartJoints = Mapping[str, PredictedJoint]
"""The joint of every part but the root, by part."""


def adjust_hinge(
    part_joints: PartJoints,
    check_report: CheckReport,
    check: Callable[[PartJoints], CheckReport],
    size_m: float,
) -> PartJoints | None:
    """Return the joints with one hinge moved so that the checks pass; None if no shift helps.

    Args:
        part_joints: Estimated joints.
        check_report: Report of the object with these joints.
        check: Function that checks the object with other joints.
        size_m: Diagonal of the object, in the units of the joints.
    """
    depth_m = penetration_m(check_report)
    part = max(depth_m, key=lambda name: depth_m[name], default="")
    if part not in part_joints or part_joints[part].kind not in {"revolute", "continuous"}:
        return None
    if depth_m[part] > LARGEST * STEP * size_m:
        return None
    towards = np.zeros(3)
    for direction in perpendicular_axes(normalised(part_joints[part].axis_o)):
        for sign in (1.0, -1.0):
            moved = _moved(part_joints, part, sign * STEP * size_m * direction)
            report = check(moved)
            if report.is_usable:
                return moved
            gain = depth_m[part] - penetration_m(report).get(part, 0.0)
            if set(penetration_m(report)) <= {part} and gain > 0.0:
                towards += sign * direction
    for factor in (1.0, 2.0) if towards.any() else ():
        moved = _moved(part_joints, part, factor * STEP * size_m * towards)
        if check(moved).is_usable:
            return moved
    return None


def penetration_m(check_report: CheckReport) -> dict[str, float]:
    """Return the depth [m] by which each authored part penetrates others, by part.

    It is empty if another check failed as well.
    """
    failed = [check for check in check_report.checks if check.outcome == "failed"]
    if any(check.name != "authored_overlap" or check.measured is None for check in failed):
        return {}
    return {check.subject.removesuffix("_joint"): float(check.measured or 0.0) for check in failed}


def diagonal_of(meshes: Sequence[PartMesh]) -> float:
    """Compute the diagonal of the box around all parts, in their units."""
    return float(np.linalg.norm(np.ptp(joint_bounds(meshes), axis=0)))


def describe_adjustment(estimated: PartJoints, adjusted: PartJoints) -> TraceStep:
    """Describe the shift of a hinge for the trace."""
    shift = {
        part: float(np.linalg.norm(np.subtract(adjusted[part].pivot_o, estimated[part].pivot_o)))
        for part in estimated
        if adjusted[part] != estimated[part]
    }
    text = f"The hinge of {', '.join(shift)} was moved: parts collide slightly where it was."
    return TraceStep(title="hinge adjustment", text=text, figures=shift)


def _moved(part_joints: PartJoints, part: str, shift: Array) -> PartJoints:
    x, y, z = (float(v) for v in np.asarray(part_joints[part].pivot_o) + shift)
    return {**part_joints, part: replace(part_joints[part], pivot_o=(x, y, z))}
