import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.errors import ConfigError
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.robot.control import discretize_filter, filter_start, filter_step, joint_steps
from articulate_deploy.arms.guard import SetPoints, guard_limits

LIMITS = guard_limits(PANDA, margin_rad=0.01)
OMEGA = ControlConfig().omega_rad_s
HOME = np.array(PANDA.home)
MORE = 1.0 + 1e-3
"""Slack: the filter is checked at each set point, and its acceleration may peak between them."""
VALUES = (np.nan, np.inf, -np.inf, 1e9, -1e9, 10.0, -10.0, 0.0, 1.0, -1.0, 2.5)


def shares(points: np.ndarray) -> np.ndarray:
    """Largest shares of speed, acceleration and jerk limits by backward differences."""
    speed = np.diff(points, axis=0) / 1e-3
    acceleration = np.diff(speed, axis=0) / 1e-3
    jerk = np.diff(acceleration, axis=0) / 1e-3
    tables = (PANDA.dq_max, PANDA.ddq_max, PANDA.dddq_max)
    found = zip((speed, acceleration, jerk), tables, strict=True)
    return np.array([(np.abs(values) / np.array(table)).max() for values, table in found])


def run(points: SetPoints, targets: np.ndarray, steps: int = 50) -> np.ndarray:
    """Set points of a sequence of targets, with a rest of three before them."""
    out = [points.state[..., 0].copy()] * 4
    for target in targets:
        points.set_target(target)
        out += [points.step() for _ in range(steps)]
    return np.array(out)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.lists(st.sampled_from(VALUES), min_size=7, max_size=7), min_size=1, max_size=12))
def test_no_targets_lead_out_of_half_the_limit_table(targets):
    points = SetPoints(HOME, OMEGA, LIMITS)
    found = run(points, np.array(targets))
    assert (shares(found) <= 0.5 * MORE).all()
    assert ((found >= LIMITS.low - 1e-9) & (found <= LIMITS.high + 1e-9)).all()


def test_trained_motions_pass_through_the_guard_unchanged():
    rng = np.random.default_rng(0)
    targets = HOME + np.cumsum(0.4 * rng.uniform(-1, 1, (40, 7)), axis=0) * 0.028
    points, state = SetPoints(HOME, OMEGA, LIMITS), filter_start(HOME)
    found = run(points, targets)[4:]
    A, B = discretize_filter(OMEGA, 1e-3)
    expected = []
    for target in targets:
        for _ in range(50):
            filter_step(state, target, A, B)
            expected.append(state[:, 0].copy())
    assert points.limited == 0
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_oscillation_at_the_largest_step_is_limited():
    steps = joint_steps(ControlConfig(), PANDA)
    targets = HOME + steps * np.where(np.arange(40) % 2, 1.0, -1.0)[:, None] * 4
    points = SetPoints(HOME, OMEGA, LIMITS)
    assert (shares(run(points, targets)) <= 0.5 * MORE).all()
    assert points.limited > 0


def test_a_stop_from_full_speed_ends_at_rest_within_the_box():
    points = SetPoints(HOME, OMEGA, LIMITS)
    run(points, np.full((12, 7), 10.0))
    assert np.abs(points.state[:, 1]).max() > 0.5
    found = [points.stop_step() for _ in range(1500)]
    assert points.at_rest
    assert (np.array(found) <= LIMITS.high + 1e-9).all()


def test_a_stop_takes_longer_only_as_the_limits_require():
    points = SetPoints(HOME, OMEGA, LIMITS)
    run(points, np.full((4, 7), HOME + 0.1))
    steps = 0
    while not points.at_rest:
        points.stop_step()
        steps += 1
    assert steps < 500


def test_a_batch_equals_its_rows():
    rng = np.random.default_rng(1)
    targets = HOME + rng.uniform(-2, 2, (10, 3, 7))
    together = run(SetPoints(np.tile(HOME, (3, 1)), OMEGA, LIMITS), targets, 10)
    for i in range(3):
        single = run(SetPoints(HOME, OMEGA, LIMITS), targets[:, i], 10)
        np.testing.assert_allclose(together[:, i], single, atol=1e-12)


def test_a_start_outside_of_the_box_is_rejected(error_line):
    q = HOME.copy()
    q[3] = 0.0
    error_line("SetPoints(outside of the box)", lambda: SetPoints(q, OMEGA, LIMITS))
    with pytest.raises(ConfigError):
        guard_limits(PANDA, fraction=0.6)


def test_waypoints_and_position_limits_of_ruckig_are_not_used():
    from pathlib import Path

    from articulate_deploy import arms

    for path in Path(arms.__file__).parent.rglob("*.py"):
        text = path.read_text()
        assert "intermediate_positions" not in text
        assert "max_position" not in text
