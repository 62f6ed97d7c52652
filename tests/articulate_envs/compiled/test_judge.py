"""What a tick shows is what the function that a robot runs would say."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from articulate.task.episode_monitor import WIDTH, judge_tick, new_monitor
from articulate.task.task import Task
from articulate_envs.compiled.after import Judged
from articulate_envs.compiled.judge import asked_of, write_judgement

N, TICK_S = 300, 0.05
OPEN = Task(name="open_drawer", joint="j", kind="slide", span=0.3, target=0.8)
CLOSE = Task(name="close_joint", joint="j", kind="hinge", span=-2.0, target=0.05, begin=(0.4, 0.8))


@pytest.mark.parametrize("task", [OPEN, CLOSE], ids=["open", "close"])
def test_ticks_are_judged_as_the_python_function_judges_them(task):
    rng = np.random.default_rng(0)
    theirs = new_monitor(N)
    ours = Judged(theirs.rest_s, theirs.opened, theirs.diverged)
    rested = 0
    for tick in range(30):
        samples = rng.normal(size=(N, WIDTH))
        if tick == 15:
            samples[3, 4], samples[7, 0] = np.nan, np.inf
        opened = task.target + rng.uniform(-0.02, 0.1, N) * (-1.0 if task.closes else 1.0)
        speed = rng.uniform(-1.3, 1.3, N) * task.slow
        if tick == 16:
            opened[9], speed[11] = np.nan, -np.inf
        theirs = judge_tick(theirs, samples, task, opened=opened, speed=speed, step_s=TICK_S)
        before, flags = ours, np.empty((2, N), dtype=bool)
        ours = Judged(np.empty(N), flags[0], flags[1])
        write_judgement(samples, asked_of(task), opened, speed, TICK_S, before, ours)
        for name in Judged._fields:
            assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
        rested += int((ours.rest_s > 0.0).sum())
    assert 0 < rested < 30 * N
    assert set(np.flatnonzero(ours.diverged)) == {3, 7, 9, 11}
