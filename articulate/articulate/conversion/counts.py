"""How many links, joints, visuals and collisions went in and came out."""

from __future__ import annotations

from articulate.assets.asset import Asset
from articulate.assets.check_report import Counts
from articulate.formats.source_object import SourceObject


def counts_of(source: SourceObject, asset: Asset) -> Counts:
    """Counts of ``source`` and of the ``asset`` made of it.

    Links and geometry are counted as they stand in the file, joints if they move. The numbers
    differ for good reasons that ``asset.repairs`` names: links fixed together become one, a mesh
    of several materials becomes several visuals, collision geometry is made anew.
    """
    links = source.links.values()
    return Counts(
        links=(len(links), len(asset.links)),
        joints=(sum(joint.kind != "fixed" for joint in source.joints), len(asset.joints)),
        visuals=(
            sum(len(link.visuals) for link in links),
            sum(link.visuals for link in asset.links),
        ),
        collisions=(
            sum(len(link.collisions) for link in links),
            sum(link.collisions for link in asset.links),
        ),
    )
