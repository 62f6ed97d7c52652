"""Limits of the simulated arm: just inside passes, just outside ends with the right error."""

import numpy as np
import pytest

from articulate.robot.arm import PANDA
from articulate_deploy.wire.limits import FR3_LIMITS, PANDA_LIMITS, STEP_S
from articulate_deploy.wire.messages import CONTROLLER, ERROR, GENERATOR, PROTOCOLS, ROBOT_MODE
from articulate_deploy.wire.motion import ArmController, Thresholds
from articulate_deploy.wire.physics import BareArm

HOME = np.array(PANDA.home)
LIMITS = {5: PANDA_LIMITS, 10: FR3_LIMITS}


class Rig:
    """A controller in a motion, at rest at the home pose."""

    def __init__(self, version=5, controller="joint_impedance", generator="joint_position", **more):
        self.limits = LIMITS[version]
        self.arm = ArmController(self.limits, lockstep=more.get("lockstep", True))
        self.kind = PROTOCOLS[version].command_type
        self.measured = BareArm(HOME).measure()
        self.arm.hold(HOME)
        assert self.arm.move(1, CONTROLLER[controller], GENERATOR[generator]) == "started"

    def send(self, **fields):
        record = np.zeros(1, self.kind)
        for name, value in fields.items():
            record[name] = value
        self.arm.cycle(record[0], self.measured)
        return self

    def moving(self, q=HOME, dq=0.0, ddq=0.0):
        """Let a motion have begun with this set point and its derivatives."""
        assert self.arm.motion is not None
        self.arm.motion.started = True
        self.arm.q_d = np.array(q, dtype=float)
        self.arm.dq_d, self.arm.ddq_d = np.zeros(7) + dq, np.zeros(7) + ddq
        return self

    @property
    def errors(self):
        return self.arm.errors


def unit(joint, value):
    out = np.zeros(7)
    out[joint] = value
    return out


@pytest.mark.parametrize("version", [5, 10])
@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize(("factor", "outside"), [(0.999, False), (1.001, True)])
def test_limits_of_a_motion_generator(version, joint, factor, outside):
    limits = LIMITS[version]
    jerk = limits.dddq_max[joint] * factor
    rig = Rig(version).send(q_c=HOME + unit(joint, jerk * STEP_S**3))
    assert rig.errors == ({15} if outside else set())

    rig = Rig(version).moving(ddq=unit(joint, limits.ddq_max[joint]))
    rig.send(q_c=HOME + unit(joint, limits.ddq_max[joint] * factor * STEP_S**2))
    assert rig.errors == ({14} if outside else set())

    middle = (limits.q_min + limits.q_max) / 2.0
    top = limits.speed_bounds(middle)[1][joint]
    factor = 1.0 + (factor - 1.0) * 1e-2  # a larger step of the speed is one of acceleration
    rig = Rig(version).moving(q=middle, dq=unit(joint, top))
    rig.send(q_c=middle + unit(joint, top * factor * STEP_S))
    assert rig.errors == ({13} if outside else set())

    end = np.where(np.arange(7) == joint, limits.q_max, HOME)
    rig = Rig(version).moving(q=end).send(q_c=end + unit(joint, 1e-12 * outside))
    assert rig.errors == ({12} if outside else set())


@pytest.mark.parametrize(("distance", "error"), [(0.0999, 13), (0.1001, 11)])
def test_the_first_position_must_be_the_reported_one(distance, error):
    assert Rig().send(q_c=HOME + unit(2, distance)).errors == {error}


def test_a_number_that_is_not_finite_is_outside_the_limits():
    assert Rig().moving().send(q_c=HOME + unit(0, np.nan)).errors == {12}
    rig = Rig(controller="external", generator="joint_velocity")
    assert rig.send(tau_J_d=unit(0, np.nan)).errors == {32}


def test_the_speed_of_an_fr3_depends_on_the_position():
    q = HOME + unit(0, 2.7)
    low, high = FR3_LIMITS.speed_bounds(q)
    assert high[0] == pytest.approx(np.sqrt(2 * 6.0 * (2.7501 - 2.7)) - 0.30)
    assert low[0] == -2.62
    at_end = FR3_LIMITS.speed_bounds(HOME + unit(0, 2.7501 - 0.30**2 / 12.0))[1]
    assert at_end[0] == pytest.approx(0.0, abs=1e-9)
    assert PANDA_LIMITS.speed_bounds(q)[1][0] == 2.175


@pytest.mark.parametrize("version", [5, 10])
@pytest.mark.parametrize(("factor", "outside"), [(0.999, False), (1.001, True)])
def test_limits_of_torques(version, factor, outside):
    generator = "none" if version == 10 else "joint_velocity"
    rig = Rig(version, "external", generator).send(tau_J_d=unit(1, 1.0 * factor))
    assert rig.errors == ({32} if outside else set())
    rig = Rig(version, "external", generator)
    rig.arm.torque = unit(5, 12.0)
    rig.send(tau_J_d=unit(5, 12.0 * factor))
    assert rig.errors == ({34} if outside else set())


def test_measured_joints_have_limits():
    rig = Rig()
    rig.measured.dq = unit(3, 2.175 + 0.11)
    assert rig.send(q_c=HOME).errors == {ERROR["joint_velocity_violation"]}
    rig = Rig()
    rig.measured.q = HOME + unit(3, -1.0)
    assert rig.send(q_c=HOME).errors == {ERROR["joint_position_limits_violation"]}


def test_twenty_lost_commands_in_a_row_end_a_motion():
    rig = Rig().send(q_c=HOME)
    for _ in range(19):
        rig.arm.cycle(None, rig.measured)
    assert rig.errors == set()
    rig.send(q_c=HOME)
    assert rig.arm.success_rate == pytest.approx(2 / 21)
    for _ in range(20):
        rig.arm.cycle(None, rig.measured)
    assert rig.errors == {25}
    assert rig.arm.ended == [(1, "reflex")]
    assert rig.arm.robot_mode == ROBOT_MODE["reflex"]


def test_states_before_the_first_command_are_not_lost():
    rig = Rig()
    for _ in range(100):
        rig.arm.cycle(None, rig.measured)
    assert (rig.arm.lost, rig.errors) == (0, set())
    rig.arm.cycle(None, rig.measured)
    assert rig.errors == {25}


def test_a_lost_command_is_extrapolated_with_constant_acceleration():
    rig = Rig().moving(dq=unit(0, 0.5), ddq=unit(0, 2.0))
    rig.arm.cycle(None, rig.measured)
    assert rig.arm.ddq_d[0] == pytest.approx(2.0)
    assert rig.arm.dq_d[0] == pytest.approx(0.502)
    assert rig.arm.q_d[0] == pytest.approx(HOME[0] + 0.502e-3)


def test_a_lost_torque_is_repeated():
    rig = Rig(5, "external", "joint_velocity").send(tau_J_d=unit(0, 0.5))
    drive = rig.arm.cycle(None, rig.measured)
    assert drive.torque[0] == 0.5


def test_in_wall_clock_time_discontinuities_are_only_counted():
    rig = Rig(lockstep=False).send(q_c=HOME + unit(0, 1e-5))
    name = "joint_motion_generator_acceleration_discontinuity"
    assert (rig.errors, rig.arm.violations[name]) == (set(), 1)
    assert Rig(lockstep=False).moving(dq=2.0).send(q_c=HOME + 0.003).errors == {13}


def test_a_motion_ends_at_rest():
    rig = Rig().moving(dq=unit(0, 0.1))
    rig.send(q_c=HOME + unit(0, 1e-4), motion_generation_finished=1)
    assert rig.errors == {14}
    rig = Rig().send(q_c=HOME, motion_generation_finished=1)
    assert rig.arm.ended == [(1, "success")]
    assert rig.arm.robot_mode == ROBOT_MODE["idle"]


@pytest.mark.parametrize(
    ("torque", "force", "errors"),
    [(9.0, 0.0, set()), (15.0, 15.0, set()), (20.1, 0.0, {6}), (0.0, 20.1, {7})],
)
def test_contact_and_collision_thresholds(torque, force, errors):
    rig = Rig()
    numbers = np.repeat([10.0, 20.0, 10.0, 20.0], 7), np.repeat([10.0, 20.0, 10.0, 20.0], 6)
    rig.arm.thresholds = Thresholds.from_numbers(np.concatenate(numbers))
    rig.measured.external_torque = unit(2, -torque)
    rig.measured.external_wrench = np.array([0.0, force, 0.0, 0.0, 0.0, 0.0])
    rig.arm.check_contact(rig.measured)
    assert rig.errors == errors
    assert bool(rig.arm.joint_contact[2]) == (torque > 10.0)
    assert bool(rig.arm.cartesian_contact[1]) == (force > 10.0)


def test_thresholds_of_acceleration_apply_to_an_accelerating_arm():
    rig = Rig()
    rig.arm.thresholds = Thresholds(upper_torque_acceleration=np.full(7, 30.0))
    rig.measured.external_torque = unit(2, 25.0)
    rig.moving(ddq=unit(0, 1.0)).arm.check_contact(rig.measured)
    assert rig.errors == set()
    rig.moving(ddq=0.0).arm.check_contact(rig.measured)
    assert rig.errors == {6}


def test_recovery():
    rig = Rig()
    assert rig.arm.move(2, 0, 0) == "not_possible"
    rig.arm.fault(6)
    assert rig.arm.move(2, 0, 0) == "not_possible"
    rig.arm.is_persistent = True
    assert rig.arm.recover() == "reflex"
    rig.arm.is_persistent = False
    assert rig.arm.recover() == "success"
    assert (rig.arm.errors, rig.arm.reflex_reason) == (set(), {6})
    assert rig.arm.move(2, 0, 0) == "started"
    assert rig.arm.reflex_reason == set()


def test_a_user_stop_is_not_recovered():
    rig = Rig()
    rig.arm.press_user_stop()
    assert rig.arm.ended == [(1, "emergency")]
    assert rig.arm.recover() == rig.arm.move(2, 0, 0) == "not_possible"
    rig.arm.release_user_stop()
    assert rig.arm.move(2, 0, 0) == "started"


@pytest.mark.parametrize(("controller", "generator"), [(0, 2), (0, 3), (0, 4), (3, 0), (0, 9)])
def test_other_modes_are_invalid(controller, generator):
    arm = ArmController(PANDA_LIMITS, lockstep=True)
    assert arm.move(1, controller, generator) == "invalid"
