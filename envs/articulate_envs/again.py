"""Draws that failed and wait to come again, first come, first served."""

from __future__ import annotations

import numpy as np

from articulate.draw import COLUMNS
from articulate.transforms import Array, Mask
from articulate_envs.settings import StartConfig


class Again:
    """A queue of draws in which the policy has failed.

    A draw leaves it as it comes again, for good: one in which nobody can succeed would else come
    back for ever, and in the end nothing else.
    """

    def __init__(self, config: StartConfig) -> None:
        """Nothing waits yet."""
        self.config = config
        self.waiting = np.zeros((0, len(COLUMNS)))
        """Draws in their order (M, len(COLUMNS))."""

    def failed(self, values: Array, progress: float) -> None:
        """Let draws (M, len(COLUMNS)) wait that failed when ``progress`` of training was done."""
        if progress < self.config.again_from or not len(values):
            return
        added = np.repeat(values, self.config.again_times, axis=0)
        self.waiting = np.concatenate([self.waiting, added])[-self.config.again_most :]

    def take(self, values: Array, may: Mask, rng: np.random.Generator) -> Mask:
        """Put draws that wait in the place of some of ``values`` (N, len(COLUMNS)); of which (N,).

        Args:
            values: Fresh draws, written to.
            may: Rows that may be replaced (N,).
            rng: Decides which; not asked where nothing waits.
        """
        taken = np.zeros(len(values), dtype=bool)
        if not len(self.waiting):
            return taken
        rows = np.flatnonzero(may & (rng.random(len(values)) < self.config.again_share))
        rows = rows[: len(self.waiting)]
        values[rows], self.waiting = self.waiting[: len(rows)], self.waiting[len(rows) :]
        taken[rows] = True
        return taken
