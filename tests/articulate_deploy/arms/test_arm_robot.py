"""The child process, the sender and its watchdogs, with an arm in the child process itself."""

import subprocess
import sys
import time

import numpy as np
import pytest

from articulate.errors import ConfigError, MissingError
from articulate_deploy.arms.client import ClientSpec
from articulate_deploy.arms.errors import (
    ArmUnreachableError,
    CommandRejectedError,
    CommunicationLostError,
    ReflexError,
    UserStopError,
    VersionMismatchError,
    WatchdogError,
)
from articulate_deploy.bundle import load_bundle
from articulate_deploy.robots.arm import ArmOptions, ArmRobot
from articulate_deploy.robots.robot import ForceStopError, NotConnectedError, action_dict


@pytest.fixture(scope="module")
def manifest(exported):
    return load_bundle(exported).manifest


def make(manifest, *, options=None, **fake):
    fake.setdefault("q", list(manifest.start.q))
    chosen = options or ArmOptions(lockstep=True)
    return ArmRobot(manifest, ClientSpec("fake", "test", fake), chosen)


def drive(robot, manifest, steps=8, rad=0.01):
    q = np.array(manifest.start.q)
    for k in range(steps):
        robot.send_action(action_dict(q + rad * (k + 1), 0.08))


def test_targets_are_followed_in_the_controllers_time(manifest):
    with make(manifest) as robot:
        robot.reset_to(np.array(manifest.start.q), 0.08)
        drive(robot, manifest)
        robot.stop()
        q = robot.get_observation()
        assert q["joint_1.pos"] > manifest.start.q[0] + 0.01
        steps = manifest.scene.timestep_s
        assert len(robot.take_samples()) == round(8 * manifest.control.step_s / steps)
        assert robot.statistics[0]["set_points"] >= 8 * manifest.control.step_s * 1e3
        with pytest.raises(NotConnectedError):
            robot.send_action(action_dict(np.array(manifest.start.q), 0.08))


def test_a_ramp_brings_a_distant_arm_to_its_start(manifest):
    start = np.array(manifest.start.q)
    with make(manifest, q=list(start + 0.2)) as robot:
        robot.reset_to(start, 0.08)
        observed = robot.get_observation()
        found = np.array([observed[f"joint_{i}.pos"] for i in range(1, 8)])
        assert np.abs(found - start).max() < 0.01


def test_without_ramps_a_distant_arm_is_rejected(manifest):
    start = np.array(manifest.start.q)
    options = ArmOptions(lockstep=True, ramp=False)
    with (
        make(manifest, q=list(start + 0.2), options=options) as robot,
        pytest.raises(CommandRejectedError, match=r"0\.200 rad from its start"),
    ):
        robot.reset_to(start, 0.08)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("unreachable", CommunicationLostError), ("version", VersionMismatchError),
        ("rejected", CommandRejectedError), ("in_reflex", ReflexError),
        ("silent", ArmUnreachableError),
    ],
)  # fmt: skip
def test_errors_before_motion(manifest, fault, error):
    robot = make(
        manifest, fault=fault, options=ArmOptions(start_s=3.0 if fault == "silent" else 15.0)
    )
    begun = time.monotonic()
    with pytest.raises(error):
        robot.connect()
    assert not robot.has_moved
    assert not robot.is_connected
    assert time.monotonic() - begun < 30.0


def test_a_reflex_is_cleared_only_on_request(manifest):
    with make(
        manifest, fault="in_reflex", options=ArmOptions(lockstep=True, recover=True)
    ) as robot:
        robot.reset_to(np.array(manifest.start.q), 0.08)
        drive(robot, manifest, 2)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("reflex", ReflexError), ("user_stop", UserStopError), ("lost", CommunicationLostError),
        ("gap", CommunicationLostError),
    ],
)  # fmt: skip
def test_errors_during_a_motion(manifest, fault, error):
    start = np.array(manifest.start.q)
    with make(manifest, q=list(start + 0.05), fault=fault, at_ms=120) as robot:
        robot.reset_to(start, 0.08)
        with pytest.raises(error):
            drive(robot, manifest)
        with pytest.raises(NotConnectedError):
            robot.send_action(action_dict(start, 0.08))


def test_the_force_watchdog_ends_the_episode(manifest):
    start = np.array(manifest.start.q)
    with make(manifest, q=list(start + 0.05), at_ms=120, force_n=80.0) as robot:
        robot.reset_to(start, 0.08)
        with pytest.raises(ForceStopError, match="above the limit of 40 N"):
            drive(robot, manifest)


def test_the_policy_watchdog_stops_without_targets(manifest):
    with make(manifest, real_time=True, options=ArmOptions()) as robot:
        robot.reset_to(np.array(manifest.start.q), 0.08)
        drive(robot, manifest, 2)
        time.sleep(1.0)
        with pytest.raises(WatchdogError, match="policy: no targets"):
            drive(robot, manifest, 3)


def test_unknown_and_absent_clients(manifest, error_line, monkeypatch):
    def with_client(name):
        return lambda: ArmRobot(manifest, ClientSpec(name, "172.16.0.2"))

    error_line("ArmRobot(client panda_python)", with_client("panda_python"))
    with pytest.raises(ConfigError):
        with_client("other")()
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    error_line("ArmRobot(client franka-rs)  # not installed", with_client("franka-rs"))
    with pytest.raises(MissingError):
        with_client("pylibfranka")()


def test_the_bridge_drives_the_reference_server(manifest):
    pytest.importorskip("zmq")
    address = "127.0.0.1:7391"
    code = (
        "from articulate_deploy.arms.bridge_server import *; "
        "serve(ExampleController(), '127.0.0.1', 7391)"
    )
    server = subprocess.Popen([sys.executable, "-c", code])
    try:
        options = ArmOptions(lockstep=True)
        with ArmRobot(manifest, ClientSpec("bridge", address), options, name="bridge") as robot:
            assert robot.notes[0] == "client bridge to example"
            robot.reset_to(np.array(manifest.start.q), 0.08)
            drive(robot, manifest)
            robot.stop()
            assert robot.get_observation()["joint_1.pos"] > manifest.start.q[0] + 0.01
    finally:
        server.kill()
        server.wait()
