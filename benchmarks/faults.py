"""Inject faults of 20 kinds into the simulated robot during episodes of ``deploy``.

Checks after each fault: the arm is at rest, no limit was violated, the error has the expected
class, the recording is readable and complete, and no command arrived after the stop. Each result is
one line of ``--out``, so the same command continues after an interruption.

    python benchmarks/faults.py cabinet.zip --count 1000 --out faults.jsonl
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.task.manifest import Manifest
from articulate_deploy.arms.client import ClientSpec
from articulate_deploy.arms.connection import LOCKSTEP_S, START_S
from articulate_deploy.arms.errors import (
    ArmError,
    ArmUnreachableError,
    CommunicationLostError,
    ReflexError,
    UserStopError,
    VersionMismatchError,
)
from articulate_deploy.bundle import load_bundle
from articulate_deploy.episode_log import EpisodeLog, read_log
from articulate_deploy.robots.arm import ArmOptions, ArmRobot
from articulate_deploy.robots.robot import GRIPPER_KEY, action_dict, read_keys
from articulate_deploy.wire import SimulatedArm

STEPS = 24
"""Control steps of an episode."""
SILENT_S = 4.0
"""Longest time until a client is connected, for a silent controller [s]."""
REST_RAD_S = 0.01
"""Speed below which a joint is at rest [rad/s]."""
OWN = "communication_constraints_violation"
"""Error of the arm for 20 commands in a row that are lost."""
CONTACT = ("joint_reflex", "cartesian_reflex")
"""Errors of the arm for contacts."""
HANGING = ("silent", "truncated_reply")
"""Faults of the connection for which the client hangs."""


@dataclass(frozen=True)
class Case:
    """One kind of fault."""

    error: type[ArmError]
    """Expected class."""
    names: tuple[str, ...] = ()
    """Violations that the arm itself reports."""
    fields: tuple[tuple[str, Any], ...] = ()
    """Further fields of the fault."""
    before: bool = False
    """True if the client cannot connect."""
    text: str = ""
    """Part of the message."""


LOST = CommunicationLostError
PUSH = (0.0, 0.0, 0.0, -60.0, 0.0, 0.0, 0.0)
CASES = {
    "silent": Case(ArmUnreachableError, before=True, text="no answer"),
    "close": Case(LOST, before=True, text="connection was lost"),
    "wrong_version": Case(VersionMismatchError, before=True, text="version 7"),
    "no_states": Case(LOST, before=True, text="connection was lost"),
    "wrong_state_size": Case(LOST, before=True, text="connection was lost"),
    "short_header": Case(LOST, before=True, text="connection was lost"),
    "truncated_reply": Case(ArmUnreachableError, before=True, text="no answer"),
    "no_gripper": Case(LOST, before=True, text="(gripper)"),
    "drop_commands": Case(LOST, (OWN,), (("count", 25),), text="too many packets"),
    "delay_commands": Case(LOST, (OWN,), (("count", 25),), text="too many packets"),
    "drop_states": Case(LOST, (OWN,), (("count", 25),)),
    "delay_states": Case(LOST, (OWN,), (("count", 25), ("delay", 30))),
    "reorder_states": Case(LOST, (OWN,), (("count", 25),)),
    "stall": Case(LOST, (OWN,), (("seconds", 1.3),)),
    "reflex": Case(ReflexError, ("cartesian_reflex",), (("error", "cartesian_reflex"),)),
    "self_collision": Case(
        ReflexError,
        ("self_collision_avoidance_violation",),
        (("kind", "reflex"), ("error", "self_collision_avoidance_violation")),
        text="self_collision_avoidance_violation",
    ),
    "user_stop": Case(UserStopError, text="user stop"),
    "disconnect": Case(LOST, (OWN,), text="connection was lost"),
    "silence": Case(LOST, (OWN,), text="connection was lost"),
    "external_torque": Case(
        ReflexError, CONTACT, (("count", 0), ("torque", PUSH)), text="with the reflex"
    ),
}
"""Kinds of faults and what is expected."""


class Bench:
    """Simulated arm, and a client that stays connected while it can."""

    def __init__(self, manifest: Manifest, arm: SimulatedArm, folder: Path) -> None:
        self.manifest, self.arm, self.folder = manifest, arm, folder
        self.q = np.asarray(manifest.start.q)
        self.robot: ArmRobot | None = None

    def connect(self, start_s: float = LOCKSTEP_S) -> ArmRobot:
        """Return the connected robot."""
        if self.robot is None:
            robot = ArmRobot(
                self.manifest,
                ClientSpec("panda-python", self.arm.address),
                ArmOptions(lockstep=True, start_s=start_s),
            )
            robot.connect()
            self.robot = robot
        return self.robot

    def disconnect(self) -> None:
        """Disconnect."""
        robot, self.robot = self.robot, None
        if robot is not None:
            robot.disconnect()

    def settle(self) -> bool:
        """Wait until the arm is at rest; return False if it does not come to rest."""
        for _ in range(2000):
            if np.abs(self.arm.status()["dq"]).max() < REST_RAD_S:
                return True
            time.sleep(0.01)
        return False

    def restore(self) -> None:
        """Clear the fault, and place the arm at its start."""
        self.arm.clear_faults()
        self.arm.release_user_stop()
        self.arm.recover()
        self.settle()
        self.arm.reset_to(self.q)


def before_connecting(bench: Bench, kind: str) -> tuple[Exception | None, int, int]:
    """Inject a fault of the connection and connect; return the error, no steps and no rows."""
    bench.disconnect()
    bench.arm.inject(kind)
    try:
        bench.connect(SILENT_S if kind in HANGING else START_S)
    except ArmError as error:
        return error, 0, 0
    bench.disconnect()
    return None, 0, 0


def in_episode(
    bench: Bench, kind: str, case: Case, index: int, rng: np.random.Generator
) -> tuple[Exception | None, int, int]:
    """Inject a fault into an episode; return the error, the steps sent and the rows recorded."""
    robot = bench.connect()
    robot.reset_to(bench.q, 0.08)
    fields = {"kind": kind, **dict(case.fields)}
    bench.arm.inject(fields.pop("kind"), after=int(rng.integers(50, 900)), **fields)
    log, sent, failed = EpisodeLog(bench.folder, index), 0, None
    target = bench.q
    try:
        for step in range(STEPS):
            observed = robot.get_observation()
            target = target + rng.uniform(-0.01, 0.01, 7)
            robot.send_action(action_dict(target, 0.08))
            sent += 1
            log.add(
                time_s=step * bench.manifest.control.step_s,
                joint_pos=read_keys(observed),
                target=target,
                gripper_width_m=observed[GRIPPER_KEY],
            )
        robot.stop()
    except ArmError as error:
        failed = error
    log.close()
    rows = len(read_log(log.path)["target"]) if sent else 0
    log.path.unlink(missing_ok=True)
    return failed, sent, rows


def run_fault(bench: Bench, kind: str, index: int) -> dict[str, Any]:
    """Inject one fault and return what was found."""
    case, rng = CASES[kind], np.random.default_rng([index, 55])
    begin, before = time.perf_counter(), bench.arm.status()
    if case.before:
        error, sent, rows = before_connecting(bench, kind)
    else:
        error, sent, rows = in_episode(bench, kind, case, index, rng)
    at_rest, after = bench.settle(), bench.arm.status()
    time.sleep(0.02)
    last = bench.arm.status()

    def more(name: str, first: dict[str, Any], second: dict[str, Any]) -> dict[str, int]:
        return dict(Counter(second[name]) - Counter(first[name]))

    violations = more("violations", before, after)
    others = set(violations) - set(case.names)
    moves = more("counts", after, last)
    checks = {
        "stopped": at_rest and after["robot_mode"] != 2,
        "limits": not others,
        "named": type(error) is case.error and case.text in str(error),
        "recorded": rows == sent,
        "silent": not moves.get("motions") and not moves.get("outside_motion"),
    }
    if error is not None and not isinstance(error, (ReflexError, UserStopError)):
        bench.disconnect()
    bench.restore()
    return {
        "index": index,
        "kind": kind,
        "passed": all(checks.values()),
        "failed": [name for name, passed in checks.items() if not passed],
        "error": f"{type(error).__name__}: {error}",
        "violations": violations,
        "rows": rows,
        "seconds": round(time.perf_counter() - begin, 2),
    }


def finished(path: Path) -> list[dict[str, Any]]:
    """Return the results in a file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def main() -> None:
    """Inject the faults that are missing and print a summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bundle", type=Path, help="bundle of a policy")
    parser.add_argument("--count", type=int, default=1000, help="number of faults")
    parser.add_argument("--kinds", nargs="*", default=list(CASES), help="kinds of faults")
    parser.add_argument("--out", type=Path, required=True, help="file of the results (JSON lines)")
    parser.add_argument(
        "--address", default="127.0.0.21", help="loopback address of the simulated robot"
    )
    flags = parser.parse_args()
    done = {row["index"] for row in finished(flags.out)}
    manifest = load_bundle(flags.bundle).manifest
    with (
        tempfile.TemporaryDirectory() as folder,
        SimulatedArm(None, flags.address, protocol=5) as arm,
        flags.out.open("a") as out,
    ):
        bench = Bench(manifest, arm, Path(folder))
        bench.restore()
        for index in range(flags.count):
            kind = list(CASES)[index % len(CASES)]
            if index in done or kind not in flags.kinds:
                continue
            row = run_fault(bench, kind, index)
            out.write(json.dumps(row) + "\n")
            out.flush()
        bench.disconnect()
    rows = finished(flags.out)
    kinds = sorted({row["kind"] for row in rows})
    passed = {k: sum(r["passed"] for r in rows if r["kind"] == k) for k in kinds}
    print(json.dumps({"faults": len(rows), "passed": sum(passed.values()), "kinds": passed}))


if __name__ == "__main__":
    main()
