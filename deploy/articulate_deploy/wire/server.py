"""Server of the simulated robot: one loop for the arm's cycle, its requests and its gripper.

In lockstep, the server waits for the command that answers a state, then advances the physics by one
cycle and sends the next state: every command counts, no matter how slow client and computer are.
The wait ends when the client sends a request that ends the motion, or leaves.
Time is frozen while the arm is at rest. In wall-clock time a cycle takes 1 ms, and a command that
arrives later is lost, as on the arm.
"""

from __future__ import annotations

import select
import socket
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate_deploy.wire.arm_requests import ArmRequests
from articulate_deploy.wire.endpoints import Endpoint
from articulate_deploy.wire.faults import FaultPlan
from articulate_deploy.wire.gripper import STATE_CYCLES, GripperMechanism
from articulate_deploy.wire.gripper_requests import GripperRequests
from articulate_deploy.wire.limits import LIMITS, STEP_S
from articulate_deploy.wire.messages import (
    ARM_PORT,
    ERROR,
    GRIPPER_HEADER,
    GRIPPER_PORT,
    PROTOCOLS,
)
from articulate_deploy.wire.motion import AT_REST_RAD_S, ArmController
from articulate_deploy.wire.physics import Physics
from articulate_deploy.wire.robot_state import StateWriter

POLL_S = 1.0
"""Time between checks of the connection while a command is awaited in lockstep [s]."""
START_WAIT_S = 0.5
"""Wait for the first command of a motion after each state in lockstep [s]."""
MAX_BEHIND_S = 0.003
"""Delay after which the schedule of wall-clock time starts again [s]: a busy computer slows the
arm's clock down instead of sending many states at once."""


@dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """Options of a server."""

    address: str
    """Address at which it listens."""
    protocol: int = 5
    """Version of the arm's protocol."""
    lockstep: bool = True
    """Advance with each command; otherwise 1 ms for each cycle."""
    max_rate: float = 0.0
    """Largest speed in lockstep relative to real time, 0 for none."""
    gripper: bool = True
    """Serve the gripper."""


class Server:
    """Simulated arm and gripper on one address."""

    def __init__(self, physics: Physics, options: ServerOptions) -> None:
        """Listen at the address of ``options``.

        Raises:
            UsageError: The address cannot be used.
        """
        self.physics, self.options = physics, options
        self.protocol = PROTOCOLS[options.protocol]
        self.measured = physics.measure()
        self.arm = ArmController(LIMITS[options.protocol], lockstep=options.lockstep)
        self.arm.hold(self.measured.q)
        self.writer, self.faults = StateWriter(self.protocol, physics.flange_pose), FaultPlan()
        self.mechanism = GripperMechanism(physics.max_width_m)
        self.mechanism.reset_to(self.measured.width_m)
        self.counts: Counter[str] = Counter()
        self.periods_s: list[float] = []
        """Durations of the last cycles in wall-clock time [s]."""
        self._endpoint = Endpoint(options.address, ARM_PORT, "<III")
        self._gripper: Endpoint | None = None
        if options.gripper:
            try:
                self._gripper = Endpoint(options.address, GRIPPER_PORT, GRIPPER_HEADER)
            except BaseException:
                self._endpoint.close()
                raise
        self._requests = ArmRequests(self)
        self._gripper_requests = GripperRequests(self.mechanism)
        self._control: list[tuple[socket.socket, Any]] = []
        self._commands: list[Any] = []
        self._handled, self._send_next, self._is_muted = 0, True, False
        self._held_states: list[tuple[int, bytes]] = []
        self._next_s = time.perf_counter()
        self.is_closing = False

    def add_control(self, control: socket.socket, handler: Any) -> None:
        """Call ``handler`` when data arrives at ``control``; it returns False at its end."""
        self._control.append((control, handler))

    def close(self) -> None:
        """Close all sockets."""
        self._endpoint.close()
        if self._gripper is not None:
            self._gripper.close()

    def run(self) -> None:
        """Serve until the control connection closes."""
        try:
            self._next_s = time.perf_counter()
            while not self.is_closing:
                self._cycle()
        finally:
            self.close()

    def reset(self) -> None:
        """Continue from the state of the physics, after it was placed."""
        self.measured = self.physics.measure()
        self.arm.hold(self.measured.q)
        self.mechanism.reset_to(self.measured.width_m)

    def _cycle(self) -> None:
        started = self.arm.motion is not None and self.arm.motion.started
        if self._send_next:
            self._send_state(started)
        command = self._collect(started)
        if self.options.lockstep and command is not None:
            self._handled = int(command["message_id"])
            self._send_next = self._handled >= self.writer.message_id
        else:
            self._handled, self._send_next = self.writer.message_id, True
        self._inject(started)
        self._advance(self._filtered(command))
        self.report_ended()

    def _advance(self, command: Any | None) -> None:
        lost = self.arm.lost
        drive = self.arm.cycle(command, self.measured)
        self.counts["lost"] += self.arm.lost - lost
        motion = self.arm.motion
        in_motion = motion is not None and motion.started
        if in_motion:
            self.faults.cycle += 1
        else:
            self.faults.cycle = 0
        is_at_rest = not in_motion and not self.mechanism.is_busy
        is_at_rest = is_at_rest and np.abs(self.measured.dq).max() < AT_REST_RAD_S
        if not (self.options.lockstep and is_at_rest):
            fingers = self.mechanism.drive()
            self.measured = self.physics.step(drive, fingers, in_motion=in_motion)
            self.counts["cycles"] += 1
            self.arm.check_contact(self.measured)
            status = self.mechanism.update(self.measured.width_m)
            if self._gripper is not None:
                self._gripper_requests.finish(self._gripper, status)
        if self._gripper is not None and self.writer.message_id % STATE_CYCLES == 0:
            self._gripper_requests.send_state(self._gripper)

    def report_ended(self) -> None:
        """Reply to the requests of motions that ended."""
        for command_id, status in self.arm.ended:
            self.counts[status] += 1
            if not self._is_muted:
                self._requests.end_motion(self._endpoint, command_id, status)
        self.arm.ended.clear()

    def _send_state(self, started: bool) -> None:
        data = self.writer.write(self.arm, self.measured)
        number, faults = self.writer.message_id, self.faults
        if self._is_muted or faults.connection("no_states"):
            return
        if faults.connection("wrong_state_size"):
            data = data[:-1]
        if started and faults.active("drop_states"):
            self.counts["dropped_states"] += 1
            return
        late = faults.active("delay_states") if started else None
        swapped = faults.active("reorder_states") if started else None
        if late is not None or swapped is not None:
            delay = late.delay if late is not None else 1
            self._held_states.append((number + delay, data))
        else:
            self._endpoint.send_state(data)
        for due, held in [entry for entry in self._held_states if entry[0] <= number]:
            self._held_states.remove((due, held))
            self._endpoint.send_state(held)

    def _collect(self, started: bool) -> Any | None:
        """Return the command for this cycle, or None; serve requests meanwhile."""
        if self.options.lockstep:
            return self._collect_in_lockstep(started)
        self._next_s += STEP_S
        now = time.perf_counter()
        if now - self._next_s > MAX_BEHIND_S:
            self._next_s = now + STEP_S
        found = None
        while True:
            self._serve(max(self._next_s - time.perf_counter(), 0.0))
            for command in self._pop_commands():
                if int(command["message_id"]) == self.writer.message_id:
                    found = command
                else:
                    self.counts["late"] += 1
            if time.perf_counter() >= self._next_s:
                break
        self.periods_s.append(time.perf_counter())
        del self.periods_s[:-20_000]
        return found

    def _collect_in_lockstep(self, started: bool) -> Any | None:
        motion = self.arm.motion
        wait_s = STEP_S if motion is None else np.inf if started else START_WAIT_S
        if started and self._answer_is_impossible():
            wait_s = 0.0
        end = time.perf_counter() + wait_s
        while True:
            for k, command in enumerate(self._commands):
                if self._handled < int(command["message_id"]) <= self.writer.message_id:
                    del self._commands[: k + 1]
                    self._pace()
                    return command
                self.counts["late"] += 1
            self._commands.clear()
            left = end - time.perf_counter()
            if left <= 0.0 or self.is_closing or (motion is not self.arm.motion):
                self._serve(0.0)
                return None
            self._serve(min(left, POLL_S))

    def _answer_is_impossible(self) -> bool:
        """Return True if a fault keeps the last state or its answer from arriving."""
        names = ("drop_states", "delay_states", "reorder_states")
        return self._is_muted or any(self.faults.active(name) for name in names)

    def _pace(self) -> None:
        """Sleep if lockstep is faster than its largest rate."""
        if self.options.max_rate > 0.0:
            now = time.perf_counter()
            self._next_s = max(self._next_s + STEP_S / self.options.max_rate, now - MAX_BEHIND_S)
            if self._next_s > now:
                time.sleep(self._next_s - now)

    def _pop_commands(self) -> list[Any]:
        commands, self._commands = self._commands, []
        return commands

    def _serve(self, seconds: float) -> None:
        """Handle what arrives within ``seconds``; return after the first of it."""
        gripper = self._gripper
        sockets = self._endpoint.sockets() + (gripper.sockets() if gripper is not None else [])
        sockets += [control for control, _ in self._control]
        ready, _, _ = select.select(sockets, [], [], seconds)
        for source in ready:
            if source is self._endpoint.udp:
                self._receive_commands()
            elif source is self._endpoint.listener:
                self._requests.accept(self._endpoint)
            elif source is self._endpoint.client:
                self._requests.receive(self._endpoint)
            elif gripper is not None and source in gripper.sockets():
                self._gripper_requests.receive(gripper, source, self.faults)
            else:
                for control, handler in list(self._control):
                    if source is control and not handler():
                        self._control.remove((control, handler))

    def _receive_commands(self) -> None:
        kind = self.protocol.command_type
        for data in self._endpoint.datagrams():
            if len(data) != kind.itemsize:
                self.counts["wrong_size"] += 1
                continue
            if self.arm.motion is None:
                self.counts["outside_motion"] += 1
                continue
            self._commands.append(np.frombuffer(data, kind)[0])

    def _inject(self, started: bool) -> None:
        """Let the faults of a motion happen."""
        faults = self.faults
        if not started:
            return
        stall = faults.begins("stall")
        if stall is not None:
            time.sleep(stall.seconds)
        reflex = faults.begins("reflex")
        if reflex is not None:
            self.arm.fault(ERROR[reflex.error])
            self.arm.is_persistent = reflex.persistent
        if faults.begins("user_stop") is not None:
            self.arm.press_user_stop()
        if faults.begins("silence") is not None:
            self._is_muted = True
        if faults.begins("disconnect") is not None:
            self._endpoint.disconnect()
            self.client_left()
        press = faults.active("external_torque")
        self.physics.set_external_torque(np.zeros(7) if press is None else np.array(press.torque))

    def _filtered(self, command: Any | None) -> Any | None:
        """Return the command, or None if a fault drops it."""
        for name in ("drop_commands", "delay_commands"):
            if command is not None and self.faults.active(name) is not None:
                self.counts["dropped_commands"] += 1
                return None
        return command

    def client_left(self) -> None:
        """Stop a motion whose client left; the arm reports lost communication."""
        self._is_muted = False
        if self.arm.motion is not None:
            self.arm.fault(ERROR["communication_constraints_violation"])
            self.arm.ended.clear()
