"""Round parts, buttons and drawers: what turns about its own axis, or slides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.rotational_symmetry import symmetry_deviation
from articulate.reconstruct.actors.semantic.hinge import Line
from articulate.reconstruct.actors.semantic.part_relations import Named, Shape
from articulate.transforms import Array, normalised

LIKE = float(np.cos(np.radians(10.0)))
MOST_NEAR = 300
"""Points of a panel whose normals are compared."""
OPENED = frozenset({"door", "flap", "lid"})
"""What is opened first is not in the way."""
STEPS = tuple(0.07 * k for k in range(1, 14))
"""Shares of a part's depth by which it is moved to see whether it is free."""


def panel_normal(shape: Shape, parent: Shape, scene: Named) -> Array:
    """Where the surface looks on which a part sits, outwards (3,)."""
    points, normals = parent.dense
    reach = 0.6 * float(np.linalg.norm(shape.size)) + 0.03 * scene.diagonal
    near = np.linalg.norm(points - shape.centre, axis=-1) < reach
    if near.sum() < 8:
        near = np.argsort(np.linalg.norm(points - shape.centre, axis=-1))[:40]
    points, found = points[near], normals[near]
    step = 1 + len(found) // MOST_NEAR
    points, found = points[::step], found[::step]
    alike = np.abs(found @ found.T) > LIKE
    best = int(alike.sum(axis=1).argmax())
    mine = found[alike[best]]
    axis = normalised((mine * np.sign(mine @ found[best])[:, None]).sum(axis=0))
    middle = np.median(points, axis=0)
    return axis if float((shape.centre - middle) @ axis) >= 0.0 else -axis


def candidates(shape: Shape, normal: Array) -> list[Array]:
    """The panel's normal, the part's own directions, and those of the frame."""
    found = [normal]
    for _, axis in shape.axes:
        if all(abs(float(axis @ other)) < np.cos(np.radians(4.0)) for other in found):
            found.append(axis)
    return found


def spin_of(shape: Shape, scene: Named, *, level: bool = False) -> Line:
    """The axis about which a part is round; that of what it sits on where it is about none.

    Args:
        shape: The part.
        scene: The object.
        level: It is a wheel, whose axis is level whatever it sits on.
    """
    parent = scene.shapes[scene.hangs[shape.name]]
    normal = panel_normal(shape, parent, scene)
    tree = cKDTree(shape.points)
    best, best_penalty = normal, np.inf
    for axis in candidates(shape, normal):
        off = symmetry_deviation(shape.points, tree, axis, shape.centre)
        width = float(np.ptp(shape.points @ axis)) / (float(np.linalg.norm(shape.size)) + 1e-9)
        if level:
            penalty = off + 0.8 * abs(float(axis[2])) + 0.1 * width
        else:
            penalty = off - 0.25 * abs(float(axis @ normal)) + 0.05 * width
        if penalty < best_penalty:
            best, best_penalty = axis, penalty
    return Line(best, shape.centre, best_penalty, 1.0, "round")


def press_of(shape: Shape, scene: Named) -> Line:
    """The way in which a button is pressed, outwards."""
    parent = scene.shapes[scene.hangs[shape.name]]
    normal = panel_normal(shape, parent, scene)
    best, best_penalty = normal, np.inf
    longest = float(np.max(shape.size)) + 1e-9
    for axis in candidates(shape, normal):
        thick = float(np.ptp(shape.points @ axis)) / longest
        penalty = 0.5 * thick - abs(float(axis @ normal))
        if penalty < best_penalty:
            best, best_penalty = axis, penalty
    out = best if float(best @ normal) >= 0.0 else -best
    return Line(out, shape.centre, best_penalty, 1.0, "pressed")


def slide_of(shape: Shape, scene: Named, ways: Sequence[tuple[Array, float]]) -> Line:
    """The freest of some ways of sliding out, each with a penalty of its own."""
    others = [s for s in scene.around(shape) if s.role not in OPENED]
    found = []
    for axis, penalty in ways:
        depth = float(np.ptp(shape.points @ axis))
        blocked = scene.stops(shape, others, axis, np.array(STEPS) * depth)
        found.append(Line(axis, shape.centre, penalty + blocked, 1.0, "free", blocked))
    return min(found, key=lambda line: line.penalty)


def drawer_of(shape: Shape, scene: Named) -> Line:
    """The way in which a drawer is drawn: mostly to the front."""
    x, y = np.eye(3)[0], np.eye(3)[1]
    ways = [(x, 0.0), (y, 0.25), (-y, 0.25), (-x, 0.25)]
    return slide_of(shape, scene, ways)


def lift_of(shape: Shape, scene: Named) -> Line:
    """The way in which a cap is drawn off: along the body, away from it."""
    parent = scene.shapes[scene.hangs[shape.name]]
    away = shape.centre - parent.centre
    best = int(np.argmax(np.abs(away) / (parent.size + 0.2 * np.max(parent.size))))
    if shape.role == "lift" and best != 2 and abs(away[2]) > 0.3 * abs(away[best]):
        best = 2
    axis = np.eye(3)[best] * (np.sign(away[best]) or 1.0)
    return Line(axis, shape.centre, 0.0, 1.0, "away from the body")


def held_at(shape: Shape, scene: Named) -> Array:
    """Middle of where a part is held (3,); of the part where nothing touches."""
    parent = scene.shapes[scene.hangs[shape.name]]
    for share in (0.5, 1.0, 2.0):
        touching = scene.contact(shape, parent, share)
        if len(touching) >= 8:
            return np.asarray(0.5 * (touching.min(axis=0) + touching.max(axis=0)))
    return shape.centre
