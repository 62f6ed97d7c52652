"""Run the objects of a benchmark in isolated child processes, so that a crash costs one object.

The record of an object is one file, complete or absent. A run that was stopped continues when it is
started again with the same settings; objects lost to an error are tried again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import LIBRARIES, Dataset
from articulate.benchmark.imported_predictions import is_imported, split_source
from articulate.benchmark.records import Record, crashed_object, is_final
from articulate.errors import ArticulateError, ConfigError
from articulate.files import read_json_object, write_json
from articulate.jobs.process_pool import run_isolated
from articulate.reconstruct.actors.semantic.embeddings import embeddings_installed
from articulate.reconstruct.actors.vlm.options import ModelOptions

FOLDER = "objects"
"""Folder of the records, below that of the run."""
RECORD_VERSION = 4
"""Records of another version are computed again."""
MODULE = "articulate.benchmark.child"
"""Module that runs one object in a child process."""


@dataclass(kw_only=True)
class BenchmarkBatch:
    """Runs objects in parallel."""

    dataset: Dataset
    source: str
    """Argument DATASET of the command."""
    data: Path | None
    config: BenchmarkConfig
    out: Path
    limit_s: float
    """Processor time after which an object is lost [s]."""
    fresh: bool = False
    """Ignore earlier records."""
    models: ModelOptions = field(default_factory=ModelOptions)
    """Settings of the actor's models."""
    fingerprint: str = field(init=False)
    """Hash of everything that a record depends on, except the object."""

    def __post_init__(self) -> None:
        """Compute the fingerprint once, as files may change during the run."""
        self.fingerprint = fingerprint(self.source, self.data, self.config, self.models)

    def run(self, ids: Sequence[str], jobs: int) -> Iterator[Record]:
        """Run all objects, ``jobs`` at a time, and yield their records as they are ready.

        Records that were made with the same settings are read from their files.

        Raises:
            UsageError: The settings are not accepted.
        """
        missing = []
        for object_id in ids:
            found = None if self.fresh else _read(self.path_of(object_id), self.fingerprint)
            if found is not None and is_final(found):
                yield found
            else:
                missing.append((object_id, self._request(object_id)))
        for object_id, result in run_isolated(MODULE, missing, jobs, self.limit_s):
            reason = result.failure(self.limit_s)
            made = None if reason else _read(self.path_of(object_id), self.fingerprint)
            yield made or self._crashed(object_id, reason or "its process left no record")

    def one(self, object_id: str) -> Record:
        """Run one object; errors as for :meth:`run`."""
        return next(iter(self.run([object_id], 1)))

    def path_of(self, object_id: str) -> Path:
        """Return the file of an object's record, with a safe name for any id."""
        safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in object_id)
        if safe != object_id or safe.startswith("."):
            safe = f"{safe.lstrip('.')}-{hashlib.sha256(object_id.encode()).hexdigest()[:8]}"
        return self.out / FOLDER / f"{safe}.json"

    def _crashed(self, object_id: str, reason: str) -> Record:
        """Write the record of an object without a result."""
        try:
            known = self.dataset.known(object_id)
        except ArticulateError as error:
            known, reason = (), f"{reason}; its joints are not known: {error}"
        record = crashed_object(object_id, self.dataset.category(object_id), known, reason)
        write_json(self.path_of(object_id), record | self._stamp)
        return record

    @property
    def _stamp(self) -> dict[str, Any]:
        return {"fingerprint": self.fingerprint, "version": RECORD_VERSION}

    def _request(self, object_id: str) -> dict[str, Any]:
        return {
            "source": self.source,
            "data": None if self.data is None else str(self.data),
            "object": object_id,
            "config": dataclasses.asdict(self.config),
            "models": dataclasses.asdict(self.models),
            "path": str(self.path_of(object_id)),
            "stamp": self._stamp,
        }


def fingerprint(
    source: str, data: Path | None, config: BenchmarkConfig, models: ModelOptions | None = None
) -> str:
    """Hash the data set, the settings, the model in use and the availability of embeddings.

    An index is hashed by its content and the folder of its paths; a folder by its path and the
    names, sizes and times of its files; a library by its name.

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
        if is_imported(config.actor):
            dataset += _stamps(split_source(config.actor)[1])
    except OSError as error:
        raise ConfigError(f"{source}: cannot be read ({error.strerror})") from None
    models = models or ModelOptions()
    model = [models.source, models.examples]
    inputs = {"dataset": dataset, "model": model, "meanings": embeddings_installed()}
    content = inputs | dataclasses.asdict(config)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _stamps(folder: Path) -> list[str]:
    """Return name, size and time of change of each file below ``folder``."""
    found = ((path, path.stat()) for path in sorted(folder.rglob("*")) if path.is_file())
    return [f"{path.relative_to(folder)} {st.st_size} {st.st_mtime_ns}" for path, st in found]


def _read(path: Path, wanted: str) -> Record | None:
    """Return the record in ``path`` if it was made with the settings ``wanted``."""
    content = read_json_object(path)
    same = content.get("fingerprint") == wanted and content.get("version") == RECORD_VERSION
    return content if same else None
