"""Write files and folders so that they are complete or absent."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from articulate.errors import UsageError
from articulate.untrusted import load_json_object

MAX_TRIES = 20
"""Attempts to replace a folder that other processes replace at the same time."""
RACE_ERRORS = frozenset({errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST})
"""Errors of a rename that lost the race against another writer."""


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder that replaces ``path`` on success.

    Nothing is left behind if the block raises.

    Raises:
        UsageError: The folder cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    os.close(handle)
    temporary = Path(name)
    try:
        temporary.chmod(0o644)
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    except OSError as error:
        if error.filename not in {None, name}:  # the block failed on another file
            raise
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from None
    finally:
        temporary.unlink(missing_ok=True)


def require_space(folder: Path, need_bytes: int, what: str) -> None:
    """Check that the disk has enough room.

    Args:
        folder: Folder to write into; it need not exist.
        need_bytes: Space required [bytes].
        what: Purpose of the space, for the message.

    Raises:
        UsageError: Less is free.
    """
    above = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    free = shutil.disk_usage(above).free
    if free < need_bytes:
        raise UsageError(
            f"{folder}: {what} takes about {need_bytes / 1e6:.0f} MB, and {free / 1e6:.0f} MB are "
            "free on its disk; free some or choose another --out"
        )


def reject_links(folder: Path) -> None:
    """Raise an error if ``folder`` holds a link: its target would be read or overwritten.

    Raises:
        UsageError: There is one, at any depth.
    """
    for base, folders, names in os.walk(folder):
        for name in (*folders, *names):
            path = Path(base, name)
            if path.is_symlink():
                raise UsageError(f"{path}: a link; remove it, or replace it by its target")


def copy_writable(source: Path, target: Path) -> None:
    """Copy a folder that may be read-only to one that can be written and removed again."""
    shutil.copytree(source, target, copy_function=shutil.copyfile, dirs_exist_ok=True)
    for folder in (target, *(path for path in target.rglob("*") if path.is_dir())):
        folder.chmod(0o755)


def write_bytes(path: Path, content: bytes) -> None:
    """Write ``content``; on failure ``path`` keeps its previous content."""
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Write ``content`` as UTF-8; on failure ``path`` keeps its previous content.

    Surrogates, such as the bytes of a file name that is not UTF-8, are written as escapes.
    """
    write_bytes(path, content.encode("utf-8", errors="backslashreplace"))


def write_json(path: Path, content: Any) -> None:
    """Write ``content`` as indented JSON, completely or not at all.

    Raises:
        ValueError: ``content`` holds NaN or infinity.
    """
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_json_object(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; empty if it is absent, unreadable or something else."""
    try:
        return load_json_object(path)
    except UsageError:
        return {}


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def is_asset(folder: Path) -> bool:
    """Return whether ``folder`` is an asset folder of any schema version."""
    return has_schema(folder / "asset.json", "articulate.asset")


def has_schema(file: Path, schema: str) -> bool:
    """Return whether ``file`` is JSON of ``schema``, of any version.

    The file name is not enough: folders with this file get replaced, and other programs may use
    the same name.
    """
    return read_json_object(file).get("schema") == schema


def replace_directory(
    new: Path, out: Path, aside: Path, is_replaceable: Callable[[Path], bool] = is_asset
) -> None:
    """Rename ``new`` to ``out``; move a replaceable folder at ``out`` into ``aside``.

    Nothing is deleted here, so that killing the process leaves complete folders only.

    Args:
        new: Folder on the same disk.
        out: Target: a replaceable folder, an empty one, or nothing.
        aside: Folder on the same disk that receives the previous ``out``.
        is_replaceable: Predicate for folders at ``out`` that may be moved away.

    Raises:
        OSError: ``out`` is something else, or the disk does not permit the move.
    """
    previous = None
    for k in range(MAX_TRIES):
        try:
            if is_replaceable(out):
                previous = out.rename(aside / f"old_{k}")
            new.rename(out)
        except OSError as error:
            if error.errno in RACE_ERRORS and k + 1 < MAX_TRIES:
                continue
            if previous is not None:  # move it back unless another writer was faster
                with suppress(OSError):
                    previous.rename(out)
            raise
        return
