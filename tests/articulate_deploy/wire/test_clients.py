"""Unmodified clients of Franka's arms on the simulated robot, each in a child process.

``FRANKY_PYTHON`` names an interpreter with franky, which cannot be loaded beside pylibfranka.
"""

import importlib.util
import os
import subprocess
import sys

import numpy as np
import pytest
from tests.articulate_deploy.wire.fci import address

from articulate.robot.arm import PANDA
from articulate_deploy.wire import SimulatedArm

DEADLINE_S = 120.0
HOME = np.array(PANDA.home)
MODULES = {"panda": "panda_py", "pylibfranka": "pylibfranka", "rust": "franka"}

PANDA_CODE = """
from panda_py import libfranka as f
import math, sys
def motion(robot, size=0.05):
    first, t = robot.read_once().q_d, 0.0
    def callback(state, period):
        nonlocal t
        t += period.to_sec()
        q = list(first)
        q[0] += size * (1 - math.cos(math.pi * min(t, 1.0))) / 2
        out = f.JointPositions(q)
        out.motion_finished = t >= 1.0
        return out
    robot.control_joint_position(callback, f.ControllerMode.kJointImpedance, True, 1000.0)
robot = f.Robot(sys.argv[1], f.RealtimeConfig.kIgnore)
"""
LIBFRANKA_CODE = """
import pylibfranka as f
import math, sys
def motion(robot, size=0.05):
    control = robot.start_joint_position_control(f.ControllerMode.JointImpedance)
    first, t = None, 0.0
    while t < 1.0:
        state, period = control.readOnce()
        first = first or list(state.q_d)
        t += period.to_sec()
        q = list(first)
        q[0] += size * (1 - math.cos(math.pi * min(t, 1.0))) / 2
        out = f.JointPositions(q)
        out.motion_finished = t >= 1.0
        control.writeOnce(out)
robot = f.Robot(sys.argv[1], f.RealtimeConfig.kIgnore)
"""
RUST_CODE = """
import franka, sys, time
import numpy as np
def motion(robot, size=0.05, backend="robot"):
    goal = np.array(robot.read_once().q_d)
    goal[0] += size
    with robot.joint_targets(fraction=0.3, backend=backend) as arm:
        first = arm.state().time
        while arm.running and arm.state().time < first + 1.5:
            try:
                arm.move_to(goal.tolist())
            except franka.FrankaError:
                break  # the motion ended; stop() raises the reason
            time.sleep(0.001)
        arm.stop()
robot = franka.Robot(sys.argv[1], realtime="ignore")
"""
CODES = {"panda": (PANDA_CODE, 5), "pylibfranka": (LIBFRANKA_CODE, 10), "rust": (RUST_CODE, 5)}


def run(code, arm, python=sys.executable):
    """Run a client's program and return what it prints; it ignores SIGINT and may hang."""
    command = [python, "-c", code, arm.address]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout.strip().splitlines()


@pytest.fixture(params=["panda", "pylibfranka", pytest.param("rust", marks=pytest.mark.slow)])
def case(request):
    """Program and protocol of an installed client."""
    if importlib.util.find_spec(MODULES[request.param]) is None:
        pytest.skip(f"{MODULES[request.param]} is not installed")
    return CODES[request.param]


@pytest.fixture
def panda():
    if importlib.util.find_spec("panda_py") is None:
        pytest.skip("panda_py is not installed")
    with SimulatedArm(None, address(121), grasped_width_m=0.02) as arm:
        yield arm


def start(protocol, **options):
    return SimulatedArm(None, address(121), protocol=protocol, **options)


def test_a_client_moves_the_arm(case):
    code, protocol = case
    with start(protocol) as arm:
        run(code + "motion(robot)", arm)
        assert arm.status()["q_d"][0] == pytest.approx(HOME[0] + 0.05, abs=2e-3)
        assert (arm.violations, arm.counts["lost"], arm.counts["success"]) == ({}, 0, 1)


@pytest.mark.slow
def test_a_client_reports_a_reflex_and_recovers(case):
    code, protocol = case
    attempt = "\ntry:\n    motion(robot)\nexcept Exception as error:\n    print(error)\n"
    with start(protocol) as arm:
        arm.inject("reflex", after=50, error="cartesian_reflex")
        program = code + attempt + "robot.automatic_error_recovery()\nmotion(robot)"
        lines = run(program, arm)
        assert "reflex" in lines[0]
        assert arm.counts["success"] == 1


@pytest.mark.slow
def test_a_client_reports_a_user_stop(case):
    code, protocol = case
    attempt = "\ntry:\n    motion(robot)\nexcept Exception as error:\n    print(error)\n"
    with start(protocol) as arm:
        arm.inject("user_stop", after=50)
        assert "stop" in " ".join(run(code + attempt, arm)).lower()


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["robot", "impedance"])
@pytest.mark.parametrize("protocol", [5, 10])
def test_franka_rs_moves_the_arm(backend, protocol):
    if importlib.util.find_spec("franka") is None:
        pytest.skip("franka is not installed")
    with start(protocol) as arm:
        run(RUST_CODE + f"motion(robot, backend={backend!r})", arm)
        tolerance = 5e-3 if backend == "robot" else 2e-2
        assert arm.status()["q"][0] == pytest.approx(HOME[0] + 0.05, abs=tolerance)
        assert (arm.violations, arm.counts["lost"]) == ({}, 0)


@pytest.mark.slow
def test_panda_py_moves_and_grasps(panda):
    code = """
import panda_py, sys
from panda_py import controllers, libfranka
import numpy as np
arm = panda_py.Panda(sys.argv[1])
goal = np.array(arm.q) + 0.05
print(arm.move_to_joint_position(goal, speed_factor=0.3))
gripper = libfranka.Gripper(sys.argv[1])
print(gripper.grasp(0.0, 0.2, 40.0, 0.08, 0.08), round(gripper.read_once().width, 3))
"""
    if not panda_model_exists():
        pytest.skip("no C compiler for the model library")
    assert run(code, panda)[-2:] == ["True", "True 0.02"]
    assert panda.violations == {}


def panda_model_exists():
    from articulate_deploy.wire.model import model_library

    return model_library() is not None


@pytest.mark.slow
def test_franky_moves_the_arm():
    python = os.environ.get("FRANKY_PYTHON")
    if not python:
        pytest.skip("FRANKY_PYTHON names no interpreter with franky")
    code = """
import franky, sys
robot = franky.Robot(sys.argv[1], realtime_config=franky.RealtimeConfig.Ignore)
robot.relative_dynamics_factor = franky.RelativeDynamicsFactor(0.2, 0.1, 0.05)
goal = [float(v) for v in robot.state.q]
goal[0] += 0.05
robot.move(franky.JointMotion(franky.JointState(goal)))
"""
    with start(10) as arm:
        run(code, arm, python)
        assert arm.status()["q_d"][0] == pytest.approx(HOME[0] + 0.05, abs=1e-3)
        assert (arm.violations, arm.counts["lost"]) == ({}, 0)
