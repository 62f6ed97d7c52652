"""Messages of Franka's control interface (FCI), protocol versions 5 (Panda) and 10 (FR3).

All structures are packed and little-endian; matrices are column-major. Source: libfranka-common,
``research_interface/robot`` and ``research_interface/gripper`` at the commits that libfranka 0.9.2
and 0.21.2 use.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

ARM_PORT, GRIPPER_PORT = 1337, 1338
"""TCP ports; clients have them built in."""
GRIPPER_VERSION = 3
"""Version of the gripper's protocol, for both arms."""

_STATE_FIELDS: tuple[tuple[str, int], ...] = (
    ("O_T_EE", 16), ("O_T_EE_d", 16), ("F_T_EE", 16), ("EE_T_K", 16), ("F_T_NE", 16),
    ("NE_T_EE", 16), ("m_ee", 1), ("I_ee", 9), ("F_x_Cee", 3), ("m_load", 1), ("I_load", 9),
    ("F_x_Cload", 3), ("elbow", 2), ("elbow_d", 2), ("tau_J", 7), ("tau_J_d", 7), ("dtau_J", 7),
    ("q", 7), ("q_d", 7), ("dq", 7), ("dq_d", 7), ("ddq_d", 7), ("joint_contact", 7),
    ("cartesian_contact", 6), ("joint_collision", 7), ("cartesian_collision", 6),
    ("tau_ext_hat_filtered", 7), ("O_F_ext_hat_K", 6), ("K_F_ext_hat_K", 6), ("O_dP_EE_d", 6),
    ("O_ddP_O", 3), ("elbow_c", 2), ("delbow_c", 2), ("ddelbow_c", 2), ("O_T_EE_c", 16),
    ("O_dP_EE_c", 6), ("O_ddP_EE_c", 6), ("theta", 7), ("dtheta", 7),
)  # fmt: skip
"""Numbers of a state in order; float64 up to version 9, float32 in version 10."""
_ACCELEROMETERS: tuple[tuple[str, int], ...] = (
    ("accelerometer_top", 18),
    ("accelerometer_bottom", 18),
)
"""Further numbers of version 10."""

ERRORS = (
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame_flag",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_J_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
)
"""Names of the errors by their index in a state."""
ERROR = {name: index for index, name in enumerate(ERRORS)}
"""Index of an error by its name."""

COMMAND_TYPE = np.dtype(
    [
        ("message_id", "<u8"),
        ("q_c", "<f8", 7),
        ("dq_c", "<f8", 7),
        ("O_T_EE_c", "<f8", 16),
        ("O_dP_EE_c", "<f8", 6),
        ("elbow_c", "<f8", 2),
        ("valid_elbow", "u1"),
        ("motion_generation_finished", "u1"),
        ("tau_J_d", "<f8", 7),
    ]
)
"""Command of versions 5 and 6; later ones append ``torque_command_finished``."""
COMMAND_TYPE_10 = np.dtype([*COMMAND_TYPE.descr, ("torque_command_finished", "u1")])
GRIPPER_STATE = struct.Struct("<IddBH")
"""State of the gripper: message_id, width and largest width [m], is_grasped, temperature."""


def _state_type(number: str, extra: tuple[tuple[str, int], ...]) -> np.dtype[Any]:
    fields: list[tuple[Any, ...]] = [("message_id", "<u8")]
    fields += [
        (name, number) if count == 1 else (name, number, count)
        for name, count in (*_STATE_FIELDS, *extra)
    ]
    fields += [
        ("motion_generator_mode", "u1"),
        ("controller_mode", "u1"),
        ("errors", "u1", len(ERRORS)),
        ("reflex_reason", "u1", len(ERRORS)),
        ("robot_mode", "u1"),
        ("control_command_success_rate", number),
    ]
    return np.dtype(fields)


@dataclass(frozen=True)
class Protocol:
    """Numbers and layouts of one version of the arm's protocol."""

    version: int
    """Version in ``Connect``."""
    commands: dict[str, int]
    """Number of a command by its name."""
    state_type: np.dtype[Any]
    """Layout of a state."""
    command_type: np.dtype[Any]
    """Layout of a command during a motion."""
    move: dict[str, int]
    """Status of ``Move`` by its meaning."""
    stop: dict[str, int]
    """Status of ``StopMove`` by its meaning."""
    recovery: dict[str, int]
    """Status of ``AutomaticErrorRecovery`` by its meaning."""
    move_request: struct.Struct
    """Payload of ``Move``: modes, deviations and, in version 10, ``use_async`` and speeds."""

    def names(self) -> dict[int, str]:
        """Return the names of the commands by their numbers."""
        return {number: name for name, number in self.commands.items()}


def _numbered(*names: str) -> dict[str, int]:
    return {name: number for number, name in enumerate(names)}


PROTOCOLS = {
    5: Protocol(
        version=5,
        commands=_numbered(
            "Connect", "Move", "StopMove", "GetCartesianLimit", "SetCollisionBehavior",
            "SetJointImpedance", "SetCartesianImpedance", "SetGuidingMode", "SetEEToK", "SetNEToEE",
            "SetLoad", "SetFilters", "AutomaticErrorRecovery", "LoadModelLibrary",
        ),
        state_type=_state_type("<f8", ()),
        command_type=COMMAND_TYPE,
        move=_numbered(
            "success", "started", "preempted", "not_possible", "singular", "invalid", "reflex",
            "emergency", "input_error", "aborted",
        ),
        stop=_numbered("success", "not_possible", "emergency", "reflex", "aborted"),
        recovery=_numbered(
            "success", "not_possible", "manual_required", "reflex", "emergency", "aborted"
        ),
        move_request=struct.Struct("<II3d3d"),
    ),
    10: Protocol(
        version=10,
        commands=_numbered(
            "Connect", "Move", "StopMove", "SetCollisionBehavior", "SetJointImpedance",
            "SetCartesianImpedance", "SetGuidingMode", "SetEEToK", "SetNEToEE", "SetLoad",
            "AutomaticErrorRecovery", "GetRobotModel",
        ),
        state_type=_state_type("<f4", _ACCELEROMETERS),
        command_type=COMMAND_TYPE_10,
        move=_numbered(
            "success", "started", "preempted", "preempted_safety", "rejected_safety",
            "not_possible", "singular", "invalid", "reflex", "emergency", "input_error", "aborted",
        ),
        stop=_numbered("success", "not_possible", "safety", "emergency", "reflex", "aborted"),
        recovery=_numbered(
            "success", "not_possible", "safety", "manual_required", "reflex", "emergency",
            "aborted",
        ),
        move_request=struct.Struct("<II3d3dB7d"),
    ),
}  # fmt: skip
"""Protocols by their version."""

PAYLOADS = {
    "Connect": struct.Struct("<HH"),
    "StopMove": struct.Struct("<"),
    "GetCartesianLimit": struct.Struct("<i"),
    "SetCollisionBehavior": struct.Struct("<52d"),
    "SetJointImpedance": struct.Struct("<7d"),
    "SetCartesianImpedance": struct.Struct("<6d"),
    "SetGuidingMode": struct.Struct("<7B"),
    "SetEEToK": struct.Struct("<16d"),
    "SetNEToEE": struct.Struct("<16d"),
    "SetLoad": struct.Struct("<d3d9d"),
    "SetFilters": struct.Struct("<5d"),
    "AutomaticErrorRecovery": struct.Struct("<"),
    "LoadModelLibrary": struct.Struct("<BB"),
    "GetRobotModel": struct.Struct("<"),
}
"""Payloads of requests after the header, all but ``Move``, which depends on the version."""
GRIPPER_COMMANDS = _numbered("Connect", "Homing", "Grasp", "Move", "Stop")
"""Number of a gripper's command by its name."""
GRIPPER_PAYLOADS = {
    "Connect": struct.Struct("<HH"),
    "Homing": struct.Struct("<"),
    "Grasp": struct.Struct("<5d"),
    "Move": struct.Struct("<2d"),
    "Stop": struct.Struct("<"),
}
"""Payloads of a gripper's requests after the header."""
GRIPPER_STATUS = _numbered("success", "fail", "unsuccessful", "aborted")
"""Status of a gripper's command by its meaning."""

SETTER_STATUS = _numbered("success", "not_possible", "invalid")
"""Status of a request that sets or gets a parameter, by its meaning."""
ROBOT_MODE = _numbered(
    "other", "idle", "move", "guiding", "reflex", "user_stopped", "automatic_recovery"
)
"""Mode of the robot in a state, by its meaning."""
IDLE_GENERATOR, IDLE_CONTROLLER = 0, 3
"""Modes in the state of an arm without a motion."""
CONTROLLER = _numbered("joint_impedance", "cartesian_impedance", "external")
"""Controller of a motion, in ``Move`` and in a state."""
GENERATOR = _numbered(
    "joint_position", "joint_velocity", "cartesian_position", "cartesian_velocity", "none"
)
"""Motion generator in ``Move``; its number in a state is one higher."""


@dataclass(frozen=True)
class Request:
    """One request over TCP."""

    command: int
    command_id: int
    payload: bytes


class Stream:
    """Requests in the bytes of a TCP connection."""

    def __init__(self, header: str = "<III") -> None:
        """Expect ``header``: command, command id, size with the header."""
        self._header, self._buffer = struct.Struct(header), b""

    def add(self, data: bytes) -> list[Request]:
        """Return the requests that ``data`` completes.

        Raises:
            ValueError: A size is below the header's or above 64 kB.
        """
        self._buffer += data
        requests = []
        while len(self._buffer) >= self._header.size:
            command, command_id, size = self._header.unpack_from(self._buffer)
            if not self._header.size <= size <= 65536:
                raise ValueError(f"a message of {size} bytes")
            if len(self._buffer) < size:
                break
            requests.append(Request(command, command_id, self._buffer[self._header.size : size]))
            self._buffer = self._buffer[size:]
        return requests

    def reply(self, request: Request, payload: bytes) -> bytes:
        """Return the bytes of a reply to ``request``."""
        size = self._header.size + len(payload)
        return self._header.pack(request.command, request.command_id, size) + payload


GRIPPER_HEADER = "<HII"
"""Header of the gripper's messages; the arm's is three 32-bit numbers."""
