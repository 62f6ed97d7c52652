"""Requests to the gripper over TCP; replies to motions come when they are complete."""

from __future__ import annotations

import socket
import struct
from typing import Any

from articulate_deploy.wire.endpoints import Endpoint
from articulate_deploy.wire.faults import FaultPlan
from articulate_deploy.wire.gripper import MAX_FORCE_N, GripperCommand, GripperMechanism
from articulate_deploy.wire.messages import (
    GRIPPER_COMMANDS,
    GRIPPER_PAYLOADS,
    GRIPPER_STATUS,
    GRIPPER_VERSION,
    Request,
)

_NAMES = {number: name for name, number in GRIPPER_COMMANDS.items()}
_HOMING_SPEED_M_S = 0.1
"""Speed of the opening in homing [m/s]."""


class GripperRequests:
    """Handler of the gripper's requests."""

    def __init__(self, mechanism: GripperMechanism) -> None:
        """Act on ``mechanism``."""
        self._mechanism = mechanism
        self._pending: Request | None = None
        self._message_id = 0

    def receive(self, endpoint: Endpoint, source: socket.socket, faults: FaultPlan) -> None:
        """Handle what arrived at a socket of ``endpoint``."""
        if source is endpoint.udp:
            endpoint.datagrams()
        elif source is endpoint.listener:
            if endpoint.accept() is not None and faults.connection("no_gripper"):
                endpoint.disconnect()
        else:
            requests = endpoint.receive()
            if requests is None:
                endpoint.disconnect()
                self._pending = None
                return
            for request in requests:
                self._handle(endpoint, request)

    def finish(self, endpoint: Endpoint, status: str) -> None:
        """Reply to the pending request if its motion is complete."""
        if status and self._pending is not None:
            self._reply(endpoint, self._pending, status)
            self._pending = None

    def send_state(self, endpoint: Endpoint) -> None:
        """Send a state to the client."""
        if endpoint.target is not None:
            self._message_id += 1
            endpoint.send_state(self._mechanism.state(self._message_id))

    def _reply(self, endpoint: Endpoint, request: Request, status: str) -> None:
        endpoint.reply(request, struct.pack("<H", GRIPPER_STATUS[status]))

    def _handle(self, endpoint: Endpoint, request: Request) -> None:
        name = _NAMES.get(request.command, "")
        layout = GRIPPER_PAYLOADS.get(name)
        if layout is None or layout.size != len(request.payload):
            endpoint.disconnect()
            return
        values = layout.unpack(request.payload)
        if name == "Connect":
            fits = values[0] == GRIPPER_VERSION
            if fits and endpoint.client is not None:
                endpoint.target = (endpoint.client.getpeername()[0], values[1])
            endpoint.reply(request, struct.pack("<HH", 0 if fits else 1, GRIPPER_VERSION))
            return
        if self._pending is not None:
            self._reply(endpoint, self._pending, "aborted")
            self._pending = None
        if name == "Stop":
            self._mechanism.stop()
            self._reply(endpoint, request, "success")
            return
        status = self._mechanism.begin(_command(name, values))
        if status:
            self._reply(endpoint, request, status)
        else:
            self._pending = request


def _command(name: str, values: tuple[Any, ...]) -> GripperCommand:
    """Return the command of a request."""
    if name == "Homing":
        return GripperCommand(name, 0.0, _HOMING_SPEED_M_S)
    if name == "Move":
        return GripperCommand(name, values[0], values[1])
    width, inner, outer, speed, force = values
    force = min(force, MAX_FORCE_N)
    return GripperCommand(name, width, speed, force, inner_m=inner, outer_m=outer)
