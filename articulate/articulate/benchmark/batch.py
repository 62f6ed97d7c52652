"""Many objects, each in a process of its own: what crashes costs one object.

The record of an object is a file that is whole or absent. A run that was stopped goes on where it
was when it is started again with the same settings; what was lost to an error is tried again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import LIBRARIES, Dataset
from articulate.benchmark.records import Record, is_final, lost_object
from articulate.errors import ArticulateError, ConfigError, UsageError
from articulate.files import write_json
from articulate.jobs.process_pool import Answer, ProcessPool
from articulate.reconstruct.actors.semantic.embeddings import meanings_installed
from articulate.reconstruct.actors.vlm.gemini import MODEL_VARIABLE, URL_VARIABLE

FOLDER = "objects"
"""Folder of the records, below that of the run."""
RECORD_VERSION = 2
"""Records of another version are made anew."""
USAGE_EXIT = 2


@dataclass(kw_only=True)
class Batch:
    """Runs objects side by side."""

    dataset: Dataset
    source: str
    """What was given as DATASET."""
    data: Path | None
    config: BenchmarkConfig
    out: Path
    limit_s: float
    """An object that takes longer is lost [s]."""
    fresh: bool = False
    """Run again what was run before."""
    fingerprint: str = field(init=False)
    """Hash of everything that decides a record but the object."""
    _children: ProcessPool = field(init=False)

    def __post_init__(self) -> None:
        """Say once what the records are made of: files may change while they are made."""
        self.fingerprint = fingerprint(self.source, self.data, self.config)
        self._children = ProcessPool("articulate.benchmark.child", self.limit_s)

    def run(self, ids: Sequence[str], jobs: int) -> Iterator[Record]:
        """Run all objects, ``jobs`` at a time, and yield their records as they come."""
        yield from self._children.side_by_side(ids, self.one, jobs)

    def one(self, object_id: str) -> Record:
        """The record of one object, from its file if that was made with the same settings.

        Raises:
            UsageError: The settings are not accepted.
        """
        path = self.path_of(object_id)
        if not self.fresh:
            found = _read(path, self.fingerprint)
            if found is not None and is_final(found):
                return found
        reason = self._child(object_id, path)
        made = None if reason else _read(path, self.fingerprint)
        if made is not None:
            return made
        reason = reason or "its process left no record"
        try:
            known = self.dataset.known(object_id)
        except ArticulateError as error:
            known, reason = (), f"{reason}; its joints are not known: {error}"
        record = lost_object(object_id, self.dataset.category(object_id), known, reason)
        write_json(path, {**record, "fingerprint": self.fingerprint, "version": RECORD_VERSION})
        return record

    def path_of(self, object_id: str) -> Path:
        """File of an object's record; its name is safe whatever the id is."""
        safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in object_id)
        if safe != object_id or safe.startswith("."):
            safe = f"{safe.lstrip('.')}-{hashlib.sha256(object_id.encode()).hexdigest()[:8]}"
        return self.out / FOLDER / f"{safe}.json"

    def _child(self, object_id: str, path: Path) -> str:
        """Why no record was made; empty if one was."""
        request = {
            "source": self.source,
            "data": None if self.data is None else str(self.data),
            "object": object_id,
            "config": dataclasses.asdict(self.config),
            "path": str(path),
            "fingerprint": self.fingerprint,
        }
        return _outcome(self._children.ask(request), self.limit_s)


def fingerprint(source: str, data: Path | None, config: BenchmarkConfig) -> str:
    """Hash of the data set, of the settings, of which model is asked, and whether meanings are.

    An index counts by its content and by the folder that its paths start from; a folder by where
    it lies and by the names, sizes and times of its files; a library by its name.

    Raises:
        ConfigError: The index cannot be read.
    """
    path = Path(source)
    try:
        if source in LIBRARIES:
            dataset = [source]
        elif path.is_file():
            index = hashlib.sha256(path.read_bytes()).hexdigest()
            dataset = [index, str((data or path.parent).resolve())]
        else:
            dataset = [str(path.resolve()), *_stamps(path)]
    except OSError as error:
        raise ConfigError(f"{source}: cannot be read ({error.strerror})") from None
    model = [os.environ.get(name, "") for name in (MODEL_VARIABLE, URL_VARIABLE)]
    asked = {"dataset": dataset, "model": model, "meanings": meanings_installed()}
    content = asked | dataclasses.asdict(config)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _stamps(folder: Path) -> list[str]:
    """Name, size and time of change of each file below ``folder``."""
    found = ((path, path.stat()) for path in sorted(folder.rglob("*")) if path.is_file())
    return [f"{path.relative_to(folder)} {st.st_size} {st.st_mtime_ns}" for path, st in found]


def _read(path: Path, wanted: str) -> Record | None:
    """The record in ``path`` if it was made with the settings ``wanted``."""
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    same = content.get("fingerprint") == wanted and content.get("version") == RECORD_VERSION
    return content if same else None


def _outcome(answer: Answer, limit_s: float) -> str:
    """Why a child that has ended made nothing; empty if it did."""
    if answer.code is None:
        return f"took longer than {limit_s:g} s"
    if answer.code == USAGE_EXIT:
        raise UsageError(answer.last_words)
    if answer.code < 0:
        return f"its process was ended by {answer.signal_name}"
    return answer.last_words if answer.code else ""
