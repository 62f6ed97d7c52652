"""Simulated arm for tests and tools: a server in a child process or a thread, and its handle."""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from articulate.errors import ConfigError, UsageError
from articulate.robot.arm import PANDA
from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array
from articulate_deploy.robots.robot import Sample
from articulate_deploy.wire.control_channel import ControlHandler
from articulate_deploy.wire.faults import Fault
from articulate_deploy.wire.messages import PROTOCOLS
from articulate_deploy.wire.physics import BareArm, Physics
from articulate_deploy.wire.server import Server, ServerOptions

START_S = 120.0
"""Longest time until a server is ready [s]: it compiles the scene."""
CALL_S = 60.0
"""Longest time of a call [s]."""


class SimulatedArm:
    """Simulated arm and gripper that serve Franka's control interface on a loopback address.

    Use it as a context manager; several run at once on 127.0.0.2, 127.0.0.3, and so on.
    """

    def __init__(
        self,
        bundle: Path | None,
        address: str = "127.0.0.2",
        *,
        protocol: int = 5,
        lockstep: bool = True,
        max_rate: float = 0.0,
        gripper: bool = True,
        grasped_width_m: float = 0.0,
        in_process: bool = False,
    ) -> None:
        """Keep the options; :meth:`start` or ``with`` starts the server.

        Args:
            bundle: Policy bundle whose scene is served, None for a bare arm.
            address: IPv4 address; clients connect to its ports 1337 and 1338.
            protocol: Version of the arm's protocol, 5 (Panda) or 10 (FR3).
            lockstep: Advance with each command of the client; otherwise in wall-clock time.
            max_rate: Largest speed in lockstep relative to real time, 0 for none.
            gripper: Serve the gripper.
            grasped_width_m: Width of a rigid object in the gripper of a bare arm [m].
            in_process: Run in a thread of this process instead of a child process.

        Raises:
            ConfigError: The protocol is unknown.
        """
        if protocol not in PROTOCOLS:
            known = ", ".join(str(version) for version in PROTOCOLS)
            raise ConfigError(f"--protocol {protocol}: unknown; choose one of {known}")
        self._options = {
            "bundle": None if bundle is None else str(bundle),
            "address": address,
            "protocol": protocol,
            "lockstep": lockstep,
            "max_rate": max_rate,
            "gripper": gripper,
            "grasped_width_m": grasped_width_m,
        }
        self.address = address
        self._in_process = in_process
        self._lock = threading.Lock()
        self._child: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._connection: socket.socket | None = None
        self._buffer = b""

    def start(self) -> Self:
        """Start the server and return when clients can connect.

        Raises:
            UsageError: The bundle or the address cannot be used.
        """
        ours, theirs = socket.socketpair()
        self._connection, self._buffer = ours, b""
        if self._in_process:
            self._thread = threading.Thread(
                target=serve, args=(theirs, self._options), daemon=True, name="simulated-arm"
            )
            self._thread.start()
        else:
            self._log = tempfile.TemporaryFile()  # noqa: SIM115  closed by close()
            module = "articulate_deploy.wire.simulated_arm"
            command = [sys.executable, "-m", module]
            command += [str(theirs.fileno()), json.dumps(self._options)]
            self._child = subprocess.Popen(
                command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, stderr=self._log
            )
            theirs.close()
        try:
            self._read(START_S)
        except BaseException:
            self.close()
            raise
        return self

    def close(self) -> None:
        """Stop the server."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        if self._child is not None:
            try:
                self._child.wait(5.0)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()
            self._child = None
            self._log.close()
        if self._thread is not None:
            self._thread.join(5.0)
            self._thread = None

    def __enter__(self) -> Self:
        """Start the server."""
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the server."""
        self.close()

    def reset_to(self, q: Array, width_m: float = PANDA.gripper.max_width_m) -> None:
        """Place the arm at rest at ``q`` (7,) [rad] with an opening [m], the object at its start.

        Raises:
            UsageError: A motion is in progress.
        """
        self._call("reset_to", q=np.asarray(q).tolist(), width_m=float(width_m))

    def set_episode_params(self, params: EpisodeParams) -> None:
        """Set the parameters of the next episodes (one row), from :meth:`reset_to` on."""
        self._call("set_episode_params", values=params.values[0].tolist())
        self._call("set_gripper_latency", seconds=float(params["gripper_latency_s"][0]))

    def object_state(self) -> Estimate:
        """Return the true state of the object, one row."""
        value = self._call("object_state")
        return Estimate(**{name: np.array(numbers) for name, numbers in value.items()})

    def take_samples(self) -> list[Sample]:
        """Return the samples of motions since the last call, at the rate of training."""
        return [
            Sample(
                dq=np.array(row["dq"]),
                torque=np.array(row["torque"]),
                wrench=np.array(row["wrench"]),
                touch=row["touch"],
                dt=row["dt"],
            )
            for row in self._call("take_samples")
        ]

    def inject(self, kind: str, **fields: Any) -> None:
        """Inject a fault; see :class:`articulate_deploy.wire.faults.Fault`."""
        Fault(kind=kind, **fields)
        self._call("inject", kind=kind, **fields)

    def clear_faults(self) -> None:
        """Remove all faults and the external torque."""
        self._call("clear_faults")

    def set_external_torque(self, torque: Array) -> None:
        """Set a torque of the surroundings on the arm (7,) [Nm]."""
        self._call("set_external_torque", torque=np.asarray(torque).tolist())

    def set_gripper_latency(self, seconds: float) -> None:
        """Set the time from a command of the gripper to its motion [s]."""
        self._call("set_gripper_latency", seconds=seconds)

    def press_user_stop(self) -> None:
        """Press the user stop."""
        self._call("press_user_stop")

    def release_user_stop(self) -> None:
        """Release the user stop."""
        self._call("release_user_stop")

    def trigger(self, error: str = "joint_reflex") -> None:
        """Stop with an error; see :data:`articulate_deploy.wire.messages.ERRORS`."""
        self._call("trigger", error=error)

    def recover(self) -> str:
        """Clear the errors of a reflex, as ``AutomaticErrorRecovery``; return its status."""
        return str(self._call("recover"))

    def status(self) -> dict[str, Any]:
        """Return mode, errors, counts, violations, joints, opening and settings."""
        value: dict[str, Any] = self._call("status")
        return value

    @property
    def counts(self) -> Mapping[str, int]:
        """Number of motions, cycles, lost and late commands, and ends of motions by status."""
        counts: dict[str, int] = self.status()["counts"]
        return counts

    @property
    def violations(self) -> Mapping[str, int]:
        """Number of violations by the name of the error."""
        violations: dict[str, int] = self.status()["violations"]
        return violations

    def periods_s(self) -> Array:
        """Return the periods of the last cycles in wall-clock time (N,) [s]."""
        return np.array(self._call("periods"))

    def _call(self, name: str, **arguments: Any) -> Any:
        if self._connection is None:
            raise UsageError("the simulated arm is not running; use it in a with statement")
        request = json.dumps({"call": name, "arguments": arguments}).encode() + b"\n"
        with self._lock:
            self._connection.sendall(request)
            return self._read(CALL_S)

    def _read(self, seconds: float) -> Any:
        assert self._connection is not None
        self._connection.settimeout(seconds)
        while b"\n" not in self._buffer:
            try:
                data = self._connection.recv(1 << 20)
            except TimeoutError:
                data = b""
            if not data:
                raise UsageError(f"the simulated arm at {self.address} ended{self._last_line()}")
            self._buffer += data
        line, self._buffer = self._buffer.split(b"\n", 1)
        answer = json.loads(line)
        if "error" in answer:
            raise UsageError(answer["error"])
        return answer["value"]

    def _last_line(self) -> str:
        """Return the last line that the child process printed."""
        if self._child is None:
            return ""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(2.0)
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return f" ({lines[-1][:200]})" if lines else ""


def make_physics(bundle: str | None, grasped_width_m: float = 0.0) -> Physics:
    """Return the scene of the bundle at a path, or a bare arm.

    Raises:
        BundleError: The bundle cannot be used.
    """
    if bundle is None:
        return BareArm(np.array(PANDA.home), grasped_width_m=grasped_width_m)
    from articulate_deploy.bundle import load_bundle  # late: a bare arm needs neither
    from articulate_deploy.wire.scene_physics import ScenePhysics

    return ScenePhysics(load_bundle(Path(bundle)))


def serve(connection: socket.socket, options: dict[str, Any]) -> None:
    """Serve until ``connection`` closes; report over it when clients can connect."""
    with connection:
        options = dict(options)
        try:
            physics = make_physics(options.pop("bundle"), options.pop("grasped_width_m"))
            server = Server(physics, ServerOptions(**options))
        except UsageError as error:
            connection.sendall(json.dumps({"error": str(error)}).encode() + b"\n")
            return
        server.add_control(connection, ControlHandler(server, connection))
        connection.sendall(b'{"value": null}\n')
        server.run()


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])), json.loads(sys.argv[2]))
