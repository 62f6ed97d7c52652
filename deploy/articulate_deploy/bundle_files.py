"""Files of a bundle, read completely into memory within bounds."""

from __future__ import annotations

import io
import lzma
import os
import re
import stat
import struct
import zipfile
import zlib
from pathlib import Path

from articulate.errors import BundleError, quote, shorten
from articulate.task.manifest import MANIFEST_FILE
from articulate.untrusted import read_bounded

MAX_BYTES = 64 << 20
"""Largest size of a bundle, unpacked, and of each archive in it [bytes]."""
MAX_RATIO = 100
"""Largest ratio of a zip member's size to its packed size."""
MAX_FILES = 2000
"""Largest number of files."""
MAX_DEPTH = 4
"""Deepest folder of a bundle; an exported one has two levels."""
COMPRESSION = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
"""Supported compression of members; unpacking the others may take any amount of memory."""
UNREADABLE = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    KeyError,
    MemoryError,
    OSError,
    OverflowError,
    RuntimeError,  # encrypted files and unknown compression
    ValueError,  # UnicodeDecodeError as well
)
"""Errors of :mod:`zipfile` for damaged archives and other files."""
_ENTRY = b"PK\x01\x02"
"""First bytes of an entry in the directory of a zip file."""


def read_contents(path: Path) -> dict[str, bytes]:
    """Return the files of the folder or zip file at ``path`` by their paths in it.

    Raises:
        BundleError: It is neither, cannot be read, or contains files that no bundle contains.
    """
    try:
        if path.is_dir():
            return _from_folder(path)
        if not path.exists():
            raise BundleError(f"{path}: no such bundle; export-policy makes one from a run")
    except OSError as error:
        raise BundleError(f"{path}: cannot be read ({error.strerror})") from None
    return _from_zip(path)


def open_zip(content: bytes) -> zipfile.ZipFile:
    """Open the zip file that ``content`` is.

    Raises:
        ValueError: It has too many members; and :data:`UNREADABLE`.
    """
    if content.count(_ENTRY) > MAX_FILES + 1:
        raise ValueError(f"more than {MAX_FILES} members")
    return zipfile.ZipFile(io.BytesIO(content))


def member(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> bytes:
    """Return the content of one member of a zip file, at most of the size in its directory.

    Raises:
        ValueError: It is encrypted or its compression is not supported; and :data:`UNREADABLE`.
    """
    if item.flag_bits & 0x1 or item.compress_type not in COMPRESSION:
        raise ValueError(f"{quote(item.filename, 60)} has a compression that is not supported")
    return archive.read(item)


def _from_folder(folder: Path) -> dict[str, bytes]:
    if not (folder / MANIFEST_FILE).is_file():
        raise BundleError(
            f"{folder}: not a bundle, it has no {MANIFEST_FILE}; give one that export-policy made"
        )
    contents: dict[str, bytes] = {}
    total = 0
    for path in _files_below(folder):
        name = path.relative_to(folder).as_posix()
        content = read_bounded(path, MAX_BYTES, error=BundleError)
        total += len(content)
        _check_size(folder, total, len(contents))
        contents[name] = content
    return contents


def _files_below(folder: Path) -> list[Path]:
    """Return the regular files below ``folder``, sorted."""
    files: list[Path] = []
    folders = [(folder, 0)]
    entries = 0
    while folders:
        parent, depth = folders.pop()
        with os.scandir(parent) as found:
            for entry in found:
                entries += 1
                _check_size(folder, 0, entries // 2)
                path = Path(entry.path)
                if entry.is_dir(follow_symlinks=False) and depth < MAX_DEPTH:
                    folders.append((path, depth + 1))
                elif entry.is_file(follow_symlinks=False):
                    files.append(path)
                else:
                    name = quote(path.relative_to(folder).as_posix(), 60)
                    raise BundleError(
                        f"{folder}: {name} is not a regular file in at most {MAX_DEPTH} folders; "
                        "bundles have no links"
                    )
    return sorted(files)


def _from_zip(path: Path) -> dict[str, bytes]:
    contents: dict[str, bytes] = {}
    total = 0
    packed = read_bounded(path, MAX_BYTES, error=BundleError)
    try:
        with open_zip(packed) as archive:
            for item in archive.infolist():
                if item.is_dir():
                    _check_name(path, item.filename.rstrip("/"))
                    continue
                _check_member(path, item)
                if item.filename in contents:
                    raise BundleError(f"{path}: duplicate member {quote(item.filename, 60)}")
                total += item.file_size
                _check_size(path, total, len(contents))
                contents[item.filename] = member(archive, item)
    except UNREADABLE as error:
        reason = shorten(" ".join(str(error).split()), 160) or type(error).__name__
        raise BundleError(
            f"{path}: not a bundle ({reason}); give one that export-policy made"
        ) from None
    return contents


def _check_member(path: Path, item: zipfile.ZipInfo) -> None:
    _check_name(path, item.filename)
    mode = item.external_attr >> 16
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG) or item.flag_bits & 0x1:
        raise BundleError(f"{path}: {quote(item.filename, 60)} is not a regular file")
    if item.file_size > MAX_RATIO * max(item.compress_size, 100):
        raise BundleError(
            f"{path}: {quote(item.filename, 60)} unpacks to more than {MAX_RATIO} times its size"
        )


def _check_name(path: Path, name: str) -> None:
    parts = name.split("/")
    bad = any(part in {"", ".", ".."} for part in parts) or re.search(r"[\\:\x00-\x1f]", name)
    if bad or len(name) > 200:
        raise BundleError(f"{path}: {quote(name, 60)} is not a valid file name in a bundle")


def _check_size(path: Path, total: int, count: int) -> None:
    if total > MAX_BYTES or count >= MAX_FILES:
        raise BundleError(
            f"{path}: larger than a bundle may be ({MAX_BYTES >> 20} MB, {MAX_FILES} files)"
        )
