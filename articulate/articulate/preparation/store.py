"""What was checked before, by content: found again without loading a mesh or a simulator.

A record lies in ``checks/`` of the cache. Its name is a hash of the source file, the options and
this package's own code; it says which other files were read and what their hashes were, and in
which folder of the cache the result lies. The result counts only while all of that still holds.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from articulate.cache import cache_folder, touch
from articulate.errors import UsageError
from articulate.files import (
    copy_writable,
    has_schema,
    is_asset,
    replace_directory,
    sha256,
    write_json,
)
from articulate.preparation.check_report_file import CHECK_REPORT_FILE
from articulate.preparation.check_report_file import SCHEMA as CHECK_REPORT_SCHEMA

CODE = (
    "assets",
    "checks",
    "conversion",
    "formats",
    "geometry",
    "preparation",
    "simulator.py",
    "transforms.py",
)
"""What decides about a verdict, inside the package."""
JUDGES = ("mujoco", "pybullet")
"""Packages whose version, or absence, decides about a verdict as well."""
PACKAGES_VARIABLE = "ROS_PACKAGE_PATH"
"""Names folders in which meshes are looked for."""
MOST_NAMES = 5000
"""So many file names beside a source are looked at for files that came or went."""
MOST_BYTES = 64_000_000
"""Larger source files are not read here."""


default_cache = cache_folder
"""Where results are kept."""


@functools.cache
def code_id() -> str:
    """Hash of the code that converts and proves."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for name in CODE:
        path = package / name
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_file() and file.suffix != ".pyc":
                digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


@functools.cache
def judges() -> tuple[str, ...]:
    """Names and versions of the simulators that judge, told without importing them."""
    found = []
    for name in JUDGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} absent")
    return tuple(found)


def find(source: Path, options: Mapping[str, Any], cache: Path) -> Path | None:
    """Folder with the result of an earlier check of ``source``, or None.

    Args:
        source: File or asset folder that is checked.
        options: All that the result depends on besides.
        cache: Cache folder.
    """
    try:
        record = json.loads(_record(source, options, cache).read_text(encoding="utf-8"))
        folder = cache / str(record["folder"])
        if (
            record["listing"] != _listing(source, dated=record["dated"])
            or not (folder / CHECK_REPORT_FILE).is_file()
        ):
            return None
        if any(sha256(Path(path)) != known for path, known in record["inputs"].items()):
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    touch(folder)
    touch(_record(source, options, cache))
    return folder


def keep(
    source: Path,
    options: Mapping[str, Any],
    cache: Path,
    inputs: Iterable[Path],
    folder: Path,
    *,
    dated: bool = False,
) -> None:
    """Note that the result of ``source`` lies in ``folder`` of the cache.

    Args:
        source: File or asset folder that was checked.
        options: All that the result depends on besides.
        cache: Cache folder.
        inputs: Further files that were read.
        folder: Folder below ``cache``.
        dated: The files beside and below ``source`` have to keep their dates, too: nobody knows
            which of them was read when reading ended in an error.
    """
    known = {}
    for path in sorted(set(inputs)):
        with suppress(OSError):
            known[str(path.resolve())] = sha256(path)
    content = {
        "source": str(source.resolve()),
        "inputs": known,
        "dated": dated,
        "listing": _listing(source, dated=dated),
        "folder": folder.relative_to(cache).as_posix(),
    }
    touch(folder)
    write_json(_record(source, options, cache), content)


def ticket(source: Path, options: Mapping[str, Any]) -> str:
    """Hash of ``source``, where it lies, the ``options``, the code and what it runs with."""
    packages = os.environ.get(PACKAGES_VARIABLE, "")
    around = "\0".join((code_id(), *judges(), packages, str(source.resolve())))
    digest = hashlib.sha256(f"{around}\0".encode(errors="surrogateescape"))
    digest.update(json.dumps(dict(options), sort_keys=True, default=str).encode() + b"\0")
    if source.is_dir():
        for path in sorted(p for p in source.rglob("*") if p.is_file()):
            digest.update(f"{path.relative_to(source)}\0{sha256(path)}\0".encode())
    else:
        digest.update(_content(source))
    return digest.hexdigest()


def _content(source: Path) -> bytes:
    """Bytes of a file; what is too large to be an object is told by its size and date."""
    try:
        state = source.stat()
        return source.read_bytes() if state.st_size <= MOST_BYTES else _size_and_date(source)
    except OSError as error:
        return f"unreadable: {error.errno}".encode()


def _size_and_date(path: Path) -> bytes:
    try:
        state = path.stat()
    except OSError as error:
        return f"unreadable: {error.errno}".encode()
    return f"{state.st_size} {state.st_mtime_ns}".encode()


def _record(source: Path, options: Mapping[str, Any], cache: Path) -> Path:
    return cache / "checks" / f"{ticket(source, options)[:32]}.json"


def _listing(source: Path, *, dated: bool) -> str:
    """Hash of the names beside and below ``source``: a mesh that was absent may have come.

    With sizes and dates if ``dated``: one that was damaged may have been mended.

    Names are taken from the top folder on: who asks may write the path to it in another way than
    who kept the result.
    """
    digest = hashlib.sha256()
    count = 0
    path = source.resolve()
    top = path if path.is_dir() else path.parent
    for base, folders, files in os.walk(top):
        folders.sort()
        inside = os.path.relpath(base, top)
        for name in sorted(files):
            digest.update(f"{inside}/{name}\0".encode(errors="surrogateescape"))
            if dated:
                digest.update(_size_and_date(Path(base, name)))
        count += len(files)
        if count > MOST_NAMES:
            break
    return digest.hexdigest()


def hand_over(folder: Path, out: Path) -> None:
    """Copy ``folder`` to ``out``, whole or not at all; an earlier result there is replaced.

    Raises:
        UsageError: ``out`` is something else, or cannot be written.
    """
    check_out(out)
    temporary = None
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{out.name[:40]}.", dir=out.parent))
        copy_writable(folder, temporary / "new")
        replace_directory(temporary / "new", out, temporary, is_replaceable=_is_result)
    except OSError as error:
        raise UsageError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def _is_result(folder: Path) -> bool:
    """Whether an asset or a proof lies in ``folder``."""
    return is_asset(folder) or has_schema(folder / CHECK_REPORT_FILE, CHECK_REPORT_SCHEMA)


def check_out(out: Path) -> None:
    """Refuse an ``out`` that holds something other than an earlier result.

    Raises:
        UsageError: It does.
    """
    try:
        if not out.exists():
            return
    except OSError as error:
        raise UsageError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    if not _is_result(out) and not (out.is_dir() and not any(out.iterdir())):
        raise UsageError(f"{out}: exists and is not an asset; choose another --out")
