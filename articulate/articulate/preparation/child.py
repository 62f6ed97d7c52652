"""Check one object in a child process; see :mod:`articulate.jobs.child`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from articulate.formats.config import ConvertConfig
from articulate.preparation.prepare import prepare_in_cache


def run(request: dict[str, Any]) -> str:
    """Check ``file`` with ``options`` and return the folder of the result in ``cache``."""
    options, cache = request["options"], Path(request["cache"])
    against = Path(options["against"]) if "against" in options else None
    config = _config(options, cache)
    return str(prepare_in_cache(Path(request["file"]), config, options, against))


def _config(options: dict[str, Any], cache: Path) -> ConvertConfig:
    fields = {key: value for key, value in options.items() if key != "against"}
    fields = {k: tuple(v) if isinstance(v, list) else v for k, v in fields.items()}
    if "mesh_dirs" in fields:
        fields["mesh_dirs"] = tuple(Path(str(path)) for path in fields["mesh_dirs"])
    return ConvertConfig(cache_dir=cache, **fields)
