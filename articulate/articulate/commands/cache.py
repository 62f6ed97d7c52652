"""``articulate cache``: list or clean the cache of conversions and checks."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from articulate.cache import Entry, cache_folder, clean, entries, limit_bytes
from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError, UsageError

N_LISTED = 20
"""Number of the largest entries in the list."""


@dataclass(frozen=True, kw_only=True)
class CacheFlags:
    """List or clean the cache of conversions and checks.

    Removed entries are recomputed on use. Above 20 GB the least recently used entries are removed
    automatically; ARTICULATE_CACHE_GB sets another limit.

    Example: articulate cache clean --keep-gb 2
    """

    action: Annotated[Literal["list", "clean"], POSITIONAL] = "list"
    """Action: list or clean."""
    keep_gb: float = 0.0
    """Keep the most recently used entries, up to this size [GB]; only for clean."""
    json: bool = False
    """Print only the result, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if not self.keep_gb >= 0.0:
            raise ConfigError(f"--keep-gb is {self.keep_gb:g}; it must be 0 GB or more")
        if not math.isfinite(self.keep_gb):
            raise ConfigError(f"--keep-gb is {self.keep_gb:g}; it must be finite")


FLAGS = CacheFlags


def main(argv: Sequence[str]) -> int:
    """List or clean, and print."""
    flags = parse(CacheFlags, argv, prog="articulate cache")
    folder = cache_folder()
    if flags.action == "list":
        found = entries(folder)
        content = _content(folder, found)
        console.emit_json(content) if flags.json else console.emit(_listed(folder, found))
        return 0
    if flags.keep_gb == 0.0 and not folder.exists():
        raise UsageError(f"{folder}: there is no cache yet; nothing to clean")
    done = clean(folder, int(flags.keep_gb * 1e9))
    if flags.json:
        console.emit_json({"folder": str(folder), **done.as_dict()})
        return 0
    busy = f"; {done.busy} in use and kept" if done.busy else ""
    console.emit(
        f"{folder}: {done.removed} entries removed ({_size(done.removed_bytes)}), "
        f"{done.left} left ({_size(done.left_bytes)}){busy}"
    )
    return 0


def _content(folder: Path, found: Sequence[Entry]) -> dict[str, Any]:
    return {
        "folder": str(folder),
        "bytes": sum(entry.bytes for entry in found),
        "limit_bytes": limit_bytes(),
        "entries": [
            {
                "kind": entry.kind,
                "name": entry.path.name,
                "bytes": entry.bytes,
                "used": _date(entry.used, "%Y-%m-%dT%H:%M:%SZ"),
            }
            for entry in found
        ],
    }


def _listed(folder: Path, found: Sequence[Entry]) -> str:
    """Format a line for each kind and the largest entries."""
    total = sum(entry.bytes for entry in found)
    limit = _size(limit_bytes())
    lines = [f"{folder}: {len(found)} entries, {_size(total)} of at most {limit}"]
    for kind in sorted({entry.kind for entry in found}):
        of = [entry.bytes for entry in found if entry.kind == kind]
        lines.append(f"  {kind:<16} {len(of):>6} entries  {_size(sum(of)):>9}")
    largest = sorted(found, key=lambda entry: -entry.bytes)[:N_LISTED]
    if largest:
        lines.append("largest:")
    for entry in largest:
        day = _date(entry.used, "%Y-%m-%d %H:%M")
        lines.append(f"  {_size(entry.bytes):>9}  used {day}  {entry.kind}/{entry.path.name}")
    return "\n".join(lines)


def _size(size_bytes: float) -> str:
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= scale:
            return f"{size_bytes / scale:.1f} {unit}"
    return f"{size_bytes:.0f} B"


def _date(when: float, form: str) -> str:
    return time.strftime(form, time.gmtime(when))
