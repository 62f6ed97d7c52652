"""What a folder or a zip file holds, read whole into memory within bounds."""

from __future__ import annotations

import lzma
import re
import stat
import struct
import zipfile
import zlib
from itertools import islice
from pathlib import Path

from articulate.errors import BundleError

MAX_BYTES = 64 << 20
"""Largest size of a bundle, unpacked, and of each archive in it [bytes]."""
MAX_RATIO = 100
"""Largest ratio of a zip member's size to its packed size."""
MAX_FILES = 2000
"""Largest number of files."""
PACKINGS = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
"""How members may be packed; others ask for as much memory as they like to be unpacked."""
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
    RuntimeError,  # of encrypted files and of unknown compression, too
    ValueError,  # and UnicodeDecodeError
)
"""What :mod:`zipfile` says of archives that are none, or damaged."""


def read_contents(path: Path) -> dict[str, bytes]:
    """Files of the folder or zip file at ``path``, by their paths in it.

    Raises:
        BundleError: It is neither, cannot be read, or holds what a bundle does not hold.
    """
    try:
        if path.is_dir():
            return _from_folder(path)
        if not path.is_file():
            raise BundleError(f"{path}: no such bundle; export-policy makes one from a run")
    except OSError as error:
        raise BundleError(f"{path}: cannot be read ({error.strerror})") from None
    return _from_zip(path)


def member(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> bytes:
    """Content of one member of a zip file; no more than its directory says.

    Raises:
        ValueError: It is locked, or packed as no file of ours is; and :data:`UNREADABLE`.
    """
    if item.flag_bits & 0x1 or item.compress_type not in PACKINGS:
        raise ValueError(f"{item.filename[:60]!r} is packed in a way that is not read")
    return archive.read(item)


def _from_folder(folder: Path) -> dict[str, bytes]:
    contents: dict[str, bytes] = {}
    total = 0
    paths = list(islice(folder.rglob("*"), 2 * MAX_FILES))  # and not all of a disk
    _check_size(folder, 0, len(paths) // 2)
    for path in sorted(paths):
        name = path.relative_to(folder).as_posix()
        mode = path.lstat().st_mode
        if stat.S_ISDIR(mode):
            continue
        if not stat.S_ISREG(mode):
            raise BundleError(f"{folder}: {name} is not a plain file; a bundle holds no links")
        total += path.stat().st_size
        _check_size(folder, total, len(contents))
        contents[name] = path.read_bytes()
    return contents


def _from_zip(path: Path) -> dict[str, bytes]:
    contents: dict[str, bytes] = {}
    total = 0
    try:
        with zipfile.ZipFile(path) as archive:
            for item in archive.infolist():
                if item.is_dir():
                    _check_name(path, item.filename.rstrip("/"))
                    continue
                _check_member(path, item)
                if item.filename in contents:
                    raise BundleError(f"{path}: {item.filename} stands twice in it")
                total += item.file_size
                _check_size(path, total, len(contents))
                contents[item.filename] = member(archive, item)
    except UNREADABLE as error:
        what = " ".join(str(error).split())[:160] or type(error).__name__
        raise BundleError(f"{path}: not a bundle ({what}); give what export-policy made") from None
    return contents


def _check_member(path: Path, item: zipfile.ZipInfo) -> None:
    _check_name(path, item.filename)
    mode = item.external_attr >> 16
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG) or item.flag_bits & 0x1:
        raise BundleError(f"{path}: {item.filename!r} is not a plain file")
    if item.file_size > MAX_RATIO * max(item.compress_size, 100):
        raise BundleError(f"{path}: {item.filename!r} unpacks to more than {MAX_RATIO} times")


def _check_name(path: Path, name: str) -> None:
    parts = name.split("/")
    bad = any(part in {"", ".", ".."} for part in parts) or re.search(r"[\\:\x00-\x1f]", name)
    if bad or len(name) > 200:
        raise BundleError(f"{path}: {name[:60]!r} is no name of a file inside a bundle")


def _check_size(path: Path, total: int, count: int) -> None:
    if total > MAX_BYTES or count >= MAX_FILES:
        raise BundleError(
            f"{path}: larger than a bundle may be ({MAX_BYTES >> 20} MB, {MAX_FILES} files)"
        )
