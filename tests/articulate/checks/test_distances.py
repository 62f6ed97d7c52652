"""Depths of overlapping shapes against closed forms, and no pair lost to pruning."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.articulate.checks.objects import Box, Part, make_object

from articulate.checks.distances import Shapes
from articulate.checks.model import ObjectModel, load_model
from articulate.simulator import mujoco

CUBE = ((0.0, 0.0, 0.0), (0.05, 0.05, 0.05))


def two_cubes(folder: Path) -> tuple[ObjectModel, Shapes]:
    """A cube that slides along x over a cube, 100 mm wide both; at 0 they coincide."""
    part = Part(name="slider", kind="slide", axis=(1.0, 0.0, 0.0), span=0.5, boxes=(CUBE,))
    model = load_model(make_object(folder, part, body=(CUBE,)))
    return model, Shapes(model)


@pytest.mark.parametrize("depth_mm", [0.5, 3.0, 30.0, 49.0])
def test_depth_and_way_out_of_two_cubes(tmp_path, depth_mm):
    model, shapes = two_cubes(tmp_path / "a")
    data = model.data()
    model.set_joints(data, {"slider_joint": 0.1 - depth_mm / 1e3})
    one, other = shapes.of_link["slider"], shapes.of_link["body"]
    (found,) = shapes.overlaps(data, one, other, least_m=0.0)
    assert found.depth_m == pytest.approx(depth_mm / 1e3, abs=2e-5)
    assert found.separation_w == pytest.approx((1.0, 0.0, 0.0), abs=2e-5)
    (back,) = shapes.overlaps(data, other, one, least_m=0.0)
    assert back.separation_w == pytest.approx((-1.0, 0.0, 0.0), abs=2e-5)


def test_depth_of_a_cube_standing_on_its_edge(tmp_path):
    part = Part(name="cube", kind="hinge", axis=(0.0, 1.0, 0.0), span=3.0, boxes=(CUBE,))
    floor = ((0.0, 0.0, -0.16), (0.5, 0.5, 0.1))  # its top lies 60 mm below the axis
    model = load_model(make_object(tmp_path / "a", part, body=(floor,)))
    shapes, data = Shapes(model), model.data()
    both = shapes.of_link["cube"], shapes.of_link["body"]
    assert shapes.overlaps(data, *both, least_m=0.0) == []
    model.set_joints(data, {"cube_joint": math.pi / 4})
    (found,) = shapes.overlaps(data, *both, least_m=0.0)
    assert found.depth_m == pytest.approx(0.05 * math.sqrt(2.0) - 0.06, abs=2e-5)
    assert found.separation_w == pytest.approx((0.0, 0.0, 1.0), abs=2e-5)


def test_shallower_overlaps_than_asked_for_are_left_out(tmp_path):
    model, shapes = two_cubes(tmp_path / "a")
    data = model.data()
    model.set_joints(data, {"slider_joint": 0.097})
    both = shapes.of_link["slider"], shapes.of_link["body"]
    assert len(shapes.overlaps(data, *both, least_m=0.0029)) == 1
    assert shapes.overlaps(data, *both, least_m=0.0031) == []


def test_shapes_that_the_engine_keeps_apart_are_measured_all_the_same(tmp_path):
    model, shapes = two_cubes(tmp_path / "a")
    assert model.model.nexclude == 1
    everything = shapes.geoms({"slider", "body"})
    pairs = {(o.one, o.other) for o in shapes.overlaps(model.data(), everything, everything,
                                                      least_m=0.001)}  # fmt: skip
    assert pairs == {(0, 2), (2, 0)}


def test_what_is_seen_only_is_no_collision_shape(tmp_path):
    _, shapes = two_cubes(tmp_path / "a")
    assert shapes.link_of == {0: "body", 2: "slider"}


def test_no_overlap_is_lost_to_pruning(tmp_path):
    rng = np.random.default_rng(3)

    def boxes(n: int) -> tuple:
        middle, half = rng.uniform(-0.2, 0.2, (n, 3)), rng.uniform(0.01, 0.1, (n, 3))
        return tuple((tuple(m), tuple(h)) for m, h in zip(middle, half, strict=True))

    part = Part(name="clutter", kind="hinge", axis=(0.6, 0.0, 0.8), span=None, boxes=boxes(8))
    model = load_model(make_object(tmp_path / "a", part, body=boxes(8)))
    shapes, data = Shapes(model), model.data()
    ones, others = shapes.of_link["clutter"], shapes.of_link["body"]
    for angle in (0.3, 1.1, 2.9):
        model.set_joints(data, {"clutter_joint": angle})
        found = {(o.one, o.other): o.depth_m for o in shapes.overlaps(data, ones, others,
                                                                     least_m=0.002)}  # fmt: skip
        every = {}
        for a in ones:
            for b in others:
                distance = mujoco.mj_geomDistance(model.model, data, a, b, 0.1, np.zeros(6))
                every[int(a), int(b)] = -distance
        deep = {pair: depth for pair, depth in every.items() if depth > 0.002}
        assert found == pytest.approx(deep, abs=2e-5)
        assert 5 < len(found) < len(every)


def test_boxes_on_a_grid_are_as_deep_as_along_their_shallowest_axis(tmp_path):
    rng = np.random.default_rng(0)
    for trial in range(60):
        one, other = rng.integers(1, 6, (2, 3)) * 0.01
        middle = rng.integers(-6, 7, 3) * 0.01
        body: Box = ((0.0, 0.0, 0.0), tuple(one))
        part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), pos=tuple(middle),
                    boxes=(((0.0, 0.0, 0.0), tuple(other)),))  # fmt: skip
        model = load_model(make_object(tmp_path / str(trial), part, body=(body,)))
        shapes = Shapes(model)
        both = shapes.of_link["part"], shapes.of_link["body"]
        depth = float((one + other - np.abs(middle)).min())
        found = shapes.overlaps(model.data(), *both, least_m=1e-4)
        assert [o.depth_m for o in found] == pytest.approx(
            [depth] if depth > 1e-4 else [], abs=2e-5
        )
