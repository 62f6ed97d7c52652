import dataclasses

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from articulate.robot.arm import PANDA, Gripper
from articulate.robot.config import ControlConfig
from articulate.robot.control import (
    OPEN_M,
    WIDEST_M,
    apply_gripper_latency,
    check_control,
    delay_action,
    discretize_filter,
    exceeds_force_limit,
    filter_start,
    filter_step,
    finger_params,
    finger_start,
    finger_step,
    force_limits,
    gripper_params,
    joint_steps,
    new_action_delay,
    new_gripper_state,
    response,
    send_gripper_command,
    target_params,
    target_workspace,
    update_targets,
    worst_case,
    write_target_step,
)
from articulate.robot.kinematics import small_twist, tool_jacobian, tool_pose
from articulate.task.observation import ACTION
from articulate.task.task import Limits

CONFIG = ControlConfig()
HAND = Gripper()
TICK_S = CONFIG.step_s
FINE_S = 1e-4
WORK = target_workspace()


def filtered(state, target, A, B):
    """States (N, 7, 3) of set-point filters one step later."""
    out = state.copy()
    for row, goal in zip(out, target, strict=True):
        filter_step(row, goal, A, B)
    return out


def next_target(target, motion, q, config=CONFIG, retract=False):
    """Targets (N, 7) of the next control step."""
    out, params = target.copy(), target_params(PANDA, config)
    for i, row in enumerate(out):
        update_targets(row, motion[i], q[i], np.broadcast_to(retract, len(q))[i], params, WORK)
    return out


@pytest.mark.parametrize("omega", [5.0, 20.0, 40.0])
@pytest.mark.parametrize("dt", [1e-4, 1e-3, 5e-3, 5e-2])
def test_discrete_step_is_the_matrix_exponential(omega, dt):
    companion = np.array([[0, 1, 0], [0, 0, 1], [-(omega**3), -3 * omega**2, -3 * omega]])
    augmented = np.zeros((4, 4))
    augmented[:3, :3] = companion
    augmented[2, 3] = omega**3
    exact = scipy.linalg.expm(augmented * dt)
    A, B = discretize_filter(omega, dt)
    scale = np.array([1.0, omega, omega**2])
    assert_allclose(A * scale / scale[:, None], exact[:3, :3] * scale / scale[:, None], atol=1e-12)
    assert_allclose(B / scale, exact[:3, 3] / scale, atol=1e-12)


def test_step_response_is_what_the_discrete_follower_does():
    A, B = discretize_filter(CONFIG.omega_rad_s, 0.01)
    state = filter_start(np.zeros((1, 7)))
    for k in range(1, 50):
        state = filtered(state, np.ones((1, 7)), A, B)
        expected = response(CONFIG.omega_rad_s, np.array(0.01 * k))[:3]
        assert_allclose(state[0, 3], expected, atol=1e-11 * CONFIG.omega_rad_s**2)


def test_response_is_the_derivative_chain_of_itself():
    t, h = np.linspace(0.01, 0.5, 40), 1e-6
    slope = (response(20.0, t + h) - response(20.0, t - h))[..., :3] / (2 * h)
    assert_allclose(slope, response(20.0, t)[..., 1:], rtol=1e-5, atol=1e-2)


@given(seed=st.integers(0, 2**32 - 1))
def test_five_steps_of_1_ms_are_one_of_5_ms_for_any_targets(seed):
    """The robot's controller and the simulator see the same set points."""
    rng = np.random.default_rng(seed)
    fine, coarse = (
        discretize_filter(CONFIG.omega_rad_s, 1e-3),
        discretize_filter(CONFIG.omega_rad_s, 5e-3),
    )
    a = b = filter_start(rng.uniform(-2, 2, (2, 7)))
    for _ in range(10):
        target = rng.uniform(-2, 2, (2, 7))
        for _ in range(5):
            a = filtered(a, target, *fine)
        b = filtered(b, target, *coarse)
        scale = np.array([1.0, CONFIG.omega_rad_s, CONFIG.omega_rad_s**2])
        assert_allclose(a / scale, b / scale, rtol=0, atol=1e-12)


def test_follower_at_rest_on_its_target_stays_there():
    q = np.linspace(-1, 1, 7)[None]
    state = filtered(filter_start(q), q, *discretize_filter(CONFIG.omega_rad_s, 5e-3))
    assert_allclose(state, filter_start(q), atol=1e-14 * CONFIG.omega_rad_s**2)


def peaks(config, deltas):
    """Largest speed, acceleration, jerk (3,) at every 0.1 ms under ``deltas`` (ticks, M)."""
    w, count = config.omega_rad_s, round(config.step_s / FINE_S)
    A, B = discretize_filter(w, FINE_S)
    powers, inputs = [np.eye(3)], [np.zeros(3)]
    for _ in range(count):
        powers.append(A @ powers[-1])
        inputs.append(A @ inputs[-1] + B)
    state, target, out = np.zeros((deltas.shape[1], 3)), np.zeros(deltas.shape[1]), np.zeros(3)
    for delta in deltas:
        target = target + config.step_rad * np.clip(delta, -1, 1)
        way = np.einsum("kij,mj->kmi", powers, state) + np.einsum("ki,m->kmi", inputs, target)
        x, v, a = np.moveaxis(way, -1, 0)
        jerk = w**3 * (target - x) - 3 * w**2 * v - 3 * w * a
        out = np.maximum(out, [np.abs(v).max(), np.abs(a).max(), np.abs(jerk).max()])
        state = way[-1]
    return out


@pytest.mark.parametrize("config", [CONFIG, ControlConfig(omega_rad_s=35.0, step_rad=0.01)])
def test_no_sequence_of_targets_exceeds_the_worst_case_and_one_comes_near(config):
    bound, rng, ticks = worst_case(config), np.random.default_rng(0), 60
    noise = rng.uniform(-1, 1, (ticks, 50))
    bang = np.sign(rng.normal(size=(ticks, 50)))
    held = np.sign(rng.normal(size=(ticks // 5, 50))).repeat(5, axis=0)
    # The worst sequence for a phase gives every past change the sign of its response there.
    phase = np.linspace(0, config.step_s, 26)
    t = config.step_s * np.arange(ticks)[::-1, None, None] + phase[:, None]
    worst = np.sign(response(config.omega_rad_s, t[..., 0])[..., 1:]).reshape(ticks, -1)
    seen = [peaks(config, deltas) for deltas in (noise, bang, held, worst)]
    assert np.all(np.max(seen, axis=0) <= bound * (1 + 1e-4))
    assert np.all(seen[-1] >= 0.99 * bound)


def test_default_follower_stays_within_the_arms_limits_whatever_is_asked():
    shares = joint_steps(CONFIG, PANDA) / CONFIG.step_rad
    speed, acceleration, jerk = worst_case(CONFIG)[:, None] * shares
    assert np.all(speed < Limits().speed_share * np.array(PANDA.dq_max))
    assert np.all(acceleration < PANDA.ddq_max)
    assert np.all(jerk < PANDA.dddq_max)


def test_joints_step_in_proportion_to_the_acceleration_they_are_allowed():
    assert_allclose(
        joint_steps(CONFIG, PANDA),
        CONFIG.step_rad * np.array([2, 1, 4 / 3, 5 / 3, 2, 8 / 3, 8 / 3]),
    )


def joints(low=-3.0, high=3.0):
    return arrays(np.float64, (3, 7), elements=st.floats(low, high))


@given(target=joints(), motion=joints(-5, 5), q=joints(-4, 4), yields=arrays(bool, 3))
def test_target_moves_by_one_step_at_most_and_never_leaves_the_limits(target, motion, q, yields):
    low, high = PANDA.bounds(CONFIG.margin_rad)
    target = np.clip(target, low, high)
    new = next_target(target, motion, q, CONFIG, yields)
    assert np.all(np.abs(new - target) <= joint_steps(CONFIG, PANDA) + 1e-12)
    assert np.all((new >= low - 1e-12) & (new <= high + 1e-12))


@given(motion=joints(-1, 1), lead=joints(-1, 1))
def test_target_does_not_run_away_from_a_joint_that_is_held(motion, lead):
    q = np.tile(PANDA.home, (3, 1))
    new = next_target(q + CONFIG.max_tracking_error_rad * lead, motion, q)
    assert np.all(np.abs(new - q) <= CONFIG.max_tracking_error_rad + 1e-12)


@given(motion=joints(-1, 1), lead=joints(-1, 1))
def test_hands_that_press_take_their_targets_back_whatever_is_asked(motion, lead):
    """By a step a tick, and no further than the joints."""
    q = np.tile(PANDA.home, (3, 1))
    ahead, most = CONFIG.max_tracking_error_rad * lead, joint_steps(CONFIG, PANDA)
    new = next_target(q + ahead, motion, q, CONFIG, True)
    assert_allclose(new - q, np.sign(ahead) * np.maximum(np.abs(ahead) - most, 0.0), atol=1e-12)


@pytest.mark.parametrize(
    ("force_n", "wish", "width_m", "much"),
    [
        (CONFIG.force_limit_n - 0.1, -1.0, 0.08, False),
        (CONFIG.force_limit_n + 0.1, -1.0, 0.08, True),
        (CONFIG.force_limit_n + 0.1, 1.0, OPEN_M + 1e-3, True),  # told to close, and has not begun
        (CONFIG.force_limit_n + 0.1, -1.0, 0.02, True),  # told to let go
        (CONFIG.force_limit_n + 0.1, 1.0, 0.02, False),
        (CONFIG.force_limit_holding_n - 0.1, 1.0, 0.02, False),
        (CONFIG.force_limit_holding_n + 0.1, 1.0, 0.02, True),
        (np.nan, 1.0, 0.02, True),  # an arm that cannot tell
    ],
)
def test_a_hand_that_closes_may_pull_and_an_open_one_has_nothing_to_press_for(
    force_n, wish, width_m, much
):
    fx, fz = 0.6 * force_n, -0.8 * force_n
    assert exceeds_force_limit(fx, 0.0, fz, wish, width_m, force_limits(CONFIG)) == much


HOME = np.asarray(PANDA.home)[None]


def moved(motion, config=CONFIG):
    """What a motion of one field does to the tool at home (6,), in its own frame."""
    vector = np.zeros((1, ACTION.size))
    vector[:, ACTION.slice(motion[0])] = motion[1]
    new = next_target(HOME, vector[:, :7], HOME, config)
    return small_twist(tool_pose(PANDA, HOME), tool_pose(PANDA, new))[0]


@pytest.mark.parametrize("axis", range(3))
def test_tool_moves_and_turns_along_its_own_axes_by_what_is_asked(axis):
    """At a fifth of a step nothing is scaled down, and curvature is below a hundredth."""
    unit = np.eye(3)[axis]
    move, turn = moved(("move", 0.2 * unit)), moved(("turn", 0.2 * unit))
    assert_allclose(move, [*(0.2 * CONFIG.move_m * unit), 0, 0, 0], atol=2e-5)
    assert_allclose(turn, [0, 0, 0, *(0.2 * CONFIG.turn_rad * unit)], atol=5e-5)


def test_elbow_moves_by_its_step_and_leaves_the_tool_where_it_is():
    new = next_target(HOME, np.eye(7)[6][None], HOME)
    assert np.linalg.norm(new - HOME) == pytest.approx(CONFIG.step_rad)
    assert_allclose(moved(("elbow", 1.0)), 0, atol=3e-4)


def test_motion_that_is_too_large_for_a_joint_is_scaled_down_as_a_whole():
    config = dataclasses.replace(CONFIG, move_m=0.05)
    ask = np.array([0.3, -0.5, 0.8])
    got = moved(("move", ask), config)[:3]
    assert np.linalg.norm(got) < 0.5 * config.move_m * np.linalg.norm(ask)
    assert np.dot(got, ask) / np.linalg.norm(got) / np.linalg.norm(ask) > 0.999


@given(motion=joints(-1, 1), seed=st.integers(0, 1000))
def test_same_motion_asked_near_a_singular_pose_stays_small(motion, seed):
    """The arm stretched out: the elbow at its bound nearest to straight, wrist in line."""
    rng = np.random.default_rng(seed)
    q = np.clip(0.01 * rng.normal(size=(3, 7)), *PANDA.bounds(CONFIG.margin_rad))
    for target, each in zip(q, motion, strict=True):
        write_target_step(target, each, target_params(PANDA, CONFIG), WORK)
        assert np.isfinite(WORK.step).all()
        assert np.all(np.abs(WORK.step) <= joint_steps(CONFIG, PANDA) + 1e-12)


@pytest.mark.parametrize(("joint", "bound"), [(1, 1), (3, 1), (5, -1)])
def test_the_elbow_moves_away_from_a_joint_limit_and_leaves_the_tool_in_place(joint, bound):
    params = target_params(PANDA, CONFIG)
    q = np.array([0.3, 0.2, -0.4, -1.8, 0.5, 1.9, 0.6])
    write_target_step(q, np.zeros(7), params, WORK)
    assert_allclose(WORK.step, 0.0)  # no joint is near a limit
    limit = (params.low, params.high)[bound == 1]
    q[joint] = limit[joint] - 0.05 * bound
    write_target_step(q, np.zeros(7), params, WORK)
    assert bound * WORK.step[joint] < 0.0
    assert_allclose(tool_jacobian(PANDA, q) @ WORK.step, 0.0, atol=1e-9)


def test_the_opening_at_the_last_command_to_open_is_kept():
    state = new_gripper_state(1)
    assert state.release_width[0] == WIDEST_M
    for command, width in ((1.0, 0.08), (1.0, 0.03), (-1.0, 0.02), (1.0, 0.07)):
        for _ in range(40):
            gripper_step(state, 0, command, 0.0, HAND, TICK_S, width)
    assert state.release_width[0] == 0.02


def gripper_step(state, i, command, latency_s, gripper, step_s, width=0.08):
    """Advance gripper ``i`` by one control step."""
    sent = send_gripper_command(state, i, command, width, gripper_params(gripper, step_s))
    apply_gripper_latency(state, i, sent, latency_s, step_s)


def run_hand(commands, *, latency_s=0.0, gripper=HAND, step_s=TICK_S):
    """States of one gripper after each of ``commands``."""
    state, out = new_gripper_state(1), []
    for command in commands:
        gripper_step(state, 0, command, latency_s, gripper, step_s)
        out.append(state.copy())
    return out


@pytest.mark.parametrize(
    ("command", "width", "closing", "on"),
    [
        (-0.03, 0.041, 1.0, -0.03),  # pressed together on something
        (-0.03, 0.041, -1.0, 0.0205),  # and let go: at once
        (0.03, 0.05, -1.0, 0.03),  # opening already, and ahead of the fingers
        (0.01, 0.05, 1.0, 0.01),
    ],
)
def test_a_hand_opens_from_where_its_fingers_are(command, width, closing, on):
    assert finger_start(command, width, closing) == pytest.approx(on)


def test_fingers_move_at_their_speed_within_their_limits():
    params = finger_params(HAND, 0.005)
    assert finger_step(0.02, 1.0, params) == pytest.approx(0.02 - 0.005 * HAND.finger_speed_m_s)
    assert finger_step(0.02, -1.0, params) == pytest.approx(0.02 + 0.005 * HAND.finger_speed_m_s)
    closed, wide = HAND.finger_m
    assert finger_step(closed, 1.0, params) == closed
    assert finger_step(wide, -1.0, params) == wide


def test_an_action_acts_after_its_delay_and_is_pending_until_then():
    delay = new_action_delay(1, 4)
    delay.steps[0] = 2
    motions = np.arange(1.0, 6.0)
    acted, pending = [], []
    for motion in motions:
        delay_action(delay, 0, np.full(8, motion))
        acted.append(delay.motion[0, 0])
        pending.append(delay.pending[0, 0])
    assert acted == [0.0, 0.0, 1.0, 2.0, 3.0]
    assert pending == [1.0, 3.0, 5.0, 7.0, 9.0]


def test_a_closed_hand_presses_with_its_force_on_the_thinnest_thing():
    closed, wide = HAND.finger_m
    assert -HAND.stiffness_n_m * closed == pytest.approx(HAND.force_n)
    assert wide == pytest.approx(HAND.max_width_m / 2)


def column(states, name):
    return np.array([getattr(s, name)[0] for s in states])


def test_hand_is_told_to_close_when_the_smoothed_command_passes_the_threshold():
    """Under a constant 1 the smoothed command is 1 - s^k after k ticks of 50 ms."""
    states = run_hand(np.ones(60), step_s=0.05)
    smooth = column(states, "smooth")
    assert_allclose(smooth, 1 - HAND.smoothing ** np.arange(1, 61))
    assert_allclose(column(states, "command"), np.where(smooth > HAND.on_threshold, 1.0, -1.0))


@given(ratio=st.sampled_from([2, 5, 10]))
def test_smoothing_depends_on_time_not_on_ticks(ratio):
    coarse = run_hand(np.ones(10), step_s=0.05)
    fine = run_hand(np.ones(10 * ratio), step_s=0.05 / ratio)
    assert_allclose(fine[-1].smooth, coarse[-1].smooth, rtol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_command_between_the_thresholds_changes_nothing(sign):
    settle = round(2 * HAND.dwell_s / TICK_S) + 40
    states = run_hand([*([sign] * settle), *([-sign * 0.9 * HAND.on_threshold] * 200)])
    assert np.all(column(states, "command")[settle:] == sign)
    assert np.all(column(states, "closing")[settle:] == sign)


@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.3, 1.2])
def test_command_acts_after_its_latency(latency_s):
    states = run_hand(np.ones(100), latency_s=latency_s)
    told = int(np.argmax(column(states, "command") > 0))
    acts = int(np.argmax(column(states, "closing") > 0))
    assert (acts - told) * TICK_S == pytest.approx(latency_s, abs=TICK_S / 2 + 1e-9)


@given(seed=st.integers(0, 1000), period=st.integers(1, 30))
def test_hand_is_never_told_twice_within_its_dwell(seed, period):
    rng = np.random.default_rng(seed)
    commands = np.sign(rng.normal(size=300 // period + 1)).repeat(period)
    wish = column(run_hand(commands, latency_s=0.5), "command")
    told = np.flatnonzero(np.diff(wish))
    assert np.all(np.diff(told) * TICK_S >= HAND.dwell_s - 1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_noise_of_exploration_does_not_toggle_a_hand_that_is_meant(sign):
    """A policy that says ±0.6 with standard deviation 0.6 holds its hand for 100 episodes."""
    rng = np.random.default_rng(0)
    state, n = new_gripper_state(100), 100
    for _ in range(60):
        for i in range(n):
            gripper_step(state, i, sign, 0.0, HAND, TICK_S)
    for _ in range(200):
        command = 0.6 * sign + 0.6 * rng.normal(size=n)
        for i in range(n):
            gripper_step(state, i, command[i], 0.0, HAND, TICK_S)
        assert np.all(state.closing == sign)


def test_rates_and_steps_must_be_above_zero(error_line):
    for name in ("rate_hz", "omega_rad_s", "step_rad", "max_tracking_error_rad"):
        error_line(f"ControlConfig({name}=0)", lambda name=name: ControlConfig(**{name: 0}))


@pytest.mark.parametrize(
    "asked", [{"margin_rad": -0.1}, {"margin_rad": np.inf}, {"step_rad": np.inf}], ids=repr
)
def test_margins_are_not_negative_and_nothing_is_endless(asked, error_line):
    error_line(f"ControlConfig(**{asked})", lambda: ControlConfig(**asked))


def test_a_follower_that_could_break_a_limit_of_the_arm_is_refused(error_line):
    """The default is within all of them; a step or a bandwidth half as large again is not."""
    check_control(CONFIG, PANDA)
    error_line(
        "check_control(ControlConfig(step_rad=0.1), PANDA)",
        lambda: check_control(ControlConfig(step_rad=0.1), PANDA),
    )
    error_line(
        "check_control(ControlConfig(omega_rad_s=60.0), PANDA)",
        lambda: check_control(ControlConfig(omega_rad_s=60.0), PANDA),
    )
