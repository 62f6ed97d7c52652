"""Where an object comes from and under which licence."""

from __future__ import annotations

import json
from pathlib import Path

from articulate.convert.config import ConvertConfig
from articulate.convert.size import is_normalised

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
    try:
        said = json.loads((urdf.parent / ORIGIN_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        said = {}
    if isinstance(said, dict):
        source, licence = str(said.get("source", source)), str(said.get("licence", licence))
    return source, licence if config.licence == "unknown" else config.licence
