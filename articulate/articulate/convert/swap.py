"""A folder that takes the place of an asset, whole."""

from __future__ import annotations

import errno
from contextlib import suppress
from pathlib import Path

TRIES = 20
"""So often a place is tried that others write to as well."""
BEATEN = frozenset({errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST})
"""What a rename says where another writer was first: one after the other."""


def is_asset(folder: Path) -> bool:
    """Whether an asset lies in ``folder``."""
    return (folder / "asset.json").is_file()


def take_place(new: Path, out: Path, aside: Path) -> None:
    """Rename ``new`` to ``out``; an asset that lies there is set aside, nothing else is touched.

    Nothing is deleted here: who is killed in between leaves whole folders alone.

    Args:
        new: Folder on the same disk.
        out: Where it is to lie: an asset, an empty folder, or nothing.
        aside: Folder on the same disk that takes what lay there.

    Raises:
        OSError: Something else lies there, or the disk does not let it be moved.
    """
    earlier = None
    for k in range(TRIES):
        try:
            if is_asset(out):
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
