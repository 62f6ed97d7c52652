"""Find the pairs of bodies of one object whose contact is excluded."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from articulate.assets.asset import Asset
from articulate.conversion.write_asset import Body, Mimic, mjcf
from articulate.errors import AssetError
from articulate.simulator import mujoco

TOUCH_M = 0.001
"""Bodies nearer than this at rest count as touching."""


def contact_excludes(
    asset: Asset, bodies: Sequence[Body], mimics: Sequence[Mimic], folder: Path
) -> list[tuple[str, str]]:
    """Return the pairs of bodies whose contact is excluded.

    The collision shapes do not model the guides of a moving part, so its contact with its parent
    and with the fixed body is excluded; that of two moving parts if they touch while all joints
    are closed.

    Args:
        asset: For its joints.
        bodies: As they will be written.
        mimics: Joints that follow others.
        folder: Folder that already has ``meshes/``.

    Raises:
        AssetError: MuJoCo does not accept the model.
    """
    root = bodies[0].name
    pairs: dict[tuple[str, str], None] = {}
    for body in bodies[1:]:
        pairs.setdefault((root, body.name))
        if body.parent is not None and body.parent != root:
            pairs.setdefault((body.parent, body.name))
    text = mjcf(asset.name, bodies, (), list(pairs), mimics)
    try:
        spec = mujoco.MjSpec.from_string(text)
        spec.meshdir = str((folder / "meshes").resolve())
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise AssetError(
            f"{asset.name}: MuJoCo does not accept the converted model: {reason}"
        ) from None
    data = mujoco.MjData(model)
    for joint in asset.joints:
        address = model.joint(joint.name).qposadr[0]
        data.qpos[address] = joint.closed
    model.geom_margin[:] = TOUCH_M
    mujoco.mj_kinematics(model, data)  # without forces, which thousands of contacts overflow
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    for contact in data.contact[: data.ncon]:
        one, two = (int(model.geom_bodyid[g]) for g in np.sort(contact.geom))
        names = (model.body(one).name, model.body(two).name)
        if one and two and names[0] != names[1] and (names[1], names[0]) not in pairs:
            pairs.setdefault(names)
    return list(pairs)
