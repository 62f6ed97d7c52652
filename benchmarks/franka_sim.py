"""Run the arm's driver against the public ``franka-sim`` with its limits enforced.

    python -m venv VENV && VENV/bin/pip install franka-sim
    python benchmarks/franka_sim.py cabinet.zip --python VENV/bin/python --motions 20 --json

``franka-sim`` has its own reading of protocol 10 and of the limits of the FR3, so it is an
independent check of the drivers. It needs a separate environment and runs in wall-clock time. At
its first start it downloads a model of the FR3; ``FR3_MJCF`` names a local one instead. Each motion
is a slow ramp to a sampled start, then two seconds of targets that change at the rate of a policy.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import ArticulateError
from articulate.transforms import Array
from articulate_deploy.arm_deployment import common_limits
from articulate_deploy.arms.client import ClientSpec
from articulate_deploy.bundle import load_bundle
from articulate_deploy.robots.arm import ArmRobot
from articulate_deploy.robots.robot import action_dict

ADDRESS, PORT = "127.0.0.1", 1337
START_S = 120.0
"""Longest time until the server listens [s]; at its first start it downloads a model."""
SERVER = "from franka_sim.run_server import main; main()"
ENFORCED = ("--enforce-motion-limits", "--enforce-comm-constraints")
START_RAD, TARGET_RAD = 0.15, 0.02
"""Largest offset of a start, and largest change of a target in a control step [rad]."""
STEPS = 40
"""Control steps of each motion."""


@contextmanager
def server(python: Path, log: Path) -> Iterator[None]:
    """Run ``franka-sim`` with the interpreter ``python``; its output goes to ``log``.

    Raises:
        RuntimeError: It does not listen in time.
    """
    with log.open("w", encoding="utf-8") as stream:
        child = subprocess.Popen([python, "-c", SERVER, *ENFORCED], stdout=stream, stderr=stream)
        try:
            end = time.monotonic() + START_S
            while not _listens():
                if child.poll() is not None or time.monotonic() > end:
                    raise RuntimeError(f"franka-sim does not run: {_last_line(log)}")
                time.sleep(0.2)
            yield
        finally:
            child.terminate()
            child.wait()


def _listens() -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((ADDRESS, PORT)) == 0


def _last_line(path: Path) -> str:
    lines = path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    return lines[-1] if lines else "no output"


def run_motion(robot: ArmRobot, start: Array, rng: np.random.Generator, wide_m: float) -> None:
    """Ramp to a sampled start near ``start`` (7,) [rad], then follow sampled targets."""
    q = start + rng.uniform(-START_RAD, START_RAD, 7)
    robot.reset_to(q, wide_m)
    target = q.copy()
    for _ in range(STEPS):
        target = np.clip(target + rng.uniform(-TARGET_RAD, TARGET_RAD, 7), q - 0.1, q + 0.1)
        robot.send_action(action_dict(target, wide_m))
    robot.stop()


def measure(bundle: Path, client: str, n_motions: int, seed: int) -> list[dict[str, Any]]:
    """Return one row for each motion; an aborted one has its error."""
    manifest = load_bundle(bundle).manifest
    manifest = replace(manifest, robot=common_limits(manifest.robot, "fr3"))
    rng, start = np.random.default_rng(seed), np.array(manifest.start.q)
    wide_m, rows = manifest.robot.gripper.max_width_m, []
    for k in range(n_motions):
        row: dict[str, Any] = {"motion": k, "error": None}
        try:
            with ArmRobot(manifest, ClientSpec(client, ADDRESS), name="fr3") as robot:
                run_motion(robot, start, rng, wide_m)
                row |= robot.statistics[-1]
        except ArticulateError as error:
            row["error"] = str(error)
        rows.append(row)
        sys.stderr.write(f"motion {k}: {row}\n")
    return rows


def main() -> None:
    """Start the server, run the motions, print the number of aborts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bundle", type=Path, help="bundle whose start and control stack are used")
    parser.add_argument(
        "--python", type=Path, required=True, help="interpreter with franka-sim installed"
    )
    parser.add_argument("--client", default="franka-rs", help="franka-rs or pylibfranka")
    parser.add_argument("--motions", type=int, default=20, help="number of motions")
    parser.add_argument("--seed", type=int, default=0, help="seed of the motions")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    flags = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as folder, server(flags.python, Path(folder) / "log"):
        rows = measure(flags.bundle, flags.client, flags.motions, flags.seed)
    aborts = sum(row["error"] is not None for row in rows)
    if flags.json:
        print(json.dumps({"client": flags.client, "aborts": aborts, "rows": rows}, indent=1))
    else:
        print(f"{flags.client}: {aborts} aborts in {len(rows)} motions")


if __name__ == "__main__":
    main()
