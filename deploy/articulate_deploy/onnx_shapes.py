"""Shapes of all results of an ONNX graph, inferred before it runs, and their bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from articulate.errors import BundleError

Shape = tuple[int, ...]
MAX_NUMBERS = 50_000_000
"""Most numbers of all results together [200 MB]; an exported policy has 3 million in 64 rows."""
MAX_PRODUCTS = 20_000_000_000
"""Most multiplications of all matrix products; some seconds on one core."""
MAX_DIMS = 8
"""Most dimensions of a result."""


@dataclass
class Node:
    """Operator of a graph."""

    operator: str
    inputs: list[str]
    """Names of its inputs; an omitted one is empty."""
    outputs: list[str]
    attributes: dict[str, int]
    """Integer attributes by name; 0 for attributes of other types."""


@dataclass(frozen=True)
class Tensor:
    """Constant or result of a graph."""

    shape: Shape
    integers: tuple[int, ...] | None = None
    """Values of a small constant of integers."""


def check_sizes(
    nodes: Sequence[Node],
    tensors: Mapping[str, Tensor],
    inputs: Mapping[str, Shape],
    rows: int,
    where: str,
) -> None:
    """Check the sizes of all results of a graph for ``rows`` observations.

    Args:
        nodes: Operators in the order in which they run.
        tensors: Constants by name.
        inputs: Declared shapes of the inputs by name; 0 for a dimension without a number.
        rows: Number of observations, the first dimension of the input.
        where: Name of the file, for messages.

    Raises:
        BundleError: The results are too large, or shapes do not fit together.
    """
    known = dict(tensors)
    for name, shape in inputs.items():
        known.setdefault(name, Tensor((rows, *shape[1:])))
    numbers = products = 0
    for node in nodes:
        try:
            operands = [known[name] if name else None for name in node.inputs]
            shape = OPERATORS[node.operator](operands, node.attributes)
        except (IndexError, KeyError, TypeError, ValueError, AttributeError):
            raise BundleError(
                f"{where}: the inputs of an operator {node.operator} do not fit together"
            ) from None
        numbers += math.prod(shape)
        if node.operator in ("MatMul", "Gemm"):
            products += math.prod(shape) * _inner(operands, node.attributes)
        if numbers > MAX_NUMBERS or products > MAX_PRODUCTS or len(shape) > MAX_DIMS:
            raise BundleError(
                f"{where}: its results are larger than {MAX_NUMBERS // 1_000_000} million numbers "
                f"or {MAX_PRODUCTS // 1_000_000_000} billion products for {rows} observations"
            )
        known.update(dict.fromkeys(node.outputs, Tensor(shape)))


Operands = Sequence[Tensor | None]
Attributes = Mapping[str, int]


def _operand(operands: Operands, index: int) -> Tensor:
    tensor = operands[index]
    if tensor is None:
        raise ValueError("an input is missing")
    return tensor


def _same(operands: Operands, _: Attributes) -> Shape:
    return _operand(operands, 0).shape


def _broadcast(a: Shape, b: Shape) -> Shape:
    size = max(len(a), len(b))
    a, b = (1,) * (size - len(a)) + a, (1,) * (size - len(b)) + b
    if any(x != y and 1 not in (x, y) for x, y in zip(a, b, strict=True)):
        raise ValueError("shapes cannot be broadcast")
    return tuple(y if x == 1 else x for x, y in zip(a, b, strict=True))


def _elementwise(operands: Operands, _: Attributes) -> Shape:
    return _broadcast(_operand(operands, 0).shape, _operand(operands, 1).shape)


def _matmul(operands: Operands, _: Attributes) -> Shape:
    a, b = _operand(operands, 0).shape, _operand(operands, 1).shape
    left, right = (1, *a) if len(a) == 1 else a, (*b, 1) if len(b) == 1 else b
    if left[-1] != right[-2]:
        raise ValueError("inner dimensions differ")
    rows = left[-2:-1] if len(a) > 1 else ()
    columns = right[-1:] if len(b) > 1 else ()
    return (*_broadcast(left[:-2], right[:-2]), *rows, *columns)


def _gemm(operands: Operands, attributes: Attributes) -> Shape:
    a, b = _operand(operands, 0).shape, _operand(operands, 1).shape
    if len(a) != 2 or len(b) != 2:
        raise ValueError("not matrices")
    a = a[::-1] if attributes.get("transA") else a
    b = b[::-1] if attributes.get("transB") else b
    if a[1] != b[0]:
        raise ValueError("inner dimensions differ")
    return a[0], b[1]


def _inner(operands: Operands, attributes: Attributes) -> int:
    """Return the inner dimension of a matrix product."""
    shape = _operand(operands, 0).shape
    return shape[0] if attributes.get("transA") else shape[-1]


def _concat(operands: Operands, attributes: Attributes) -> Shape:
    shapes = [_operand(operands, i).shape for i in range(len(operands))]
    axis = _axis(attributes["axis"], len(shapes[0]))
    others = {shape[:axis] + shape[axis + 1 :] for shape in shapes}
    if len(others) != 1:
        raise ValueError("other dimensions differ")
    return (*shapes[0][:axis], sum(s[axis] for s in shapes), *shapes[0][axis + 1 :])


def _reduce(operands: Operands, attributes: Attributes) -> Shape:
    shape = _operand(operands, 0).shape
    axes = tuple(range(len(shape)))
    if len(operands) > 1 and operands[1] is not None:
        reduced = _integers(operands, 1)
        axes = tuple(_axis(a, len(shape)) for a in reduced) if reduced else axes
        if not reduced and attributes.get("noop_with_empty_axes"):
            return shape
    if attributes.get("keepdims", 1):
        return tuple(1 if i in axes else size for i, size in enumerate(shape))
    return tuple(size for i, size in enumerate(shape) if i not in axes)


def _slice(operands: Operands, _: Attributes) -> Shape:
    shape = list(_operand(operands, 0).shape)
    starts, ends = _integers(operands, 1), _integers(operands, 2)
    axes = _integers(operands, 3) if _has(operands, 3) else tuple(range(len(starts)))
    steps = _integers(operands, 4) if _has(operands, 4) else (1,) * len(starts)
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        if step < 1:
            raise ValueError("ONNX clamps backward slices in another way than Python")
        k = _axis(axis, len(shape))
        shape[k] = len(range(*slice(start, end, step).indices(shape[k])))
    return tuple(shape)


def _has(operands: Operands, index: int) -> bool:
    return len(operands) > index and operands[index] is not None


def _integers(operands: Operands, index: int) -> tuple[int, ...]:
    values = _operand(operands, index).integers
    if values is None:
        raise ValueError("not a small constant")
    return values


def _axis(axis: int, n_dims: int) -> int:
    if not -n_dims <= axis < n_dims:
        raise ValueError("no such axis")
    return axis % n_dims


OPERATORS: dict[str, Callable[[Operands, Attributes], Shape]] = {
    "Abs": _same,
    "Add": _elementwise,
    "Clip": _same,
    "Concat": _concat,
    "Div": _elementwise,
    "Elu": _same,
    "Gemm": _gemm,
    "MatMul": _matmul,
    "Mul": _elementwise,
    "Pow": _elementwise,
    "ReduceSum": _reduce,
    "Slice": _slice,
    "Sub": _elementwise,
}
"""Operators of exported policies, with the functions that give the shapes of their results."""
