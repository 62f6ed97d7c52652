"""Exported networks of tests: one of equal weights is exported once, which takes seconds."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from filelock import FileLock
from tests.placements import FOLDER

from articulate.files import write_bytes
from articulate_train import export
from articulate_train.policy import Policy

_to_onnx = export.to_onnx


def to_onnx(policy: Policy) -> bytes:
    """Return the result of :func:`articulate_train.export.to_onnx`, from memory."""
    weights = hashlib.sha256(repr(policy.action_scaling).encode())
    for name, value in policy.state_dict().items():
        weights.update(f"{name} {tuple(value.shape)}".encode() + value.numpy().tobytes())
    folder = Path(os.environ[FOLDER])
    folder.mkdir(exist_ok=True)
    file = folder / weights.hexdigest()
    with FileLock(file.with_suffix(".lock")):
        if not file.exists():
            write_bytes(file, _to_onnx(policy))
    return file.read_bytes()
