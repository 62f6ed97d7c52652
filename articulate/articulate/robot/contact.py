"""Contact sensors of a scene: the net wrench on the hand, and who touches the object."""

from __future__ import annotations

import numpy as np

from articulate.transforms import Array, Mask

GRIPPER_SENSOR, FLOOR_SENSOR, ROBOT_SENSOR = "gripper_object", "gripper_floor", "robot_object"
"""Contact sensors: net wrench of object and floor on the hand; contacts of all of the robot."""


def contact_wrench(
    sensors: Array, starts: tuple[int, int, int], tool_w: Array
) -> tuple[Array, Mask]:
    """Net wrench on the hand about the tool (N, 6), and whether the arm touches the object (N,).

    The contact sensors give the net force of the hand on what it is paired with, in the world
    frame, with the moment about the point that they name; the hand feels the opposite.

    Args:
        sensors: Sensor data (N, nsensordata).
        starts: First number of the hand, floor and robot sensors.
        tool_w: Place of the tool (N, 3) [m].
    """
    wrench = np.zeros((len(sensors), 6))
    for start in starts[:2]:
        block = sensors[:, start : start + 10]
        force = block[:, 1:4]
        wrench[:, :3] -= force
        wrench[:, 3:] -= block[:, 4:7] + _cross(block[:, 7:10] - tool_w, force)
    touch = sensors[:, starts[2]] > sensors[:, starts[0]] + 0.5
    return wrench, np.asarray(touch)


def _cross(a: Array, b: Array) -> Array:
    """Vector products (N, 3); ``numpy.cross`` takes ten times as long for one row."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
