"""Objects named by ``--asset``: a file, a folder or a pattern."""

from __future__ import annotations

import glob
from collections import Counter
from pathlib import Path

from articulate.errors import UsageError
from articulate.preparation.batch import Item, items_in


def objects_of(pattern: str) -> list[Item]:
    """Return the objects of ``--asset``: a file, a folder of objects, or a pattern with ``*``.

    Raises:
        UsageError: There are none.
    """
    if Path(pattern).exists() or not glob.has_magic(pattern):
        return items_in(Path(pattern))[0]
    names = sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207  # of any root
    found = [Path(name) for name in names]
    if not found:
        raise UsageError(f"--asset {pattern!r}: no file or folder matches; quote the pattern")
    items: dict[str, Item] = {}
    stems = Counter(path.stem for path in found if path.is_file())
    for path in found:
        for item in items_in(path)[0]:
            alike = path.is_file() and stems[path.stem] > 1  # .../ID/mobility.urdf
            name = path.resolve().parent.name if alike else item.name
            while name in items:
                name += "_"
            items[name] = Item(name=name, file=item.file)
    return list(items.values())


def is_many(pattern: str) -> bool:
    """Return whether ``--asset`` names more than one object."""
    if glob.has_magic(pattern) and not Path(pattern).exists():
        return True
    return Path(pattern).is_dir() and len(items_in(Path(pattern))[0]) > 1
