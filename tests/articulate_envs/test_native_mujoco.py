"""Addresses of MuJoCo's arrays, and copies of models without allocation."""

import copy
import ctypes

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.scenes import drawer_scene

from articulate_envs.native_mujoco import SAMPLED, copy_model, sampled_arrays


@pytest.fixture
def model(tmp_path):
    return drawer_scene(tmp_path).nominal


def test_a_copied_model_has_the_numbers_of_its_source_at_its_own_addresses(model):
    other = copy.copy(model)
    other.body_mass[:] = 7.0
    before = sampled_arrays(other)[0]
    copy_model(other, model)
    assert_array_equal(other.body_mass, model.body_mass)
    assert_array_equal(sampled_arrays(other)[0], before)


def test_sampled_arrays_are_found_by_their_addresses(model):
    addresses, sizes = sampled_arrays(model)
    read = [
        np.ctypeslib.as_array((ctypes.c_double * int(n)).from_address(int(address)))
        for address, n in zip(addresses, sizes, strict=True)
    ]
    plain = [getattr(model, name).ravel() for name in SAMPLED if getattr(model, name).size]
    stat = model.stat
    stats = [stat.meaninertia, stat.meanmass, stat.meansize, stat.extent, *stat.center]
    assert {"body_mass", "geom_friction"} <= set(SAMPLED)
    for found, wanted in zip(read, [*plain, np.array(stats)], strict=True):
        assert_array_equal(found, wanted)
