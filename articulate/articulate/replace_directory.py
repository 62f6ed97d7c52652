"""A folder that takes the place of an earlier one, whole."""

from __future__ import annotations

import errno
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

TRIES = 20
"""So often a place is tried that others write to as well."""
BEATEN = frozenset({errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST})
"""What a rename says where another writer was first: one after the other."""


def is_asset(folder: Path) -> bool:
    """Whether an asset lies in ``folder``."""
    return is_of(folder / "asset.json", "articulate.asset")


def is_of(file: Path, schema: str) -> bool:
    """Whether ``file`` is JSON that says to be of ``schema``, of whatever version.

    Its name alone is not enough: what takes the place of a folder deletes it, and others have
    files of that name too.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("schema") == schema


def replace_directory(
    new: Path, out: Path, aside: Path, ours: Callable[[Path], bool] = is_asset
) -> None:
    """Rename ``new`` to ``out``; what is ours there is set aside, nothing else is touched.

    Nothing is deleted here: who is killed in between leaves whole folders alone.

    Args:
        new: Folder on the same disk.
        out: Where it is to lie: a folder of ours, an empty one, or nothing.
        aside: Folder on the same disk that takes what lay there.
        ours: Tells whether a folder is an earlier one, which may be set aside.

    Raises:
        OSError: Something else lies there, or the disk does not let it be moved.
    """
    earlier = None
    for k in range(TRIES):
        try:
            if ours(out):
                earlier = out.rename(aside / f"old_{k}")
            new.rename(out)
        except OSError as error:
            if error.errno in BEATEN and k + 1 < TRIES:
                continue
            if earlier is not None:  # it goes back unless another one is there by now
                with suppress(OSError):
                    earlier.rename(out)
            raise
        return
