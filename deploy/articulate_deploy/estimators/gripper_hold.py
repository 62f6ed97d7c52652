"""Position of a joint from the arm's own kinematics while the gripper holds the handle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.robot.arm import Arm
from articulate.robot.kinematics import tool_pose
from articulate.task.object_placement import HandlePath
from articulate.transforms import Array, apply, inverse

SETTLED_M = 0.001
"""Change of the gripper opening between control steps below which the fingers are at rest [m]."""
SETTLED_STEPS = 2
"""Control steps at rest after which the gripper holds the handle."""
MIN_WIDTH_M = 0.002
"""Opening below which nothing is between the fingers [m]."""
OPEN_MARGIN_M = 0.006
"""Distance to the largest opening above which the gripper is open [m]."""
NEAR_M = 0.06
"""Largest distance of the tool from the handle at which a grasp counts [m]. A long bar can be held
beside its middle by its half length more."""
OFF_PATH_M = 0.025
"""Distance from the path of the grasp at which the handle has slipped [m]."""
SLIP_STD_M = 0.001
"""Standard deviation of the position of the handle between the fingers [m]."""
SLIDE_STD, HINGE_STD = 0.005, 0.01
"""Standard deviation per travel since the grasp. An object that is 1 degree off shortens the travel
of a slide by its square only; an axis of a hinge that is 5 mm off turns it by about 1 %."""


@dataclass(frozen=True)
class ArmReading:
    """State of the arm that the estimator reads."""

    q: Array
    """Joint angles (7,) [rad]."""
    gripper_width_m: float
    """Opening between the fingers [m]."""


@dataclass(frozen=True)
class _Grasp:
    """Begin of a hold."""

    joint: float
    tool_w: Array


class GripperHold:
    """Estimator of the joint's position while the gripper holds the handle.

    When a grasp begins, the position of the tool is attached to the part at its present position.
    From then on the tool moves on a known path: a line, or an arc about the hinge. The position
    along it is that of the joint. Errors of the object's position cancel to first order.
    """

    def __init__(self, arm: Arm, path: HandlePath, handle_length_m: float) -> None:
        """Create an estimator.

        Args:
            arm: Kinematics of the arm.
            path: Path of the handle in the object frame.
            handle_length_m: Length of the handle along its long axis [m].
        """
        self._arm, self._path = arm, path
        self._near_m = NEAR_M + 0.5 * handle_length_m
        self.reset()

    def reset(self) -> None:
        """Begin without a grasp."""
        self._grasp: _Grasp | None = None
        self._last_width_m = np.nan
        self._settled = 0

    @property
    def holds(self) -> bool:
        """True while the handle is between the fingers."""
        return self._grasp is not None

    def release(self) -> None:
        """End the hold: another source contradicts it."""
        self._grasp = None
        self._settled = 0

    def update(self, reading: ArmReading, T_wo: Array, joint: float) -> tuple[float, float] | None:
        """Return the position of the joint and its standard deviation; None without a hold.

        The deviation is that of the travel since the grasp began.

        Args:
            reading: State of the arm.
            T_wo: Pose of the object in the base frame (4, 4) [m].
            joint: Position of the joint by other sources, used when a grasp begins [m or rad].
        """
        width = reading.gripper_width_m
        steady = abs(width - self._last_width_m) < SETTLED_M
        self._settled = self._settled + 1 if steady else 0
        self._last_width_m = width
        between = MIN_WIDTH_M < width < self._arm.gripper.max_width_m - OPEN_MARGIN_M
        tool_w = tool_pose(self._arm, reading.q)[:3, 3]
        tool_o = apply(inverse(T_wo), tool_w)
        if not between:
            self.release()
            return None
        if self._grasp is None:
            if self._settled < SETTLED_STEPS or not self._is_near(tool_o, joint):
                return None
            self._grasp = _Grasp(joint, tool_w)
        begin_o = apply(inverse(T_wo), self._grasp.tool_w)
        travel, off_path_m, lever_m = self._projected(begin_o, tool_o)
        if off_path_m > OFF_PATH_M:
            self.release()
            return None
        share = HINGE_STD if self._path.hinge else SLIDE_STD
        return self._grasp.joint + travel, float(np.hypot(SLIP_STD_M / lever_m, share * travel))

    def _is_near(self, tool_o: Array, joint: float) -> bool:
        opened = (joint - self._path.closed) / self._path.span
        handle_o = self._path.at(np.asarray(opened))[:3, 3]
        return float(np.linalg.norm(tool_o - handle_o)) < self._near_m

    def _projected(self, begin_o: Array, tool_o: Array) -> tuple[float, float, float]:
        """Return travel [m or rad], distance from the path [m] and lever [m or 1]."""
        axis = self._path.axis_o
        if not self._path.hinge:
            moved = tool_o - begin_o
            along = float(axis @ moved)
            return along, float(np.linalg.norm(moved - along * axis)), 1.0
        a, b = begin_o - self._path.pivot_o, tool_o - self._path.pivot_o
        flat_a, flat_b = a - (axis @ a) * axis, b - (axis @ b) * axis
        angle = float(np.arctan2(axis @ np.cross(flat_a, flat_b), flat_a @ flat_b))
        lever = float(np.linalg.norm(flat_a))
        off = np.hypot(float(np.linalg.norm(flat_b)) - lever, float(axis @ (b - a)))
        return angle, float(off), max(lever, 0.02)
