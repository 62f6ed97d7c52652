"""Find earlier results by content, without loading a mesh or a simulator.

A record is a file in ``checks/`` of the cache. Its name is a hash of the source file, the options
and the code of this package; it lists the other files that were read with their hashes, and the
folder of the cache with the result. The result is valid only while all of them are unchanged.
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
    read_json_object,
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
    "untrusted.py",
)
"""Parts of the package that a verdict depends on."""
SIMULATORS = ("mujoco", "pybullet")
"""Packages on whose version, or absence, a verdict depends as well."""
PACKAGES_VARIABLE = "ROS_PACKAGE_PATH"
"""Environment variable with folders in which meshes are searched."""
MAX_NAMES = 5000
"""Number of file names beside a source that are compared."""
MAX_BYTES = 64_000_000
"""Larger files are identified by size and date instead of content."""


default_cache = cache_folder
"""Folder of the results."""


@functools.cache
def code_id() -> str:
    """Hash the code that converts and checks."""
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
def simulator_versions() -> tuple[str, ...]:
    """Return names and versions of the simulators without importing them."""
    found = []
    for name in SIMULATORS:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} absent")
    return tuple(found)


def load(source: Path, options: Mapping[str, Any], cache: Path) -> Path | None:
    """Return the folder with the result of an earlier check of ``source``, or None.

    Args:
        source: File or asset folder.
        options: Everything else that the result depends on.
        cache: Cache folder.
    """
    try:
        record = read_json_object(_record(source, options, cache))
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


def save(
    source: Path,
    options: Mapping[str, Any],
    cache: Path,
    inputs: Iterable[Path],
    folder: Path,
    *,
    dated: bool = False,
) -> None:
    """Record that ``folder`` of the cache holds the result of ``source``.

    Args:
        source: File or asset folder.
        options: Everything else that the result depends on.
        cache: Cache folder.
        inputs: Further files that were read.
        folder: Folder below ``cache``.
        dated: Compare the dates of the files beside and below ``source`` as well, because it is
            unknown which of them were read when reading ended in an error.
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


def record_key(source: Path, options: Mapping[str, Any]) -> str:
    """Hash ``source``, its path, the ``options``, the code and the versions of simulators."""
    packages = os.environ.get(PACKAGES_VARIABLE, "")
    context = "\0".join((code_id(), *simulator_versions(), packages, str(source.resolve())))
    digest = hashlib.sha256(f"{context}\0".encode(errors="surrogateescape"))
    digest.update(json.dumps(dict(options), sort_keys=True, default=str).encode() + b"\0")
    if source.is_dir():
        for path in sorted(p for p in source.rglob("*") if p.is_file()):
            name = path.relative_to(source).as_posix().encode(errors="surrogateescape")
            digest.update(name + b"\0" + hashlib.sha256(_content(path)).digest())
    else:
        digest.update(_content(source))
    return digest.hexdigest()


def _content(source: Path) -> bytes:
    """Return the bytes of a file, or of one that is too large its size and date."""
    try:
        state = source.stat()
        return source.read_bytes() if state.st_size <= MAX_BYTES else _size_and_date(source)
    except OSError as error:
        return f"unreadable: {error.errno}".encode()


def _size_and_date(path: Path) -> bytes:
    try:
        state = path.stat()
    except OSError as error:
        return f"unreadable: {error.errno}".encode()
    return f"{state.st_size} {state.st_mtime_ns}".encode()


def _record(source: Path, options: Mapping[str, Any], cache: Path) -> Path:
    return cache / "checks" / f"{record_key(source, options)[:32]}.json"


def _listing(source: Path, *, dated: bool) -> str:
    """Hash the names beside and below ``source``, as an absent mesh may have been added.

    With ``dated``, sizes and dates are included, as a damaged file may have been corrected. Names
    are relative to the top folder, whose path may be written in different ways.
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
        if count > MAX_NAMES:
            break
    return digest.hexdigest()


def export(folder: Path, out: Path) -> None:
    """Copy ``folder`` to ``out``, completely or not at all; an earlier result is replaced.

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
    """Return whether ``folder`` holds an asset or a check report."""
    return is_asset(folder) or has_schema(folder / CHECK_REPORT_FILE, CHECK_REPORT_SCHEMA)


def check_out(out: Path) -> None:
    """Reject an ``out`` that holds something other than an earlier result.

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
