"""Small convolutional networks on inner features of the ImageNet network, in NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from articulate.transforms import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """Weights of convolutions and linear layers, batch normalization folded in, by name."""

    weights: Mapping[str, Array]

    def layer(self, name: str, x: Array, stride: int = 1, *, relu: bool = True) -> Array:
        """Return the convolution of a map (C, H, W), zero-padded, with a rectifier."""
        weight, bias = self.weights[f"{name}.weight"], self.weights[f"{name}.bias"]
        kernel = weight.shape[2]
        reach = kernel // 2
        padded = np.pad(x, ((0, 0), (reach, reach), (reach, reach)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, (kernel, kernel), (1, 2))
        windows = windows[:, ::stride, ::stride]
        out = np.tensordot(weight, windows, axes=((1, 2, 3), (0, 3, 4))) + bias[:, None, None]
        return np.maximum(out, 0.0) if relu else out

    def linear(self, name: str, x: Array) -> Array:
        """Return the linear layer of a vector (C,)."""
        return np.asarray(self.weights[f"{name}.weight"] @ x + self.weights[f"{name}.bias"])

    def decode(self, maps: Mapping[str, Array]) -> tuple[Array, Array]:
        """Return a map (C, 14, 14) and a vector of features of one image.

        Args:
            maps: Inner features of the image by the names of ``classifier.MAPS``.
        """
        x = self._layer("in_32", maps["stride_32"][0])
        x = self._layer("mid_32", x)
        context = np.maximum(self.linear("decoder.context", x.mean(axis=(1, 2))), 0.0)
        x = x + context[:, None, None]
        own = self._layer("in_16", maps["stride_16"][0])
        x = self._layer("mid_16", np.concatenate([x.repeat(2, axis=1).repeat(2, axis=2), own]))
        return x, context

    def _layer(self, name: str, x: Array) -> Array:
        return self.layer(f"decoder.{name}", x)


@lru_cache(maxsize=4)
def read_network(path: Path) -> Network:
    """Read the weights of a network from an ``.npz`` file."""
    with np.load(path, allow_pickle=False) as file:
        return Network(weights={name: file[name].astype(np.float32) for name in file.files})
