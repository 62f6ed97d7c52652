"""Open the drawer of a bundle with unmodified clients of the simulated robot, over FCI.

Each client runs in a child process with a deadline. It gets only the address and a trajectory,
which comes from the true pose of the handle. Episode k has the parameters of ``deploy``.

    python benchmarks/wire_clients.py BUNDLE --python VENV/bin/python --episodes 20
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from articulate.robot.kinematics import solve_ik
from articulate.task.manifest import Manifest
from articulate.task.object_placement import handle_path_of, object_pose
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array
from articulate_deploy.bundle import load_bundle
from articulate_deploy.episode import start_of
from articulate_deploy.plan import make_plan
from articulate_deploy.wire import SimulatedArm

BACK_M = 0.08
"""Distance from the handle at which the straight approach begins [m]."""
BEYOND = 0.05
"""Distance by which the pull continues beyond the target, as a fraction of the joint's range."""
DEADLINE_S = 240.0
"""Longest time of a client [s]; a client hangs for ever on a silent robot."""

_PREAMBLE = """
import json, sys, time
import numpy as np
address, folder = sys.argv[1:3]
segments = [np.load(f"{folder}/{name}.npy") for name in ("approach", "pull")]
FORCE, TORQUE = [60.0] * 6, [60.0] * 7
"""
CLIENTS = {
    "panda-python": _PREAMBLE
    + """
from panda_py import libfranka as f
robot, gripper = f.Robot(address, f.RealtimeConfig.kIgnore), f.Gripper(address)
robot.set_collision_behavior(*[TORQUE] * 4, *[FORCE] * 4)
def run(rows):
    time_s = 0.0
    def callback(state, period):
        nonlocal time_s
        time_s += period.to_sec()
        k = min(round(1000 * time_s), len(rows) - 1)
        out = f.JointPositions(rows[k])
        out.motion_finished = k == len(rows) - 1
        return out
    robot.control_joint_position(callback, f.ControllerMode.kJointImpedance, True, 1000.0)
run(segments[0])
gripper.grasp(0.0, 0.1, 60.0, 0.08, 0.08)
run(segments[1])
""",
    "pylibfranka": _PREAMBLE
    + """
import pylibfranka as f
robot, gripper = f.Robot(address, f.RealtimeConfig.kIgnore), f.Gripper(address)
robot.set_collision_behavior(TORQUE, TORQUE, FORCE, FORCE)
def run(rows):
    control = robot.start_joint_position_control(f.ControllerMode.JointImpedance)
    time_s, k = 0.0, 0
    while k < len(rows) - 1:
        state, period = control.readOnce()
        time_s += period.to_sec()
        k = min(round(1000 * time_s), len(rows) - 1)
        out = f.JointPositions(rows[k].tolist())
        out.motion_finished = k == len(rows) - 1
        control.writeOnce(out)
run(segments[0])
gripper.grasp(0.0, 0.1, 60.0, 0.08, 0.08)
run(segments[1])
""",
    "franka-rs": _PREAMBLE
    + """
import franka
robot = franka.Robot(address, realtime="ignore")
gripper = robot.gripper()
robot.set_collision_behavior_simple(TORQUE, TORQUE, FORCE, FORCE)
def run(rows):
    with robot.joint_targets(fraction=0.3, backend="robot") as arm:
        first, k = arm.state().time, 0
        while k < len(rows) + 700 and arm.running:
            k = round(1000 * (arm.state().time - first))
            arm.move_to(rows[min(k, len(rows) - 1)].tolist())
            time.sleep(0.0005)
        arm.stop()
run(segments[0])
gripper.grasp(0.0, 0.1, 60.0, 0.08, 0.08)
run(segments[1])
""",
    "franky": _PREAMBLE
    + """
import franky as f
robot = f.Robot(address, realtime_config=f.RealtimeConfig.Ignore)
gripper = f.Gripper(address)
robot.set_collision_behavior(TORQUE, TORQUE, FORCE, FORCE)
robot.relative_dynamics_factor = f.RelativeDynamicsFactor(0.2, 0.1, 0.05)
def run(rows):
    # Ruckig of the public package takes no waypoints: stop at each of some.
    for k in np.linspace(0, len(rows) - 1, 6).round().astype(int)[1:]:
        robot.move(f.JointMotion(f.JointState([float(v) for v in rows[k]])))
run(segments[0])
gripper.grasp(0.0, 0.1, 60.0, epsilon_inner=0.08, epsilon_outer=0.08)
run(segments[1])
""",
}
"""Programs by the name of the client; they get the address and a folder with two arrays (T, 7)."""
PAIRS: tuple[tuple[str, int], ...] = (
    ("panda-python", 5),
    ("franka-rs", 5),
    ("franka-rs", 10),
    ("pylibfranka", 10),
)
"""Clients and protocols that are measured by default."""


@dataclass(frozen=True)
class Trial:
    """Result of one episode with one client."""

    opened: float
    """Fraction open at the end."""
    violations: dict[str, int]
    """Violations of the arm's limits by name."""
    lost: int
    """Commands that did not arrive."""
    cycles: int
    """Control cycles of the arm."""
    wall_s: float
    """Duration in wall-clock time [s]."""
    error: str
    """Last line of a client that failed."""


def min_jerk(path: Array, seconds: float) -> Array:
    """Return the joint path (K, 7) as a trajectory at 1 kHz (T, 7) from rest to rest."""
    s = np.linspace(0.0, 1.0, round(1000 * seconds) + 1)
    s = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    spline = CubicSpline(np.linspace(0.0, 1.0, len(path)), path)
    return np.asarray(spline(s))


def trajectory(manifest: Manifest, params: EpisodeParams) -> tuple[Array, Array]:
    """Return the trajectories at 1 kHz (T, 7) of the approach and of the pull [rad]."""
    path = handle_path_of(manifest.object, manifest.task.joint, flip=manifest.placement.flip)
    T_wo = object_pose(
        manifest.object,
        manifest.task.joint,
        manifest.placement,
        scale=np.ones(1),
        shift=np.stack([params["x_m"], params["y_m"]], axis=1),
        yaw=params["yaw_rad"],
    )

    def grasp(opened: float, back_m: float = 0.0) -> Array:
        T = path.in_world(T_wo=T_wo, scale=np.ones(1), opened=np.array([opened])).copy()
        T[:, :3, 3] -= back_m * T[:, :3, 2]
        return T

    start = start_of(manifest, params)
    closed = float(params["part_open"][0])
    goals = [grasp(closed, back) for back in np.linspace(BACK_M, 0.0, 9)]
    end = manifest.task.target + BEYOND
    goals += [grasp(opened) for opened in np.linspace(closed, end, 25)[1:]]
    q, rows = start, []
    for goal in goals:
        found = solve_ik(manifest.robot, goal, q, iterations=100, rest_gain=0.0)
        if found.pos_error[0] > 2e-3:
            raise ValueError(f"the handle is out of reach by {found.pos_error[0]:.3f} m")
        q = found.q[0]
        rows.append(q)
    reach = min_jerk(np.linspace(start, rows[0], 3), 1.5)
    advance, pull = min_jerk(np.array(rows[:9]), 1.0), min_jerk(np.array(rows[8:]), 2.5)
    return np.concatenate([reach, advance[1:]]), pull


def run_trial(arm: SimulatedArm, python: str, client: str, approach: Array, pull: Array) -> Trial:
    """Run one client once on a simulated arm that was reset."""
    before, count, begin = arm.violations, arm.counts, time.perf_counter()
    error = ""
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "approach.npy", approach)
        np.save(Path(folder) / "pull.npy", pull)
        command = [python, "-c", CLIENTS[client], arm.address, folder]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=DEADLINE_S, check=False
            )
            if done.returncode != 0:
                error = (done.stderr.strip().splitlines() or ["exit " + str(done.returncode)])[-1]
        except subprocess.TimeoutExpired:
            error = f"no end within {DEADLINE_S:g} s"
    after = arm.counts
    found = {
        name: n - before.get(name, 0)
        for name, n in arm.violations.items()
        if n > before.get(name, 0)
    }
    return Trial(
        opened=float(arm.object_state().opened[0]),
        violations=found,
        lost=after.get("lost", 0) - count.get("lost", 0),
        cycles=after.get("cycles", 0) - count.get("cycles", 0),
        wall_s=time.perf_counter() - begin,
        error=error,
    )


def run_client(
    bundle: Path, client: str, protocol: int, *, python: str, episodes: int, address: str
) -> list[Trial]:
    """Return the trials of a client on the first episodes of a bundle."""
    loaded = load_bundle(bundle)
    manifest, plan = loaded.manifest, make_plan(loaded, episodes, seed=None, randomise=True)
    trials = []
    with SimulatedArm(bundle, address, protocol=protocol) as arm:
        for k in range(episodes):
            params = plan.params(k)
            approach, pull = trajectory(manifest, params)
            arm.set_episode_params(params)
            arm.reset_to(approach[0], manifest.start.gripper_width_m)
            trials.append(run_trial(arm, python, client, approach, pull))
            if arm.status()["errors"]:
                arm.recover()
            print(client, protocol, k, trials[-1], flush=True)
    return trials


def main() -> None:
    """Run the clients and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bundle", type=Path, help="bundle of a policy")
    parser.add_argument("--python", default=sys.executable, help="interpreter with the clients")
    parser.add_argument("--episodes", type=int, default=20, help="episodes of each client")
    parser.add_argument(
        "--address", default="127.0.0.20", help="loopback address of the simulated robot"
    )
    parser.add_argument("--clients", nargs="*", help="pairs such as franka-rs:10")
    args = parser.parse_args()
    pairs = PAIRS
    if args.clients:
        pairs = tuple((p.split(":")[0], int(p.split(":")[1])) for p in args.clients)
    target = load_bundle(args.bundle).manifest.task.target
    rows = {}
    for client, protocol in pairs:
        trials = run_client(
            args.bundle,
            client,
            protocol,
            python=args.python,
            episodes=args.episodes,
            address=args.address,
        )
        rows[f"{client} on protocol {protocol}"] = {
            "opened": sum(t.opened >= target and not t.error for t in trials),
            "episodes": len(trials),
            "limit_faults": sum(sum(t.violations.values()) for t in trials),
            "lost_commands": sum(t.lost for t in trials),
            "times_real_time": sum(t.cycles for t in trials) / 1e3 / sum(t.wall_s for t in trials),
        }
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
