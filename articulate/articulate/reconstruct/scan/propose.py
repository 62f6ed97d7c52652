"""Choose the parts of a scan among the proposals of all rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.reconstruct.scan.discs import knobs, round_door, wheels
from articulate.reconstruct.scan.door_handles import (
    details_of_ajar,
    levers,
    turning_handles,
)
from articulate.reconstruct.scan.faucets import faucet_parts
from articulate.reconstruct.scan.fronts import Front, all_fronts, front_parts, moving_fronts
from articulate.reconstruct.scan.handle_layout import parts_by_handles
from articulate.reconstruct.scan.lids import ajar_door, closed_lid, lid_above_gap, open_flaps
from articulate.reconstruct.scan.panels import ENTIRE
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.reconstruct.scan.slabs import slab_parts
from articulate.reconstruct.scan.sliding import with_sliding
from articulate.reconstruct.scan.toilets import toilet_parts
from articulate.reconstruct.scan.vessels import vessel_parts
from articulate.reconstruct.scan.wall_plates import switch_parts

TALL = 1.2
"""Containers with a lid that are higher than this multiple of their width are bins."""
MOST_MOVING = 0.95
"""Largest area of all moving parts, as a share of the object."""
LEFT = 0.5
"""Least share of its area that a proposal keeps; with less, it is a knob or wheel itself."""
UNSURE = 0.45
"""Largest confidence of fronts without handles and trays."""


PRECISION: Mapping[str, float] = {
    "it moves in the video": 0.9,
    "a tray behind the front": 0.9,
    "an arch from one side of a round body to the other": 0.9,
    "a centred part above a round body": 0.6,
    "a thin slab above a flat base": 0.85,
    "a partner beside it": 0.6,
    "equal discs at the bottom": 0.6,
    "a handle near the other edge": 0.6,
    "a handle on a front without seams": 0.6,
    "a plate above the rim of a container": 0.6,
    "a tray behind a door": 0.6,
    "an upright slab turned against the object": 0.5,
    "the upper part of a column": 0.5,
    "a round protrusion of the front": 0.35,
    "a centred handle at the top": 0.35,
    "a centred handle at the bottom": 0.3,
    "a large disc in the front": 0.3,
    "a dial beside the fronts": 0.5,
    "a lever beside a dial": 0.5,
    "the upper part of a case": 0.5,
    "its side of the object": 0.2,
    "a wide front with a centred handle": 0.2,
    "a cover on top of a container": 0.2,
}
"""Share of objects of the development half whose parts and joints a rule finds, rounded down."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundParts:
    """Proposed parts of one object."""

    parts: tuple[PartProposal, ...] = ()
    category: str = "unknown"
    """Category that the parts imply, ``unknown`` if several have such parts."""


def propose_parts(
    mesh: ScanMesh, counts: Mapping[str, int] | None = None, *, smooth: bool = False
) -> FoundParts:
    """Return the proposed moving parts of an object, whose faces do not overlap.

    Args:
        mesh: The object; its front is +x.
        counts: Number of parts by kind, where known; other numbers lower the confidence.
        smooth: True for the surface of a scanner, on which few parts have a border.
    """
    parts = Segmentation(mesh)
    found = _by_rules(parts, smooth=smooth)
    moving = np.zeros(len(mesh.faces), dtype=bool)
    for proposal in found.parts:
        moving[proposal.faces] = True
    if mesh.areas[moving].sum() > MOST_MOVING * mesh.areas.sum():
        return FoundParts()  # nothing is left that it could move on
    if counts:
        found = replace(found, parts=tuple(rated(found.parts, counts)))
    return found


def _of_category(parts: Segmentation) -> FoundParts | None:
    """Return the parts of a rule that implies the category; None if none applies."""
    for category, rule in _RULES.items():
        found = rule(parts)
        if found:
            return FoundParts(parts=tuple(found), category=category)
    slabs = slab_parts(parts)
    if slabs:
        category = "Laptop" if slabs[0].kind == "screen" else "Box"
        return FoundParts(parts=tuple(slabs), category=category)
    vessel = vessel_parts(parts)
    if vessel:
        return FoundParts(parts=tuple(vessel), category=_vessel_category(parts, vessel[0]))
    return None


_RULES: Mapping[str, Callable[[Segmentation], list[PartProposal]]] = {
    "Switch": switch_parts,
    "Faucet": faucet_parts,
    "Toilet": toilet_parts,
}


def _vessel_category(parts: Segmentation, part: PartProposal) -> str:
    height, width = float(parts.mesh.size[2]), float(parts.mesh.size[:2].max())
    if part.kind == "handle":
        return "Bucket"
    if part.joint == "revolute":
        return "TrashCan" if height > width else "unknown"
    return "Bottle" if height > TALL * width else "KitchenPot"


def _lid_category(parts: Segmentation) -> str:
    return "TrashCan" if parts.mesh.size[2] > TALL * parts.mesh.size[:2].max() else "Box"


def _by_rules(parts: Segmentation, *, smooth: bool) -> FoundParts:
    known = _of_category(parts)
    if known is not None:
        return known
    ajar = ajar_door(parts)
    if ajar:
        details = details_of_ajar(parts, ajar[0])
        return FoundParts(parts=tuple(with_details(parts, ajar, details)))
    every_front = all_fronts(parts)
    fronts, sure = moving_fronts(parts, every_front)
    if smooth:
        divided = parts_by_handles(parts)
        certain = [front for front in fronts if sure and not _is_entire(parts, front)]
        if len(divided) > len(certain):
            return FoundParts(parts=tuple(with_details(parts, divided)))
    porthole = [] if sum(len(front.tray) > 0 for front in fronts) > 1 else round_door(parts)
    if porthole:
        beside = [front for front in fronts if len(front.tray)]
        found = [*porthole, *_clear_of(front_parts(parts, beside), porthole)]
        return FoundParts(parts=tuple(with_details(parts, found)))
    lid = [] if sure else lid_above_gap(parts)
    if lid:
        return FoundParts(parts=tuple(with_details(parts, lid)), category=_lid_category(parts))
    if not sure and len(fronts) < 2:
        flaps = open_flaps(parts)
        if flaps:
            return FoundParts(parts=tuple(with_details(parts, flaps)), category="Box")
        lid = closed_lid(parts)
        if lid:
            return FoundParts(parts=tuple(with_details(parts, lid)), category=_lid_category(parts))
    if not sure and wheels(parts):
        fronts = []  # the panels of a cart or a stand have no handle or tray
    found = with_sliding(parts, front_parts(parts, fronts), every_front)
    if not sure:
        found = [proposal.with_confidence(min(proposal.confidence, UNSURE)) for proposal in found]
    return FoundParts(parts=tuple(with_details(parts, found)))


def _is_entire(parts: Segmentation, front: Front) -> bool:
    """Return whether a front panel is nearly the entire front: perhaps the body itself."""
    return bool((front.panel.size > ENTIRE * parts.mesh.size[1:]).all())


def _clear_of(found: Sequence[PartProposal], others: Sequence[PartProposal]) -> list[PartProposal]:
    """Return the proposals that share no face with ``others``."""
    return [p for p in found if not any(np.isin(p.faces, other.faces).any() for other in others)]


def rated(found: Sequence[PartProposal], counts: Mapping[str, int]) -> list[PartProposal]:
    """Return the proposals, with lower confidence where the text gives another number."""
    kinds = ["door" if p.kind == "flap" else p.kind for p in found]
    changed = []
    for kind, proposal in zip(kinds, found, strict=True):
        known = counts.get(kind)
        right = known is not None and kinds.count(kind) == known
        change = 0.0 if known is None else (0.1 if right else -0.25)
        changed.append(proposal.with_confidence(proposal.confidence + change))
    return changed


def calibrated(found: Sequence[PartProposal]) -> list[PartProposal]:
    """Return the proposals with the share of right parts of their rule as confidence."""
    return [
        proposal.with_confidence(
            min(
                PRECISION.get(proposal.evidence[0] if proposal.evidence else "", 0.5),
                1.0 if proposal.confidence >= 0.5 else proposal.confidence,
            )
        )
        for proposal in found
    ]


def with_details(
    parts: Segmentation, found: list[PartProposal], known: Sequence[PartProposal] = ()
) -> list[PartProposal]:
    """Add knobs and wheels to proposals; their faces are removed from what carries them.

    Args:
        parts: The object; its front is +x.
        found: Proposals.
        known: Knobs and levers of these that were found before.
    """
    covered = np.zeros(len(parts.mesh.faces), dtype=bool)
    for proposal in found:
        covered[proposal.faces] = True
    turning = [*known, *turning_handles(parts, found)]
    rolling = wheels(parts)
    dials = _clear_of(knobs(parts, covered, found), [*turning, *rolling])
    bars = _clear_of(levers(parts, [*found, *turning, *dials]), [*turning, *dials])
    details = [*turning, *dials, *bars, *rolling]
    own = np.concatenate([np.zeros(0, dtype=np.int64), *(detail.faces for detail in details)])
    areas = parts.mesh.areas
    rests = [np.setdiff1d(p.faces, own) for p in found]
    kept = [
        k
        for k, (p, rest) in enumerate(zip(found, rests, strict=True))
        if areas[rest].sum() > LEFT * areas[p.faces].sum()
    ]
    left = [replace(found[k], faces=rests[k]) for k in kept]
    details = [replace(d, on=kept.index(d.on) if d.on in kept else None) for d in details]
    return [*left, *details]
