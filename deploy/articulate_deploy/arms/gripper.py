"""Gripper of a real arm in a child process: one command at a time, the last request wins.

The manufacturer's gripper takes about a second for each command. A ``move`` into an object blocks
for minutes, so it only opens; ``grasp`` closes. Two grasps in a row would fail, so a request that
equals the last command is dropped.
"""

from __future__ import annotations

import importlib
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from typing import Any, Protocol

from articulate.robot.arm import Gripper
from articulate_deploy.arms.client import ClientInfo, ClientSpec
from articulate_deploy.arms.connection import START_S, ClientProcess
from articulate_deploy.arms.errors import arm_error

OPEN, CLOSE = "open", "grasp"
MODULE = "articulate_deploy.arms.gripper"
GRIPPERS = {
    "panda-python": "panda_py.libfranka:Gripper",
    "pylibfranka": "pylibfranka:Gripper",
    "franka-rs": "franka:Gripper",
    "bridge": "articulate_deploy.arms.clients.bridge:BridgeGripper",
    "fake": "articulate_deploy.arms.clients.fake:FakeGripper",
}
"""Class of the gripper of each client, ``module:class``."""
EPSILON_M = 0.08
"""Tolerance of a grasp [m]: any object between the fingers is accepted."""
RETRY_S = 0.05
"""Wait after a failed reading [s]."""


class GripperClient(Protocol):
    """Blocking interface of a gripper; names of libfranka."""

    def grasp(self, width: float, speed: float, force: float, inner: float, outer: float) -> bool:
        """Close on an object."""

    def move(self, width: float, speed: float) -> bool:
        """Move the fingers to an opening."""

    def homing(self) -> bool:
        """Measure the range of the fingers."""

    def read_once(self) -> Any:
        """Return the next state."""


class GripperWorker:
    """Thread that executes the last of the requests."""

    def __init__(self, client: GripperClient, settings: Gripper) -> None:
        """Begin with an open gripper that is not commanded."""
        self._client, self._settings = client, settings
        self._wanted: str | None = None
        self._last: str | None = None
        self._condition = threading.Condition()
        self._closing = False
        self.error: Exception | None = None
        """Exception of the last command."""
        self.commands: list[str] = []
        """Commands that were executed."""
        self._thread = threading.Thread(target=self._run, daemon=True, name="gripper")
        self._thread.start()

    def request(self, command: str) -> None:
        """Request :data:`OPEN` or :data:`CLOSE`; it replaces one that waits."""
        with self._condition:
            self._wanted = command
            self._condition.notify()

    def finish(self, seconds: float) -> bool:
        """Wait until no command is left; return False after ``seconds``."""
        with self._condition:
            return self._condition.wait_for(lambda: self._wanted is None, seconds)

    def close(self) -> None:
        """End the thread after the present command."""
        with self._condition:
            self._closing = True
            self._condition.notify()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._closing or self._wanted is not None)
                if self._closing:
                    return
                command = self._wanted
            if command != self._last:
                self._last = command
                self.commands.append(str(command))
                try:
                    self._execute(str(command))
                except Exception as error:  # noqa: BLE001  clients have no common base class
                    self.error, self._last = error, None
            with self._condition:
                if self._wanted == command:
                    self._wanted = None
                    self._condition.notify_all()

    def _execute(self, command: str) -> None:
        settings = self._settings
        speed = 2.0 * settings.finger_speed_m_s  # of the opening: both fingers move
        if command == CLOSE:
            self._client.grasp(0.0, speed, settings.force_n, EPSILON_M, EPSILON_M)
        else:
            self._client.move(settings.max_width_m, speed)


class GripperProcess:
    """Parent's end of a gripper's child process."""

    def __init__(self, spec: ClientSpec, settings: Gripper, *, start_s: float = START_S) -> None:
        """Connect within ``start_s`` [s].

        Raises:
            ArmError: No gripper answers.
        """
        self._process = ClientProcess(spec, start_s=start_s, module=MODULE)
        self.width_m: float = self._process.request("begin", settings, seconds=start_s)
        """Opening that was measured last [m]."""

    def request(self, command: str) -> None:
        """Request :data:`OPEN` or :data:`CLOSE`."""
        self._process.send((command,))

    def homing(self) -> None:
        """Measure the range of the fingers; they move to their ends."""
        self.width_m = self._process.request("homing", seconds=30.0)

    def update(self) -> float:
        """Return the opening that was measured last [m].

        Raises:
            ArmError: A command failed or the connection was lost.
        """
        while self._process.has_message():
            reply = self._process.receive(0.0)
            if reply[0] == "width":
                self.width_m = reply[1]
        return self.width_m

    def finish(self, seconds: float) -> None:
        """Wait until no command is in progress, for at most ``seconds``."""
        self.width_m = self._process.request("finish", seconds, seconds=seconds + 5.0)

    def close(self) -> None:
        """End the process."""
        self._process.close()


def make_gripper(spec: ClientSpec) -> GripperClient:
    """Return a connected gripper of the client of ``spec``."""
    module, name = GRIPPERS[spec.client].split(":")
    client: Any = getattr(importlib.import_module(module), name)
    made: GripperClient = client(spec.address)
    return made


class _Server:
    """Child's end: requests, and the measured opening at each state of the gripper."""

    def __init__(self, link: Connection, client: GripperClient, settings: Gripper) -> None:
        self._link, self._client = link, client
        self._lock = threading.Lock()
        self.worker = GripperWorker(client, settings)
        self.width_m = float(client.read_once().width)
        threading.Thread(target=self._read, daemon=True, name="gripper-state").start()

    def send(self, *message: Any) -> None:
        with self._lock:
            self._link.send(message)

    def _read(self) -> None:
        while True:
            try:
                self.width_m = float(self._client.read_once().width)
                self.send("width", self.width_m)
            except (OSError, ValueError):
                return  # the pipe is closed
            except Exception:  # noqa: BLE001  a state was lost
                time.sleep(RETRY_S)

    def serve(self, spec: ClientSpec) -> None:
        while True:
            kind, *arguments = self._link.recv()
            if kind == "close":
                return
            if kind in {OPEN, CLOSE}:
                self.worker.request(kind)
                continue
            if kind == "homing":
                self._client.homing()
            elif kind == "finish":
                self.worker.finish(*arguments)
            error, self.worker.error = self.worker.error, None
            if error is not None:
                found = arm_error(str(error), spec.address)
                self.send("error", found.kind, f"{found} (gripper)")
            else:
                self.send("done", self.width_m)


def main(link: Connection) -> None:
    """Serve requests until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    spec: ClientSpec = link.recv()
    try:
        client = make_gripper(spec)
        link.send(("done", ClientInfo(spec.client, 0)))
        _, settings = link.recv()
        server = _Server(link, client, settings)
        server.send("done", server.width_m)
    except Exception as error:  # noqa: BLE001  clients have no common base class
        found = arm_error(str(error), spec.address)
        link.send(("error", found.kind, f"{found} (gripper)"))
        return
    try:
        server.serve(spec)
    except (EOFError, BrokenPipeError):
        return
    finally:
        server.worker.close()


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
