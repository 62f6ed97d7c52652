"""What is known of an object, averaged over what was seen of it so far.

Estimates are wrong by millimetres, and by others at each tick. A policy has no memory, so that it
would follow every one of them; while a part stands still, their mean is what is worth following.
The same code runs in training and beside the robot, between estimator and observation.
"""

from __future__ import annotations

import numpy as np

from articulate.observe import Estimate
from articulate.transforms import Array, Ints

LEAST_GAIN = 0.1
"""Share of what is seen now that counts at least: it forgets within about ten ticks."""
MOVING = {"slide": 0.03, "hinge": 0.06}
"""Speed of a part from which its handle is taken for what is seen of it now [m/s, rad/s]."""


class Tracker:
    """Means over the estimates of N objects, one estimate a tick.

    The handle's place is the mean of all estimates since the start, later a fading one; the faster
    the part moves, the less of the past counts, for the handle is elsewhere by then. With gain a,
    the next one is ``a / (1 + a)``, which makes the plain mean of it, and at least what the speed
    asks for. Openings are carried on by the speed first, so that their mean does not lag
    (a Kalman filter's correction of a prediction, whose gain ends at :data:`LEAST_GAIN`).
    Directions are taken as they are.

    Args:
        n: How many objects.
        span: Way of the joint from closed to open [m or rad].
        kind: Of the joint, ``slide`` or ``hinge``.
        tick_s: Length of a tick [s].
    """

    def __init__(self, n: int, span: float, kind: str, tick_s: float) -> None:
        self._moving, self._step = MOVING[kind], tick_s / abs(span)
        self._place = np.zeros((n, 3))
        self._opened = np.zeros(n)
        self._gains = np.full((n, 2), np.inf)

    def reset(self, rows: Ints) -> None:
        """Forget the objects ``rows`` (M,): another episode begins."""
        self._gains[rows] = np.inf

    def update(self, seen: Estimate, rows: Ints | None = None) -> Estimate:
        """Take the estimates of a tick and give what is known of all N objects then.

        Args:
            seen: Of all N.
            rows: Those (M,) that are new; the others stay as they are. None: all.
        """
        rows = np.arange(len(self._opened)) if rows is None else rows
        speed = seen.speed[rows]
        least = np.full((len(rows), 2), LEAST_GAIN)
        least[:, 0] += (1.0 - LEAST_GAIN) * np.minimum(np.abs(speed) / self._moving, 1.0)
        gains = np.maximum(1.0 / (1.0 + 1.0 / self._gains[rows]), least)
        first = np.isinf(self._gains[rows, 1])
        place = np.where(first[:, None], seen.T_wh[rows, :3, 3], self._place[rows])
        opened = np.where(first, seen.opened[rows], self._opened[rows] + self._step * speed)
        self._place[rows] = place + gains[:, :1] * (seen.T_wh[rows, :3, 3] - place)
        self._opened[rows] = opened + gains[:, 1] * (seen.opened[rows] - opened)
        self._gains[rows] = gains
        T_wh = seen.T_wh.copy()
        T_wh[:, :3, 3] = self._place
        return Estimate(T_wh=T_wh, opened=self._opened.copy(), speed=seen.speed)

    def snapshot(self) -> dict[str, Array]:
        """What was averaged so far."""
        return {
            "track_place": self._place.copy(),
            "track_opened": self._opened.copy(),
            "track_gains": self._gains.copy(),
        }

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""
        self._place[:] = snapshot["track_place"]
        self._opened[:] = snapshot["track_opened"]
        self._gains[:] = snapshot["track_gains"]
