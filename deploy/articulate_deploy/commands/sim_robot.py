"""``articulate sim-robot``: a simulated robot that serves Franka's control interface."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from articulate.commands import console
from articulate.commands.flags import parse
from articulate.errors import ConfigError

if TYPE_CHECKING:
    from articulate_deploy.wire.server import Server

PROTOCOLS = (5, 10)
"""Versions of the control interface that are served: Panda and FR3."""


@dataclass(frozen=True, kw_only=True)
class SimRobotFlags:
    """Serve Franka's control interface (FCI) on a loopback address, with a simulated arm behind it.

    Clients such as panda-python, franka-rs, pylibfranka and franky connect without changes.

    Example: articulate sim-robot --scene cabinet.zip --protocol 5 --address 127.0.0.2
    """

    scene: Path | None = None
    """Bundle whose scene is simulated; by default a bare arm without an object."""
    protocol: int = 5
    """Version of the control interface: 5 (Panda) or 10 (FR3)."""
    address: str = "127.0.0.2"
    """Address to serve on; clients connect to its ports 1337 (arm) and 1338 (gripper)."""
    lockstep: bool = False
    """Advance with each command of the client instead of in wall-clock time."""
    max_rate: float = 0.0
    """Largest speed in lockstep relative to real time; 0 sets no limit."""
    real_time: bool = False
    """Request real-time scheduling (SCHED_FIFO), for a steady period."""
    json: bool = False
    """Print only the report as JSON on standard output."""

    def __post_init__(self) -> None:
        if self.protocol not in PROTOCOLS:
            raise ConfigError(f"--protocol {self.protocol}: unknown; choose one of 5, 10")
        if not self.max_rate >= 0.0:
            raise ConfigError(f"--max-rate is {self.max_rate}; it must be at least 0")


FLAGS = SimRobotFlags


def main(argv: Sequence[str]) -> int:
    """Serve until Ctrl-C, then print a report."""
    flags = parse(SimRobotFlags, argv, prog="articulate sim-robot")
    from articulate_deploy.arms.scheduling import real_time  # late: numpy
    from articulate_deploy.wire.server import Server, ServerOptions
    from articulate_deploy.wire.simulated_arm import make_physics

    physics = make_physics(None if flags.scene is None else str(flags.scene))
    options = ServerOptions(
        address=flags.address,
        protocol=flags.protocol,
        lockstep=flags.lockstep,
        max_rate=flags.max_rate,
    )
    server = Server(physics, options)
    pace = "lockstep" if flags.lockstep else "wall-clock time"
    with real_time() if flags.real_time else nullcontext("SCHED_OTHER") as scheduling:
        console.show_progress(
            f"serving protocol {flags.protocol} on {flags.address} in {pace}, {scheduling}; "
            "Ctrl-C stops it"
        )
        with suppress(KeyboardInterrupt):
            server.run()
    report = _report(server, scheduling)
    console.emit_json(report) if flags.json else console.emit(_text(report))
    return 0


def _report(server: Server, scheduling: str) -> dict[str, Any]:
    """Return counts, violations and the period of a cycle."""
    import numpy as np

    periods = np.diff(server.periods_s)
    p50, p99 = np.quantile(periods, (0.5, 0.99)) * 1e3 if len(periods) else (None, None)
    return {
        "counts": dict(server.counts),
        "violations": dict(server.arm.violations),
        "scheduling": scheduling,
        "period_p50_ms": p50,
        "period_p99_ms": p99,
    }


def _text(report: dict[str, Any]) -> str:
    """Return the report as lines."""
    lines = [f"{name.replace('_', ' ')}: {count}" for name, count in report["counts"].items()]
    lines += [f"violation {name}: {count}" for name, count in report["violations"].items()]
    if report["period_p50_ms"] is not None:
        p50, p99 = report["period_p50_ms"], report["period_p99_ms"]
        lines.append(f"period of a cycle: median {p50:.3f} ms, 99 % below {p99:.3f} ms")
    return "\n".join(lines)
