"""Filter of a joint's position and speed over measurements that arrive late."""

from __future__ import annotations

from bisect import insort
from typing import NamedTuple

import numpy as np

from articulate.transforms import Array

WINDOW_S = 0.5
"""Age up to which a late measurement is still used [s]."""
GATE = 4.0
"""Largest deviation of a measurement from the prediction, in standard deviations."""
MAX_REJECTED = 5
"""Successive rejected measurements after which the filter begins again at the last."""
PREDICTION_S = 0.1
"""Longest time over which the speed is extrapolated [s]; a part can stop at any time."""


class JointMeasurement(NamedTuple):
    """Position of a joint at a time, by one source."""

    time_s: float
    """Time [s]."""
    q: float
    """Position [m or rad]."""
    std: float
    """Standard deviation [m or rad]."""
    source: str
    """Name of the source."""


class JointFilter:
    """Kalman filter of constant speed with white acceleration noise.

    Late measurements are inserted at their time, and the filter is run again from there.
    """

    def __init__(self, acceleration_std: float) -> None:
        """Create an empty filter.

        Args:
            acceleration_std: Standard deviation of the acceleration [m/s^2 or rad/s^2].
        """
        self._noise = acceleration_std**2
        self.reset()

    def reset(self) -> None:
        """Forget all measurements."""
        self._used: list[JointMeasurement] = []
        self._base: tuple[float, Array, Array] | None = None
        self._state: tuple[float, Array, Array] | None = None
        self._rejected: dict[str, int] = {}

    @property
    def time_s(self) -> float:
        """Time of the newest measurement that was used [s]; -inf without one."""
        return -np.inf if self._state is None else self._state[0]

    def add(self, measurement: JointMeasurement) -> bool:
        """Use a measurement; return False if it is too old or contradicts the others."""
        if self._state is None:
            self._begin(measurement)
            return True
        if self._base is not None and measurement.time_s < self._base[0]:
            return False
        if self.deviation(measurement) > GATE:
            count = self._rejected.get(measurement.source, 0) + 1
            self._rejected[measurement.source] = count
            if count < MAX_REJECTED:
                return False
            self._begin(measurement)
            return True
        self._rejected[measurement.source] = 0
        insort(self._used, measurement)
        self._run()
        return True

    def deviation(self, measurement: JointMeasurement) -> float:
        """Return the deviation of a measurement from the prediction, in standard deviations."""
        if self._state is None:
            return 0.0
        x, P = self._state_at(measurement.time_s)
        return float(abs(measurement.q - x[0]) / np.sqrt(P[0, 0] + measurement.std**2))

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return position [m or rad], speed and standard deviation of the position at a time.

        The speed is extrapolated over at most :data:`PREDICTION_S`.
        """
        assert self._state is not None, "no measurement yet"
        last, x, P = self._state
        ahead = max(time_s - last, 0.0)
        moved = float(x[0] + min(ahead, PREDICTION_S) * x[1])
        _, P = self._predicted(x, P, ahead)
        speed = float(x[1]) if ahead <= PREDICTION_S else 0.0
        return moved, speed, float(np.sqrt(P[0, 0]))

    def _begin(self, measurement: JointMeasurement) -> None:
        self._used, self._rejected = [], {}
        x = np.array([measurement.q, 0.0])
        P = np.diag([measurement.std**2, 0.05**2])
        self._base = self._state = (measurement.time_s, x, P)

    def _state_at(self, time_s: float) -> tuple[Array, Array]:
        assert self._state is not None
        last, x, P = self._state
        if time_s >= last:
            return self._predicted(x, P, time_s - last)
        found = self._base
        assert found is not None
        for state in self._history():
            if state[0] > time_s:
                break
            found = state
        return self._predicted(found[1], found[2], time_s - found[0])

    def _history(self) -> list[tuple[float, Array, Array]]:
        assert self._base is not None
        time_s, x, P = self._base
        out = []
        for m in self._used:
            x, P = self._predicted(x, P, m.time_s - time_s)
            x, P = _updated(x, P, m)
            time_s = m.time_s
            out.append((time_s, x, P))
        return out

    def _run(self) -> None:
        history = self._history()
        self._state = history[-1]
        old = [k for k, m in enumerate(self._used) if m.time_s < self._state[0] - WINDOW_S]
        if old:
            self._base = history[old[-1]]
            del self._used[: old[-1] + 1]

    def _predicted(self, x: Array, P: Array, dt: float) -> tuple[Array, Array]:
        F = np.array([[1.0, dt], [0.0, 1.0]])
        Q = self._noise * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        return F @ x, F @ P @ F.T + Q


def _updated(x: Array, P: Array, measurement: JointMeasurement) -> tuple[Array, Array]:
    gain = P[:, 0] / (P[0, 0] + measurement.std**2)
    return x + gain * (measurement.q - x[0]), P - np.outer(gain, P[0])
