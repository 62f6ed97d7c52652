"""Parent's end of a client's child process."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from articulate.errors import ArticulateError, ConfigError
from articulate_deploy.arms.client import ClientInfo, ClientSpec
from articulate_deploy.arms.errors import KINDS, ArmError, CommunicationLostError, silent_error

START_S = 15.0
"""Longest time until a client is connected [s], its import included."""
REQUEST_S = 10.0
"""Longest time of a request that moves nothing [s]."""
LOCKSTEP_S = 600.0
"""Each of these times for a simulated robot in lockstep [s]: its results do not depend on the speed
of the computer, so a busy one must not end the motion."""
MODULE = "articulate_deploy.arms.process"


class ClientProcess:
    """Child process of one client."""

    def __init__(self, spec: ClientSpec, *, start_s: float = START_S, module: str = MODULE) -> None:
        """Start the process and connect.

        Args:
            spec: Client and address.
            start_s: Longest time until it is connected [s].
            module: Module to run.

        Raises:
            ArmError: The controller does not answer or rejects the client.
        """
        self.address = spec.address
        self._request_s = start_s if start_s > START_S else REQUEST_S
        ours, theirs = socket.socketpair()
        self._lock = threading.Lock()
        self._child = subprocess.Popen(
            [sys.executable, "-m", module, str(theirs.fileno())],
            pass_fds=(theirs.fileno(),),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C goes to the parent, which stops the arm
        )
        theirs.close()
        self._link = Connection(ours.detach())
        try:
            self.send(spec)
            self.info: ClientInfo = self.result(start_s)
        except BaseException:
            self.close()
            raise

    def send(self, message: Any) -> None:
        """Send a message from any thread."""
        with self._lock:
            try:
                self._link.send(message)
            except OSError:
                raise self._ended() from None

    def request(self, *message: Any, seconds: float = 0.0) -> Any:
        """Send a request and return its result, after at most ``seconds`` if they are given."""
        self.send(message)
        return self.result(seconds or self._request_s)

    def result(self, seconds: float) -> Any:
        """Return the result of the last request; states that arrive before it are dropped."""
        while True:
            reply = self.receive(seconds)
            if reply[0] == "done":
                return reply[1]

    def receive(self, seconds: float) -> tuple[Any, ...]:
        """Return the next message of the child.

        Raises:
            ArmError: It is an error, none arrives, or the child ended.
        """
        try:
            if not self._link.poll(seconds):
                raise silent_error(self.address, seconds)
            reply: tuple[Any, ...] = self._link.recv()
        except (EOFError, OSError):
            raise self._ended() from None
        if reply[0] == "error":
            raise _raised(reply[1], reply[2])
        return reply

    def has_message(self) -> bool:
        """Return whether a message of the child is there."""
        try:
            return self._link.poll()
        except (EOFError, OSError):
            return True  # receive raises the error

    def close(self) -> None:
        """End the process; kill it if it does not end."""
        with suppress(OSError, ArmError):
            self.send(("close",))
        self._link.close()
        try:
            self._child.wait(1.0)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()

    def _ended(self) -> ArmError:
        return CommunicationLostError(f"{self.address}: the client's process ended")


def _raised(kind: str, text: str) -> ArticulateError:
    if kind in KINDS:
        return KINDS[kind](text)
    return ConfigError(text) if kind == "usage" else ArticulateError(text)
