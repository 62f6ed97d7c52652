"""What a tick begins with is what the functions that a robot runs would say."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.robot.control import finger_command, hand_start, hand_tick, presses
from articulate.task.randomization import BLOCKS, COLUMNS, PUSH_S
from articulate_envs.buffered_engine import KEPT_ACTIONS, _buffers
from articulate_envs.compiled.begin import Hands, begin, times_of, write_due

FOLLOW = ControlConfig()
N, TICK_S, EPISODE_S = 50, FOLLOW.step_s, 10.0


class Begun:
    """N environments that only begin ticks."""

    def __init__(self, rng):
        start = hand_start(N)
        self.hands = Hands(*(getattr(start, name) for name in Hands._fields))
        self.actions = np.zeros((KEPT_ACTIONS, N, 7))
        self.delay = rng.integers(0, KEPT_ACTIONS, N)
        self.motion, self.due = np.zeros((2, N, 7))
        self.yields = np.zeros(N, dtype=bool)
        self.drawn = np.zeros((N, len(COLUMNS)))
        self.drawn[:, COLUMNS.index("gripper_latency_s")] = rng.uniform(0.0, 0.6, N)
        self.drawn[:, COLUMNS.index("push_x_n") :][:, :3] = rng.normal(size=(N, 3))
        self.drawn[:, COLUMNS.index("push_time")] = rng.uniform(0.0, 0.9, N)
        self.tick = np.zeros(N, dtype=np.int64)
        self.buffers = _buffers(N)
        self.times = times_of(PANDA.gripper, FOLLOW, EPISODE_S)

    def step(self, action):
        said = (self.actions, self.delay, self.motion, self.yields, self.due)
        begin(action, *said, self.hands, self.drawn, self.tick, self.times, self.buffers)
        self.tick += 1


def said(rng, ticks=200):
    """What policies say, the hand's word held for a while (T, N, 8)."""
    out = rng.uniform(-1.3, 1.3, (ticks, N, 8))
    out[:, :, 7] = np.repeat(rng.uniform(-1.5, 1.5, (ticks // 10 + 1, N)), 10, axis=0)[:ticks]
    return out


def test_hands_do_what_the_python_function_says():
    rng = np.random.default_rng(0)
    begun, want = Begun(rng), hand_start(N)
    latency = begun.drawn[:, COLUMNS.index("gripper_latency_s")]
    moved = set()
    for action in said(rng):
        begun.step(action)
        want = hand_tick(want, action[:, 7], latency, PANDA.gripper, TICK_S)
        for name in Hands._fields:
            got = getattr(begun.hands, name)
            assert_allclose(got, getattr(want, name), rtol=0, atol=1e-13, err_msg=name)
        moved |= set(np.flatnonzero(want.closing > 0.0))
    assert len(moved) > N // 2


def test_hands_press_where_the_python_function_says_so():
    rng = np.random.default_rng(4)
    begun, seen = Begun(rng), []
    begun.drawn[:, BLOCKS["force_bias"]] = rng.normal(scale=3.0, size=(N, 3))
    for action in said(rng, 60):
        begun.buffers.rest[:, 0] = rng.uniform(0.0, 0.08, N)
        begun.buffers.samples[:, :3] = rng.normal(scale=14.0, size=(N, 3))
        begun.step(action)
        force = begun.buffers.samples[:, :3] + begun.drawn[:, BLOCKS["force_bias"]]
        want = presses(force, begun.hands.wish, begun.buffers.rest[:, 0], FOLLOW)
        assert_array_equal(begun.yields, want)
        seen.append(want)
    assert 0.1 < np.mean(seen) < 0.9


def test_fingers_go_on_from_where_they_are_when_they_open():
    rng = np.random.default_rng(1)
    begun = Begun(rng)
    for action in said(rng, 60):
        begun.buffers.finger[:] = rng.uniform(0.0, 0.04, N)
        begun.buffers.rest[:, 0] = rng.uniform(0.0, 0.08, N)
        before = begun.buffers.finger.copy()
        begun.step(action)
        want = finger_command(before, begun.buffers.rest[:, 0], begun.hands.closing)
        assert_array_equal(begun.buffers.finger, want)
        assert_array_equal(begun.buffers.closing, begun.hands.closing)


def test_motions_act_when_their_delay_is_over_and_are_due_until_then():
    rng = np.random.default_rng(2)
    begun, past = Begun(rng), [np.zeros((N, 7))] * KEPT_ACTIONS
    for action in said(rng, 20):
        begun.step(action)
        past = [action[:, :7], *past[:-1]]
        for i in range(N):
            delay = begun.delay[i]
            assert_array_equal(begun.motion[i], past[delay][i])
            want = sum((p[i] for p in past[:delay]), np.zeros(7))
            assert_allclose(begun.due[i], want, rtol=0, atol=1e-14)
        again = np.full((N, 7), np.nan)
        write_due(np.arange(N), begun.actions, begun.delay, again)
        assert_array_equal(again, begun.due)


def test_a_push_acts_for_its_time_alone():
    rng = np.random.default_rng(3)
    begun, acted = Begun(rng), np.zeros(N)
    column = COLUMNS.index("push_x_n")
    for action in said(rng):
        begun.step(action)
        on = begun.buffers.push.any(axis=1)
        assert_array_equal(begun.buffers.push[on], begun.drawn[on, column : column + 3])
        acted += on
    assert acted * TICK_S == pytest.approx(PUSH_S, abs=1.001 * TICK_S)
