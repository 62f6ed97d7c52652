"""Limit of processor time for making shapes finer."""

from __future__ import annotations

import math
import os


class OutOfTimeError(Exception):
    """The processor time is spent."""


class Budget:
    """Processor time from now on, child processes included.

    Args:
        limit_s: Limit [s].
    """

    def __init__(self, limit_s: float = math.inf) -> None:
        self._end_s = spent_s() + limit_s

    def check(self) -> None:
        """Check the limit.

        Raises:
            OutOfTimeError: The time is spent.
        """
        if spent_s() > self._end_s:
            raise OutOfTimeError


def spent_s() -> float:
    """Return the processor time of this process and its ended children [s]."""
    return sum(os.times()[:4])


UNLIMITED = Budget()
"""No limit."""
