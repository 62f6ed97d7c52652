"""Doors, flaps and drawers from the front panels of an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.reconstruct.actors.protocol import JointKind
from articulate.reconstruct.scan.frames import grown, joined_frames
from articulate.reconstruct.scan.front_view import heights_above
from articulate.reconstruct.scan.panels import (
    MAX_OVERLAP,
    THIN,
    Handle,
    Panel,
    find_panels,
    overlap,
)
from articulate.reconstruct.scan.part_proposal import QUARTER_RAD, PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.reconstruct.scan.trays import Tray, is_attached, trays_behind
from articulate.transforms import Ints

SAME_SIZE = 0.08
"""Panels whose sides differ by less than this share are congruent."""
NARROW = 0.09
"""Narrower panels without a handle, as a share of the diagonal of the front, are frames or legs."""
LOWEST = 0.12
"""Panels without a handle that end below this share of the height are plinths, if they are low."""
BACKING, BEHIND = 1.3, 0.04
"""Largest outline of a board behind a panel, as a multiple of it, and its largest distance, as a
share of the diagonal."""
OUTSIDE = 1.6
"""Largest area of the shell of a panel, seen from the front, as a share of the panel."""
STRIP, LOPSIDED = 2.5, 0.1
"""The handles of a panel that is this much wider than high are centred within this share."""
UPRIGHT, DIAL = 0.6, 0.2
"""Panels narrower than the first share of their height are control panels if all protrusions are
as wide and as high as the second share of their width."""
ROW = 3
"""Equal protrusions of a control panel."""
BAR = 2.0
"""Ratio of the sides of a protrusion from which it is a bar."""
LEG = 3.0
"""Narrow panels that are taller than this ratio are legs or stiles."""
WIDE = 0.42
"""Panels lower than this share of their width are drawers rather than flaps."""
LEAF = 0.35
"""Largest thickness of a board, as a share of the shorter side of its panel."""
CHAMFER = 0.07
"""Largest width of the chamfer around a front, as a share of each side."""
FLAP = 0.7
"""Panels lower than this share of their width are flaps if a knob is centred on them."""
MIRROR, MIRRORED = 0.3, 0.05
"""Largest difference of the sides of two handles of one panel, as a share, and of their middle from
that of the panel, as a share of its width."""
SYMMETRIC = 0.005
"""Largest offset of a panel in the middle of the object, as a share of its width."""
CENTRED = 0.17
"""Largest offset of a centred handle, as a share of the width of the panel."""
FLAT = 0.5
"""Largest height of a case, as a share of its smaller side."""
COVERING = 0.8
"""Least share of the width and depth of the object that a lid covers."""
TRAVEL = 0.75
"""Travel of a drawer, as a share of its depth."""
CONTROLS = 0.4
"""Smaller boards beside a door without a handle, as a share of it, are control panels; strips are
control panels if they are lower than this share of the object."""
LEVEL = 0.02
"""Largest distance of the surfaces of panels in one plane, as a share of the diagonal."""
ADJACENT = 0.12
"""Largest gap between the doors of a pair, as a share of the width of the object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """A panel with the trays behind it."""

    panel: Panel
    tray: Ints
    """Faces of the tray behind the panel (K,); empty without one."""
    handle: Handle | None
    """The largest protrusion that can be a handle."""
    depth: float
    """Depth of the tray behind the panel [m]; 0 without one."""
    inner: tuple[Tray, ...] = ()
    """Trays behind the panel that are not attached to it."""


def all_fronts(parts: Segmentation) -> list[Front]:
    """Return the front panels with the trays behind them, whether they move or not."""
    levels = (parts.shells, parts.coloured, parts.facets)
    panels = joined_frames(parts, find_panels(parts.mesh, levels, parts.view))
    return [front_of(parts, panel) for panel in panels]


def front_parts(parts: Segmentation, moving: Sequence[Front]) -> list[PartProposal]:
    """Propose the doors, flaps and drawers of the front.

    Args:
        parts: The object; its front is +x.
        moving: Fronts that move.
    """
    mesh = parts.mesh
    found: list[PartProposal] = []
    covered = np.zeros(len(mesh.faces), dtype=bool)
    for front in moving:
        others = [other for other in moving if other is not front]
        for proposal in (_proposal(parts, front, others), *_inner_drawers(front)):
            faces = proposal.faces[~covered[proposal.faces]]
            if len(faces):
                covered[faces] = True
                found.append(replace(proposal, faces=faces))
    return found


def front_of(parts: Segmentation, panel: Panel) -> Front:
    """Return a panel with its boards, its handle and the trays behind it."""
    panel = _with_backing(parts, _with_chamfer(parts, panel))
    panel = replace(panel, board=_is_board(parts, panel))
    trays = trays_behind(parts, panel)
    attached = [tray for tray in trays if is_attached(parts, panel, tray)]
    nothing = np.zeros(0, dtype=np.int64)
    return Front(
        panel=panel,
        tray=np.concatenate([nothing, *(tray.faces for tray in attached)]),
        handle=_main_handle(panel),
        depth=max([float(panel.back - tray.box[0, 0]) for tray in attached], default=0.0),
        inner=tuple(tray for tray in trays if not is_attached(parts, panel, tray)),
    )


def _with_backing(parts: Segmentation, panel: Panel) -> Panel:
    """Return the panel with the boards right behind it that have nearly the same outline."""
    boxes, mesh = parts.shells.boxes, parts.mesh
    low = np.maximum(boxes[:, 0, 1:], panel.rect[:2])
    high = np.minimum(boxes[:, 1, 1:], panel.rect[2:])
    common = np.clip(high - low, 0.0, None).prod(axis=1)
    sides = boxes[:, 1] - boxes[:, 0]
    same = (common > 0.8 * panel.area) & (sides[:, 1:].prod(axis=1) < BACKING * panel.area)
    same &= (sides[:, 0] < THIN * mesh.size[0]) & (boxes[:, 1, 0] < panel.front + parts.near)
    same &= boxes[:, 1, 0] > panel.front - BEHIND * mesh.diagonal
    same[np.unique(parts.shells.label[panel.own])] = False
    outline = mesh.bounds[:, 1:].ravel()
    if (np.abs(panel.rect - outline) < parts.near).sum() <= 2:  # a door frame behind its door
        flat = boxes[..., 1:].reshape(-1, 4)
        same &= (np.abs(flat - outline) < parts.near).sum(axis=1) <= 2
    which = np.flatnonzero(same)
    if not len(which) or not panel.thin:
        return panel
    spans = boxes[which]
    rect = np.concatenate(
        [
            np.minimum(panel.rect[:2], spans[:, 0, 1:].min(axis=0)),
            np.maximum(panel.rect[2:], spans[:, 1, 1:].max(axis=0)),
        ]
    )
    return replace(
        panel,
        rect=rect,
        back=min(panel.back, float(spans[:, 0, 0].min())),
        own=np.union1d(panel.own, parts.faces_of(parts.shells, which)),
    )


def _with_chamfer(parts: Segmentation, panel: Panel) -> Panel:
    """Return a panel grown to the outline of its shell, if only a chamfer is between them."""
    shells = np.unique(parts.shells.label[panel.own])
    spans = parts.shells.boxes[shells][..., 1:]
    rect = np.concatenate([spans[:, 0].min(axis=0), spans[:, 1].max(axis=0)])
    bounds = parts.mesh.bounds[:, 1:].ravel()
    is_body = (np.abs(rect - bounds) < parts.near).sum() > 2
    rim = np.abs(rect - panel.rect) / np.tile(panel.size, 2)
    return panel if is_body or rim.max() > CHAMFER else replace(panel, rect=rect)


def _is_board(parts: Segmentation, panel: Panel) -> bool:
    """Return whether the shells of a panel end at its outline."""
    shells = np.unique(parts.shells.label[panel.own])
    sides = np.ptp(parts.shells.boxes[shells][:, :, 1:], axis=1)
    return bool(sides.prod(axis=1).max() < OUTSIDE * panel.area)


def _main_handle(panel: Panel) -> Handle | None:
    """Return the largest protrusion that is not a frame around the panel, a bar before a dial.

    Two equal ones at both sides of the middle are one handle.
    """
    found = []
    for handle in panel.handles:
        share = handle.size / panel.size
        if share.max() > 0.97 and share.min() > 0.3:
            continue
        bar = float(handle.size.max() / max(float(handle.size.min()), 1e-9)) > BAR
        found.append((bar, float(np.prod(handle.size)), handle))
    if not found:
        return None
    handle = max(found, key=lambda item: item[:2])[2]
    for _, _, other in found:
        if other is not handle and _is_mirrored(panel, handle, other):
            low, high = np.minimum(handle.rect, other.rect), np.maximum(handle.rect, other.rect)
            rect = np.concatenate([low[:2], high[2:]])
            return Handle(rect=rect, height=max(handle.height, other.height))
    return handle


def _is_mirrored(panel: Panel, one: Handle, other: Handle) -> bool:
    """Return whether two equal handles are at the same height on both sides of the middle."""
    middle = 0.5 * (one.centre + other.centre) - panel.centre
    equal = (np.abs(one.size - other.size) < MIRROR * one.size).all()
    level = abs(one.centre[1] - other.centre[1]) < MIRROR * one.size[1]
    return bool(equal and level and abs(middle[0]) < MIRRORED * panel.size[0])


def _inner_drawers(front: Front) -> list[PartProposal]:
    """Propose the trays behind a door as drawers."""
    if len(front.tray):
        return []
    return [
        PartProposal(
            kind="drawer",
            faces=tray.faces,
            joint="prismatic",
            axis=np.array([1.0, 0.0, 0.0]),
            pivot=tray.box.mean(axis=0),
            upper=TRAVEL * float(np.ptp(tray.box[:, 0])),
            confidence=0.6,
            evidence=("a tray behind a door",),
            front=float(tray.box[1, 0]),
        )
        for tray in front.inner
    ]


def moving_fronts(parts: Segmentation, fronts: Sequence[Front]) -> tuple[list[Front], bool]:
    """Return the fronts that move, and whether handles or trays show that they do.

    They have a handle or tray, or are like one that has.
    """
    size = parts.mesh.size
    scale = float(np.hypot(size[1], size[2]))

    def plain(front: Front) -> bool:
        return bool(front.panel.size.min() < NARROW * scale)

    fronts = [f for f in fronts if not _is_leg(parts, f) and not _is_control_panel(parts, f.panel)]
    sure = [f for f in fronts if len(f.tray) or (f.handle is not None and f.panel.board)]
    alike = [
        f
        for f in fronts
        if f not in sure
        and f.panel.thin
        and any(_moves_like(parts, f.panel, other.panel) for other in sure)
        and not plain(f)
    ]
    if sure:
        return sure + alike, True
    bottom = parts.mesh.bounds[0, 2]
    large = [
        f
        for f in fronts
        if not plain(f)
        and (f.panel.rect[3] - bottom > LOWEST * size[2] or f.panel.size[1] > 0.3 * size[2])
        and f.panel.area > 0.06 * size[1] * size[2]
    ]
    if not large:
        return [], False
    panels = [_grown(parts, front, fronts) for front in large]
    largest = max(panels, key=lambda panel: panel.area)
    same = [
        panel
        for panel in panels
        if _is_level(parts, panel, largest) and panel.area > CONTROLS * largest.area
    ]
    return [front_of(parts, panel) for panel in same], False


def _moves_like(parts: Segmentation, panel: Panel, other: Panel) -> bool:
    """Return whether a panel is congruent to a moving one, or a larger board in its plane."""
    larger = panel.board and panel.area > other.area
    return _congruent(panel, other) or (larger and _is_level(parts, panel, other))


def _grown(parts: Segmentation, front: Front, fronts: Sequence[Front]) -> Panel:
    """Return the panel of a front with its frame, unless this would cover another front."""
    panel = grown(parts, front.panel)
    others = [other.panel for other in fronts if other is not front]
    covers = any(overlap(panel.rect, other.rect) > MAX_OVERLAP for other in others)
    return front.panel if covers else panel


def _is_leg(parts: Segmentation, front: Front) -> bool:
    """Return whether a panel is a narrow upright, of the frame or down to the floor."""
    wide, high = front.panel.size
    size = parts.mesh.size
    narrow = wide < NARROW * float(np.hypot(size[1], size[2])) and high > LEG * wide
    floor = front.panel.rect[1] < parts.mesh.bounds[0, 2] + 0.03 * size[2]
    return bool(narrow and (front.handle is None or (floor and not len(front.tray))))


def _is_control_panel(parts: Segmentation, panel: Panel) -> bool:
    """Return whether a panel has a row of equal knobs, large dials, or knobs on half of a strip."""
    strip = panel.size[0] > STRIP * panel.size[1]
    if panel.handles and strip and panel.size[1] < CONTROLS * parts.mesh.size[2]:
        low = min(handle.rect[0] for handle in panel.handles)
        high = max(handle.rect[2] for handle in panel.handles)
        middle = 0.5 * float(low + high)
        if abs(middle - panel.centre[0]) > LOPSIDED * panel.size[0]:
            return True
    if panel.handles and panel.size[0] < UPRIGHT * panel.size[1]:
        sides = np.array([handle.size for handle in panel.handles])
        square = sides.max(axis=1) < BAR * sides.min(axis=1)
        if (square & (sides.min(axis=1) > DIAL * panel.size[0])).all():
            return True
    if len(panel.handles) < ROW:
        return False
    sizes = np.array([handle.size for handle in panel.handles])
    typical = np.median(sizes, axis=0)
    alike = (np.abs(sizes - typical) < 0.3 * typical).all(axis=1)
    return bool(alike.sum() >= ROW)


def _congruent(one: Panel, other: Panel) -> bool:
    return bool((np.abs(one.size - other.size) < SAME_SIZE * other.size).all())


def _is_level(parts: Segmentation, one: Panel, other: Panel) -> bool:
    """Return whether two boards, or two faces of the body, end at the same depth."""
    near = abs(one.front - other.front) < LEVEL * parts.mesh.diagonal
    return one.thin == other.thin and near


def _proposal(parts: Segmentation, front: Front, others: Sequence[Front]) -> PartProposal:
    panel, base = front.panel, _base(parts, front)
    if len(front.tray):
        lid = _topmost(parts, base)
        return lid or _drawer(parts, base, front, "a tray behind the front")
    wide = panel.size[1] < WIDE * panel.size[0]
    centred = _is_centred(front)
    if wide and (centred or front.handle is None):
        return _drawer(
            parts,
            base,
            front,
            f"a wide front {'with a centred' if centred else 'without a'} handle",
        )
    if centred and _is_flap(front) and not _has_neighbour(parts, front, others):
        return _flap(base, front)
    if front.handle is None and _is_wide_centred(parts, panel):
        return _turned_flap(base, panel, above=False, reason="a wide front without a handle")
    return _door(parts, base, front, others)


def _topmost(parts: Segmentation, base: PartProposal) -> PartProposal | None:
    """Return the part above a flat body of the same outline as a lid; None for other parts."""
    low, high = parts.mesh.bounds
    if parts.mesh.size[2] > FLAT * parts.mesh.size[:2].min():
        return None  # of furniture, this is a drawer
    corners = parts.mesh.triangles[base.faces].reshape(-1, 3)
    bottom, top = corners.min(axis=0), corners.max(axis=0)
    covers = ((top - bottom)[:2] > COVERING * (high - low)[:2]).all()
    if not covers or top[2] < high[2] - parts.near or bottom[2] < low[2] + parts.near:
        return None
    heights = heights_above(parts.mesh, np.stack([bottom, top]), COVERING)
    if float((heights > 0.5 * (bottom[2] + top[2])).mean()) < COVERING:
        return None  # a drawer without a board above
    return replace(
        base,
        kind="lid",
        axis=np.array([0.0, -1.0, 0.0]),
        pivot=np.array([bottom[0], 0.5 * (bottom[1] + top[1]), bottom[2]]),
        panel=None,
        handles=(),
        hollow=False,
        evidence=("the upper part of a case",),
    )


def moved_front(
    parts: Segmentation, front: Front, joint: JointKind, side: str, reason: str
) -> PartProposal:
    """Propose a front whose joint is known.

    Args:
        parts: The object; its front is +x.
        front: The front.
        joint: ``prismatic`` for a drawer, otherwise a door or flap.
        side: Edge of the hinge seen from the front: left, right, top or bottom; empty if unknown.
        reason: The evidence.
    """
    base, panel = _base(parts, front), front.panel
    if joint == "prismatic":
        return _drawer(parts, base, front, reason)
    if side in {"top", "bottom"}:
        return _turned_flap(base, panel, above=side == "top", reason=reason)
    if side in {"left", "right"}:
        return _turned_door(base, panel, left=side == "left", reason=reason)
    return replace(_door(parts, base, front, []), evidence=(reason,))


def _base(parts: Segmentation, front: Front) -> PartProposal:
    """Return a front as a door whose hinge is not chosen."""
    panel = front.panel
    reach = max([handle.height for handle in panel.handles], default=0.0)
    y0, z0, y1, z1 = panel.rect
    low = np.array([panel.back, y0, z0])
    high = np.array([panel.front + reach, y1, z1])
    attached = parts.faces_of(parts.facets, parts.inside(parts.facets, low, high))
    # Surfaces at the back that face the panel are edges of the body.
    behind = parts.mesh.triangles[attached].max(axis=1)[:, 0] < panel.back + parts.near
    attached = attached[~(behind & (parts.mesh.normals[attached, 0] > 0.9))]
    faces = np.unique(np.concatenate([panel.own, attached, front.tray, _leaf(parts, panel)]))
    return PartProposal(
        kind="door",
        faces=faces,
        joint="revolute",
        axis=np.array([0.0, 0.0, 1.0]),
        pivot=np.zeros(3),
        upper=QUARTER_RAD,
        confidence=0.7,
        panel=panel.rect,
        front=panel.front,
        handles=panel.handles,
    )


def _leaf(parts: Segmentation, panel: Panel) -> Ints:
    """Return the faces of the shells of a panel that are boards with its outline (K,)."""
    shells = np.unique(parts.shells.label[panel.own])
    boxes = parts.shells.boxes[shells]
    within = (boxes[:, 0, 1:] > panel.rect[:2] - 2.0 * parts.near).all(axis=1)
    within &= (boxes[:, 1, 1:] < panel.rect[2:] + 2.0 * parts.near).all(axis=1)
    within &= np.ptp(boxes[..., 0], axis=1) < LEAF * panel.size.min()
    return parts.faces_of(parts.shells, shells[within])


def _is_centred(front: Front) -> bool:
    """Return whether a horizontal handle, or a knob, is in the middle of the width."""
    handle, panel = front.handle, front.panel
    if handle is None:
        return False
    offset = abs(handle.centre[0] - panel.centre[0]) / panel.size[0]
    return bool(offset < CENTRED and handle.size[1] < 1.5 * handle.size[0])


def _is_flap(front: Front) -> bool:
    """Return whether a centred handle is a horizontal bar, or the panel is much wider than high."""
    handle, panel = front.handle, front.panel
    bar = handle is not None and handle.size[0] > BAR * handle.size[1]
    return bool(bar or panel.size[1] < FLAP * panel.size[0])


def _is_wide_centred(parts: Segmentation, panel: Panel) -> bool:
    """Return whether a panel is much wider than high, and in the middle of the object."""
    offset = abs(float(panel.centre[0] - parts.mesh.bounds[:, 1].mean()))
    return bool(panel.size[1] < FLAP * panel.size[0] and offset < MIRRORED * parts.mesh.size[1])


def _has_neighbour(parts: Segmentation, front: Front, others: Sequence[Front]) -> bool:
    """Return whether a tall congruent panel is beside: the two are a pair of doors."""
    panel = front.panel
    if panel.size[1] < 0.6 * panel.size[0]:
        return False
    return any(
        _congruent(panel, other.panel) and _beside(parts, panel, other.panel)
        for other in others
        if not len(other.tray)
    )


def _beside(parts: Segmentation, one: Panel, other: Panel) -> bool:
    gap = max(one.rect[0] - other.rect[2], other.rect[0] - one.rect[2])
    level = min(one.rect[3], other.rect[3]) - max(one.rect[1], other.rect[1])
    return bool(gap < ADJACENT * parts.mesh.size[1] and level > 0.8 * one.size[1])


def _drawer(parts: Segmentation, base: PartProposal, front: Front, reason: str) -> PartProposal:
    depth = front.depth or 0.6 * float(front.panel.front - parts.mesh.bounds[0, 0])
    return replace(
        base,
        kind="drawer",
        joint="prismatic",
        axis=np.array([1.0, 0.0, 0.0]),
        pivot=np.array([front.panel.front, *front.panel.centre]),
        upper=TRAVEL * depth,
        confidence=0.9 if len(front.tray) else 0.6,
        hollow=not len(front.tray),
        evidence=(reason,),
    )


def _flap(base: PartProposal, front: Front) -> PartProposal:
    """Return a panel that turns about a horizontal edge, away from its handle."""
    panel, handle = front.panel, front.handle
    below = handle is not None and handle.centre[1] < panel.rect[1] + 0.4 * panel.size[1]
    reason = f"a centred handle at the {'bottom' if below else 'top'}"
    return _turned_flap(base, panel, above=below, reason=reason)


def _turned_flap(base: PartProposal, panel: Panel, *, above: bool, reason: str) -> PartProposal:
    """Return a panel that turns about its upper or lower edge."""
    return replace(
        base,
        kind="flap",
        axis=np.array([0.0, -1.0 if above else 1.0, 0.0]),
        pivot=np.array([panel.back, panel.centre[0], panel.rect[3 if above else 1]]),
        evidence=(reason,),
        hollow=True,
    )


def _door(
    parts: Segmentation, base: PartProposal, front: Front, others: Sequence[Front]
) -> PartProposal:
    """Return a panel that turns about a vertical edge, away from its handle or its partner."""
    left, reason, confidence = _hinge_side(parts, front, others)
    return replace(_turned_door(base, front.panel, left=left, reason=reason), confidence=confidence)


def _turned_door(base: PartProposal, panel: Panel, *, left: bool, reason: str) -> PartProposal:
    """Return a panel that turns about its edge at the smaller or larger y."""
    return replace(
        base,
        axis=np.array([0.0, 0.0, -1.0 if left else 1.0]),
        pivot=np.array([panel.back, panel.rect[0 if left else 2], panel.centre[1]]),
        evidence=(reason,),
        hollow=True,
    )


def _hinge_side(
    parts: Segmentation, front: Front, others: Sequence[Front]
) -> tuple[bool, str, float]:
    """Return whether the hinge is at the smaller y, the evidence, and the confidence."""
    panel, handle = front.panel, front.handle
    if handle is not None and not _is_centred(front):
        offset = (handle.centre[0] - panel.centre[0]) / panel.size[0]
        if abs(offset) > 0.1:
            return bool(offset > 0.0), "a handle near the other edge", 0.85
    beside = [o for o in others if _congruent(panel, o.panel) and _beside(parts, panel, o.panel)]
    if beside:
        partner = beside[0].panel
        return bool(partner.centre[0] > panel.centre[0]), "a partner beside it", 0.7
    middle = float(parts.mesh.bounds[:, 1].mean())
    right = panel.centre[0] > middle + SYMMETRIC * parts.mesh.size[1]
    return not right, "its side of the object", 0.4
