"""Kill an episode of ``deploy`` at random control steps, and read its recording.

Each episode runs in a child process, which reports the number of each step once it is recorded. It
is ended by SIGKILL after a random step. The recording must then have every reported step, except
for at most one. Each result is one line of ``--out``, so the same command continues after an
interruption.

    python benchmarks/recording_kills.py BUNDLE --kills 200 --out kills.jsonl
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import struct
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from articulate.transforms import Array
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.episode import run_episode, start_of
from articulate_deploy.episode_log import EpisodeLog, read_log
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.plan import Plan, make_plan
from articulate_deploy.policy_runner import Policy
from articulate_deploy.robots import robot_named
from articulate_deploy.robots.robot import SimulatedRobot

STEP = struct.Struct("<I")
MAX_STEP = 120
"""Last step at which an episode is killed."""
MAX_DELAY_S = 0.01
"""Longest time between a step and the kill [s]: kills fall between steps and into writes."""


class ReportedLog(EpisodeLog):
    """Recording that reports each step through a pipe."""

    pipe = -1
    reported = 0

    def add(self, **values: Array | float) -> None:
        """Record a step, then report its number."""
        super().add(**values)
        self.reported += 1
        os.write(self.pipe, STEP.pack(self.reported))


def run_child(
    bundle: Bundle, robot: SimulatedRobot, plan: Plan, k: int, folder: Path, pipe: int
) -> None:
    """Run episode ``k`` in this process."""
    params, noise = plan.params(k), plan.noise(k)
    manifest = bundle.manifest
    robot.set_episode_params(params, force_noise_n=plan.config.force_noise_n, noise=noise)
    robot.reset_to(start_of(manifest, params), manifest.start.gripper_width_m)
    log = ReportedLog(folder, k)
    log.pipe = pipe
    estimator = TruthEstimator(robot, plan.config, manifest.task, params, noise)
    run_episode(Policy(bundle), robot, estimator, manifest, recording=log)


def kill_once(
    bundle: Bundle, robot: SimulatedRobot, plan: Plan, index: int, folder: Path
) -> dict[str, Any]:
    """Run an episode, kill it and return what the recording has."""
    rng = np.random.default_rng([index, 9])
    step, delay_s = int(rng.integers(1, MAX_STEP)), float(rng.uniform(0.0, MAX_DELAY_S))
    k = index % len(plan.episode_params.values)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        try:
            run_child(bundle, robot, plan, k, folder, writer)
        finally:
            os._exit(1)
    os.close(writer)
    reported = 0
    with os.fdopen(reader, "rb", buffering=0) as stream:
        while reported < step and (data := stream.read(STEP.size)):
            (reported,) = STEP.unpack(data)
        time.sleep(delay_s)
        os.kill(child, signal.SIGKILL)
        while data := stream.read(STEP.size):
            (reported,) = STEP.unpack(data)
    os.waitpid(child, 0)
    path = folder / f"episode_{k:04d}.log"
    rows = len(read_log(path)["target"]) if path.exists() else 0
    path.unlink(missing_ok=True)
    return {"index": index, "step": step, "reported": reported, "rows": rows}


def main() -> None:
    """Kill the episodes that are missing and print a summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bundle", type=Path, help="bundle of a policy")
    parser.add_argument("--kills", type=int, default=200, help="number of killed episodes")
    parser.add_argument("--out", type=Path, required=True, help="file of the results (JSON lines)")
    flags = parser.parse_args()
    done = flags.out.read_text().splitlines() if flags.out.exists() else []
    bundle = load_bundle(flags.bundle)
    plan = make_plan(bundle, bundle.manifest.episodes.count, seed=None, randomise=True)
    with (
        tempfile.TemporaryDirectory() as folder,
        robot_named("mujoco", bundle) as robot,
        flags.out.open("a") as out,
    ):
        for index in range(len(done), flags.kills):
            out.write(json.dumps(kill_once(bundle, robot, plan, index, Path(folder))) + "\n")
            out.flush()
    rows = [json.loads(line) for line in flags.out.read_text().splitlines()]
    lost = [row["reported"] - row["rows"] for row in rows]
    print(json.dumps({"kills": len(rows), "most_lost": max(lost), "least_lost": min(lost)}))


if __name__ == "__main__":
    main()
