"""What an ONNX file refers to, read without onnx: before anything native opens it.

The few fields of ONNX's protocol buffers that matter here, by their numbers in ``onnx.proto``
(IR version 3 and later): operator domains, local functions, and tensors kept in other files.
"""

from __future__ import annotations

from collections.abc import Iterator

from articulate.errors import BundleError

DEFAULT_DOMAINS = ("", "ai.onnx")
"""Domains of ONNX's own operators."""
OPERATORS = frozenset({
    "Abs", "Add", "Clip", "Concat", "Div", "Elu", "Gemm", "MatMul", "Mul", "Pow", "ReduceSum",
    "Slice", "Sub",
})  # fmt: skip
"""Operators of an exported policy; none makes more numbers than it is given, as Expand does."""
MAX_NODES = 1000
"""Most operators in a graph; ours have some hundred."""
MAX_KEY = 0xFFFFFFFF
"""Largest key of a field: its number and its wire type."""

_MODEL_GRAPH, _MODEL_OPSET, _MODEL_FUNCTIONS, _MODEL_TRAINING = 7, 8, 25, 20
_OPSET_DOMAIN = 1
_GRAPH_NODE, _GRAPH_TENSOR, _GRAPH_SPARSE = 1, 5, 15
_NODE_OPERATOR, _NODE_ATTRIBUTE, _NODE_DOMAIN = 4, 5, 7
_ATTRIBUTE_TENSORS, _ATTRIBUTE_GRAPHS, _ATTRIBUTE_SPARSE = (5, 10), (6, 11), (22, 23)
_TENSOR_EXTERNAL, _TENSOR_LOCATION = 13, 14
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def check_graph(content: bytes, where: str) -> None:
    """Refuse a model that reaches outside of itself or may run without end.

    Raises:
        BundleError: It is not ONNX, keeps tensors in other files, uses operators that are not
            ONNX's own, or has a node that runs a graph of its own (Loop, If, Scan), which may
            never end.
    """
    try:
        graphs = 0
        for number, value in _messages(content):
            if number == _MODEL_GRAPH:
                graphs += 1
                _check_graph(value, where)
            elif number == _MODEL_OPSET:
                _check_domain(_text(value, _OPSET_DOMAIN), where)
            elif number in (_MODEL_FUNCTIONS, _MODEL_TRAINING):
                raise BundleError(f"{where}: has functions of its own; only plain graphs are run")
    except (IndexError, ValueError):
        raise BundleError(f"{where}: not an ONNX model") from None
    if graphs != 1:
        raise BundleError(f"{where}: not an ONNX model")


def _check_graph(graph: bytes, where: str) -> None:
    if sum(number == _GRAPH_NODE for number, _ in _messages(graph)) > MAX_NODES:
        raise BundleError(f"{where}: has more than {MAX_NODES} operators")
    for number, value in _messages(graph):
        if number == _GRAPH_NODE:
            _check_node(value, where)
        elif number == _GRAPH_TENSOR:
            _check_tensor(value, where)
        elif number == _GRAPH_SPARSE:
            raise BundleError(f"{where}: has sparse tensors, which are not read")


def _check_node(node: bytes, where: str) -> None:
    _check_domain(_text(node, _NODE_DOMAIN), where)
    for number, attribute in _messages(node):
        if number != _NODE_ATTRIBUTE:
            continue
        for kind, value in _messages(attribute):
            if kind in _ATTRIBUTE_TENSORS:
                _check_tensor(value, where)
            elif kind in _ATTRIBUTE_GRAPHS:
                raise BundleError(f"{where}: has loops or branches; only plain graphs are run")
            elif kind in _ATTRIBUTE_SPARSE:
                raise BundleError(f"{where}: has sparse tensors, which are not read")
    operator = _text(node, _NODE_OPERATOR)
    if operator not in OPERATORS:
        raise BundleError(f"{where}: has an operator {operator[:60]!r}, which no export writes")


def _check_tensor(tensor: bytes, where: str) -> None:
    for number, _, value in _fields(tensor):
        if number == _TENSOR_EXTERNAL or (number == _TENSOR_LOCATION and value != 0):
            raise BundleError(f"{where}: keeps its weights in another file, which is not opened")


def _check_domain(domain: str, where: str) -> None:
    if domain not in DEFAULT_DOMAINS:
        raise BundleError(f"{where}: uses operators of {domain[:60]!r}; only ONNX's own are run")


def _text(message: bytes, number: int) -> str:
    values = [value for n, value in _messages(message) if n == number]
    return values[-1].decode("utf-8") if values else ""


def _messages(message: bytes) -> Iterator[tuple[int, bytes]]:
    """Fields that hold bytes: numbers and contents."""
    for number, kind, value in _fields(message):
        if kind == _BYTES and isinstance(value, bytes):
            yield number, value


def _fields(message: bytes) -> Iterator[tuple[int, int, bytes | int]]:
    """Number, wire type and value of every field; ValueError or IndexError if malformed."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        # Readers in C++ keep 32 bits of a key: with more, they would see another field than we do.
        if key > MAX_KEY or key >> 3 == 0:
            raise ValueError(f"key {key}")
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield number, kind, value
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in (_FIXED32, _FIXED64):
            size = 4 if kind == _FIXED32 else 8
        else:
            raise ValueError(f"wire type {kind}")
        if at + size > len(message):
            raise ValueError("cut short")
        yield number, kind, message[at : at + size]
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if not byte & 0x80:
            return value, at
    raise ValueError("number too long")
