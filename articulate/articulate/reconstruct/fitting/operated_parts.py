"""Joints that may have moved in a video: parts, hinges and directions that a category can have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from articulate.errors import ConfigError
from articulate.library.procedural.front_layout import MOVING, FrontPanel, HingeSide, PanelKind
from articulate.library.procedural.materials import PALETTE
from articulate.library.procedural.truth import origins
from articulate.reconstruct.fitting.box_fit import BoxFit
from articulate.reconstruct.fitting.categories import USUAL, Generated
from articulate.reconstruct.fitting.front_network import KINDS
from articulate.reconstruct.fitting.object_front import ObjectFront
from articulate.reconstruct.fitting.part_motion import JointMotion
from articulate.reconstruct.link_meshes import HALF_TURN
from articulate.reconstruct.make_object import part_meshes
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array

FLAPS = 0.1
"""Share of hinged fronts of furniture that fall or lift open."""
LIFTED = 0.25
"""Share of flaps with the hinge at the top."""
MISSED = 0.2
"""Share of operated parts that the front network did not find."""
FLOOR = 0.05
"""Least probability of a kind of part from the front network."""
MIN_OVERLAP = 0.15
"""Share of a panel in the moving region from which it may be the operated one."""
TURN_RAD = 3.1
"""Range of joints without limits [rad]."""
OPENINGS: tuple[tuple[PanelKind, HingeSide], ...] = (
    ("drawer", ""),
    ("door", "left"),
    ("door", "right"),
    ("flap", "bottom"),
    ("flap", "top"),
)
"""Kinds and hinges of an openable panel."""
STRUCTURE: Mapping[str, tuple[PanelKind, ...]] = {
    "Dishwasher": ("flap",),
    "Microwave": ("door",),
    "Oven": ("flap", "drawer"),
    "Refrigerator": ("door", "drawer"),
}
"""Kinds of panels of a category; any kind for others. Their flaps fall open."""
OPEN_WHEN_FITTED: Mapping[str, float] = {"Laptop": 1.75}
"""Position of the joints at which the box of a category is fitted [rad]; else closed."""
Region = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class OperatedPart:
    """An object and its part that may have moved."""

    category: str
    """PartNet-Mobility's name."""
    generated: Generated
    part: str
    """Name of the part."""
    share: float
    """Probability among the parts of the category before the motion is compared."""


def operated_parts(
    category: str, generated: Generated, front: ObjectFront, moving_px: Region
) -> tuple[OperatedPart, ...]:
    """Return the parts of an object that may have moved, with each structure it can have.

    Args:
        category: PartNet-Mobility's name.
        generated: Object of the image.
        front: Its front.
        moving_px: Left, right, top and bottom of the region of the image that moves [px].
    """
    if generated.layout is not None:
        return tuple(_panels(category, generated, front, moving_px))
    found = [
        OperatedPart(
            category=category,
            generated=one,
            part=part.name,
            share=_share(category, part.motion.kind),
        )
        for one in generated.alternatives()
        for part in one.parts
        if part.motion is not None
    ]
    return tuple(replace(one, share=one.share / len(found)) for one in found)


def _share(category: str, kind: str) -> float:
    slides = USUAL[category].slides
    return slides if kind == "prismatic" else 1.0 - slides


def _panels(
    category: str, generated: Generated, front: ObjectFront, moving_px: Region
) -> Iterator[OperatedPart]:
    """Yield each panel in the moving region as a drawer, door and flap; all if none is in it."""
    layout = generated.layout
    assert layout is not None
    kinds = _kinds_of_panels(generated, front)
    moving = sum(panel.kind in MOVING for panel in layout.panels)
    movable = [k for k, panel in enumerate(layout.panels) if panel.kind in (*MOVING, "panel")]
    moved = [k for k in movable if _overlap(layout.panels[k], front, moving_px) > MIN_OVERLAP]
    for k in moved or movable:
        panel = layout.panels[k]
        known = panel.kind in MOVING
        seen = (1.0 - MISSED) / max(moving, 1) if known else MISSED / (len(layout.panels) - moving)
        for kind, hinge in _openings(category):
            same = panel.kind == kind
            name = panel.name if same and panel.name else f"moved_{kind}"
            changed = replace(panel, kind=kind, hinge=hinge, name=name)
            panels = (*layout.panels[:k], changed, *layout.panels[k + 1 :])
            try:
                other = replace(layout, panels=panels)
            except ConfigError:  # too small for a joint
                continue
            share = seen * _prior(category, changed) * (kinds[k][(kind, hinge)] if known else 0.2)
            yield OperatedPart(
                category=category,
                generated=replace(generated, layout=other, parts=tuple(other.parts())),
                part=name,
                share=share,
            )


def _openings(category: str) -> list[tuple[PanelKind, HingeSide]]:
    kinds = STRUCTURE.get(category)
    return [
        (kind, hinge)
        for kind, hinge in OPENINGS
        if kinds is None or (kind in kinds and hinge != "top")
    ]


def _overlap(panel: FrontPanel, front: ObjectFront, region: Region) -> float:
    """Return the share of a panel that is in a region of the image."""
    fit, base = front.fit, front.base_share
    edges = [(u, v) for u in (panel.left, panel.right) for v in (panel.bottom, panel.top)]
    points = [(fit.depth / 2, (u - 0.5) * fit.width, base + v * (1.0 - base)) for u, v in edges]
    uv, _ = fit.camera.project(np.array(points))
    (left, top), (right, bottom) = uv.min(axis=0), uv.max(axis=0)
    wide = min(right, region[1]) - max(left, region[0])
    high = min(bottom, region[3]) - max(top, region[2])
    area = float((right - left) * (bottom - top))
    return max(0.0, float(wide)) * max(0.0, float(high)) / max(area, 1.0)


def _prior(category: str, panel: FrontPanel) -> float:
    """Return the share of a kind and hinge among the operated parts of a category."""
    slides = USUAL[category].slides
    if panel.kind == "drawer":
        return slides
    kinds = STRUCTURE.get(category, ("flap", "door"))
    flaps = 0.0 if "flap" not in kinds else 1.0 if "door" not in kinds else FLAPS
    if panel.kind == "flap":
        return (1.0 - slides) * flaps * (LIFTED if panel.hinge == "top" else 1.0 - LIFTED)
    return (1.0 - slides) * (1.0 - flaps) * 0.5


def _kinds_of_panels(
    generated: Generated, front: ObjectFront
) -> list[dict[tuple[PanelKind, HingeSide], float]]:
    """Return the probability of each kind and hinge of the panels, from the front network."""
    assert generated.layout is not None
    out = []
    for panel in generated.layout.panels:
        middle = np.array([0.5 * (panel.left + panel.right), 0.5 * (panel.bottom + panel.top)])
        middle[1] = front.base_share + middle[1] * (1.0 - front.base_share)
        at = [p for p in front.parts if p.left <= middle[0] <= p.right]
        at = [p for p in at if p.bottom <= middle[1] <= p.top]
        p = at[0].kinds if at else np.full(len(KINDS), 1.0 / len(KINDS))
        p = np.maximum(p[1:] / max(float(p[1:].sum()), 1e-9), FLOOR)
        flap = float(p[3])
        out.append(
            dict(zip(OPENINGS, (float(p[0]), float(p[1]), float(p[2]), flap, flap), strict=True))
        )
    return out


def fitted_joint(operated: OperatedPart, fit: BoxFit) -> tuple[tuple[PartMesh, ...], JointMotion]:
    """Return the parts of an object, scaled to a fitted box in its frame, and the joint.

    Args:
        operated: Object and part.
        fit: Fitted box.
    """
    generated = operated.generated
    meshes = [
        m.with_vertices(m.vertices @ HALF_TURN.T) for m in part_meshes(generated.parts, PALETTE)
    ]
    part = next(part for part in generated.parts if part.name == operated.part)
    motion = part.motion
    assert motion is not None
    axis = HALF_TURN @ np.asarray(motion.axis, dtype=np.float64)
    pivot = HALF_TURN @ origins(generated.parts)[part.name]
    span = TURN_RAD if motion.kind == "continuous" else motion.upper
    joint = JointMotion(
        part=part.name,
        kind=motion.kind,
        axis=axis,
        pivot=pivot,
        span=span,
        fitted=min(OPEN_WHEN_FITTED.get(operated.category, 0.0), span),
        moves=_moves(generated, part.name),
    )
    opened = joint.transform(joint.fitted)
    low, high = joint_bounds([m.moved(opened) if m.name in joint.moves else m for m in meshes])
    scale = np.array([fit.depth, fit.width, 1.0]) / (high - low)
    origin = np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])

    def placed(points: Array) -> Array:
        return np.asarray((points - origin) * scale)

    if motion.kind == "prismatic":
        span *= float(np.linalg.norm(axis * scale))
    placed_joint = replace(joint, pivot=placed(pivot), span=span)
    return tuple(mesh.with_vertices(placed(mesh.vertices)) for mesh in meshes), placed_joint


def _moves(generated: Generated, name: str) -> tuple[str, ...]:
    """Return the part and all that are attached to it; parents come before children."""
    out = [name]
    for part in generated.parts:
        if part.motion is not None and part.motion.parent in out:
            out.append(part.name)
    return tuple(out)
