"""Answers of models in files, named by a hash of the request.

A folder of the cache keeps the answers of conversations that end with a valid one. A recording,
which is a folder with ``recording.json``, keeps every answer, so that a run can be repeated exactly
without a key.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from articulate.cache import cache_folder, entry_lock, touch
from articulate.errors import ConfigError
from articulate.files import has_schema, write_json
from articulate.reconstruct.actors.vlm.model import Reply
from articulate.untrusted import load_json_object

ANSWERS = "answers"
"""Folder of the answers."""
RECORDING_FILE = "recording.json"
SCHEMA, SCHEMA_VERSION = "articulate.recording", 1


@dataclass(frozen=True)
class AnswerStore:
    """Answers in a folder; without a folder nothing is stored."""

    folder: Path | None

    @property
    def keeps_all(self) -> bool:
        """True for a recording."""
        return self.folder is not None and (self.folder / RECORDING_FILE).is_file()

    def read(self, key: str) -> Reply | None:
        """Return a stored reply; None if it is absent or invalid."""
        if self.folder is None:
            return None
        path = self._path(key)
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(content["text"], str):
                return None
            reply = Reply(**{**content, "cached": True})
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None
        touch(path)
        return reply

    def write(self, key: str, reply: Reply) -> None:
        """Store a reply."""
        if self.folder is not None and not reply.cached:
            write_json(self._path(key), asdict(reply))

    @contextmanager
    def lock(self, key: str) -> Iterator[None]:
        """Hold the lock of a request, which one thread or process at a time sends."""
        if self.folder is None:
            yield
            return
        with entry_lock(cache_folder(), f"{ANSWERS}-{key}"):
            yield

    def _path(self, key: str) -> Path:
        assert self.folder is not None
        return self.folder / ANSWERS / f"{key}.json"


def open_recording(folder: Path, model: str, default: str) -> str:
    """Create or open a recording and return its model, as ``PROVIDER:NAME[@URL]``.

    Args:
        folder: Folder of the recording.
        model: Requested model; empty: that of an existing recording.
        default: Full name of the requested model, or of the one that is used without a request.

    Raises:
        ConfigError: The folder holds something else, or a recording of another model.
    """
    file = folder / RECORDING_FILE
    if not file.exists():
        if folder.is_dir() and any(folder.iterdir()):
            raise ConfigError(f"--record {folder}: not empty and not a recording; give another one")
        content: dict[str, Any] = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION}
        write_json(file, content | {"model": default})
        return default
    if not has_schema(file, SCHEMA):
        raise ConfigError(f"--record {folder}: {RECORDING_FILE} is not of {SCHEMA}")
    found = str(load_json_object(file, error=ConfigError).get("model", ""))
    if model and found != default:
        raise ConfigError(
            f"--record {folder}: contains answers of {found}, not of {default}; give another folder"
        )
    return found
