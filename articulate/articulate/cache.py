"""The cache folder: what is in it, how large it may grow, and who uses it at the moment.

::

    articulate/                in the platform's cache folder
      assets/ refused/ checks/ decompositions/ answers/    entries: a file or a folder each
      users/                   a locked file for each process at work
      locks/                   a file for each thing that one process at a time makes
      gate.lock                held while a user comes and while entries are taken away

An entry is found by its name, which is a hash of what it was made from, so any of them may go.
Entries go oldest use first. Those that were used since the oldest process at work began stay, and
a process that comes waits for the gate: nothing is taken from under anybody's hands.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from articulate.errors import ConfigError, UsageError

KINDS = ("assets", "refused", "checks", "decompositions", "answers")
"""Folders of entries. Nothing else in the cache is touched."""
USERS, LOCKS, GATE, TRASH = "users", "locks", "gate.lock", ".trash-"
LIMIT_VARIABLE = "ARTICULATE_CACHE_GB"
LIMIT_GB = 20.0
"""Size beyond which the entries longest unused go, unless the variable says otherwise [GB]."""
BETWEEN_S = 3600.0
"""The size is looked at so often at most [s]."""
LOOKED = "looked"
"""File whose date says when the size was looked at last."""


@dataclass(frozen=True)
class Entry:
    """One thing that was kept."""

    kind: str
    """Folder of the cache that it lies in."""
    path: Path
    bytes: int
    used: float
    """When it was made or used last [s since 1970]."""


@dataclass(frozen=True)
class Cleaned:
    """What a cleaning took away."""

    removed: int
    removed_bytes: int
    left: int
    left_bytes: int
    busy: int
    """Entries that would have gone, but may be in use."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return dict(vars(self))


def cache_folder() -> Path:
    """``articulate`` in the user's cache folder, as the platform has it."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    if Path(given).is_absolute():
        return Path(given) / "articulate"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "articulate"
    return Path.home() / ".cache" / "articulate"


def limit_bytes() -> int:
    """Size beyond which entries go [bytes].

    Raises:
        ConfigError: The variable does not hold a number of GB.
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
def using(cache: Path) -> Iterator[None]:
    """Be at work in ``cache``: what is used inside is not taken away.

    At the end the size limit is seen to, now and then.

    Raises:
        UsageError: The folder cannot be written.
    """
    limit = limit_bytes()
    try:
        (cache / USERS).mkdir(parents=True, exist_ok=True)
        with _gate(cache):
            handle, name = tempfile.mkstemp(dir=cache / USERS)
            fcntl.flock(handle, fcntl.LOCK_EX)
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
        os.close(handle)
        with suppress(OSError):
            if _is_due(cache):
                clean(cache, limit)


@contextmanager
def alone(cache: Path, key: str) -> Iterator[bool]:
    """Be the only one at work on what ``key`` names; others wait for their turn.

    Yields whether this one had to wait, so that the other may have done the work.
    """
    (cache / LOCKS).mkdir(parents=True, exist_ok=True)
    with (cache / LOCKS / key).open("ab") as stream:
        waited = False
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            waited = True
            fcntl.flock(stream, fcntl.LOCK_EX)
        yield waited


def touch(entry: Path) -> None:
    """Note that ``entry`` of the cache is used now."""
    with suppress(OSError):  # a cache that can only be read is as good
        os.utime(entry)


def entries(cache: Path) -> list[Entry]:
    """All entries, the longest unused first."""
    found = []
    for kind in KINDS:
        found += [_entry(kind, path) for path in _children(cache / kind) if path.name[0] != "."]
    return sorted(found, key=lambda e: (e.used, str(e.path)))


def clean(cache: Path, most_bytes: int) -> Cleaned:
    """Take entries away, the longest unused first, until at most ``most_bytes`` are left.

    Entries that a process at work may use stay, whatever that leaves.
    """
    with _gate(cache):
        since = _at_work_since(cache)
        found = entries(cache)
        total = sum(entry.bytes for entry in found)
        trash = Path(tempfile.mkdtemp(prefix=TRASH, dir=cache))
        for lock in _children(cache / LOCKS) if since == float("inf") else ():
            lock.unlink(missing_ok=True)
        gone: list[Entry] = []
        busy = 0
        for entry in found:
            if total <= most_bytes and most_bytes > 0:
                break
            if entry.used >= since:
                busy += 1
                continue
            with suppress(OSError):
                entry.path.rename(trash / f"{len(gone)}-{entry.path.name}")
                gone.append(entry)
                total -= entry.bytes
    for folder in cache.glob(f"{TRASH}*"):  # others' too: they may have been killed
        shutil.rmtree(folder, ignore_errors=True)
    return Cleaned(
        removed=len(gone),
        removed_bytes=sum(entry.bytes for entry in gone),
        left=len(found) - len(gone),
        left_bytes=total,
        busy=busy,
    )


@contextmanager
def _gate(cache: Path) -> Iterator[None]:
    """Alone among those who come and those who clean."""
    cache.mkdir(parents=True, exist_ok=True)
    with (cache / GATE).open("ab") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        yield


def _at_work_since(cache: Path) -> float:
    """When the oldest process at work began; inf if there is none. Files of dead ones go."""
    since = float("inf")
    for path in _children(cache / USERS):
        with suppress(OSError), path.open("rb") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                since = min(since, path.stat().st_mtime)
            else:
                path.unlink()
    return since


def _is_due(cache: Path) -> bool:
    """Whether the size was not looked at for a while; notes that it is now."""
    path = cache / LOOKED
    with suppress(FileNotFoundError):
        if 0.0 <= time.time() - path.stat().st_mtime < BETWEEN_S:
            return False
    path.touch()
    return True


def _children(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return []


def _entry(kind: str, path: Path) -> Entry:
    """The size of all files below ``path``, and when it was touched last."""
    size, used = 0, 0.0
    with suppress(OSError):  # it may go at any moment
        state = path.lstat()
        size, used = state.st_size, state.st_mtime
        for base, _, names in os.walk(path):
            for name in names:
                with suppress(OSError):
                    size += Path(base, name).lstat().st_size
    return Entry(kind=kind, path=path, bytes=size, used=used)
