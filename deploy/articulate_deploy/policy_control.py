"""Between the policy and the robot, once a tick: target and command of the hand."""

from __future__ import annotations

import numpy as np

from articulate.robot.control import GripperState, hand_start, hand_tick, next_target, presses
from articulate.task.manifest import Manifest
from articulate.transforms import Array

_NO_LATENCY = np.zeros(1)
"""The hand's latency is the robot's own; here only the commands count."""


class Plant:
    """The targets of one episode; what runs between ticks is the robot's."""

    def __init__(self, manifest: Manifest, q: Array, *, delay_steps: int = 0) -> None:
        """Begin at rest.

        Args:
            manifest: Step, lead, margins, hand.
            q: Angles of the arm (7,) [rad].
            delay_steps: Age of the motions that are used: a slow link, for stand-ins.
        """
        self._follow, self._arm = manifest.control, manifest.robot
        self.target: Array = np.asarray(q, dtype=np.float64).copy()
        """What the robot was last told (7,) [rad]."""
        self.gripper: GripperState = hand_start(1)
        """What the hand was told."""
        self._late = [np.zeros(7)] * delay_steps

    @property
    def pending_actions(self) -> Array:
        """Sum of the motions that were said but have not been used yet (7,)."""
        return np.sum(self._late, axis=0) if self._late else np.zeros(7)

    def tick(self, action: Array, *, q: Array, width_m: float, force: Array) -> tuple[Array, float]:
        """Targets (7,) [rad] and opening of the hand [m] for an action (8,).

        Args:
            action: What the policy says.
            q: Angles of the arm (7,) [rad].
            width_m: Opening between the fingers [m].
            force: Net force on the hand as it is felt (3,) [N].
        """
        self._late.append(action[:7])
        motion = self._late.pop(0)
        self.gripper = hand_tick(
            self.gripper, action[7:8], _NO_LATENCY, self._arm.gripper, self._follow.step_s
        )
        yields = presses(force[None], self.gripper.wish, np.array([width_m]), self._follow)
        target = next_target(
            self.target[None], motion[None], q[None], self._follow, self._arm, yields
        )
        width = 0.0 if self.gripper.wish[0] > 0.0 else self._arm.gripper.max_width_m
        return target[0], width

    def sent(self, target: Array) -> None:
        """What was really sent (7,) [rad]; the next target starts there."""
        self.target = target
