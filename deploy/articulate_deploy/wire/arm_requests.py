"""Requests to the arm over TCP: connection, motions, parameters, recovery, model."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from articulate_deploy.wire.endpoints import Endpoint
from articulate_deploy.wire.messages import PAYLOADS, SETTER_STATUS, Request
from articulate_deploy.wire.model import model_library, robot_urdf
from articulate_deploy.wire.motion import Thresholds
from articulate_deploy.wire.physics import MIN_STIFFNESS

if TYPE_CHECKING:
    from articulate_deploy.wire.server import Server

_SETTERS = (
    "SetCollisionBehavior", "SetJointImpedance", "SetCartesianImpedance", "SetGuidingMode",
    "SetEEToK", "SetNEToEE", "SetLoad", "SetFilters",
)  # fmt: skip
MAX_STIFFNESS = 14250.0
"""Largest stiffness of ``SetJointImpedance`` [Nm/rad]."""


class ArmRequests:
    """Handler of the arm's requests."""

    def __init__(self, server: Server) -> None:
        """Act on the arm, the states and the faults of ``server``."""
        self._server = server
        self._names = server.protocol.names()
        self._moves: dict[int, Request] = {}

    def accept(self, endpoint: Endpoint) -> None:
        """Accept a client."""
        if endpoint.accept() is not None and self._server.faults.connection("close"):
            endpoint.disconnect()

    def receive(self, endpoint: Endpoint) -> None:
        """Handle what arrived from the client."""
        requests = endpoint.receive()
        if requests is None:
            endpoint.disconnect()
            self._server.client_left()
            return
        if self._server.faults.connection("silent"):
            return
        for request in requests:
            self._handle(endpoint, request)

    def end_motion(self, endpoint: Endpoint, command_id: int, status: str) -> None:
        """Send the second reply to a ``Move``."""
        request = self._moves.pop(command_id, None)
        if request is not None:
            endpoint.reply(request, bytes([self._server.protocol.move[status]]))

    def _handle(self, endpoint: Endpoint, request: Request) -> None:
        server, name = self._server, self._names.get(request.command, "")
        layout = server.protocol.move_request if name == "Move" else PAYLOADS.get(name)
        if layout is None or layout.size != len(request.payload):
            endpoint.disconnect()  # as for any client of another protocol
            server.client_left()
            return
        values = layout.unpack(request.payload)
        if name == "Connect":
            self._connect(endpoint, request, values)
        elif name == "Move":
            self._move(endpoint, request, values)
        elif name == "StopMove":
            status = server.arm.stop()
            server.report_ended()
            endpoint.reply(request, bytes([server.protocol.stop[status]]))
        elif name == "AutomaticErrorRecovery":
            status = server.arm.recover()
            endpoint.reply(request, bytes([server.protocol.recovery[status]]))
        elif name in _SETTERS:
            endpoint.reply(request, bytes([SETTER_STATUS[self._set(name, values)]]))
        elif name == "GetCartesianLimit":
            frame = np.eye(4).ravel()
            payload = struct.pack("<B3d16dB", SETTER_STATUS["success"], 0, 0, 0, *frame, 0)
            endpoint.reply(request, payload)
        else:
            endpoint.reply(request, self._model(name, values))

    def _connect(self, endpoint: Endpoint, request: Request, values: tuple[Any, ...]) -> None:
        server = self._server
        version, port = values
        offered = 7 if server.faults.connection("wrong_version") else server.protocol.version
        fits = version == offered
        payload = struct.pack("<BH", 0 if fits else 1, offered)
        if server.faults.connection("short_header"):
            endpoint.send_raw(struct.pack("<III", request.command, request.command_id, 8))
            return
        if server.faults.connection("truncated_reply"):
            endpoint.send_raw(struct.pack("<III", request.command, request.command_id, 15)[:9])
            endpoint.disconnect()
            return
        if fits and endpoint.client is not None:
            endpoint.target = (endpoint.client.getpeername()[0], port)
            server.counts["connections"] += 1
        endpoint.reply(request, payload)

    def _move(self, endpoint: Endpoint, request: Request, values: tuple[Any, ...]) -> None:
        server, is_async = self._server, len(values) > 8 and values[8]
        status = "invalid"
        if not is_async:
            status = server.arm.move(request.command_id, values[0], values[1])
        if status == "started":
            self._moves[request.command_id] = request
            server.counts["motions"] += 1
        endpoint.reply(request, bytes([server.protocol.move[status]]))

    def _set(self, name: str, values: tuple[Any, ...]) -> str:
        """Set a parameter; return the status of the request."""
        server, numbers = self._server, np.array(values, dtype=np.float64)
        if server.arm.motion is not None:
            return "not_possible"
        if not np.isfinite(numbers).all():
            return "invalid"
        if name == "SetCollisionBehavior":
            if (numbers < 0.0).any():
                return "invalid"
            server.arm.thresholds = Thresholds.from_numbers(numbers)
        elif name == "SetJointImpedance":
            if not ((numbers >= 0.0) & (numbers <= MAX_STIFFNESS)).all():
                return "invalid"
            server.arm.set_stiffness(np.maximum(numbers, MIN_STIFFNESS))
        elif name == "SetLoad":
            server.writer.set_load(float(numbers[0]), numbers[1:4], numbers[4:])
        elif name in ("SetEEToK", "SetNEToEE"):
            pose = numbers.reshape(4, 4).T
            if not _is_rigid(pose):
                return "invalid"
            key = "T_EE_K" if name == "SetEEToK" else "T_NE_EE"
            server.writer.set_frames(**{key: pose})
        return "success"

    def _model(self, name: str, values: tuple[Any, ...]) -> bytes:
        """Return the payload with the model of the arm."""
        missing = self._server.faults.connection("no_model")
        if name == "GetRobotModel":
            return bytes([0]) + (b"" if missing else robot_urdf().encode())
        library = None if missing or values != (0, 0) else model_library()
        return bytes([1]) if library is None else bytes([0]) + library


def _is_rigid(pose: Any) -> bool:
    """Return True if a matrix (4, 4) is a rotation and a translation."""
    rotation = pose[:3, :3]
    return bool(
        np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)
        and np.allclose(pose[3], (0.0, 0.0, 0.0, 1.0))
    )
