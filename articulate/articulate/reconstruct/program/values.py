"""Values of programs: numbers, texts, vectors, boxes and lists of them, all of limited size.

Every operation is an entry of a table and checks its operands first, so that no value exceeds the
limits of the language. The module needs only the standard library.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from articulate.reconstruct.program.language import (
    BOX_FIELDS,
    MAX_ITEMS,
    MAX_NUMBER,
    MAX_TEXT,
    VECTOR_FIELDS,
)

# A value of a program: None, bool, int, float, str, Vector, Box, tuple, list or dict of these.
Value = Any


class InvalidValueError(Exception):
    """An operation is invalid for its operands; the message is for the author of the program."""


@dataclass(frozen=True, slots=True)
class Vector:
    """Three numbers."""

    x: float
    y: float
    z: float

    @property
    def all(self) -> tuple[float, float, float]:
        """Return the components as a tuple."""
        return self.x, self.y, self.z


@dataclass(frozen=True, slots=True)
class AxisBox:
    """A box along the axes."""

    low: Vector
    high: Vector

    @property
    def size(self) -> Vector:
        """Lengths of its sides."""
        return _each(operator.sub, self.high, self.low)

    @property
    def centre(self) -> Vector:
        """Its centre."""
        return _each(lambda a, b: (a + b) / 2.0, self.low, self.high)


def attribute(value: Value, name: str) -> Value:
    """Return an attribute of a value."""
    if isinstance(value, Vector) and name in VECTOR_FIELDS:
        return dict(zip(VECTOR_FIELDS, value.all, strict=True))[name]
    if isinstance(value, AxisBox) and name in BOX_FIELDS:
        sides = {"low": value.low, "high": value.high, "size": value.size}
        return sides.get(name, value.centre)
    raise InvalidValueError(f"{format_value(value)} has no .{name}")


def item(value: Value, index: Value) -> Value:
    """Return the item at an index or key."""
    if isinstance(value, dict):
        if not isinstance(index, (str, int)) or index not in value:
            raise InvalidValueError(f"the dict has no key {format_value(index)}")
        return value[index]
    items = value.all if isinstance(value, Vector) else value
    if not isinstance(items, (list, tuple)):
        raise InvalidValueError(f"{format_value(value)} has no items")
    if type(index) is not int or not -len(items) <= index < len(items):
        raise InvalidValueError(f"index {format_value(index)} is not within the {len(items)} items")
    return items[index]


def items(value: Value) -> list[Value]:
    """Return the items of a loop."""
    if isinstance(value, Vector):
        return list(value.all)
    if isinstance(value, (list, tuple, dict)):
        return list(value)
    raise InvalidValueError(f"{format_value(value)} cannot be iterated; give a list or range()")


def number(value: Value) -> float:
    """Return ``value`` if it is a number."""
    if type(value) not in {int, float}:
        raise InvalidValueError(f"a number was expected, {format_value(value)} was given")
    found: float = value
    return found


def vector(value: Value) -> Vector:
    """Convert a vector or a list of three numbers to a vector."""
    if isinstance(value, Vector):
        return value
    if isinstance(value, (list, tuple)) and len(value) == 3:
        return Vector(*(number(v) for v in value))
    raise InvalidValueError(
        f"a vector of three numbers was expected, {format_value(value)} was given"
    )


def format_value(value: Value) -> str:
    """Format a value for a message."""
    if isinstance(value, Vector):
        return f"vec({value.x:g}, {value.y:g}, {value.z:g})"
    if isinstance(value, str):
        return repr(value[:40])
    if isinstance(value, (list, tuple, dict)):
        return f"a {type(value).__name__} of {len(value)}"
    return "a box" if isinstance(value, AxisBox) else repr(value)


def bounded(value: Value) -> Value:
    """Return ``value`` if it is within the limits of the language."""
    if type(value) in {int, float}:
        if not abs(value) <= MAX_NUMBER:  # also rejects NaN
            raise InvalidValueError(f"the result is beyond {MAX_NUMBER:g} or not a number")
    elif isinstance(value, Vector):
        for part in value.all:
            bounded(part)
    elif isinstance(value, str):
        if len(value) > MAX_TEXT:
            raise InvalidValueError(f"texts have at most {MAX_TEXT} characters")
    elif isinstance(value, (list, tuple, dict)) and len(value) > MAX_ITEMS:
        raise InvalidValueError(f"lists have at most {MAX_ITEMS} items")
    return value


def _each(operation: Callable[[float, float], float], a: Vector, b: Vector) -> Vector:
    return Vector(*(operation(u, v) for u, v in zip(a.all, b.all, strict=True)))


def _add(a: Value, b: Value) -> Value:
    for kind in (str, list, tuple):
        if isinstance(a, kind) and isinstance(b, kind):
            if len(a) + len(b) > max(MAX_ITEMS, MAX_TEXT):  # before it is created
                raise InvalidValueError(f"lists have at most {MAX_ITEMS} items")
            return a + b  # type: ignore[operator]  # both are of one kind that adds
    return _linear(operator.add, a, b)


def _linear(operation: Callable[[float, float], float], a: Value, b: Value) -> Value:
    if isinstance(a, Vector) or isinstance(b, Vector):
        return _each(operation, vector(a), vector(b))
    return operation(number(a), number(b))


def _times(a: Value, b: Value) -> Value:
    for one, other in ((a, b), (b, a)):
        if isinstance(one, Vector):
            factor = number(other)
            return Vector(*(factor * part for part in one.all))
    return number(a) * number(b)


def _divided(operation: Callable[[float, float], float], a: Value, b: Value) -> Value:
    divisor = number(b)
    if divisor == 0:
        raise InvalidValueError("division by zero")
    if isinstance(a, Vector):
        return Vector(*(operation(part, divisor) for part in a.all))
    return operation(number(a), divisor)


def _power(a: Value, b: Value) -> Value:
    base, exponent = number(a), number(b)
    if base < 0 and exponent != int(exponent):
        raise InvalidValueError("a root of a negative number")
    if base == 0 and exponent < 0:
        raise InvalidValueError("division by zero")
    return base**exponent


def _equal(a: Value, b: Value) -> bool:
    if isinstance(a, (list, tuple, dict)) and isinstance(b, (list, tuple, dict)):
        raise InvalidValueError(
            "lists are not compared; compare their items"
        )  # shared items would take forever
    return bool(a == b)


def _ordered(operation: Callable[[float, float], bool]) -> Callable[[Value, Value], bool]:
    return lambda a, b: operation(number(a), number(b))


def _within(a: Value, b: Value) -> bool:
    if isinstance(b, str):
        if not isinstance(a, str):
            raise InvalidValueError(f"a text was expected before `in`, {format_value(a)} was given")
        return a in b
    return any(_equal(a, each) for each in items(b))


ARITHMETIC: Mapping[str, Callable[[Value, Value], Value]] = {
    "Add": _add,
    "Sub": lambda a, b: _linear(operator.sub, a, b),
    "Mult": _times,
    "Div": lambda a, b: _divided(operator.truediv, a, b),
    "FloorDiv": lambda a, b: _divided(operator.floordiv, a, b),
    "Mod": lambda a, b: _divided(operator.mod, a, b),
    "Pow": _power,
}
"""By the name of the operator's node."""

COMPARISONS: Mapping[str, Callable[[Value, Value], bool]] = {
    "Eq": _equal,
    "NotEq": lambda a, b: not _equal(a, b),
    "Lt": _ordered(operator.lt),
    "LtE": _ordered(operator.le),
    "Gt": _ordered(operator.gt),
    "GtE": _ordered(operator.ge),
    "In": _within,
    "NotIn": lambda a, b: not _within(a, b),
}
"""By the name of the operator's node."""


def negated(value: Value) -> Value:
    """``-value``."""
    return _times(-1, value)


def _norm(value: Value) -> float:
    return math.sqrt(sum(part * part for part in vector(value).all))


def _unit(value: Value) -> Vector:
    length = _norm(value)
    if length == 0.0:
        raise InvalidValueError("unit() of a zero vector")
    return Vector(*(part / length for part in vector(value).all))


def _dot(a: Value, b: Value) -> float:
    return sum(u * v for u, v in zip(vector(a).all, vector(b).all, strict=True))


def _cross(a: Value, b: Value) -> Vector:
    (ax, ay, az), (bx, by, bz) = vector(a).all, vector(b).all
    return Vector(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def _extreme(choose: Callable[..., float]) -> Callable[..., float]:
    def found(*values: Value) -> float:
        operands = items(values[0]) if len(values) == 1 else list(values)
        if not operands:
            raise InvalidValueError("an empty list has no extreme")
        return choose(*(number(v) for v in operands), number(operands[0]))

    return found


def _range(*ends: Value) -> list[int]:
    if any(type(end) is not int for end in ends):
        raise InvalidValueError("range() takes integers")
    if len(ends) == 3 and ends[2] == 0:
        raise InvalidValueError("range() cannot step by 0")
    rounds = range(*ends)
    if len(rounds) > MAX_ITEMS:
        raise InvalidValueError(f"a loop takes at most {MAX_ITEMS} rounds")
    return list(rounds)


def _length(value: Value) -> int:
    return len(value) if isinstance(value, str) else len(items(value))


def _real(function: Callable[..., float]) -> Callable[..., float]:
    def applied(*values: Value) -> float:
        try:
            return function(*(number(v) for v in values))
        except (ValueError, OverflowError):
            operands = ", ".join(format_value(v) for v in values)
            raise InvalidValueError(
                f"{function.__name__}() is not defined for {operands}"
            ) from None

    return applied


def _rounded(value: Value, digits: Value = 0) -> float:
    if type(digits) is not int or not 0 <= digits <= 12:
        raise InvalidValueError("round() takes 0 to 12 digits")
    return round(number(value), digits) if digits else round(number(value))


def _summed(value: Value) -> Value:
    total: Value = 0
    for each in items(value):
        total = each if total == 0 else _linear(operator.add, total, each)
    return total


HELPER_FUNCTIONS: Mapping[str, Callable[..., Value]] = {
    "vec": lambda x, y, z: vector([x, y, z]),
    "dot": _dot,
    "cross": _cross,
    "norm": _norm,
    "unit": _unit,
    "abs": lambda v: abs(number(v)),
    "min": _extreme(min),
    "max": _extreme(max),
    "sum": _summed,
    "round": _rounded,
    "len": _length,
    "float": lambda v: float(number(v)),
    "int": lambda v: int(number(v)),
    "range": _range,
    "enumerate": lambda v: list(enumerate(items(v))),
    "zip": lambda a, b: list(zip(items(a), items(b), strict=False)),
    "sqrt": _real(math.sqrt),
    "sin": _real(math.sin),
    "cos": _real(math.cos),
    "tan": _real(math.tan),
    "asin": _real(math.asin),
    "acos": _real(math.acos),
    "atan2": _real(math.atan2),
    "radians": _real(math.radians),
    "degrees": _real(math.degrees),
}
"""The functions of ``language.HELPERS``."""
