"""Trays: boxes without a lid behind the front panels of an object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.reconstruct.scan.panels import Panel
from articulate.reconstruct.scan.segmentation import Segmentation, touching
from articulate.transforms import Array, Ints

TRAY_DEPTH = 0.25
"""Least depth of a tray, as a share of the depth of the object."""
CEILING = 0.5
"""Largest area of horizontal faces in the upper half of a tray, as a share of its bottom."""
WALL = 0.25
"""Least area of each side wall, as a share of the tray's depth and height."""
BOTTOM = 0.3
"""Least area of the bottom, as a share of the tray's depth and width."""
OWN_FRONT = 0.02
"""A tray that begins farther behind the panel is not attached to it, as a share of the diagonal."""
CLEAR = 0.001
"""Least gap between a tray and what is above it, as a share of the diagonal."""
MOST_LEVELS = 8
"""Most margins and heights at which a tray is searched among dividers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tray:
    """An open box."""

    faces: Ints
    """Its faces (K,)."""
    box: Array
    """Its bounding box (2, 3) [m]."""


def trays_behind(parts: Segmentation, panel: Panel) -> list[Tray]:
    """Return the trays within the outline of a panel and behind it."""
    mesh = parts.mesh
    y0, z0, y1, z1 = panel.rect
    low = np.array([mesh.bounds[0, 0], y0, z0])
    high = np.array([panel.front + parts.near, y1, z1])
    inside = parts.inside(parts.shells, low, high)
    own = np.isin(inside, np.unique(parts.shells.label[panel.own]))
    length = np.ptp(parts.shells.boxes[inside][..., 0], axis=1)
    inside = inside[length > np.where(own, TRAY_DEPTH, 0.05) * mesh.size[0]]
    found = [tray for group in touching(parts, inside) if (tray := _tray(parts, group)) is not None]
    if not found and len(inside):
        tray = _tray(parts, inside) or _nested(parts, panel, inside)
        found = [] if tray is None else [tray]
    return found


def _nested(parts: Segmentation, panel: Panel, inside: Ints) -> Tray | None:
    """Return the largest tray among the shells behind a panel, without dividers and liners.

    Its walls are as far from both sides of the panel, and end below what covers them.
    """
    spans = parts.shells.boxes[inside]
    margins = np.minimum(spans[:, 0, 1] - panel.rect[0], panel.rect[2] - spans[:, 1, 1])
    near, gap = parts.near, CLEAR * parts.mesh.diagonal
    best: Tray | None = None
    for margin in _distinct(margins, near):
        within = (spans[:, 0, 1] > panel.rect[0] + margin - near) & (
            spans[:, 1, 1] < panel.rect[2] - margin + near
        )
        for top in _distinct(spans[within, 1, 2], gap):
            low = within & (spans[:, 1, 2] < top + gap)
            for group in touching(parts, inside[low]):
                tray = _tray(parts, group)
                if tray is None or not _is_clear(spans[~np.isin(inside, group)], tray.box, gap):
                    continue
                if best is None or np.prod(np.ptp(tray.box, axis=0)) > np.prod(
                    np.ptp(best.box, axis=0)
                ):
                    best = tray
    return best


def _distinct(values: Array, step: float) -> list[float]:
    """Return the different values in ascending order, those nearer than ``step`` once."""
    found: list[float] = []
    for value in np.sort(values):
        if not found or value > found[-1] + step:
            found.append(float(value))
    return found[:MOST_LEVELS]


def _is_clear(others: Array, box: Array, gap: float) -> bool:
    """Return whether no other shell begins at the top of a box and covers it."""
    sides = np.minimum(others[:, 1, :2], box[1, :2]) - np.maximum(others[:, 0, :2], box[0, :2])
    covers = np.clip(sides, 0.0, None).prod(axis=1) > 0.5 * np.prod(np.ptp(box[:, :2], axis=0))
    return not bool((covers & (np.abs(others[:, 0, 2] - box[1, 2]) < gap)).any())


def is_attached(parts: Segmentation, panel: Panel, tray: Tray) -> bool:
    """Return whether a tray begins at the back of a panel and is about as high as it."""
    gap = panel.back - float(tray.box[1, 0])
    high = float(tray.box[1, 2] - tray.box[0, 2]) > 0.25 * float(panel.size[1])
    return gap < OWN_FRONT * parts.mesh.diagonal and high


def _tray(parts: Segmentation, group: Ints) -> Tray | None:
    """Return the tray of a group of shells; None without two walls and a bottom, or closed."""
    mesh = parts.mesh
    spans = parts.shells.boxes[group]
    box = np.stack([spans[:, 0].min(axis=0), spans[:, 1].max(axis=0)])
    depth, width, height = box[1] - box[0]
    if depth < TRAY_DEPTH * mesh.size[0] or _is_body(parts, box):
        return None
    faces = parts.faces_of(parts.shells, group)
    centres, area, normals = mesh.triangles.mean(axis=1)[faces], mesh.areas[faces], mesh.normals
    sideways, level = np.abs(normals[faces, 1]) > 0.9, np.abs(normals[faces, 2]) > 0.9
    left = area[sideways & (centres[:, 1] < box[0, 1] + width / 3.0)].sum()
    right = area[sideways & (centres[:, 1] > box[1, 1] - width / 3.0)].sum()
    middle = 0.5 * float(box[0, 2] + box[1, 2])
    bottom = area[level & (centres[:, 2] < middle)].sum()
    ceiling = area[level & (centres[:, 2] > middle)].sum()
    if min(left, right) < WALL * depth * height or bottom < BOTTOM * depth * width:
        return None
    if ceiling > CEILING * bottom:
        return None
    within = parts.inside(parts.shells, box[0], box[1])
    return Tray(faces=np.union1d(faces, parts.faces_of(parts.shells, within)), box=box)


def _is_body(parts: Segmentation, box: Array) -> bool:
    """Return whether a box is that of the body behind a door over the entire front."""
    bounds, near = parts.mesh.bounds, 2.0 * parts.near
    outer = box[0, 1] < bounds[0, 1] + near or box[1, 1] > bounds[1, 1] - near
    return bool(outer and box[1, 2] - box[0, 2] > 0.6 * parts.mesh.size[2])
