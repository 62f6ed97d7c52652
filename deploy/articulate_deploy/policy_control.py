"""Controller between a policy and a robot, once per control step: targets and gripper command."""

from __future__ import annotations

import numpy as np

from articulate.robot.control import (
    GripperState,
    delay_action,
    exceeds_force_limit,
    force_limits,
    gripper_params,
    new_action_delay,
    new_gripper_state,
    send_gripper_command,
    target_params,
    target_workspace,
    update_targets,
)
from articulate.task.manifest import Manifest
from articulate.transforms import Array


class PolicyController:
    """Targets and gripper commands of one episode.

    The set-point filter and the latency of the gripper run on the robot.
    """

    def __init__(self, manifest: Manifest, q: Array, *, delay_steps: int = 0) -> None:
        """Begin at rest.

        Args:
            manifest: Control stack and arm.
            q: Angles of the arm (7,) [rad].
            delay_steps: Delay of the motions, to simulate a slow link [control steps].
        """
        arm, config = manifest.robot, manifest.control
        self.target: Array = np.asarray(q, dtype=np.float64).copy()
        """Targets that were sent last (7,) [rad]."""
        self.gripper: GripperState = new_gripper_state(1)
        """Command of the gripper, one row."""
        self._delay = new_action_delay(1, delay_steps + 1)
        self._delay.steps[0] = delay_steps
        self._targets, self._workspace = target_params(arm, config), target_workspace()
        self._gripper = gripper_params(arm.gripper, config.step_s)
        self._force = force_limits(config)
        self._max_width_m = arm.gripper.max_width_m

    @property
    def pending_actions(self) -> Array:
        """Sum of the motions that were requested and have not acted yet (7,)."""
        return np.asarray(self._delay.pending[0])

    def step(self, action: Array, *, q: Array, width_m: float, force: Array) -> tuple[Array, float]:
        """Return the requested targets (7,) [rad] and opening of the gripper [m].

        Args:
            action: Action of the policy (8,).
            q: Angles of the arm (7,) [rad].
            width_m: Opening between the fingers [m].
            force: Measured net force on the gripper (3,) [N].
        """
        delay_action(self._delay, 0, action)
        send_gripper_command(self.gripper, 0, action[7], width_m, self._gripper)
        command = self.gripper.command[0]
        fx, fy, fz = force
        retract = exceeds_force_limit(fx, fy, fz, command, width_m, self._force)
        target = self.target.copy()
        update_targets(target, self._delay.motion[0], q, retract, self._targets, self._workspace)
        return target, 0.0 if command > 0.0 else self._max_width_m

    def set_sent(self, target: Array) -> None:
        """Continue from the targets that were sent (7,) [rad]."""
        self.target = target
