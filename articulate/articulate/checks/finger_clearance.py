"""Check ``finger_clearance``: space beside handles for the fingers of a gripper."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from articulate.assets.asset import Handle, handle_frame
from articulate.assets.check_report import Check
from articulate.checks.model import Data, ObjectModel
from articulate.checks.solids import Solid, inside_any, solids_of
from articulate.transforms import Array, apply, inverse

FINGER_M = 0.008
"""Space that a finger requires beside a handle [m]."""
FINGER_WIDTH_M = 0.02
"""Width of a finger along the handle [m]."""
REACH_M = 0.1
"""Space beyond this is not measured [m]."""
Solids = Mapping[str, tuple[Solid, ...]]
"""Collision shapes by link."""


def check_finger_clearance(model: ObjectModel) -> tuple[Check, ...]:
    """Measure the space for fingers beside each handle, all joints closed."""
    solids = {link.name: solids_of(model, link.name) for link in model.asset.links}
    data = model.data()
    return tuple(_fingers(model, data, handle, solids) for handle in model.asset.handles)


def _fingers(model: ObjectModel, data: Data, handle: Handle, solids: Solids) -> Check:
    """Measure the space for fingers on both sides of a handle, all joints closed."""
    T_oh = model.T_ol(data, handle.link) @ handle_frame(handle)
    room = min(_room(model, data, T_oh, handle, side, solids) for side in (-1.0, 1.0))
    passed = room >= FINGER_M
    most = " or more" if room >= REACH_M else ""
    message = (
        f"{handle.name}, a {handle.kind}: {1000 * room:.0f} mm{most} free beside it for fingers"
    )
    if not passed:
        message += f"; {1000 * FINGER_M:.0f} mm are needed to hold it with everything closed"
    return Check(
        name="finger_clearance",
        outcome="passed" if passed else "not_applicable",
        subject=handle.joint,
        measured=room,
        allowed=FINGER_M,
        unit="m",
        message=message,
    )


def _room(
    model: ObjectModel, data: Data, T_oh: Array, handle: Handle, side: float, solids: Solids
) -> float:
    """Return the free distance from the handle along its closing axis, at most ``REACH_M`` [m]."""
    along = min(FINGER_WIDTH_M, handle.extent[0]) / 2.0
    steps = np.arange(0.0005, REACH_M, 0.001)
    least = REACH_M
    for x in (-along, 0.0, along):
        points_h = np.zeros((len(steps), 3))
        points_h[:, 0] = x
        points_h[:, 1] = side * (handle.extent[1] / 2.0 + steps)
        occupied = np.zeros(len(steps), dtype=bool)
        for link in model.asset.links:
            T_lh = inverse(model.T_ol(data, link.name)) @ T_oh
            occupied |= inside_any(solids[link.name], apply(T_lh, points_h))
        if occupied.any():
            least = min(least, float(steps[int(occupied.argmax())]))
    return least
