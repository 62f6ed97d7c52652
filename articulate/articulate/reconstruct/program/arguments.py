"""Checked arguments of untrusted programs: numbers, vectors and names."""

from __future__ import annotations

from typing import Any

import numpy as np

from articulate.reconstruct.program.language import MAX_NUMBER, MAX_TEXT
from articulate.reconstruct.program.values import InvalidValueError
from articulate.transforms import Array

# Every argument is JSON from another process and can be any value.


def format_value(value: Any) -> str:
    """Format a value for a message; lists and dicts, which may be deep, only by their length."""
    if isinstance(value, (list, dict)):
        return f"a {type(value).__name__} of {len(value)}"
    return repr(value[:40] if isinstance(value, str) else value)[:60]


def named(value: Any) -> str:
    """Check a new name: short, and only visible characters."""
    if not isinstance(value, str) or not 0 < len(value) <= MAX_TEXT or not value.isprintable():
        raise InvalidValueError(f"a name has 1 to {MAX_TEXT} visible characters")
    return value


def number(value: Any, what: str) -> float:
    """Check a finite number; ``what`` is its name in messages."""
    if type(value) not in {int, float} or not abs(value) <= MAX_NUMBER:
        raise InvalidValueError(f"{what} is {format_value(value)}; a number was expected")
    return float(value)


def least_zero(value: Any, what: str) -> float | None:
    """Check a number of 0 or more, or None."""
    if value is None:
        return None
    found = number(value, what)
    if found < 0.0:
        raise InvalidValueError(f"{what} is {found:g}; it must be 0 or more")
    return found


def vector(value: Any, what: str) -> Array:
    """Check a vector of three numbers (3,)."""
    if not isinstance(value, list) or len(value) != 3:
        raise InvalidValueError(f"{what} is {format_value(value)}; three numbers were expected")
    return np.array([number(part, what) for part in value])


def unit(value: Any) -> Array:
    """Convert a direction to a unit vector (3,)."""
    axis = vector(value, "axis")
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InvalidValueError("the axis is zero; give its direction")
    return np.asarray(axis / length)


def limits(lower: Any, upper: Any) -> tuple[float | None, float | None]:
    """Check that two limits are in order, or both None."""
    if lower is None and upper is None:
        return None, None
    low, high = number(lower, "lower"), number(upper, "upper")
    if low > high:
        raise InvalidValueError(f"lower is {low:g} and upper {high:g}; swap them")
    return low, high
