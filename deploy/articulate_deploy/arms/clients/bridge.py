"""Client of a bridge to any other controller; see :mod:`articulate_deploy.arms.bridge_messages`."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import msgpack
import zmq

from articulate_deploy.arms.bridge_messages import PORT, VERSION, decode_state
from articulate_deploy.arms.client import ArmSettings, ArmState, ClientInfo, Motion

TIMEOUT_S = 1.0
"""Longest wait for a reply [s]."""
GRIPPER_S = 10.0
"""Longest time of a command to the gripper [s]."""
POLL_S = 0.05
"""Time between requests for the opening [s]."""


class BridgeConnection:
    """Requests to a bridge."""

    def __init__(self, address: str) -> None:
        """Connect to ``address``, optionally with a port."""
        self._socket: Any = zmq.Context.instance().socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, int(TIMEOUT_S * 1e3))
        self._socket.setsockopt(zmq.SNDTIMEO, int(TIMEOUT_S * 1e3))
        where = address if ":" in address else f"{address}:{PORT}"
        self._socket.connect(f"tcp://{where}")

    def call(self, name: str, **arguments: Any) -> dict[str, Any]:
        """Send a request and return the reply.

        Raises:
            RuntimeError: No reply arrives, or it is an error.
        """
        try:
            self._socket.send(msgpack.packb({"call": name, **arguments}))
            reply = msgpack.unpackb(self._socket.recv())
        except zmq.Again:
            raise RuntimeError(f"bridge: timeout of {name}") from None
        if not isinstance(reply, dict) or "ok" not in reply:
            raise RuntimeError("bridge: protocol error, a reply has no key ok")
        if not reply["ok"]:
            raise RuntimeError(str(reply.get("error", "command rejected")))
        return reply

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()


class BridgeClient:
    """See :class:`articulate_deploy.arms.client.ArmClient`."""

    def __init__(self, address: str) -> None:
        """Keep the address."""
        self._bridge = BridgeConnection(address)

    def connect(self) -> ClientInfo:
        """Check the version of the bridge."""
        reply = self._bridge.call("hello", version=VERSION)
        if reply.get("version") != VERSION:
            raise RuntimeError(f"Incompatible library version (server version: {reply['version']})")
        return ClientInfo(f"bridge to {reply.get('name', 'a controller')}", 0)

    def read_state(self) -> ArmState:
        """Return the present state."""
        return decode_state(self._bridge.call("state")["state"])

    def configure(self, settings: ArmSettings) -> tuple[str, ...]:
        """Write settings and compare them with those that the bridge reports."""
        wanted = {
            "stiffness": list(settings.stiffness),
            "damping": list(settings.damping),
            "torque_max": list(settings.torque_max),
            "collision_force_n": settings.collision_force_n,
            "collision_torque_nm": settings.collision_torque_nm,
        }
        found = self._bridge.call("settings", **wanted).get("settings", {})
        for name, value in wanted.items():
            if found.get(name) != value:
                raise RuntimeError(f"command rejected: the bridge did not take {name}")
        return ("the bridge confirmed gains and thresholds",)

    def run(self, motion: Motion) -> None:
        """Run a motion: one set point for each state."""
        state, finished = decode_state(self._bridge.call("begin")["state"]), False
        while not finished:
            if state.mode not in {"idle", "move"}:
                raise RuntimeError(f"aborted by {state.mode} {list(state.errors)}")
            set_point, finished = motion.set_point(state)
            reply = self._bridge.call("target", q=set_point.tolist())
            state = decode_state(reply["state"])
        self._bridge.call("end")

    def recover(self) -> None:
        """Clear the errors of a reflex."""
        self._bridge.call("recover")

    def close(self) -> None:
        """Disconnect."""
        self._bridge.close()


class BridgeGripper:
    """See :class:`articulate_deploy.arms.gripper.GripperClient`.

    Commands and readings come from different threads, so each has its own connection.
    """

    def __init__(self, address: str) -> None:
        """Connect."""
        self._address = address
        self._reading = BridgeConnection(address)
        self._reading.call("width")

    def grasp(self, width: float, speed: float, force: float, inner: float, outer: float) -> bool:
        """Close on an object."""
        return self._command("grasp", width=width, speed=speed, force=force)

    def move(self, width: float, speed: float) -> bool:
        """Move the fingers to an opening."""
        return self._command("move", width=width, speed=speed, force=0.0)

    def homing(self) -> bool:
        """Measure the range of the fingers."""
        return self._command("homing", width=0.0, speed=0.0, force=0.0)

    def read_once(self) -> Any:
        """Return the opening."""
        time.sleep(POLL_S)
        return SimpleNamespace(width=float(self._reading.call("width")["width"]))

    def _command(self, command: str, **arguments: float) -> bool:
        """Send a command and wait until the gripper is at rest."""
        connection = BridgeConnection(self._address)
        try:
            done = bool(connection.call("gripper", command=command, **arguments)["done"])
            end_s = time.monotonic() + GRIPPER_S
            while connection.call("width")["busy"] and time.monotonic() < end_s:
                time.sleep(POLL_S)
            return done
        finally:
            connection.close()
