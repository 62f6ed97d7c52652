"""Places at which the gripper can hold or push a part, the best first."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import trimesh

from articulate.assets.asset import Asset, Handle
from articulate.checks.model import ObjectModel, load_model
from articulate.checks.solids import solids_of
from articulate.conversion.handles import handle_from_grasp, opening_direction
from articulate.geometry.grasp import grasp_candidates
from articulate.geometry.hook import hook_places
from articulate.geometry.push import push_place
from articulate.transforms import Array, apply

MAX_CANDIDATES = 4
"""Most places that are searched beside the asset's own handle."""
DIFFERENT_M = 0.02
"""Places nearer to each other than this with the same approach are one [m]."""


def handle_candidates(asset: Asset, joint: str, *, closes: bool) -> Iterator[Handle]:
    """Yield the asset's own handle, then other places to hold, then those to hook, or one to push.

    An own handle that fingers cannot hold comes last.

    Args:
        asset: Object.
        joint: Joint of the part.
        closes: True if the part is to be closed, which pushing can do.
    """
    own = asset.handle_of(joint)
    if own is not None and own.kind != "none":
        yield own
    surface, owner, model = _surface(asset, joint)
    if not (owner == 1).any():
        return
    part = surface.vertices[np.unique(surface.faces[owner == 1])]
    data = model.data()
    T_ol = model.T_ol(data, asset.joint(joint).link)
    opening, far_from = opening_direction(asset.joint(joint), part)
    found = [own] if own is not None else []
    for grasp in grasp_candidates(surface, owner, opening=opening, far_from=far_from):
        handle = handle_from_grasp(grasp, asset.joint(joint), T_ol)
        if any(_similar(handle, other) for other in found):
            continue
        found.append(handle)
        yield handle
        if len(found) > MAX_CANDIDATES:
            break
    if closes:
        place = push_place(surface, owner, opening=opening, far_from=far_from)
        places = [] if place is None else [place]
    else:
        places = hook_places(surface, owner, opening=opening, far_from=far_from)
    yield from (handle_from_grasp(place, asset.joint(joint), T_ol) for place in places)
    if own is not None and own.kind == "none":
        yield own


def _surface(asset: Asset, joint: str) -> tuple[trimesh.Trimesh, Array, ObjectModel]:
    """Return the collision shapes of the closed object, and which triangles the joint moves.

    Returns:
        Triangles in the object frame [m]; owner of each (F,), 1 for the part, 0 for the rest; the
        compiled object.
    """
    model = load_model(asset)
    data = model.data()
    moved = _moved_links(asset, joint)
    triangles, owner = [], []
    for link in asset.links:
        T_ol = model.T_ol(data, link.name)
        for solid in solids_of(model, link.name):
            triangles.append(apply(T_ol, solid.triangles.reshape(-1, 3)).reshape(-1, 3, 3))
            owner.append(np.full(len(solid.triangles), float(link.name in moved)))
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(np.concatenate(triangles)), process=False)
    return mesh, np.concatenate(owner), model


def _moved_links(asset: Asset, joint: str) -> set[str]:
    """Return the links that move with ``joint``."""
    moved = {asset.joint(joint).link}
    for other in asset.joints:  # parents come before children
        if other.parent in moved:
            moved.add(other.link)
    return moved


def _similar(a: Handle, b: Handle) -> bool:
    distance = float(np.linalg.norm(np.subtract(a.pos_l, b.pos_l)))
    return distance < DIFFERENT_M and float(np.dot(a.normal_l, b.normal_l)) > 0.9
