"""Choose the parts of a scan among the proposals of all rules."""

from __future__ import annotations

from collections.abc import Mapping

from articulate.reconstruct.scan.fronts import front_parts
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.reconstruct.scan.slabs import slab_parts


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
    del category
    return slab_parts(parts) or front_parts(parts, counts)
