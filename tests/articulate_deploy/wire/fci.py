"""Client of Franka's control interface in a few lines, for tests of the server."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import time

import numpy as np

from articulate_deploy.wire.messages import (
    ARM_PORT,
    GRIPPER_COMMANDS,
    GRIPPER_HEADER,
    GRIPPER_PAYLOADS,
    GRIPPER_PORT,
    GRIPPER_STATE,
    PAYLOADS,
    PROTOCOLS,
)


def address(number):
    """Return a loopback address that no other process of the tests uses."""
    pid = os.getpid()
    return f"127.{20 + pid % 200}.{pid // 200 % 250}.{number}"


class Channel:
    """TCP and UDP sockets of a client."""

    def __init__(self, address, port, header):
        self.header = struct.Struct(header)
        self.tcp = socket.create_connection((address, port), timeout=10.0)
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.settimeout(1.0)
        self.ids = 0
        self.buffer = b""
        self.replies = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.tcp.close()
        self.udp.close()

    def send(self, number, payload):
        self.ids += 1
        size = self.header.size + len(payload)
        self.tcp.sendall(self.header.pack(number, self.ids, size) + payload)
        return self.ids

    def reply(self, command_id):
        """Wait for the next reply to a request and return its payload."""
        while True:
            for k, (found, payload) in enumerate(self.replies):
                if found == command_id:
                    del self.replies[k]
                    return payload
            data = self.tcp.recv(65536)
            if not data:
                raise ConnectionError("closed")
            self.buffer += data
            while len(self.buffer) >= self.header.size:
                _, number, size = self.header.unpack_from(self.buffer)
                if len(self.buffer) < size:
                    break
                self.replies.append((number, self.buffer[self.header.size : size]))
                self.buffer = self.buffer[size:]


class ArmClient(Channel):
    """Client of the arm."""

    def __init__(self, address, version=5, connect=True):
        super().__init__(address, ARM_PORT, "<III")
        self.protocol = PROTOCOLS[version]
        self.last = None
        if connect:
            assert self.connect() == (0, version)

    def connect(self):
        port = self.udp.getsockname()[1]
        payload = self.request("Connect", self.protocol.version, port)
        return struct.unpack("<BH", payload)

    def request(self, name, *values):
        layout = self.protocol.move_request if name == "Move" else PAYLOADS[name]
        return self.reply(self.send(self.protocol.commands[name], layout.pack(*values)))

    def move(self, controller=0, generator=0):
        """Request a motion; return the command id and the name of the status."""
        values: tuple[float, ...] = (controller, generator, 10.0, 3.12, 6.28, 10.0, 3.12, 6.28)
        if self.protocol.version == 10:
            values += (0, *[1.0] * 7)
        layout = self.protocol.move_request
        number = self.send(self.protocol.commands["Move"], layout.pack(*values))
        return number, self.status(self.reply(number))

    def status(self, payload):
        return {n: name for name, n in self.protocol.move.items()}[payload[0]]

    def state(self, newer=True):
        """Return the next state; older ones than the last are discarded."""
        while True:
            data, self.source = self.udp.recvfrom(4096)
            kind = self.protocol.state_type
            assert len(data) == kind.itemsize
            state = np.frombuffer(data, kind)[0]
            if self.last is None or state["message_id"] > self.last or not newer:
                self.last = int(state["message_id"])
                return state

    def state_with(self, **fields):
        """Return the first state with these values."""
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            state = self.state()
            if all(state[name] == value for name, value in fields.items()):
                return state
        raise AssertionError(f"no state with {fields}")

    def command(self, state, *, finished=False, **fields):
        """Answer a state."""
        record = np.zeros(1, self.protocol.command_type)
        record["message_id"] = state["message_id"]
        record["motion_generation_finished"] = finished
        for name, value in fields.items():
            record[name] = value
        self.udp.sendto(record.tobytes(), self.source)

    def run(self, targets, *, controller=0, generator=0, field="q_c", offset=True, pause=None):
        """Run a motion through ``targets`` (T, 7); return its states and the status of its end."""
        number, status = self.move(controller, generator)
        if status != "started":
            return [], status
        state = self.state_with(motion_generator_mode=generator + 1)
        first = np.array(state["q_d"], dtype=float) if offset else 0.0
        states = []
        for k, target in enumerate(targets):
            if state["robot_mode"] != 2:
                break
            if pause is not None:
                pause(k)
            last = k == len(targets) - 1
            self.command(state, finished=last, **{field: first + target})
            state = self.state()
            states.append(state)
        return states, self.status(self.reply(number))


class GripperClient(Channel):
    """Client of the gripper."""

    def __init__(self, address):
        super().__init__(address, GRIPPER_PORT, GRIPPER_HEADER)
        port = self.udp.getsockname()[1]
        assert struct.unpack("<HH", self.request("Connect", 3, port)) == (0, 3)

    def begin(self, name, *values):
        return self.send(GRIPPER_COMMANDS[name], GRIPPER_PAYLOADS[name].pack(*values))

    def request(self, name, *values):
        return self.reply(self.begin(name, *values))

    def status(self, name, *values):
        return struct.unpack("<H", self.request(name, *values))[0]

    def state(self):
        """Return the next state; those that arrived before are discarded."""
        self.udp.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                self.udp.recv(64)
        self.udp.settimeout(5.0)
        return GRIPPER_STATE.unpack(self.udp.recv(64))


def bump(steps=200, size=0.004):
    """A motion of joint 1 out and back, from rest to rest (T, 7) [rad]."""
    t = np.linspace(0.0, 1.0, steps + 1)[1:]
    out = np.zeros((steps, 7))
    out[:, 0] = size * (64.0 * (t * (1.0 - t)) ** 3)
    return out
