"""Contact sensors of a scene: the net wrench on the gripper, and forbidden contacts of the arm."""

from __future__ import annotations

from articulate.jit import row_function
from articulate.transforms import Array

GRIPPER_SENSOR, FLOOR_SENSOR = "gripper_object", "gripper_floor"
"""Contact sensors with the net wrench of object and floor on the gripper."""
ROBOT_SENSOR = "robot_object"
"""Contact sensor that counts the contacts of all robot links with the object."""


@row_function
def contact_wrench(
    sensors: Array, gripper: int, floor: int, robot: int, tool_w: Array, wrench: Array
) -> bool:
    """Write the net wrench on the gripper; return True if the arm itself touches the object.

    The contact sensors give the net force of the gripper on what it is paired with, in the world
    frame, with the moment about the point that they name. The wrench is the opposite.

    Args:
        sensors: Sensor data (nsensordata,).
        gripper: First number of the sensor of the gripper on the object.
        floor: First number of the sensor of the gripper on the floor.
        robot: The count of contacts of all robot links.
        tool_w: Position of the tool in the world (3,) [m].
        wrench: Output (6,): force [N] and moment about the tool [Nm], world axes.
    """
    for k in range(6):
        wrench[k] = 0.0
    for start in (gripper, floor):
        ax, ay, az = sensors[start + 1], sensors[start + 2], sensors[start + 3]
        dx = sensors[start + 7] - tool_w[0]
        dy = sensors[start + 8] - tool_w[1]
        dz = sensors[start + 9] - tool_w[2]
        wrench[0] -= ax
        wrench[1] -= ay
        wrench[2] -= az
        wrench[3] -= sensors[start + 4] + dy * az - dz * ay
        wrench[4] -= sensors[start + 5] + dz * ax - dx * az
        wrench[5] -= sensors[start + 6] + dx * ay - dy * ax
    return bool(sensors[robot] > sensors[gripper] + 0.5)
