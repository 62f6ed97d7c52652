"""Handles turned in the hand."""

import dataclasses
import math

import numpy as np
import pytest
from tests.assets import make_cabinet

from articulate.robot.arm import PAD_M
from articulate.task.object_placement import tilted

JOINT = "drawer_2_slide"


def with_handle(folder, extent):
    asset = make_cabinet(folder)
    handles = (dataclasses.replace(h, extent=extent) for h in asset.handles)
    return dataclasses.replace(asset, handles=tuple(handles))


def handle_of(asset):
    handle = asset.handle_of(JOINT)
    assert handle is not None
    return handle


@pytest.mark.parametrize("deep", [0.008, 0.05])
def test_a_plate_held_askew_is_as_thick_as_what_of_it_the_pads_reach(tmp_path, deep):
    """A deep one is no thicker between pads of 16 mm than one that ends with them."""
    turned = handle_of(tilted(with_handle(tmp_path, (0.1, 0.005, deep)), JOINT, 0.6))
    reached = min(deep, 2.0 * PAD_M)
    assert turned.extent[1] == pytest.approx(0.005 * math.cos(0.6) + reached * math.sin(0.6))


def test_a_handle_is_turned_about_its_long_axis_alone(tmp_path):
    asset = with_handle(tmp_path, (0.1, 0.005, 0.01))
    before, after = handle_of(asset), handle_of(tilted(asset, JOINT, 0.3))
    assert after.along_l == before.along_l
    cosine = np.dot(before.normal_l, after.normal_l)
    assert cosine == pytest.approx(math.cos(0.3))
    assert tilted(asset, JOINT, 0.0) is asset
