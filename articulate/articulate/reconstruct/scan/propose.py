"""Choose the parts of a scan among the proposals of all rules."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.discs import knobs, wheels
from articulate.reconstruct.scan.fronts import find_fronts, front_parts
from articulate.reconstruct.scan.lids import ajar_door, closed_lid
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.reconstruct.scan.slabs import slab_parts
from articulate.reconstruct.scan.vessels import vessel_parts


def propose_parts(
    mesh: ScanMesh, category: str = "unknown", counts: Mapping[str, int] | None = None
) -> list[PartProposal]:
    """Return the proposed moving parts of an object, whose faces do not overlap.

    Args:
        mesh: The object; its front is +x.
        category: Category of the object, if known.
        counts: Number of parts by kind, where known.
    """
    parts = Segmentation(mesh)
    del category, counts
    slabs = slab_parts(parts)
    if slabs:
        return slabs
    vessel = vessel_parts(parts)
    if vessel:
        return vessel
    ajar = ajar_door(parts)
    if ajar:
        return with_details(parts, ajar)
    fronts, sure = find_fronts(parts)
    lid = [] if sure else closed_lid(parts)
    return with_details(parts, lid or front_parts(parts, fronts))


def with_details(parts: Segmentation, found: list[PartProposal]) -> list[PartProposal]:
    """Add knobs and wheels to proposals; their faces are taken from what carries them."""
    taken = np.zeros(len(parts.mesh.faces), dtype=bool)
    for proposal in found:
        taken[proposal.faces] = True
    details = [*knobs(parts, taken, found), *wheels(parts)]
    for detail in details:
        found = [
            replace(p, faces=np.setdiff1d(p.faces, detail.faces)) if p not in details else p
            for p in found
        ]
    return [p for p in [*found, *details] if len(p.faces)]
