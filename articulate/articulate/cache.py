"""Cache folder: entries, size limit, and locks of the processes that use it.

::

    articulate/                in the platform's cache folder (``platformdirs``)
      assets/ rejected/ checks/ decompositions/ answers/ examples/ renders/
                               entries: files or folders
      users/                   a locked file for each running process that uses the cache
      locks/                   a lock file for each entry under construction
      gate.lock                held while a process registers and while entries are removed

The name of an entry is a hash of its inputs, so any entry can be removed and made again. The
least recently used entries are removed first. Entries used since the oldest registered process
began are kept, so that cleaning never removes files that are in use.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout
from platformdirs import user_cache_path

from articulate.errors import ConfigError, UsageError

KINDS = ("assets", "rejected", "checks", "decompositions", "answers", "examples", "renders")
"""Folders of entries. Nothing else in the cache is touched."""
USERS, LOCKS, GATE, TRASH = "users", "locks", "gate.lock", ".trash-"
LIMIT_VARIABLE = "ARTICULATE_CACHE_GB"
LIMIT_GB = 20.0
"""Size above which the least recently used entries are removed, without the variable [GB]."""
CHECK_INTERVAL_S = 3600.0
"""Shortest time between two checks of the size [s]."""
CHECKED = "size_checked"
"""File whose modification time is that of the last check of the size."""
POLL_S = 0.01
"""Time between two attempts to acquire a lock [s]."""


@dataclass(frozen=True)
class Entry:
    """A cached file or folder."""

    kind: str
    """Folder of the cache that contains it."""
    path: Path
    bytes: int
    used: float
    """Time of the last use [s since 1970]."""


@dataclass(frozen=True)
class CleanResult:
    """Counts of removed and remaining entries."""

    removed: int
    removed_bytes: int
    left: int
    left_bytes: int
    busy: int
    """Entries that were kept because a running process may use them."""

    def as_dict(self) -> dict[str, Any]:
        """Return a JSON-compatible dictionary."""
        return dict(vars(self))


def cache_folder() -> Path:
    """Return ``articulate`` in the user's cache folder; an absolute XDG_CACHE_HOME is honoured."""
    return user_cache_path("articulate", appauthor=False)


def limit_bytes() -> int:
    """Return the size above which entries are removed [bytes].

    Raises:
        ConfigError: The environment variable is not a number of GB.
    """
    text = os.environ.get(LIMIT_VARIABLE) or str(LIMIT_GB)
    try:
        size_gb = float(text)
    except ValueError:
        size_gb = -1.0
    if not size_gb >= 0.0:
        raise ConfigError(f"{LIMIT_VARIABLE} is {text!r}; it must be a number of GB, 0 or more")
    return int(min(size_gb * 1e9, 2.0**62))


@contextmanager
def cache_in_use(cache: Path) -> Iterator[None]:
    """Register this process, so that entries used inside the block are not removed.

    The size limit is enforced at the end, at most once an hour.

    Raises:
        UsageError: The folder cannot be written.
    """
    limit = limit_bytes()
    try:
        (cache / USERS).mkdir(parents=True, exist_ok=True)
        with _gate(cache):
            handle, name = tempfile.mkstemp(dir=cache / USERS)
            os.close(handle)
            user = FileLock(name)
            user.acquire()
    except OSError as error:
        raise UsageError(
            f"{cache}: cannot be written ({error.strerror}); "
            "set XDG_CACHE_HOME to a folder that can"
        ) from None
    try:
        yield
    finally:
        with suppress(OSError):
            Path(name).unlink()
            user.release()
            if _is_check_due(cache):
                clean(cache, limit)


@contextmanager
def entry_lock(cache: Path, key: str) -> Iterator[bool]:
    """Hold the lock of the entry ``key``, which one process at a time may make.

    Yields whether another process held it before, and so may have made the entry.
    """
    (cache / LOCKS).mkdir(parents=True, exist_ok=True)
    lock = FileLock(cache / LOCKS / key, poll_interval=POLL_S)
    waited = False
    try:
        lock.acquire(timeout=0.0)
    except Timeout:
        waited = True
        lock.acquire()
    try:
        yield waited
    finally:
        lock.release()


def touch(entry: Path) -> None:
    """Set the time of last use of ``entry`` to now; ignored in a read-only cache."""
    with suppress(OSError):
        os.utime(entry)


def entries(cache: Path) -> list[Entry]:
    """Return all entries, least recently used first."""
    found = [
        _entry(kind, path)
        for kind in KINDS
        for path in _children(cache / kind)
        if not path.name.startswith(".")
    ]
    return sorted(found, key=lambda e: (e.used, str(e.path)))


def clean(cache: Path, max_bytes: int) -> CleanResult:
    """Remove the least recently used entries until at most ``max_bytes`` are left.

    Entries that a running process may use are kept, whatever their size.
    """
    removed: list[Entry] = []
    busy = 0
    with _gate(cache):
        since = _oldest_user(cache)
        found = entries(cache)
        total = sum(entry.bytes for entry in found)
        trash = Path(tempfile.mkdtemp(prefix=TRASH, dir=cache))
        for lock in _children(cache / LOCKS) if since == float("inf") else ():
            lock.unlink(missing_ok=True)
        for entry in found:
            if total <= max_bytes and max_bytes > 0:
                break
            if entry.used >= since:
                busy += 1
                continue
            with suppress(OSError):  # renamed first: a killed deletion leaves no partial entry
                entry.path.rename(trash / f"{len(removed)}-{entry.path.name}")
                removed.append(entry)
                total -= entry.bytes
    for folder in cache.glob(f"{TRASH}*"):  # including those of killed processes
        shutil.rmtree(folder, ignore_errors=True)
    return CleanResult(
        removed=len(removed),
        removed_bytes=sum(entry.bytes for entry in removed),
        left=len(found) - len(removed),
        left_bytes=total,
        busy=busy,
    )


def _gate(cache: Path) -> FileLock:
    """Lock that is held while a process registers and while entries are removed."""
    cache.mkdir(parents=True, exist_ok=True)
    return FileLock(cache / GATE, poll_interval=POLL_S)


def _oldest_user(cache: Path) -> float:
    """Return when the oldest running process registered [s since 1970]; inf without one."""
    since = float("inf")
    for path in _children(cache / USERS):
        with suppress(OSError):
            began = path.stat().st_mtime
            try:
                with FileLock(path, timeout=0.0):
                    path.unlink()  # its process has ended
            except Timeout:
                since = min(since, began)
    return since


def _is_check_due(cache: Path) -> bool:
    """Return whether the last check of the size is long ago; record that it happens now."""
    path = cache / CHECKED
    with suppress(FileNotFoundError):
        if 0.0 <= time.time() - path.stat().st_mtime < CHECK_INTERVAL_S:
            return False
    path.touch()
    return True


def _children(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return []


def _entry(kind: str, path: Path) -> Entry:
    """Measure the size of all files below ``path`` and the time of its last use."""
    size, used = 0, 0.0
    with suppress(OSError):  # another process may remove it
        state = path.lstat()
        size, used = state.st_size, state.st_mtime
        for base, _, names in os.walk(path):
            for name in names:
                with suppress(OSError):
                    size += Path(base, name).lstat().st_size
    return Entry(kind=kind, path=path, bytes=size, used=used)
