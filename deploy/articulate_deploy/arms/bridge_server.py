"""Reference bridge: serves any object with the few methods of :class:`Controller`.

Copy it to the computer of the controller and replace the controller::

    python -m articulate_deploy.arms.bridge_server 0.0.0.0

Without changes it serves an arm without contacts, for trials of ``deploy --robot bridge``. Its time
advances with each ``target``.
"""

from __future__ import annotations

import sys
from typing import Any, Protocol

import msgpack
import numpy as np
import zmq

from articulate.robot.arm import PANDA
from articulate.transforms import Array
from articulate_deploy.arms.bridge_messages import PORT, VERSION, encode_state
from articulate_deploy.arms.client import ArmState
from articulate_deploy.arms.clients.fake import INERTIA


class Controller(Protocol):
    """Controller behind a bridge."""

    name: str

    def state(self) -> ArmState:
        """Return the present state."""

    def configure(self, settings: dict[str, Any]) -> dict[str, Any]:
        """Set gains and thresholds; return the values in force."""

    def advance(self, q: Array) -> ArmState:
        """Send set points (7,) [rad] and return the state after 1 ms."""

    def move_gripper(self, command: str, width: float, speed: float, force: float) -> bool:
        """Start a command of the gripper."""

    def gripper(self) -> tuple[float, bool]:
        """Return the opening [m], and True while a command is in progress."""


class ExampleController:
    """Arm without contacts."""

    name = "example"

    def __init__(self) -> None:
        """Begin at rest in the arm's home pose."""
        self._q, self._dq, self._time_s = np.array(PANDA.home), np.zeros(7), 1.0
        self._stiffness, self._damping = np.array(PANDA.stiffness), np.array(PANDA.damping)
        self._width_m = PANDA.gripper.max_width_m

    def state(self) -> ArmState:
        """Return the present state."""
        return ArmState(self._time_s, self._q.copy(), self._dq.copy(), np.zeros(7), np.zeros(6))

    def configure(self, settings: dict[str, Any]) -> dict[str, Any]:
        """Take the gains."""
        self._stiffness = np.array(settings["stiffness"])
        self._damping = np.array(settings["damping"])
        return settings

    def advance(self, q: Array) -> ArmState:
        """Advance by 1 ms."""
        torque = self._stiffness * (q - self._q) - self._damping * self._dq
        self._dq = self._dq + torque / INERTIA * 1e-3
        self._q = self._q + self._dq * 1e-3
        self._time_s += 1e-3
        return self.state()

    def move_gripper(self, command: str, width: float, speed: float, force: float) -> bool:
        """Move at once."""
        self._width_m = width if command == "move" else 0.01
        return True

    def gripper(self) -> tuple[float, bool]:
        """Return the opening [m]."""
        return self._width_m, False


def answer(controller: Controller, request: dict[str, Any]) -> dict[str, Any]:
    """Return the reply to a request."""
    call = request.get("call")
    if call == "hello":
        return {"ok": True, "version": VERSION, "name": controller.name}
    if call in {"state", "begin", "end", "recover"}:
        return {"ok": True, "state": encode_state(controller.state())}
    if call == "settings":
        settings = {name: value for name, value in request.items() if name != "call"}
        return {"ok": True, "settings": controller.configure(settings)}
    if call == "target":
        state = controller.advance(np.array(request["q"], dtype=np.float64))
        return {"ok": True, "state": encode_state(state)}
    if call == "gripper":
        names = ("command", "width", "speed", "force")
        return {"ok": True, "done": controller.move_gripper(*(request[name] for name in names))}
    if call == "width":
        width, busy = controller.gripper()
        return {"ok": True, "width": width, "busy": busy}
    return {"ok": False, "error": f"command rejected: unknown call {str(call)[:40]!r}"}


def serve(controller: Controller, address: str = "127.0.0.1", port: int = PORT) -> None:
    """Serve requests until the process ends."""
    with zmq.Context() as context, context.socket(zmq.REP) as endpoint:
        endpoint.bind(f"tcp://{address}:{port}")
        while True:
            try:
                reply = answer(controller, msgpack.unpackb(endpoint.recv()))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                reply = {"ok": False, "error": f"command rejected: {error}"}
            endpoint.send(msgpack.packb(reply))


if __name__ == "__main__":
    serve(ExampleController(), sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1")
