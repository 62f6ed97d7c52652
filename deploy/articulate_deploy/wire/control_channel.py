"""Control connection between a test and the server: one JSON object a line, in both directions.

It carries what no client of the arm sees: the true state of the object, faults, a new episode.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate_deploy.wire.faults import Fault
from articulate_deploy.wire.messages import ERROR
from articulate_deploy.wire.server import Server


class ControlHandler:
    """Handler of the calls of :class:`articulate_deploy.wire.simulated_arm.SimulatedArm`."""

    def __init__(self, server: Server, connection: socket.socket) -> None:
        """Serve ``connection``; its end closes the server."""
        self._server, self._connection, self._buffer = server, connection, b""
        self._calls: dict[str, Callable[..., Any]] = {
            "reset_to": self._reset_to,
            "set_episode_params": self._set_episode_params,
            "object_state": self._object_state,
            "take_samples": self._take_samples,
            "inject": self._inject,
            "clear_faults": self._clear_faults,
            "set_external_torque": self._set_external_torque,
            "set_gripper_latency": self._set_gripper_latency,
            "press_user_stop": server.arm.press_user_stop,
            "release_user_stop": server.arm.release_user_stop,
            "trigger": self._trigger,
            "recover": server.arm.recover,
            "status": self._status,
            "periods": self._periods,
        }

    def __call__(self) -> bool:
        """Handle what arrived; return False at the end of the connection."""
        try:
            data = self._connection.recv(65536)
        except OSError:
            data = b""
        if not data:
            self._server.is_closing = True
            return False
        self._buffer += data
        *lines, self._buffer = self._buffer.split(b"\n")
        for line in lines:
            self._connection.sendall(json.dumps(self._answer(line)).encode() + b"\n")
        return True

    def _answer(self, line: bytes) -> dict[str, Any]:
        request = json.loads(line)
        try:
            return {"value": self._calls[request["call"]](**request["arguments"])}
        except UsageError as error:
            return {"error": str(error)}

    def _reset_to(self, q: list[float], width_m: float) -> None:
        if self._server.arm.motion is not None:
            raise UsageError("a motion is in progress; end it before reset_to")
        self._server.physics.reset_to(np.array(q), width_m)
        self._server.reset()

    def _set_episode_params(self, values: list[float]) -> None:
        params = EpisodeParams(np.array(values, dtype=np.float64).reshape(1, len(COLUMNS)))
        self._server.physics.set_episode_params(params)

    def _object_state(self) -> dict[str, Any]:
        state = self._server.physics.object_state()
        return {
            "T_wh": state.T_wh.tolist(),
            "opened": state.opened.tolist(),
            "speed": state.speed.tolist(),
        }

    def _take_samples(self) -> list[dict[str, Any]]:
        return [
            {
                "dq": sample.dq.tolist(),
                "torque": sample.torque.tolist(),
                "wrench": sample.wrench.tolist(),
                "touch": bool(sample.touch),
                "dt": sample.dt,
            }
            for sample in self._server.physics.take_samples()
        ]

    def _inject(self, **fields: Any) -> None:
        if "torque" in fields:
            fields["torque"] = tuple(fields["torque"])
        self._server.faults.inject(Fault(**fields))

    def _clear_faults(self) -> None:
        self._server.faults.clear()
        self._server.arm.is_persistent = False
        self._server.physics.set_external_torque(np.zeros(7))

    def _set_external_torque(self, torque: list[float]) -> None:
        self._server.physics.set_external_torque(np.array(torque))

    def _set_gripper_latency(self, seconds: float) -> None:
        self._server.mechanism.latency_s = seconds

    def _trigger(self, error: str) -> None:
        self._server.arm.fault(ERROR[error])

    def _status(self) -> dict[str, Any]:
        server = self._server
        return {
            "message_id": server.writer.message_id,
            "robot_mode": server.arm.robot_mode,
            "errors": sorted(server.arm.errors),
            "counts": dict(server.counts),
            "violations": dict(server.arm.violations),
            "q": server.measured.q.tolist(),
            "q_d": server.arm.q_d.tolist(),
            "dq": server.measured.dq.tolist(),
            "width_m": server.measured.width_m,
            "is_grasped": server.mechanism.is_grasped,
            "wrench": server.measured.external_wrench.tolist(),
            "stiffness": server.arm.stiffness.tolist(),
            "upper_force": server.arm.thresholds.upper_force_nominal.tolist(),
            "upper_torque": server.arm.thresholds.upper_torque_nominal.tolist(),
        }

    def _periods(self) -> list[float]:
        return np.diff(self._server.periods_s).tolist()
