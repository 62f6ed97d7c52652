"""Source and licence of an object."""

from __future__ import annotations

from pathlib import Path

from articulate.conversion.metric_size import is_normalised
from articulate.files import read_json_object
from articulate.formats.config import ConvertConfig

ORIGIN_FILE = "source.json"
"""File beside a URDF with the keys ``source`` and ``licence``."""
ORIGIN_FILES = (ORIGIN_FILE, "asset.json")
"""Files beside a URDF from which source and licence are read; the second is that of an asset."""
PARTNET_LICENCE = (
    "PartNet-Mobility (SAPIEN) terms: research and education only, non-commercial, "
    "no redistribution"
)
"""Terms of the data set, for every copy; sapien.ucsd.edu/about."""


def origin_of(urdf: Path, config: ConvertConfig) -> tuple[str, str]:
    """Return source and licence: configured, in a file beside it, of the data set, or unknown."""
    source, licence = urdf.name, "unknown"
    if is_normalised(urdf):
        source, licence = f"PartNet-Mobility {urdf.parent.resolve().name}", PARTNET_LICENCE
    content = next((c for n in ORIGIN_FILES if (c := read_json_object(urdf.parent / n))), {})
    texts = {key: value for key, value in content.items() if isinstance(value, str) and value}
    source, licence = texts.get("source", source), texts.get("licence", licence)
    return source, licence if config.licence == "unknown" else config.licence
