"""Checks ``inertia`` and ``mass``: every link has a physically possible inertia."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from articulate.assets.asset import Asset, Link
from articulate.assets.check_report import Check
from articulate.checks.limits import robot_in
from articulate.checks.model import Model, ObjectModel
from articulate.checks.solids import solids_of
from articulate.checks.visual_collision import surface_of
from articulate.simulator import mujoco
from articulate.transforms import Array

SLACK = 1e-6
"""Share by which the triangle inequality and the box may be missed: digits of the file."""
BOX_SLACK_M = 0.002
"""Tolerance of a centre of mass outside its box: thin parts get this thickness [m]."""
SAME = 1e-5
"""Share by which mass, centre and inertia may differ from those in object.urdf."""
DENSITY_KG_M3 = (5.0, 3000.0)
"""Usual ratio of mass to box volume of objects, from empty crates to solid stone."""


def check_inertia(model: ObjectModel) -> tuple[Check, ...]:
    """Return one check for each link, and one for the mass of the object."""
    asset = model.asset
    robot = robot_in(asset.folder / "object.urdf")
    inertials = {} if robot is None else {x.name: x.inertial for x in robot.links if x.inertial}
    links = tuple(_sound(model, link, inertials) for link in asset.links)
    return (*links, _mass(asset, model))


def _sound(model: ObjectModel, link: Link, inertials: Mapping[str, Any]) -> Check:
    m, body = model.model, model.bodies[link.name]
    mass = float(m.body_mass[body])
    principal = np.sort(np.asarray(m.body_inertia[body], dtype=np.float64))
    centre_l = np.asarray(m.body_ipos[body], dtype=np.float64)
    box = _box(model, link.name)
    violations = [*_violations(mass, principal), *_misplaced(centre_l, box)]
    if abs(mass - link.mass_kg) > SLACK * max(mass, link.mass_kg):
        violations.append(f"asset.json has {link.mass_kg:.4g} kg")
    if box is not None and mass > 0.0:
        violations += _spread(mass, np.diag(_full(m, body)), centre_l, box)
    if link.name in inertials:
        violations += _urdf_differences(mass, centre_l, _full(m, body), inertials[link.name])
    share = float(principal[0] + principal[1] - principal[2]) / max(float(principal[2]), 1e-300)
    message = (
        f"{link.name}: {mass:.4g} kg, inertia {', '.join(f'{v:.3g}' for v in principal)} kg m2"
    )
    if violations:
        message += f"; {'; '.join(violations)}: give it the inertia of its geometry"
    return Check(
        name="inertia",
        outcome="failed" if violations else "passed",
        subject=link.name,
        measured=share if np.isfinite(share) else None,
        allowed=0.0,
        unit="1",
        message=message,
    )


def _violations(mass: float, principal: Array) -> list[str]:
    """Return the faults of a mass [kg] and of sorted principal moments (3,) [kg m2]."""
    if not (np.isfinite(mass) and np.isfinite(principal).all()):
        return ["mass or inertia is not a number"]
    found = []
    if mass <= 0.0:
        found.append("its mass is not above 0")
    if principal[0] <= 0.0:
        found.append("its inertia is not positive definite")
    if principal[0] + principal[1] < principal[2] * (1.0 - SLACK):
        found.append("its largest moment is greater than the sum of the others")
    return found


def _misplaced(centre_l: Array, box: Array | None) -> list[str]:
    if box is None:
        return []
    beyond = float(np.maximum(box[0] - centre_l, centre_l - box[1]).max())
    if beyond <= BOX_SLACK_M:
        return []
    return [f"its centre of mass is {1000.0 * beyond:.0f} mm outside its box"]


def _spread(mass: float, moments: Array, centre_l: Array, box: Array) -> list[str]:
    """Return a fault if moments (3,) [kg m2] about the centre do not fit ``mass`` in the box."""
    half = np.maximum(np.maximum(box[1] - centre_l, centre_l - box[0]), BOX_SLACK_M)
    squares = half**2
    most = mass * (squares.sum() - squares)
    found = []
    if (moments > most * (1.0 + SLACK)).any():
        factor = float((moments / most).max())
        found.append(f"its inertia is {factor:.3g} times the most that fits into its box")
    return found


def _urdf_differences(mass: float, centre_l: Array, full: Array, inertial: Any) -> list[str]:
    """Return the differences between a link and object.urdf."""
    T_li = np.eye(4) if inertial.origin is None else np.asarray(inertial.origin)
    turn = T_li[:3, :3]
    other = turn @ np.asarray(inertial.inertia) @ turn.T
    found = []
    if abs(mass - inertial.mass) > SAME * max(mass, inertial.mass):
        found.append(f"object.urdf has {inertial.mass:.4g} kg")
    if float(np.abs(centre_l - T_li[:3, 3]).max()) > SAME:
        found.append("object.urdf has its centre of mass elsewhere")
    if float(np.abs(full - other).max()) > SAME * float(np.abs(other).max()):
        found.append("object.urdf gives it another inertia")
    return found


def _full(m: Model, body: int) -> Array:
    """Return the inertia (3, 3) about the centre of mass in link axes [kg m2]."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, m.body_iquat[body])
    rot = turn.reshape(3, 3)
    return np.asarray(rot @ np.diag(m.body_inertia[body]) @ rot.T)


def _box(model: ObjectModel, link: str) -> Array | None:
    """Return the corners (2, 3) of the box of visual and collision geometry of ``link`` [m]."""
    corners, _ = surface_of(model, link)
    touching = [solid.triangles.reshape(-1, 3) for solid in solids_of(model, link)]
    points = np.vstack([corners, *touching])
    return np.stack([points.min(axis=0), points.max(axis=0)]) if len(points) else None


def _mass(asset: Asset, model: ObjectModel) -> Check:
    """Report the total mass without a limit, as tables of masses have wide ranges."""
    total = float(model.model.body_mass.sum())
    low, high = np.array(asset.bounds_o)
    volume = float(np.prod(np.maximum(high - low, BOX_SLACK_M)))
    density = total / volume
    usual = DENSITY_KG_M3[0] <= density <= DENSITY_KG_M3[1]
    what = f"a {asset.category} of " if asset.category != "unknown" else ""
    size = " x ".join(f"{side:.2g}" for side in high - low)
    message = f"{total:.4g} kg, {what}{size} m: {density:.3g} kg for each m3 of its box"
    if not usual:
        message += f", which is unusual ({DENSITY_KG_M3[0]:g} to {DENSITY_KG_M3[1]:g} is usual)"
    return Check(name="mass", outcome="passed", measured=total, unit="kg", message=message)
