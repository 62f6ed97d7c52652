"""Models that use the arrays of another one simulate as with their own."""

import copy
import ctypes
import gc

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.scenes import drawer_scene

from articulate.simulator import mujoco
from articulate_envs.native_mujoco import (
    DRAWN,
    SHARED,
    SharedModelArrays,
    _words,
    copy_model,
    drawn_arrays,
)


def shared(model):
    """Arrays that are shared and not empty, by name, as the model itself holds them."""
    names = [name for name in dir(model) if name.startswith(SHARED)]
    return {name: getattr(model, name) for name in names if getattr(model, name).size}


def addresses(model):
    """Where those arrays lie."""
    return {array.ctypes.data for array in shared(model).values()}


@pytest.fixture
def lender(tmp_path):
    return drawer_scene(tmp_path).nominal


def test_shapes_are_those_of_the_lender_and_nothing_else_is(lender):
    model = copy.copy(lender)
    assert {"mesh_vert", "bvh_aabb"} <= set(shared(model))
    before, own = _words(model).copy(), addresses(model)
    SharedModelArrays(lender).lend(model)
    after = _words(model)
    changed = after != before
    assert set(before[changed]) == own
    assert set(after[changed]) == addresses(lender)


def test_a_model_that_was_lent_to_has_its_own_arrays_again_once_copied_over(lender):
    model = copy.copy(lender)
    before = _words(model).copy()
    SharedModelArrays(lender).lend(model)
    copy_model(model, lender)
    assert_array_equal(_words(model), before)


def test_what_is_lent_is_left_as_it_was_by_stepping_and_by_giving_up_the_model(lender):
    before = {name: array.copy() for name, array in shared(lender).items()}
    model = copy.copy(lender)
    SharedModelArrays(lender).lend(model)
    data, alone = mujoco.MjData(model), mujoco.MjData(lender)
    mujoco.mj_setConst(model, data)
    for d, m in ((data, model), (alone, lender)):
        mujoco.mj_resetData(m, d)
        d.qpos[:7] += 0.1
        for _ in range(200):
            mujoco.mj_step(m, d)
    assert_array_equal(data.qpos, alone.qpos)
    del model, data
    gc.collect()
    for name, array in shared(lender).items():
        assert_array_equal(array, before[name], err_msg=name)


def test_a_copy_of_what_was_lent_to_stands_alone(lender):
    model = copy.copy(lender)
    SharedModelArrays(lender).lend(model)
    again = copy.copy(model)
    assert not set(_words(again)) & addresses(lender)
    for name, array in shared(again).items():
        assert_array_equal(array, getattr(lender, name), err_msg=name)


def test_arrays_that_are_drawn_are_told_by_where_they_lie(lender):
    addresses, sizes = drawn_arrays(lender)
    read = [
        np.ctypeslib.as_array((ctypes.c_double * int(n)).from_address(int(address)))
        for address, n in zip(addresses, sizes, strict=True)
    ]
    plain = [getattr(lender, name).ravel() for name in DRAWN if getattr(lender, name).size]
    stat = lender.stat
    told = [stat.meaninertia, stat.meanmass, stat.meansize, stat.extent, *stat.center]
    assert {"body_mass", "geom_friction"} <= set(DRAWN)
    for found, wanted in zip(read, [*plain, np.array(told)], strict=True):
        assert_array_equal(found, wanted)
