"""What a tick shows is what the function that a robot runs would say."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from articulate import judgement
from articulate.judgement import WIDTH, judgement_start
from articulate.task import Task
from articulate_envs.compiled.judge import asked_of, judge_tick

N, TICK_S = 300, 0.05
OPEN = Task(name="open_drawer", joint="j", kind="slide", span=0.3, target=0.8)
CLOSE = Task(name="close_joint", joint="j", kind="hinge", span=-2.0, target=0.05, begin=(0.4, 0.8))


@pytest.mark.parametrize("task", [OPEN, CLOSE], ids=["open", "close"])
def test_ticks_are_judged_as_the_python_function_judges_them(task):
    rng = np.random.default_rng(0)
    ours = theirs = judgement_start(N)
    rested = 0
    for tick in range(30):
        samples = rng.normal(size=(N, WIDTH))
        if tick == 15:
            samples[3, 4], samples[7, 0] = np.nan, np.inf
        opened = task.target + rng.uniform(-0.02, 0.1, N) * (-1.0 if task.closes else 1.0)
        speed = rng.uniform(-1.3, 1.3, N) * task.slow
        if tick == 16:
            opened[9], speed[11] = np.nan, -np.inf
        given = {"opened": opened, "speed": speed, "tick_s": TICK_S}
        ours = judge_tick(ours, samples, asked_of(task), **given)
        theirs = judgement.judge_tick(theirs, samples, task, **given)
        for field in dataclasses.fields(ours):
            want = getattr(theirs, field.name)
            assert_array_equal(getattr(ours, field.name), want, err_msg=field.name)
        rested += int((ours.rest_s > 0.0).sum())
    assert 0 < rested < 30 * N
    assert set(np.flatnonzero(ours.diverged)) == {3, 7, 9, 11}
