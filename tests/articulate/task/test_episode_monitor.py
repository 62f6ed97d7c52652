import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from articulate.robot.arm import PANDA
from articulate.task.episode_monitor import (
    COLUMN,
    FIELDS,
    REASONS,
    WIDTH,
    EpisodeMonitor,
    FailureReason,
    failure_reason,
    goal_held,
    monitor_params,
    monitor_sample,
    monitor_step,
    new_monitor,
)
from articulate.task.task import Limits, Task, goal_params

LIMITS = Limits()
DT = 0.005
TICK_S = 0.05
TASK = Task(name="open_drawer", joint="j", kind="slide", span=0.3, target=0.8)


def sample(samples, *, n=1, limits=LIMITS, dt=DT, **values):
    """One sample at rest but for ``values``."""
    zero = {
        "dq": np.zeros((n, 7)),
        "torque": np.zeros((n, 7)),
        "torque_before": np.zeros((n, 7)),
        "wrench": np.zeros((n, 6)),
        "forbidden_contact": np.zeros(n, dtype=bool),
    }
    arrays = {name: np.array(value) for name, value in {**zero, **values}.items()}
    out, params = samples.copy(), monitor_params(PANDA, limits, dt)
    for i, row in enumerate(out):
        dq, torque, last, wrench, contact = (array[i] for array in arrays.values())
        monitor_sample(row, dq, torque, last, wrench, contact, params)
    return out


def joint(k, value):
    return value * np.eye(7)[k][None]


def wrench(k, value):
    return value * np.eye(6)[k][None]


def started(n=1):
    """Rows after one sample at rest: the first one knows no torque rate."""
    return sample(np.zeros((n, WIDTH)), n=n)


@pytest.mark.parametrize("dt", [0.001, 0.005])
def test_filtered_force_is_the_step_response_of_the_first_order_filter(dt):
    rows = np.zeros((1, WIDTH))
    for k in range(1, 41):
        rows = sample(rows, dt=dt, wrench=np.array([[3.0, 0.0, 4.0, 0.0, 2.0, 0.0]]))
        share = 1 - np.exp(-k * dt / LIMITS.filter_s)
        short = 1 - np.exp(-k * dt / LIMITS.short_filter_s)
        assert_allclose(rows[0, :6], share * np.array([3, 0, 4, 0, 2, 0]), rtol=1e-12)
        assert rows[0, COLUMN["force"]] == pytest.approx(5 * share)
        assert rows[0, COLUMN["moment"]] == pytest.approx(2 * share)
        assert rows[0, COLUMN["force_short"]] == pytest.approx(5 * short)
        assert rows[0, COLUMN["force_raw"]] == pytest.approx(5)
        assert rows[0, COLUMN["time"]] == pytest.approx(k * dt)


def test_peaks_stay_when_the_force_has_gone():
    rows = sample(started(), wrench=wrench(0, 100.0))
    peak = rows[0, COLUMN["force"]]
    for _ in range(100):
        rows = sample(rows)
    assert rows[0, COLUMN["force"]] == peak > 0
    assert np.linalg.norm(rows[0, :3]) < 1e-3 * peak


TAU, DQ = np.asarray(PANDA.tau_max), np.asarray(PANDA.dq_max)
VIOLATIONS = {
    "forbidden_contact": {"forbidden_contact": np.array([True])},
    "speed": {"dq": joint(4, LIMITS.speed_share * DQ[4] * 1.001)},
    "torque": {"torque": joint(5, -1.001 * TAU[5]), "torque_before": joint(5, -1.001 * TAU[5])},
    "torque_rate": {"torque": joint(0, 1.001 * PANDA.dtau_max * DT)},
    "force": {"wrench": wrench(1, 1.001 * LIMITS.force_n / (1 - np.exp(-DT / LIMITS.filter_s)))},
    "moment": {"wrench": wrench(3, 1.001 * LIMITS.moment_nm / (1 - np.exp(-DT / LIMITS.filter_s)))},
}


@pytest.mark.parametrize("reason", VIOLATIONS)
def test_each_limit_alone_is_broken_with_its_own_reason(reason):
    rows = sample(started(), **VIOLATIONS[reason])
    assert REASONS[int(rows[0, COLUMN["code"]])] == reason
    assert rows[0, COLUMN["violation_time"]] == pytest.approx(2 * DT)


@pytest.mark.parametrize("reason", [r for r in VIOLATIONS if r != "forbidden_contact"])
def test_just_within_each_limit_nothing_is_broken(reason):
    within = {k: v * 0.998 for k, v in VIOLATIONS[reason].items()}
    rows = sample(started(), **within)
    assert rows[0, COLUMN["code"]] == 0
    assert rows[0, COLUMN["violation_time"]] == 0


def test_an_arm_that_is_held_at_its_torque_has_asked_for_more():
    """Simulators cut torques off at the table."""
    full = joint(3, TAU[3])
    rows = sample(np.zeros((1, WIDTH)), torque=full, torque_before=full)
    assert REASONS[int(rows[0, COLUMN["code"]])] == "torque"
    near = joint(3, 0.999 * TAU[3])
    rows = sample(np.zeros((1, WIDTH)), torque=near, torque_before=near)
    assert rows[0, COLUMN["code"]] == 0


def test_first_sample_knows_no_torque_rate():
    rows = sample(np.zeros((1, WIDTH)), torque=joint(0, 50.0))
    assert rows[0, COLUMN["torque_rate"]] == 0
    assert rows[0, COLUMN["code"]] == 0


@given(order=st.permutations(sorted(VIOLATIONS)))
def test_first_violation_is_the_reason_that_stays(order):
    rows = started()
    for reason in order:
        rows = sample(rows, **VIOLATIONS[reason])
    assert REASONS[int(rows[0, COLUMN["code"]])] == order[0]
    assert rows[0, COLUMN["violation_time"]] == pytest.approx(2 * DT)


def test_of_limits_broken_in_one_sample_the_first_of_the_list_counts():
    both = {**VIOLATIONS["speed"], **VIOLATIONS["force"]}
    assert sample(started(), **both)[0, COLUMN["code"]] == FailureReason.SPEED


@given(seed=st.integers(0, 2**32 - 1))
def test_episodes_of_a_batch_are_judged_as_if_alone(seed):
    rng = np.random.default_rng(seed)
    n = 4
    batch, alone = np.zeros((n, WIDTH)), [np.zeros((1, WIDTH)) for _ in range(n)]
    before = np.zeros((n, 7))
    for _ in range(5):
        torque = rng.normal(0, 3, (n, 7))
        values = {
            "dq": rng.normal(0, 0.7, (n, 7)),
            "torque": torque,
            "torque_before": before,
            "wrench": rng.normal(0, 100, (n, 6)),
            "forbidden_contact": rng.random(n) < 0.1,
        }
        batch = sample(batch, n=n, **values)
        for i in range(n):
            alone[i] = sample(alone[i], **{k: v[i : i + 1] for k, v in values.items()})
        before = torque
    assert_array_equal(batch, np.concatenate(alone))


def run(opened, speed=None, *, samples=None, task=TASK):
    """Verdict after ticks at which the part was ``opened`` and moved with ``speed``."""
    speed = np.zeros(len(opened)) if speed is None else speed
    judgement = new_monitor(1)
    if samples is not None:
        judgement = judgement._replace(samples=samples)
    for o, v in zip(opened, speed, strict=True):
        monitor_step(judgement, 0, o, v, goal_params(task), TICK_S)
    return judgement, REASONS[int(failure_reason(judgement, task)[0])]


HOLD = round(TASK.hold_s / TICK_S)


def test_part_that_rests_beyond_the_target_for_the_whole_hold_time_is_success():
    judgement, reason = run([0.0] * 20 + [TASK.target] * HOLD)
    assert reason == "success"
    assert goal_held(judgement, TASK)[0]


def test_one_tick_less_is_not_yet_a_success():
    assert run([0.0] * 20 + [1.0] * (HOLD - 1))[1] == "not_at_rest"


def test_a_break_in_the_hold_begins_it_anew():
    assert run([1.0] * HOLD + [0.7] + [1.0] * (HOLD - 1))[1] == "not_at_rest"
    assert run([1.0] * HOLD + [0.7] + [1.0] * HOLD)[1] == "success"


def test_part_that_stopped_short_is_not_open():
    assert run([TASK.target - 1e-6] * 100)[1] == "goal_not_reached"


def test_part_that_was_open_and_fell_back_is_not_open():
    assert run([1.0] * 50 + [0.5])[1] == "goal_not_reached"


def test_part_that_still_moves_at_the_end_is_moving():
    speed = [0.0] * 20 + [TASK.slow * 1.01]
    assert run([1.0] * 21, speed)[1] == "not_at_rest"
    assert run([1.0] * 21, -np.array(speed))[1] == "not_at_rest"


def test_violation_outweighs_success():
    rows = sample(started(), **VIOLATIONS["force"])
    judgement, reason = run([1.0] * 20, samples=rows)
    assert reason == "force"
    assert goal_held(judgement, TASK)[0]


@pytest.mark.parametrize("where", ["samples", "opened", "speed"])
def test_one_value_that_is_not_finite_is_diverged_for_ever(where):
    bad = new_monitor(1).samples
    bad[0, 9] = np.nan
    judgement = new_monitor(1)
    for k in range(20):
        broken = k == 3
        rows = bad if broken and where == "samples" else np.zeros((1, WIDTH))
        judgement = judgement._replace(samples=rows)
        opened = np.nan if broken and where == "opened" else 1.0
        speed = np.inf if broken and where == "speed" else 0.0
        monitor_step(judgement, 0, opened, speed, goal_params(TASK), TICK_S)
    assert REASONS[int(failure_reason(judgement, TASK)[0])] == "diverged"
    assert not goal_held(judgement, TASK)[0]


def test_diverged_outweighs_a_violation():
    rows = sample(started(), **VIOLATIONS["force"])
    judgement = EpisodeMonitor(rows, np.ones(1), np.ones(1, dtype=bool), np.ones(1, dtype=bool))
    assert failure_reason(judgement, TASK)[0] == FailureReason.DIVERGED


def test_hold_time_of_the_task_counts():
    brief = dataclasses.replace(TASK, hold_s=0.1)
    assert run([1.0, 1.0], task=brief)[1] == "success"


def test_every_field_has_its_column():
    assert [COLUMN[name] for name in FIELDS] == list(range(WIDTH))
    rows = np.arange(float(WIDTH))[None]
    judgement = new_monitor(1)._replace(samples=rows)
    assert judgement.peak("torque_rate")[0] == FIELDS.index("torque_rate")
