"""Axes of knobs, buttons, drawers and caps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.rotational_symmetry import symmetry_deviation
from articulate.reconstruct.actors.semantic.hinge import AxisCandidate
from articulate.reconstruct.actors.semantic.part_relations import LabelledScene, PartShape
from articulate.transforms import Array, normalised

EQUAL_NORMAL_COS = float(np.cos(np.radians(10.0)))
MAX_NORMALS = 300
"""Points of a panel whose normals are compared."""
OPENING_ROLES = frozenset({"door", "flap", "lid"})
"""Roles that are opened first, and so do not block."""
STEPS = tuple(0.07 * k for k in range(1, 14))
"""Travel at which collisions are checked, as shares of a part's depth."""


def panel_normal(shape: PartShape, parent: PartShape, scene: LabelledScene) -> Array:
    """Return the outward normal (3,) of the surface on which a part is mounted."""
    points, normals = parent.dense
    touch_m = 0.6 * float(np.linalg.norm(shape.size)) + 0.03 * scene.diagonal
    near = np.linalg.norm(points - shape.centre, axis=-1) < touch_m
    if near.sum() < 8:
        near = np.argsort(np.linalg.norm(points - shape.centre, axis=-1))[:40]
    points, found = points[near], normals[near]
    step = 1 + len(found) // MAX_NORMALS
    points, found = points[::step], found[::step]
    alike = np.abs(found @ found.T) > EQUAL_NORMAL_COS
    best = int(alike.sum(axis=1).argmax())
    mine = found[alike[best]]
    axis = normalised((mine * np.sign(mine @ found[best])[:, None]).sum(axis=0))
    middle = np.median(points, axis=0)
    return axis if float((shape.centre - middle) @ axis) >= 0.0 else -axis


def candidates(shape: PartShape, normal: Array) -> list[Array]:
    """Return the panel's normal, the part's own directions, and those of the frame."""
    found = [normal]
    for _, axis in shape.axes:
        if all(abs(float(axis @ other)) < np.cos(np.radians(4.0)) for other in found):
            found.append(axis)
    return found


def find_spin_axis(shape: PartShape, scene: LabelledScene, *, level: bool = False) -> AxisCandidate:
    """Return the symmetry axis of a part, or the normal of its panel if it has none.

    Args:
        shape: The part.
        scene: The object.
        level: It is a wheel, whose axis is horizontal.
    """
    parent = scene.shapes[scene.parent_names[shape.name]]
    normal = panel_normal(shape, parent, scene)
    tree = cKDTree(shape.points)
    best, best_penalty = normal, np.inf
    for axis in candidates(shape, normal):
        distance = symmetry_deviation(shape.points, tree, axis, shape.centre)
        width = float(np.ptp(shape.points @ axis)) / (float(np.linalg.norm(shape.size)) + 1e-9)
        if level:
            penalty = distance + 0.8 * abs(float(axis[2])) + 0.1 * width
        else:
            penalty = distance - 0.25 * abs(float(axis @ normal)) + 0.05 * width
        if penalty < best_penalty:
            best, best_penalty = axis, penalty
    return AxisCandidate(best, shape.centre, best_penalty, 1.0, "round")


def find_press_axis(shape: PartShape, scene: LabelledScene) -> AxisCandidate:
    """Return the axis along which a button is pressed, outwards."""
    parent = scene.shapes[scene.parent_names[shape.name]]
    normal = panel_normal(shape, parent, scene)
    best, best_penalty = normal, np.inf
    longest = float(np.max(shape.size)) + 1e-9
    for axis in candidates(shape, normal):
        thick = float(np.ptp(shape.points @ axis)) / longest
        penalty = 0.5 * thick - abs(float(axis @ normal))
        if penalty < best_penalty:
            best, best_penalty = axis, penalty
    out = best if float(best @ normal) >= 0.0 else -best
    return AxisCandidate(out, shape.centre, best_penalty, 1.0, "pressed")


def find_slide_axis(
    shape: PartShape, scene: LabelledScene, distances: Sequence[tuple[Array, float]]
) -> AxisCandidate:
    """Return the least blocked of some slide directions, each with a prior penalty."""
    others = [s for s in scene.neighbours(shape) if s.role not in OPENING_ROLES]
    found = []
    for axis, penalty in distances:
        depth = float(np.ptp(shape.points @ axis))
        blocked = scene.blocked_share_along(shape, others, axis, np.array(STEPS) * depth)
        found.append(AxisCandidate(axis, shape.centre, penalty + blocked, 1.0, "free", blocked))
    return min(found, key=lambda line: line.penalty)


def find_drawer_axis(shape: PartShape, scene: LabelledScene) -> AxisCandidate:
    """Return the axis along which a drawer slides: usually to the front."""
    x, y = np.eye(3)[0], np.eye(3)[1]
    distances = [(x, 0.0), (y, 0.25), (-y, 0.25), (-x, 0.25)]
    return find_slide_axis(shape, scene, distances)


def find_lift_axis(shape: PartShape, scene: LabelledScene) -> AxisCandidate:
    """Return the axis along which a cap is removed: along the body, away from it."""
    parent = scene.shapes[scene.parent_names[shape.name]]
    away = shape.centre - parent.centre
    best = int(np.argmax(np.abs(away) / (parent.size + 0.2 * np.max(parent.size))))
    if shape.role == "lift" and best != 2 and abs(away[2]) > 0.3 * abs(away[best]):
        best = 2
    axis = np.eye(3)[best] * (np.sign(away[best]) or 1.0)
    return AxisCandidate(axis, shape.centre, 0.0, 1.0, "away from the body")


def contact_centre(shape: PartShape, scene: LabelledScene) -> Array:
    """Return the centre of a part's contact with its parent, or its own (3,) [m]."""
    parent = scene.shapes[scene.parent_names[shape.name]]
    for share in (0.5, 1.0, 2.0):
        touching = scene.contact(shape, parent, share)
        if len(touching) >= 8:
            return np.asarray(0.5 * (touching.min(axis=0) + touching.max(axis=0)))
    return shape.centre
