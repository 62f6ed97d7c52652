"""Row functions: plain Python for one environment, which numba can compile into a larger loop.

Each formula of the control stack, the episode monitor, the observation and the reward is written
once, as a function of numbers and arrays that writes into arrays of its caller. A robot runs it as
Python. :mod:`articulate_envs.compiled` compiles it into the loop of the engine; numba is imported
there only, so a robot's computer needs no compiler.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

ROW_FUNCTIONS: list[Callable[..., Any]] = []
"""All row functions of the modules that are imported."""


def row_function(function: Function) -> Function:
    """Mark ``function`` as a row function and return it unchanged.

    It may use numbers, arrays, named tuples, :mod:`math`, numpy's scalar functions and other row
    functions.
    """
    ROW_FUNCTIONS.append(function)
    return function
