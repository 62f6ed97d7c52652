"""Sequences of the server: connection, motions, recovery, gripper, lockstep, faults."""

import random
import struct
import time

import numpy as np
import pytest
from tests.articulate_deploy.wire.fci import ArmClient, Channel, GripperClient, address, bump

from articulate.errors import ConfigError, UsageError
from articulate.robot.arm import PANDA
from articulate_deploy.wire import SimulatedArm
from articulate_deploy.wire.faults import FAULTS

HOME = np.array(PANDA.home)
ADDRESS = address(101)


@pytest.fixture(params=[5, 10])
def version(request):
    return request.param


@pytest.fixture
def arm(version):
    with SimulatedArm(None, ADDRESS, protocol=version, in_process=True) as arm:
        yield arm


@pytest.fixture
def client(arm, version):
    with ArmClient(ADDRESS, version) as client:
        yield client


@pytest.fixture
def panda():
    with SimulatedArm(None, ADDRESS, grasped_width_m=0.03, in_process=True) as arm:
        yield arm


def test_an_idle_arm_reports_its_state(client):
    state = client.state()
    assert (state["robot_mode"], state["motion_generator_mode"], state["controller_mode"]) == (
        1,
        0,
        3,
    )
    assert state["q"] == pytest.approx(HOME, abs=1e-6)
    assert state["O_ddP_O"] == pytest.approx([0.0, 0.0, -9.81], abs=1e-6)
    assert not state["errors"].any()
    pose = state["O_T_EE"].reshape(4, 4).T
    assert pose[3] == pytest.approx([0, 0, 0, 1])
    later = client.state()
    assert later["message_id"] > state["message_id"]


def test_another_version_is_rejected(arm, version):
    with ArmClient(ADDRESS, 15 - version, connect=False) as client:
        assert client.connect() == (1, version)
        with ArmClient(ADDRESS, version):  # franka-rs connects again with the version offered
            pass


def test_a_second_client_is_closed(client, arm, version):
    with (
        pytest.raises((ConnectionError, OSError)),
        ArmClient(ADDRESS, version, connect=False) as second,
    ):
        second.connect()


def test_a_motion_moves_the_arm(client, arm):
    targets = bump()
    states, status = client.run(targets)
    assert status == "success"
    assert len(states) == len(targets)
    q_d = np.array([state["q_d"][0] for state in states])
    assert q_d == pytest.approx(targets[:, 0] + HOME[0], abs=1e-6)
    assert np.abs(np.array([s["q"][0] for s in states]) - q_d).max() < 5e-3
    assert states[-1]["robot_mode"] == 1
    assert states[-2]["control_command_success_rate"] == 1.0
    assert arm.counts["lost"] == 0


def test_velocities_and_torques_move_the_arm(client, version):
    speed = np.zeros((100, 7))
    speed[:, 1] = 0.05 * np.sin(np.linspace(0.0, np.pi, 100)) ** 2
    states, status = client.run(speed, generator=1, field="dq_c", offset=False)
    assert status == "success"
    assert states[-1]["q_d"][1] - HOME[1] == pytest.approx(speed[:, 1].sum() * 1e-3, abs=1e-5)
    torque = np.zeros((100, 7))
    torque[:, 0] = np.minimum(np.arange(100), 20) * 0.1
    generator = 4 if version == 10 else 1
    states, status = client.run(
        torque, controller=2, generator=generator, field="tau_J_d", offset=False
    )
    assert status == "success"
    assert states[50]["tau_J_d"][0] == pytest.approx(2.0)
    assert states[-1]["q"][0] > HOME[0] + 1e-4


def test_stop_ends_a_motion_as_preempted(client):
    number, _ = client.move()
    state = client.state_with(robot_mode=2)
    client.command(state, q_c=state["q_d"])
    assert client.request("StopMove")[0] == 0
    assert client.status(client.reply(number)) == "preempted"
    assert client.state_with(robot_mode=1)["motion_generator_mode"] == 0
    assert client.request("StopMove")[0] == 0


def test_a_reflex_ends_a_motion_and_is_recovered(client, arm):
    arm.inject("reflex", after=20, error="cartesian_reflex")
    states, status = client.run(bump())
    assert status == "reflex"
    last = client.state_with(robot_mode=4)
    assert (last["errors"][7], last["reflex_reason"][7]) == (1, 1)
    assert len(states) <= 25
    assert client.move()[1] == "not_possible"
    assert client.request("StopMove")[0] == 1
    assert client.request("AutomaticErrorRecovery")[0] == 0
    state = client.state_with(robot_mode=1)
    assert (state["errors"][7], state["reflex_reason"][7]) == (0, 1)
    assert client.run(bump())[1] == "success"


def test_a_persistent_reflex_is_not_recovered(client, arm, version):
    arm.inject("reflex", after=5, persistent=True)
    assert client.run(bump())[1] == "reflex"
    assert client.request("AutomaticErrorRecovery")[0] == client.protocol.recovery["reflex"]
    arm.clear_faults()
    assert client.request("AutomaticErrorRecovery")[0] == 0


def test_the_user_stop(client, arm):
    arm.inject("user_stop", after=20)
    assert client.run(bump())[1] == "emergency"
    assert client.state_with(robot_mode=5)["motion_generator_mode"] == 0
    assert client.request("AutomaticErrorRecovery")[0] == 1
    assert client.move()[1] == "not_possible"
    arm.release_user_stop()
    client.state_with(robot_mode=1)
    assert client.run(bump())[1] == "success"


def test_a_contact_above_its_threshold_is_a_reflex(client, arm):
    numbers = [[10.0] * 7, [20.0] * 7] * 2 + [[100.0] * 6, [200.0] * 6] * 2
    assert client.request("SetCollisionBehavior", *np.concatenate(numbers))[0] == 0
    arm.inject("external_torque", after=20, count=0, torque=(0.0, 0.0, 0.0, -15.0, 0.0, 0.0, 0.0))
    states, status = client.run(bump())
    assert status == "success"
    assert states[-2]["joint_contact"][3] == 1.0
    assert states[-2]["tau_ext_hat_filtered"][3] == pytest.approx(15.0, abs=0.5)
    arm.inject("external_torque", after=20, count=0, torque=(0.0, 0.0, 0.0, -25.0, 0.0, 0.0, 0.0))
    assert client.run(bump())[1] == "reflex"
    assert client.state_with(robot_mode=4)["errors"][6] == 1


def test_parameters_are_set_and_reported(client, arm):
    load = [0.5, 0.0, 0.0, 0.1, *np.diag([0.01, 0.01, 0.01]).ravel()]
    assert client.request("SetLoad", *load)[0] == 0
    shift = np.eye(4)
    shift[2, 3] = 0.05
    assert client.request("SetNEToEE", *shift.T.ravel())[0] == 0
    assert client.request("SetJointImpedance", *[1000.0] * 7)[0] == 0
    for _ in range(1000):  # states that were sent before may be waiting
        state = client.state()
        if state["F_T_EE"].reshape(4, 4)[3, 2] > 0.12:
            break
    assert state["m_load"] == pytest.approx(0.5)
    assert state["F_T_EE"].reshape(4, 4)[3, 2] == pytest.approx(0.1534, abs=1e-6)
    assert arm.status()["stiffness"] == [1000.0] * 7
    assert client.request("SetJointImpedance", *[15000.0] * 7)[0] == 2
    assert client.request("SetNEToEE", *(2.0 * shift).ravel())[0] == 2
    assert client.request("SetCollisionBehavior", *[-1.0] * 52)[0] == 2
    number, _ = client.move()
    assert client.request("SetLoad", *load)[0] == 1
    client.request("StopMove")
    client.reply(number)


def test_models(client, version):
    if version == 10:
        payload = client.request("GetRobotModel")
        assert payload[0] == 0
        assert payload.count(b"position_based_velocity_limits") == 7
    else:
        payload = client.request("LoadModelLibrary", 0, 0)
        assert payload[0] == 1 or payload[1:5] == b"\x7fELF"
        assert client.request("LoadModelLibrary", 2, 0)[0] == 1
        assert len(client.request("GetCartesianLimit", 0)) == 1 + 24 + 128 + 1


def test_an_impossible_request_closes_the_connection(client):
    client.send(99, b"")
    with pytest.raises((ConnectionError, OSError)):
        client.reply(1)


@pytest.mark.parametrize("slow", [False, True])
def test_lockstep_is_deterministic(slow):
    def trace(seed):
        rng = random.Random(seed)
        with (
            SimulatedArm(None, ADDRESS, in_process=True) as arm,
            ArmClient(ADDRESS) as client,
        ):
            arm.inject("drop_commands", after=30, count=3)
            arm.inject("drop_states", after=60, count=2)
            pause = (lambda _: time.sleep(rng.choice([0.0, 0.002]))) if slow else None
            number, _ = client.move()
            state, rows = client.state_with(robot_mode=2), []
            for target in bump():
                if pause is not None:
                    pause(0)
                client.command(state, q_c=HOME + target)
                state = client.state()
                rows.append((*state["q"], *state["q_d"], *state["tau_J"]))
                if state["robot_mode"] != 2:
                    break
            client.reply(number) if state["robot_mode"] != 2 else None
            return np.array(rows), arm.violations

    first, again = trace(1), trace(2)
    assert np.array_equal(first[0], again[0])
    assert first[1] == again[1]


def test_servers_run_in_parallel():
    addresses = [address(111), address(112)]
    with (
        SimulatedArm(None, addresses[0]) as first,
        SimulatedArm(None, addresses[1], protocol=10, in_process=True) as second,
        ArmClient(addresses[0]) as a,
        ArmClient(addresses[1], 10) as b,
    ):
        assert a.run(bump())[1] == b.run(bump())[1] == "success"
        assert first.counts["motions"] == second.counts["motions"] == 1
        with pytest.raises(UsageError, match="port 1337 cannot be used"):
            SimulatedArm(None, addresses[0]).start()


def test_wall_clock_time_takes_a_millisecond_a_cycle():
    with (
        SimulatedArm(None, ADDRESS, lockstep=False, in_process=True) as arm,
        ArmClient(ADDRESS),
    ):
        time.sleep(0.3)
        assert arm.periods_s().mean() > 0.95e-3


def test_reset_places_the_arm(client, arm):
    q = HOME + 0.1
    arm.reset_to(q, 0.03)
    sent = arm.status()["message_id"]
    while client.state()["message_id"] <= sent:
        pass
    assert client.state()["q"] == pytest.approx(q, abs=1e-6)
    assert arm.status()["width_m"] == 0.03
    number, _ = client.move()
    with pytest.raises(UsageError, match="a motion is in progress"):
        arm.reset_to(q)
    client.request("StopMove")
    client.reply(number)


def test_a_client_that_leaves_a_motion_stops_the_arm(arm, version):
    with ArmClient(ADDRESS, version) as client:
        client.move()
        state = client.state_with(robot_mode=2)
        client.command(state, q_c=state["q_d"])
        client.state()
    with ArmClient(ADDRESS, version) as client:
        state = client.state_with(robot_mode=4)
        assert state["errors"][25] == 1
        assert client.request("AutomaticErrorRecovery")[0] == 0


def test_the_gripper_moves_grasps_and_stops(panda):
    panda.set_gripper_latency(0.05)
    with GripperClient(ADDRESS) as gripper:
        assert gripper.state()[1:4] == pytest.approx((0.08, 0.08, 0.0))
        assert gripper.status("Move", 0.06, 0.4) == 0
        assert gripper.state()[1] == pytest.approx(0.06, abs=1e-3)
        assert gripper.status("Grasp", 0.0, 0.01, 0.01, 0.4, 40.0) == 2
        assert gripper.status("Grasp", 0.0, 0.08, 0.08, 0.4, 40.0) == 0
        assert gripper.state()[1:4] == pytest.approx((0.03, 0.08, 1.0), abs=1e-3)
        assert gripper.status("Homing") == 0
        assert gripper.state()[1] == pytest.approx(0.08, abs=1e-3)
        assert gripper.status("Move", 0.5, 0.1) == gripper.status("Move", -1.0, 0.1) == 1
        blocked = gripper.begin("Move", 0.0, 0.4)  # a move into an object does not return
        time.sleep(0.4)
        assert gripper.status("Stop") == 0
        assert struct.unpack("<H", gripper.reply(blocked))[0] == 3


def test_a_fault_has_a_known_name(panda):
    with pytest.raises(ConfigError, match="did you mean reflex"):
        panda.inject("reflexx")


class TestFaults:
    """Result of each fault for a client; together they are all faults."""

    def check(self, arm, version, kind):
        return getattr(self, kind)(arm, version)

    @pytest.mark.parametrize("kind", FAULTS)
    def test_each(self, arm, version, kind):
        self.check(arm, version, kind)

    def fails_to_connect(self, arm, version, kind, match):
        arm.inject(kind)
        with ArmClient(ADDRESS, version, connect=False) as client:
            client.tcp.settimeout(0.3)
            with pytest.raises((OSError, ConnectionError), match=match):
                client.connect()
        arm.clear_faults()
        with ArmClient(ADDRESS, version):
            pass

    def silent(self, arm, version):
        self.fails_to_connect(arm, version, "silent", "timed out")

    def close(self, arm, version):
        self.fails_to_connect(arm, version, "close", "closed|reset|Broken")

    def truncated_reply(self, arm, version):
        self.fails_to_connect(arm, version, "truncated_reply", "closed|reset")

    def short_header(self, arm, version):
        arm.inject("short_header")
        with ArmClient(ADDRESS, version, connect=False) as client:
            client.send(0, struct.pack("<HH", version, 1))
            assert struct.unpack("<III", client.tcp.recv(64))[2] == 8

    def wrong_version(self, arm, version):
        arm.inject("wrong_version")
        with ArmClient(ADDRESS, version, connect=False) as client:
            assert client.connect() == (1, 7)

    def no_states(self, arm, version):
        arm.inject("no_states")
        with ArmClient(ADDRESS, version) as client:
            client.udp.settimeout(0.2)
            with pytest.raises(TimeoutError):
                client.state()

    def wrong_state_size(self, arm, version):
        arm.inject("wrong_state_size")
        with ArmClient(ADDRESS, version) as client:
            assert len(client.udp.recv(4096)) == client.protocol.state_type.itemsize - 1

    def no_model(self, arm, version):
        arm.inject("no_model")
        with ArmClient(ADDRESS, version) as client:
            if version == 10:
                assert client.request("GetRobotModel") == b"\0"
            else:
                assert client.request("LoadModelLibrary", 0, 0) == b"\1"

    def no_gripper(self, arm, version):
        arm.inject("no_gripper")
        with Channel(ADDRESS, 1338, "<HII") as channel:
            assert channel.tcp.recv(1) == b""

    def run(self, arm, version, **fault):
        arm.inject(**fault)
        with ArmClient(ADDRESS, version) as client:
            states, status = client.run(bump(), pause=lambda _: None)
        return states, status

    def drop_commands(self, arm, version):
        self.run(arm, version, kind="drop_commands", after=20, count=2)
        assert arm.counts["lost"] == 2

    def delay_commands(self, arm, version):
        self.run(arm, version, kind="delay_commands", after=20, count=2)
        assert arm.counts["lost"] == 2

    def drop_states(self, arm, version):
        self.run(arm, version, kind="drop_states", after=20, count=25)
        assert arm.violations["communication_constraints_violation"] == 1

    def delay_states(self, arm, version):
        self.run(arm, version, kind="delay_states", after=20, count=25, delay=3)
        assert arm.counts["lost"] >= 20

    def reorder_states(self, arm, version):
        self.run(arm, version, kind="reorder_states", after=20, count=1)
        assert arm.counts["lost"] == 1

    def stall(self, arm, version):
        begin = time.monotonic()
        assert self.run(arm, version, kind="stall", after=20, seconds=0.3)[1] == "success"
        assert time.monotonic() - begin > 0.3

    def reflex(self, arm, version):
        assert self.run(arm, version, kind="reflex", after=20)[1] == "reflex"

    def user_stop(self, arm, version):
        assert self.run(arm, version, kind="user_stop", after=20)[1] == "emergency"

    def external_torque(self, arm, version):
        push = (0.0, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        fault = {"kind": "external_torque", "after": 20, "count": 0, "torque": push}
        assert self.run(arm, version, **fault)[1] == "reflex"
        assert set(arm.violations) <= {"joint_reflex", "cartesian_reflex"}

    def disconnect(self, arm, version):
        with pytest.raises((ConnectionError, OSError)):
            self.run(arm, version, kind="disconnect", after=20)
        assert arm.status()["robot_mode"] == 4

    def silence(self, arm, version):
        with pytest.raises(TimeoutError):
            self.run(arm, version, kind="silence", after=20)
        assert arm.status()["robot_mode"] == 4
