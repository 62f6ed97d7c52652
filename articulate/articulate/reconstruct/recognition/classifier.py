"""ImageNet classifier EfficientNet-Lite0 as an ONNX model.

Architecture: Tan and Le, EfficientNet (ICML 2019), in the variant of the TensorFlow TPU models:
without squeeze-and-excitation, ReLU6, fixed stem and head.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from articulate.reconstruct.recognition.weights import CLASSIFIER, read_state_dict
from articulate.render.raster import Pixels
from articulate.transforms import Array

SIDE_PX = 224
MEAN, SCALE = 127.0, 128.0
"""Normalization of a colour: (value - mean) / scale."""
BATCH_NORM_EPSILON = 1e-3
STAGES = (
    # repeats, kernel, stride, expansion
    (1, 3, 1, 1),
    (2, 3, 2, 6),
    (2, 5, 2, 6),
    (3, 3, 2, 6),
    (3, 5, 1, 6),
    (4, 5, 2, 6),
    (1, 3, 1, 6),
)
OUTPUTS = (16, 24, 40, 80, 112, 192, 320)
"""Channels after each stage."""
MAPS = {"stride_8": 2, "stride_16": 4, "stride_32": 6}
"""Stage after which inner features are returned, of 40, 112 and 320 channels, by name."""
PAD_COLOUR = 127
FEATURES = 1280


def classify(images: list[Pixels]) -> tuple[Array, Array]:
    """Return ImageNet probabilities (N, 1000) and features (N, 1280) of images (H, W, 3).

    An image is padded to a square and resized.

    Raises:
        UsageError: The package with the weights is not installed.
    """
    batch = _batch([_square(image) for image in images])
    logits, features = _session().run(["logits", "features"], {"image": batch})
    shifted = np.exp(logits - logits.max(axis=1, keepdims=True))
    return shifted / shifted.sum(axis=1, keepdims=True), features


def feature_maps(images: list[Pixels]) -> dict[str, Array]:
    """Return inner features of images (224, 224, 3) by the names ``MAPS``: (N, C, side, side).

    Raises:
        UsageError: The package with the weights is not installed.
    """
    found = _session().run(list(MAPS), {"image": _batch(images)})
    return dict(zip(MAPS, found, strict=True))


def _batch(images: list[Pixels]) -> Array:
    """Return normalized images (N, 3, 224, 224)."""
    batch = np.stack(images).astype(np.float32)
    return np.ascontiguousarray(((batch - MEAN) / SCALE).transpose(0, 3, 1, 2))


def _square(image: Pixels) -> Pixels:
    height, width = image.shape[:2]
    side = max(height, width)
    out = np.full((side, side, 3), PAD_COLOUR, dtype=np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    out[top : top + height, left : left + width] = image
    how = cv2.INTER_AREA if side > SIDE_PX else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(out, (SIDE_PX, SIDE_PX), interpolation=how), dtype=np.uint8)


@lru_cache(maxsize=1)
def _session() -> Any:
    from articulate.onnx_runtime import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(
        _Graph(read_state_dict(CLASSIFIER.read())).model(),
        options,
        providers=["CPUExecutionProvider"],
    )


class _Graph:
    """Builds the ONNX graph from the tensors of the PyTorch model."""

    def __init__(self, state: dict[str, Array]) -> None:
        from onnx import helper, numpy_helper

        self.helper, self.numpy_helper = helper, numpy_helper
        self.state = state
        self.nodes: list[Any] = []
        self.tensors: list[Any] = []

    def model(self) -> bytes:
        """Return the serialized model."""
        value = self._convolution("image", "_conv_stem", "_bn0", stride=2, relu=True)
        block = 0
        channels = 32
        maps = {stage: name for name, stage in MAPS.items()}
        for stage, (repeats, _, stride, expansion) in enumerate(STAGES):
            outputs = OUTPUTS[stage]
            for k in range(repeats):
                same = k > 0 or (stride == 1 and channels == outputs)
                value = self._block(value, block, stride if k == 0 else 1, expansion, same)
                block, channels = block + 1, outputs
            if stage in maps:
                value = self._node("Identity", [value], output=maps[stage])
        value = self._convolution(value, "_conv_head", "_bn1", relu=True)
        value = self._node("GlobalAveragePool", [value])
        features = self._node("Flatten", [value], output="features")
        self._node(
            "Gemm",
            [features, self._tensor("_fc.weight"), self._tensor("_fc.bias")],
            output="logits",
            transB=1,
        )
        helper, float_type = self.helper, 1
        graph = helper.make_graph(
            self.nodes,
            "efficientnet_lite0",
            [helper.make_tensor_value_info("image", float_type, ["n", 3, SIDE_PX, SIDE_PX])],
            [
                helper.make_tensor_value_info("logits", float_type, ["n", 1000]),
                helper.make_tensor_value_info("features", float_type, ["n", FEATURES]),
                *(
                    helper.make_tensor_value_info(name, float_type, ["n", OUTPUTS[stage], "h", "h"])
                    for name, stage in MAPS.items()
                ),
            ],
            self.tensors,
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        return bytes(model.SerializeToString())

    def _block(self, value: str, number: int, stride: int, expansion: int, same: bool) -> str:
        """Inverted residual block: expansion, depthwise convolution, projection."""
        name, inner = f"_blocks.{number}", value
        if expansion != 1:
            inner = self._convolution(inner, f"{name}._expand_conv", f"{name}._bn0", relu=True)
        inner = self._convolution(
            inner,
            f"{name}._depthwise_conv",
            f"{name}._bn1",
            stride=stride,
            relu=True,
            depthwise=True,
        )
        inner = self._convolution(inner, f"{name}._project_conv", f"{name}._bn2")
        return self._node("Add", [inner, value]) if same else inner

    def _convolution(
        self,
        value: str,
        name: str,
        norm: str,
        *,
        stride: int = 1,
        relu: bool = False,
        depthwise: bool = False,
    ) -> str:
        """Convolution with the batch normalization folded in."""
        weight = self.state[f"{name}.weight"]
        gain = self.state[f"{norm}.weight"] / np.sqrt(
            self.state[f"{norm}.running_var"] + BATCH_NORM_EPSILON
        )
        bias = self.state[f"{norm}.bias"] - gain * self.state[f"{norm}.running_mean"]
        self._initializer(f"{name}.weight", weight * gain[:, None, None, None])
        self._initializer(f"{name}.bias", bias)
        value = self._node(
            "Conv",
            [value, f"{name}.weight", f"{name}.bias"],
            auto_pad="SAME_UPPER",
            strides=[stride, stride],
            group=len(weight) if depthwise else 1,
        )
        if not relu:
            return value
        for key, limit in (("zero", 0.0), ("six", 6.0)):
            if not any(tensor.name == key for tensor in self.tensors):
                self._initializer(key, np.array(limit))
        return self._node("Clip", [value, "zero", "six"])

    def _tensor(self, name: str) -> str:
        self._initializer(name, self.state[name])
        return name

    def _initializer(self, name: str, values: Array) -> None:
        array = np.ascontiguousarray(values, dtype=np.float32)
        self.tensors.append(self.numpy_helper.from_array(array, name))

    def _node(self, kind: str, inputs: list[str], output: str = "", **attributes: Any) -> str:
        output = output or f"value_{len(self.nodes)}"
        self.nodes.append(self.helper.make_node(kind, inputs, [output], **attributes))
        return output
