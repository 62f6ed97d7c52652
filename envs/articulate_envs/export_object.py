"""URDF of an asset for bundles: links, joints and collision geometry, without visuals."""

from __future__ import annotations

import re

from lxml import etree

from articulate.assets.asset import Asset
from articulate.errors import AssetError, quote, shorten

URDF_FILE = "object.urdf"
_MESH = re.compile(r"meshes/[\w.-]+")


def object_files(asset: Asset) -> dict[str, bytes]:
    """Return ``object.urdf`` and the meshes that it names by their paths relative to it.

    Raises:
        AssetError: The asset has no such file, or it names something outside of its meshes.
    """
    path = asset.folder / URDF_FILE
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        root = etree.fromstring(path.read_bytes(), parser)
    except (OSError, etree.XMLSyntaxError) as error:
        raise AssetError(
            f"{path}: cannot be read ({shorten(error)}); make it with check-asset"
        ) from None
    for visual in list(root.iter("visual")):
        visual.getparent().remove(visual)
    files: dict[str, bytes] = {}
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if not _MESH.fullmatch(name):
            raise AssetError(f"{path}: names {quote(name, 60)}, which is not in its meshes")
        files[name] = (asset.folder / name).read_bytes()
    etree.indent(root)
    text = etree.tostring(root, encoding="unicode") + "\n"
    return {URDF_FILE: text.encode(), **files}
