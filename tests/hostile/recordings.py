# ruff: noqa: E501  # tables of one row a line
"""Hostile recordings of a deployment."""

from __future__ import annotations

import json
import pickle  # noqa: TID251  # to make a hostile file
import zlib
from pathlib import Path

import numpy as np
from tests.hostile.writers import KINDS, Change, data, npz_of, text

HEAD = {"schema": "articulate.episode-log", "schema_version": 1}
COLUMNS = {"time_s": [], "action": [8], "target": [7], "joint_pos": [7], "joint_vel": [7],
           "gripper_width_m": []}  # fmt: skip


def log(columns: object, row: bytes = b"") -> Change:
    """Return a log with these columns, and one row with a right sum."""
    head = json.dumps({**HEAD, "columns": columns}).encode() + b"\n"
    end = zlib.crc32(row).to_bytes(4, "little") if row else b""
    return as_log(head + row + end)


def as_log(content: bytes) -> Change:
    """Return the recording with a log in place of its npz file."""

    def change(path: Path) -> None:
        path.unlink()
        path.with_suffix(".log").write_bytes(content)

    return change


def _columns(**changes: object) -> list[dict[str, object]]:
    return [{"name": name, "shape": shape} for name, shape in {**COLUMNS, **changes}.items()]


def _numbers(**values: float) -> bytes:
    """Return a row of zeros with some columns filled."""
    parts = [np.full(int(np.prod(shape)), values.get(n, 0.0)) for n, shape in COLUMNS.items()]
    return np.concatenate(parts).astype("<f8").tobytes()


LOGS: dict[str, Change] = {
    "no rows": log(_columns()),
    "one wrong sum": as_log(json.dumps({**HEAD, "columns": _columns()}).encode() + b"\n" + bytes(500)),
    "columns of 1e12": log(_columns(action=[1_000_000, 1_000_000])),
    "shapes whose product overflows": log(_columns(action=[10_000] * 100)),
    "negative shape": log(_columns(action=[-1])),
    "infinite shape": as_log(b'{"schema": "articulate.episode-log", "schema_version": 1, "columns": [{"name": "a", "shape": [1e999]}]}\n'),
    "shape of text": log(_columns(action="eight")),
    "columns are a number": log(3),
    "100,000 columns": log([{"name": str(k), "shape": []} for k in range(100_000)]),
    "deep header": as_log(b"[" * 100_000 + b"\n"),
    "action of three": log(_columns(action=[3]), bytes(8 * 20)),
    "NaN targets": log(_columns(), _numbers(target=float("nan"))),
    "targets of 1e300": log(_columns(), _numbers(target=1e300)),
    "long name": log([*_columns(), {"name": "x" * 100_000, "shape": []}], _numbers() + bytes(8)),
}  # fmt: skip


ARRAYS: dict[str, Change] = {
    "array of 1e12": data(npz_of("(1000000, 1000000)")),
    "bomb": data(npz_of("(40000000,)", bytes(320_000_000))),
    "objects": data(npz_of("(1,)", pickle.dumps([1]), "|O")),
    "deep shape": data(npz_of("(" * 5000)),
    "numbers without rows": data(npz_of("()", bytes(8))),
}
RESULTS: dict[str, Change] = {
    "deep line": text("[" * 100_000),
    "list": text("[1, 2]\n"),
    "NaN": text('{"reason": "success", "episode_params": {"a": NaN}}\n'),
    "parameters are a list": text('{"reason": "success", "episode_params": [1]}\n'),
    "parameters are texts": text('{"reason": "success", "episode_params": {"friction": "much"}}\n'),
    "binary": KINDS["junk"],
}
REPORTS: dict[str, Change] = {
    "list": text("[]"),
    "deep": text("[" * 100_000),
    "robot is a mapping": text('{"robot": {"a": 1}}'),
    "bundle of 1 MB": text('{"bundle": "%s"}' % ("x" * 1_000_000)),
    "sender is a list": text('{"sender": [1]}'),
    "sender of mappings": text('{"sender": {"a": {}}}'),
    "infinite": text('{"sender": {"a": 1e999}}'),
}
