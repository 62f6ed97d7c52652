"""Sockets of the simulated robot: a TCP listener, one client, and a UDP socket for its states."""

from __future__ import annotations

import contextlib
import socket

from articulate.errors import UsageError
from articulate_deploy.wire.messages import Request, Stream

_BUFFER = 1 << 20
"""Size of the buffers of UDP sockets [bytes]: a state of version 5 has 2,373."""


class Endpoint:
    """Port that serves one client at a time."""

    def __init__(self, address: str, port: int, header: str) -> None:
        """Listen at ``address``.

        Raises:
            UsageError: The address cannot be used or another process listens there.
        """
        self._header = header
        self.client: socket.socket | None = None
        self.target: tuple[str, int] | None = None
        """Address to which states are sent, after ``Connect``."""
        self.listener: socket.socket | None = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        try:
            self.listener.bind((address, port))
            self.udp.bind((address, 0))
        except OSError as error:
            self.close()
            raise UsageError(
                f"--address {address}: port {port} cannot be used ({error.strerror}); "
                "give another loopback address, such as 127.0.0.3"
            ) from None
        self.listener.listen(4)
        self.listener.setblocking(False)
        self.udp.setblocking(False)
        self._stream = Stream(header)

    def sockets(self) -> list[socket.socket]:
        """Return the sockets on which data can arrive, a client that leaves before the next one."""
        return [s for s in (self.client, self.udp, self.listener) if s is not None]

    def accept(self) -> socket.socket | None:
        """Accept a connection; it becomes the client, or is closed if one is connected already.

        A client that offered another version stays open while it connects again (franka-rs).
        """
        assert self.listener is not None
        try:
            connection, _ = self.listener.accept()
        except OSError:
            return None
        if self.target is not None:
            connection.close()
            return None
        self.disconnect()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.client, self._stream = connection, Stream(self._header)
        return connection

    def receive(self) -> list[Request] | None:
        """Return the requests that arrived; None if the client left or sent what is no message."""
        assert self.client is not None
        try:
            data = self.client.recv(65536)
            return self._stream.add(data) if data else None
        except (OSError, ValueError):
            return None

    def reply(self, request: Request, payload: bytes) -> None:
        """Reply to a request; a client that left is ignored."""
        self.send_raw(self._stream.reply(request, payload))

    def send_raw(self, data: bytes) -> None:
        """Send bytes over TCP."""
        if self.client is not None:
            with contextlib.suppress(OSError):
                self.client.sendall(data)

    def send_state(self, data: bytes) -> None:
        """Send a state to the client."""
        if self.target is not None:
            with contextlib.suppress(OSError):
                self.udp.sendto(data, self.target)

    def datagrams(self) -> list[bytes]:
        """Return the datagrams that arrived."""
        out = []
        with contextlib.suppress(OSError):
            while True:
                out.append(self.udp.recv(4096))
        return out

    def stop_listening(self) -> None:
        """Close the listener: further connections fail."""
        if self.listener is not None:
            self.listener.close()
            self.listener = None

    def disconnect(self) -> None:
        """Close the client's connection."""
        if self.client is not None:
            self.client.close()
        self.client, self.target = None, None

    def close(self) -> None:
        """Close all sockets."""
        self.disconnect()
        self.stop_listening()
        self.udp.close()
