"""Checks of an ONNX file before ONNX Runtime opens it, without the onnx package.

The fields of ONNX's protocol buffers that matter here are read by their numbers in ``onnx.proto``
(IR version 3 and later). A few bytes of a graph can require hours or terabytes, so its operators
are limited to those of exported policies, and :mod:`articulate_deploy.onnx_shapes` bounds the size
of every result.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

from articulate.errors import BundleError, quote
from articulate_deploy.onnx_shapes import MAX_DIMS, OPERATORS, Node, Tensor, check_sizes

DEFAULT_DOMAINS = ("", "ai.onnx")
"""Domains of the standard operators."""
MAX_BYTES = 32 << 20
"""Largest file [bytes]; an exported policy has about 1 MB."""
MAX_NODES = 1000
"""Most operators of a graph; an exported policy has about 100."""
MAX_FIELDS = 200_000
"""Most fields of a file."""
MAX_KEY = 0xFFFFFFFF
"""Largest key of a field: its number and its wire type."""
MAX_PACKED = 100
"""Longest packed field that is read [bytes]."""
SMALL = 8
"""Tensors of at most this many integers are read: axes and bounds of slices."""

_MODEL_GRAPH, _MODEL_OPSET, _MODEL_FUNCTIONS, _MODEL_TRAINING = 7, 8, 25, 20
_OPSET_DOMAIN = 1
_GRAPH_NODE, _GRAPH_TENSOR, _GRAPH_INPUT, _GRAPH_SPARSE = 1, 5, 11, 15
_NODE_INPUT, _NODE_OUTPUT, _NODE_OPERATOR, _NODE_ATTRIBUTE, _NODE_DOMAIN = 1, 2, 4, 5, 7
_ATTRIBUTE_NAME, _ATTRIBUTE_INTEGER = 1, 3
_ATTRIBUTE_TENSORS, _ATTRIBUTE_GRAPHS, _ATTRIBUTE_SPARSE = (5, 10), (6, 11), (22, 23)
_TENSOR_DIMS, _TENSOR_TYPE, _TENSOR_NAME, _TENSOR_DATA = 1, 2, 8, 9
_TENSOR_EXTERNAL, _TENSOR_LOCATION = 13, 14
_INPUT_NAME, _INPUT_TYPE, _TYPE_TENSOR, _TYPE_SHAPE, _SHAPE_DIM, _DIM_VALUE = 1, 2, 1, 2, 1, 1
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_FLOAT, _INT64 = 1, 7
_ITEM_BYTES = {_FLOAT: 4, _INT64: 8}


def check_graph(content: bytes, where: str, rows: int = 1) -> None:
    """Check that a model is self-contained and bounded in time and memory.

    Args:
        content: ONNX file.
        where: Its name, for messages.
        rows: Largest number of observations of one call; one observation is checked too.

    Raises:
        BundleError: It is not ONNX, keeps tensors in other files, uses operators other than those
            of an exported policy, or its results are too large.
    """
    if len(content) > MAX_BYTES:
        raise BundleError(f"{where}: larger than {MAX_BYTES >> 20} MB")
    try:
        graph = _Reader(where).graph(content)
    except (IndexError, ValueError):
        raise BundleError(f"{where}: not an ONNX model") from None
    for n in sorted({1, rows}):
        check_sizes(graph.nodes, graph.tensors, graph.inputs, n, where)


@dataclass
class _Graph:
    nodes: list[Node] = field(default_factory=list)
    tensors: dict[str, Tensor] = field(default_factory=dict)
    inputs: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Declared shapes by name; 0 for a dimension without a number."""


class _Reader:
    """Reader of one file; it counts the fields."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._left = MAX_FIELDS

    def graph(self, content: bytes) -> _Graph:
        graphs = []
        for number, value in self._messages(content):
            if number == _MODEL_GRAPH:
                graphs.append(value)
            elif number == _MODEL_OPSET:
                self._check_domain(self._text(value, _OPSET_DOMAIN))
            elif number in (_MODEL_FUNCTIONS, _MODEL_TRAINING):
                raise self._error("has local functions; only plain graphs are supported")
        if len(graphs) != 1:
            raise ValueError("a model has one graph")
        return self._graph(graphs[0])

    def _graph(self, content: bytes) -> _Graph:
        graph = _Graph()
        for number, value in self._messages(content):
            if number == _GRAPH_NODE:
                if len(graph.nodes) == MAX_NODES:
                    raise self._error(f"has more than {MAX_NODES} operators")
                graph.nodes.append(self._node(value))
            elif number == _GRAPH_TENSOR:
                name, tensor = self._tensor(value)
                if name in graph.tensors:
                    raise ValueError("two tensors of one name")
                graph.tensors[name] = tensor
            elif number == _GRAPH_INPUT:
                graph.inputs[self._text(value, _INPUT_NAME)] = self._shape(value)
            elif number == _GRAPH_SPARSE:
                raise self._error("has sparse tensors, which are not supported")
        return graph

    def _node(self, content: bytes) -> Node:
        node = Node("", [], [], {})
        domain = ""
        for number, value in self._messages(content):
            if number == _NODE_INPUT:
                node.inputs.append(value.decode("utf-8"))
            elif number == _NODE_OUTPUT:
                node.outputs.append(value.decode("utf-8"))
            elif number == _NODE_OPERATOR:
                node.operator = value.decode("utf-8")
            elif number == _NODE_DOMAIN:
                domain = value.decode("utf-8")
            elif number == _NODE_ATTRIBUTE:
                name, integer = self._attribute(value)
                if name in node.attributes:
                    raise ValueError("two attributes of one name")
                node.attributes[name] = integer
        self._check_domain(domain)
        if node.operator not in OPERATORS:
            raise self._error(f"has an operator {quote(node.operator, 60)}, which no export writes")
        return node

    def _attribute(self, content: bytes) -> tuple[str, int]:
        """Return the name and the integer of an attribute; 0 where it holds none."""
        name, integer = "", 0
        for number, _, value in self._fields(content):
            if number in _ATTRIBUTE_GRAPHS:
                raise self._error("has loops or branches; only plain graphs are supported")
            if number in _ATTRIBUTE_SPARSE:
                raise self._error("has sparse tensors, which are not supported")
            if number in _ATTRIBUTE_TENSORS and isinstance(value, bytes):
                self._tensor(value)
                raise self._error("has tensors in attributes, which no export writes")
            if number == _ATTRIBUTE_NAME and isinstance(value, bytes):
                name = value.decode("utf-8")
            elif number == _ATTRIBUTE_INTEGER and isinstance(value, int):
                integer = _signed(value)
        return name, integer

    def _tensor(self, content: bytes) -> tuple[str, Tensor]:
        name, dims, kind, data = "", [], 0, b""
        for number, _, value in self._fields(content):
            if number == _TENSOR_EXTERNAL or (number == _TENSOR_LOCATION and value != 0):
                raise self._error("keeps its weights in another file, which is not opened")
            if number == _TENSOR_NAME and isinstance(value, bytes):
                name = value.decode("utf-8")
            elif number == _TENSOR_DIMS:
                dims += [value] if isinstance(value, int) else _varints(value)
            elif number == _TENSOR_TYPE and isinstance(value, int):
                kind = value
            elif number == _TENSOR_DATA and isinstance(value, bytes):
                data = value
        if kind not in _ITEM_BYTES or len(dims) > MAX_DIMS:
            raise self._error(f"has a tensor of another type or of more than {MAX_DIMS} dimensions")
        shape = tuple(_signed(dim) for dim in dims)
        size = math.prod(shape)
        if min(shape, default=0) < 0 or size * _ITEM_BYTES[kind] != len(data):
            raise self._error("has a tensor whose data does not match its shape")
        integers = None
        if kind == _INT64 and size <= SMALL:
            pieces = (data[i : i + 8] for i in range(0, len(data), 8))
            integers = tuple(int.from_bytes(piece, "little", signed=True) for piece in pieces)
        return name, Tensor(shape, integers)

    def _shape(self, content: bytes) -> tuple[int, ...]:
        """Return the declared shape of an input; 0 for a dimension without a number."""
        parts = [content]
        for wanted in (_INPUT_TYPE, _TYPE_TENSOR, _TYPE_SHAPE, _SHAPE_DIM):
            parts = [v for part in parts for n, v in self._messages(part) if n == wanted]
        dims = []
        for part in parts:
            values = [v for n, _, v in self._fields(part) if n == _DIM_VALUE]
            dims.append(_signed(values[-1]) if values and isinstance(values[-1], int) else 0)
        return tuple(dims)

    def _check_domain(self, domain: str) -> None:
        if domain not in DEFAULT_DOMAINS:
            raise self._error(f"uses operators of {quote(domain, 60)}; only ONNX's are supported")

    def _text(self, content: bytes, number: int) -> str:
        values = [value for n, value in self._messages(content) if n == number]
        return values[-1].decode("utf-8") if values else ""

    def _messages(self, content: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield number and content of the fields with bytes: messages and texts."""
        for number, kind, value in self._fields(content):
            if kind == _BYTES and isinstance(value, bytes):
                yield number, value

    def _fields(self, content: bytes) -> Iterator[tuple[int, int, bytes | int]]:
        """Yield number, wire type and value of every field.

        Raises:
            ValueError: The content is malformed or has too many fields.
            IndexError: The content is cut short.
        """
        at = 0
        while at < len(content):
            self._left -= 1
            if self._left < 0:
                raise self._error(f"has more than {MAX_FIELDS} fields")
            key, at = _varint(content, at)
            # C++ readers keep 32 bits of a key: with more, they would read another field.
            if key > MAX_KEY or key >> 3 == 0:
                raise ValueError(f"key {key}")
            number, kind = key >> 3, key & 7
            if kind == _VARINT:
                value, at = _varint(content, at)
                yield number, kind, value
                continue
            if kind == _BYTES:
                size, at = _varint(content, at)
            elif kind in (_FIXED32, _FIXED64):
                size = 4 if kind == _FIXED32 else 8
            else:
                raise ValueError(f"wire type {kind}")
            if at + size > len(content):
                raise ValueError("cut short")
            yield number, kind, content[at : at + size]
            at += size

    def _error(self, reason: str) -> BundleError:
        return BundleError(f"{self._where}: {reason}")


def _varint(content: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = content[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if not byte & 0x80:
            return value, at
    raise ValueError("number too long")


def _varints(content: bytes) -> list[int]:
    """Return the numbers of a packed field, the dimensions of a tensor."""
    if len(content) > MAX_PACKED:
        raise ValueError("too many dimensions")
    out, at = [], 0
    while at < len(content):
        value, at = _varint(content, at)
        out.append(value)
    return out


def _signed(value: int) -> int:
    """Return a 64-bit number in two's complement as a signed one."""
    value &= (1 << 64) - 1
    return value - (1 << 64) if value >> 63 else value
