"""What the compiler of an MJCF file does to masses that stand in it: least values, and a total."""

from __future__ import annotations

from typing import Any

import numpy as np

from articulate.formats.repairs import Repairs
from articulate.transforms import Array

# What the child process found, as JSON.
Found = dict[str, Any]


def tensor(inertial: Found) -> Array:
    """Inertia (3, 3) about the centre of mass [kg m2]."""
    xx, yy, zz, xy, xz, yz = inertial["full"]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def apply_rules(found: Found, repairs: Repairs) -> None:
    """Bound masses and inertias from below and give them their total, as MuJoCo's compiler does.

    The world has no mass. The total is not applied where the mass of a body is not known.

    Args:
        found: What the child process found; the masses in it are changed.
        repairs: Takes what was changed.
    """
    rules = found["rules"]
    bodies = [body for body in found["bodies"] if body["parent"] != body["name"]]
    heavy = [body for body in bodies if body["inertial"] is not None]
    if max(rules["mass"], rules["inertia"]) > 0.0:
        _bound(heavy, rules["mass"], rules["inertia"], repairs)
    total = rules["total"]
    if total <= 0.0:
        return
    unknown = [
        body["name"]
        for body in bodies
        if body["inertial"] is None and any(_weighs(geom) for geom in body["geoms"])
    ]
    before = sum(body["inertial"]["mass"] for body in heavy)
    if unknown or before <= 0.0:
        names = ", ".join(unknown[:3]) or "all bodies"
        repairs.add(f"settotalmass={total:g} left out: the mass of {names} is not known")
        return
    for body in heavy:
        _scale(body["inertial"], total / before)
    repairs.add(f"masses scaled from {before:.4g} to {total:.4g} kg, as settotalmass asks for")


def _bound(bodies: list[Found], mass: float, inertia: float, repairs: Repairs) -> None:
    for body in bodies:
        own = body["inertial"]
        values, axes = np.linalg.eigh(tensor(own))
        if own["mass"] >= mass and values[0] >= inertia * (1.0 - 1e-9):
            continue
        own["mass"] = max(own["mass"], mass)
        bounded = (axes * np.maximum(values, inertia)) @ axes.T
        own["full"] = [float(bounded[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        repairs.add(f"mass and inertia of body {body['name']} raised to boundmass or boundinertia")


def _scale(inertial: Found, factor: float) -> None:
    inertial["mass"] *= factor
    inertial["full"] = [factor * value for value in inertial["full"]]


def _weighs(geom: Found) -> bool:
    return not geom["massless"] and geom["kind"] not in {"plane", "hfield"}
