"""Where an object comes from and under which licence."""

from __future__ import annotations

from pathlib import Path

from articulate.conversion.metric_size import is_normalised
from articulate.files import read_json_object
from articulate.formats.config import ConvertConfig

ORIGIN_FILE = "source.json"
"""File beside a URDF with the keys ``source`` and ``licence``."""
PARTNET_LICENCE = (
    "PartNet-Mobility (SAPIEN) terms: research and education only, non-commercial, "
    "no redistribution"
)
"""Terms of the data set, whoever published the copy; sapien.ucsd.edu/about."""


def origin_of(urdf: Path, config: ConvertConfig) -> tuple[str, str]:
    """Source and licence: as asked for, as said beside the file, by data set, or ``"unknown"``."""
    source, licence = urdf.name, "unknown"
    if is_normalised(urdf):
        source, licence = f"PartNet-Mobility {urdf.parent.resolve().name}", PARTNET_LICENCE
    said = read_json_object(urdf.parent / ORIGIN_FILE)
    words = {key: value for key, value in said.items() if isinstance(value, str) and value}
    source, licence = words.get("source", source), words.get("licence", licence)
    return source, licence if config.licence == "unknown" else config.licence
