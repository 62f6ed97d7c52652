"""Log of one episode that grows with each control step and needs no end.

The file begins with a line of JSON: schema, and name and shape of each column. A row follows for
each control step: the numbers as little-endian float64, then the CRC-32 of these bytes. Each row is
one write to the operating system, so a killed process loses at most the row that it was writing.
"""

from __future__ import annotations

import json
import math
import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from articulate.errors import UsageError
from articulate.transforms import Array
from articulate.untrusted import parse_json_object, read_bounded
from articulate_deploy.episode import Recording

SCHEMA = "articulate.episode-log"
VERSION = 1
MAX_BYTES = 256 << 20
"""Largest log [bytes]; an episode has about 0.3 MB."""
MAX_COLUMNS = 100
"""Most columns."""
MAX_VALUES = 10_000
"""Most numbers of a control step."""
MAX_NAME = 60
"""Longest name of a column [characters]."""
_CRC = struct.Struct("<I")


class EpisodeLog(Recording):
    """Recording whose control steps are written at once."""

    def __init__(self, folder: Path, index: int) -> None:
        """Create ``episode_NNNN.log`` in ``folder`` at the first control step."""
        super().__init__()
        self.folder, self.index = folder, index
        self.path = folder / f"episode_{index:04d}.log"
        self._handle: int | None = None

    def add(self, **values: Array | float) -> None:
        """Append a control step, in memory and in the file."""
        super().add(**values)
        row = {name: column[-1] for name, column in self.rows.items()}
        if self._handle is None:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC
            self._handle = os.open(self.path, flags, 0o644)
            os.write(self._handle, _header(row))
        os.write(self._handle, _encode(row))

    def close(self) -> None:
        """Close the file."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def _header(row: Mapping[str, Array]) -> bytes:
    columns = [{"name": name, "shape": list(value.shape)} for name, value in row.items()]
    content = {"schema": SCHEMA, "schema_version": VERSION, "columns": columns}
    return json.dumps(content).encode() + b"\n"


def _encode(row: Mapping[str, Array]) -> bytes:
    data = b"".join(np.ascontiguousarray(value, dtype="<f8").tobytes() for value in row.values())
    return data + _CRC.pack(zlib.crc32(data))


def read_log(path: Path) -> dict[str, Array]:
    """Return the arrays (T, ...) of a log, without a last row that is incomplete.

    Raises:
        UsageError: It is not a log, or a row was changed.
    """
    content = read_bounded(path, MAX_BYTES, error=UsageError)
    line, newline, rest = content.partition(b"\n")
    try:
        head = parse_json_object(line.decode("utf-8", "replace"), str(path))
        columns = [(str(c["name"]), tuple(map(int, c["shape"]))) for c in head["columns"]]
        good = head["schema"] == SCHEMA and head["schema_version"] == VERSION and newline
        good = good and 0 < len(columns) <= MAX_COLUMNS
        good = good and all(
            len(name) <= MAX_NAME and min(shape, default=0) >= 0 for name, shape in columns
        )
    except (KeyError, TypeError, ValueError):
        good = False
    sizes = [math.prod(shape) for _, shape in columns] if good else []
    if not good or sum(sizes) > MAX_VALUES or max(len(shape) for _, shape in columns) > 2:
        raise UsageError(f"{path}: not a log of an episode of this version")
    length = 8 * sum(sizes) + _CRC.size
    count = len(rest) // length
    rows = np.frombuffer(rest[: count * length], dtype=np.uint8).reshape(count, length)
    for k, row in enumerate(rows):
        (expected,) = _CRC.unpack(row[-_CRC.size :].tobytes())
        if zlib.crc32(row[: -_CRC.size].tobytes()) != expected:
            raise UsageError(f"{path}: row {k} was changed")
    values = rows[:, : -_CRC.size].copy().view("<f8").astype(np.float64)
    out, at = {}, 0
    for (name, shape), size in zip(columns, sizes, strict=True):
        out[name] = values[:, at : at + size].reshape(count, *shape)
        at += size
    return out
