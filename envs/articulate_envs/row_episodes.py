"""Episodes whose environments are reset one by one, each from its own seed where one is given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from articulate.transforms import Array, Ints
from articulate_envs.engine import Start
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import concatenate_starts


class RowEpisodes(Episodes):
    """N environments without automatic reset; :meth:`restart` begins new episodes in some.

    One generator serves all environments that have no seed. An environment with a seed uses a
    generator in the same order as a single environment, so its episodes depend on no
    other environment.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Take the arguments of :class:`articulate_envs.episodes.Episodes`, except ``renew``."""
        super().__init__(*args, renew=False, **kwargs)
        self._generators: dict[int, np.random.Generator] = {}
        self._active: Ints = np.arange(self.engine.n_envs)

    def reseed_rows(self, seeds: Sequence[int | None] | None) -> None:
        """Give environment i the seed ``seeds[i]``; None keeps its generator.

        Args:
            seeds: N seeds; None removes all seeds, so that one generator serves all environments.
        """
        if seeds is None:
            self._generators.clear()
            return
        for row, seed in enumerate(seeds):
            if seed is not None:
                self._generators[row] = np.random.default_rng(seed)

    def sample_starts(self, rows: Ints) -> Start:
        """Sample the starts of the next episodes of environments ``rows`` (M,), indices."""
        shared = [i for i, row in enumerate(rows) if int(row) not in self._generators]
        parts, order = [], []
        if shared:
            parts.append(self.sample_start(len(shared)))
            order += shared
        for i, row in enumerate(rows):
            if int(row) in self._generators:
                common, self._rng = self._rng, self._generators[int(row)]
                parts.append(self.sample_start(1))
                self._rng = common
                order.append(i)
        return concatenate_starts(parts, np.argsort(order))

    def restart(self, rows: Ints, start: Start | None = None) -> Array:
        """Begin new episodes in environments ``rows`` and return their observations (M, size).

        Args:
            rows: Environments (M,), indices.
            start: Initial states (M rows), sampled by default.
        """
        self._state = self._begin(rows, self.sample_starts(rows) if start is None else start)
        self._width = self._width.copy()
        self._width[rows] = self._state.gripper_width[rows]
        self._active = rows
        noise = self._sample_noise()
        self._noise[rows] = noise[rows]
        observation: Array = self._observe(noise)[rows]
        return observation

    def activate(self, rows: Ints) -> None:
        """Let the next step take observation noise of environments ``rows`` (M,), indices, only."""
        self._active = rows

    def _sample_noise(self) -> Array:
        noise = super()._sample_noise()
        for row in self._active.tolist():
            if row in self._generators:
                noise[row] = self._generators[row].normal(size=noise.shape[1])
        return noise
