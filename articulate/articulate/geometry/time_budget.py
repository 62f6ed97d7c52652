"""Time that may be spent on making shapes finer, counted on the processor."""

from __future__ import annotations

import math
import os


class OutOfTimeError(Exception):
    """The time is used up."""


class Budget:
    """Some time of the processor, that of child processes included, from now on.

    Args:
        limit_s: How much [s].
    """

    def __init__(self, limit_s: float = math.inf) -> None:
        self._end_s = spent_s() + limit_s

    def check(self) -> None:
        """Go on if there is time left.

        Raises:
            OutOfTimeError: There is none.
        """
        if spent_s() > self._end_s:
            raise OutOfTimeError


def spent_s() -> float:
    """Time of the processor that this process and its ended children took so far [s]."""
    return sum(os.times()[:4])


UNLIMITED = Budget()
"""As much time as it takes."""
