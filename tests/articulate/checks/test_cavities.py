import dataclasses
import re

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from tests.articulate.checks.objects import Part, make_object

from articulate.checks.cavities import (
    cavity_points,
    check_cavities,
    has_room,
    hull_points,
    is_cavity,
    width,
)
from articulate.checks.finger_clearance import check_finger_clearance
from articulate.checks.model import load_model

TRAY = (
    ((0.0, 0.0, -0.09), (0.2, 0.2, 0.01)),
    ((-0.19, 0.0, 0.0), (0.01, 0.2, 0.1)),
    ((0.19, 0.0, 0.0), (0.01, 0.2, 0.1)),
    ((0.0, -0.19, 0.0), (0.2, 0.01, 0.1)),
    ((0.0, 0.19, 0.0), (0.2, 0.01, 0.1)),
)
"""0.4 by 0.4 by 0.2, walls of 0.02, open above."""
BLOCK = (((0.0, 0.0, 0.0), (0.2, 0.2, 0.1)),)
CAVITY = 0.36 * 0.36 * 0.18 / (0.4 * 0.4 * 0.2)
"""Share of the tray's hull that is hollow."""


def check_of(folder, boxes, shown, **more):
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=boxes, shown=shown, **more)
    checks = check_cavities(load_model(make_object(folder / "object", part)))
    return {(c.name, c.subject): c for c in checks}


def test_a_tray_of_five_walls_is_open(tmp_path):
    check = check_of(tmp_path, TRAY, TRAY)["cavities", "part"]
    assert check.outcome == "passed"
    assert check.measured == 1.0
    (share,) = re.findall(r"\((\d+)% of its hull\)", check.message)
    assert int(share) == pytest.approx(100.0 * CAVITY, abs=3.0)


def test_the_points_of_a_cavity_lie_between_its_walls_and_are_not_those_that_judge_it(tmp_path):
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=BLOCK, shown=TRAY)
    model = load_model(make_object(tmp_path / "object", part))
    points = cavity_points(model, "part")
    assert len(points) == pytest.approx(2000 * CAVITY * (0.354 / 0.36) ** 2, abs=80)
    assert (points >= [-0.177, -0.177, -0.077]).all()
    assert (points <= [0.177, 0.177, 0.1]).all()
    judged = hull_points(
        ConvexHull([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 1)]), 9
    )
    others = hull_points(ConvexHull(judged), 9, seed=1)
    assert not np.isin(judged, others).any()


def test_a_sealed_tray_is_refused(tmp_path):
    check = check_of(tmp_path, BLOCK, TRAY)["cavities", "part"]
    assert check.outcome == "failed"
    assert check.measured == 0.0


def test_a_tray_half_filled_is_half_open(tmp_path):
    half = (*TRAY, ((0.0, 0.0, -0.035), (0.18, 0.18, 0.045)))
    check = check_of(tmp_path, half, TRAY)["cavities", "part"]
    assert check.outcome == "failed"
    assert check.measured == pytest.approx(0.5, abs=0.04)


def with_geom(asset, geom):
    """The model of ``asset`` with one more geom in its body."""
    text = asset.mjcf_path.read_text()
    asset.mjcf_path.write_text(text.replace('<body name="body">', f'<body name="body">{geom}'))
    return load_model(asset)


@pytest.mark.parametrize(
    ("size", "outcome"), [("0.18 0.18 0.15", "failed"), ("0.05 0.05 0.02", "passed")]
)
def test_a_cavity_that_an_ellipsoid_fills_is_not_open(tmp_path, size, outcome):
    asset = make_object(tmp_path / "object", body=TRAY)
    model = with_geom(asset, f'<geom type="ellipsoid" size="{size}" pos="0 0 0.02"/>')
    assert check_cavities(model)[0].outcome == outcome


def test_a_shape_that_cannot_be_measured_is_not_left_out(tmp_path):
    asset = make_object(tmp_path / "object", body=TRAY)
    check = check_cavities(with_geom(asset, '<geom name="lid" type="plane" size="1 1 1"/>'))[0]
    assert (check.outcome, check.subject) == ("failed", "body")
    assert "lid of body is of type plane, which cannot be measured" in check.message


def test_a_solid_block_and_a_thin_plate_have_no_cavity(tmp_path):
    thin = (((0.0, 0.0, 0.0), (0.2, 0.2, 0.004)),)
    for name, boxes in (("block", BLOCK), ("plate", thin)):
        check = check_of(tmp_path / name, boxes, boxes)["cavities", "part"]
        assert check.outcome == "not_applicable"


def comb(gap):
    """A plate of 0.4 by 0.4 by 0.02 with ribs of 0.02 on it, at most ``gap`` apart."""
    at = np.linspace(-0.19, 0.19, 1 + int(np.ceil(0.38 / (0.02 + gap))))
    ribs = (((float(x), 0.0, 0.02), (0.01, 0.2, 0.02)) for x in at)
    return (((0.0, 0.0, -0.01), (0.2, 0.2, 0.01)), *ribs)


@pytest.mark.parametrize(("gap", "outcome"), [(0.006, "not_applicable"), (0.03, "failed")])
def test_gaps_in_which_no_small_ball_has_room_are_no_cavity(tmp_path, gap, outcome):
    check = check_of(tmp_path, BLOCK, comb(gap))["cavities", "part"]
    assert check.outcome == outcome
    if outcome == "not_applicable":
        assert "only gaps: a ball of 10 mm has room in 0.0% of its convex hull" in check.message


@pytest.mark.parametrize(
    ("share", "count", "sure"), [(0.013, 2000, False), (0.013, 20000, True), (0.02, 2000, True)]
)
def test_room_counts_where_the_sample_is_sure_of_it(share, count, sure):
    assert has_room(share, count) is sure


def test_a_block_that_is_turned_inside_out_in_places_is_still_solid():
    triangles = np.array(trimesh.creation.box((1.0, 1.0, 1.0)).triangles)
    triangles[::2] = triangles[::2, ::-1]
    points = np.random.default_rng(0).uniform(-0.45, 0.45, (200, 3))
    assert not is_cavity(points, triangles).any()


def test_the_inside_of_a_bowl_is_a_cavity_and_its_wall_is_none():
    outer, inner = (trimesh.creation.icosphere(4, radius) for radius in (1.0, 0.8))
    bowl = trimesh.util.concatenate([outer, inner]).triangles.copy()
    bowl[len(outer.faces) :] = bowl[len(outer.faces) :, ::-1]
    bowl = bowl[bowl.mean(axis=1)[:, 2] < 0.2]  # without lid; the rim is open, too
    inside = np.array([[0.0, 0.0, 0.0], [0.3, 0.2, -0.3]])
    wall = np.array([[0.0, 0.0, -0.9], [0.0, -0.9 * np.sqrt(0.5), -0.9 * np.sqrt(0.5)]])
    assert is_cavity(inside, bowl).all()
    assert not is_cavity(wall, bowl).any()


def test_points_of_a_hull_are_spread_evenly():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    points = hull_points(ConvexHull(corners), 2000)
    assert points.shape == (2000, 3)
    assert (points.sum(axis=1) <= 1.0).all()
    np.testing.assert_allclose(points.mean(axis=0), 0.25, atol=0.02)


def test_width_of_a_turned_box_is_its_least_side():
    box = trimesh.creation.box((0.3, 0.2, 0.05))
    box.apply_transform(trimesh.transformations.euler_matrix(0.1, 0.7, 0.4))
    assert width(ConvexHull(box.vertices)) == pytest.approx(0.05, abs=1e-6)


def test_room_for_fingers_is_the_gap_beside_the_handle(tmp_path):
    bar = ((0.0, 0.0, 0.05), (0.005, 0.05, 0.005))
    lid = ((0.0, 0.0, 0.085), (0.2, 0.2, 0.01))  # 20 mm above the bar
    part = Part(
        name="part", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(bar, lid), handle=(0.0, 0.0, 0.05)
    )
    asset = make_object(tmp_path / "object", part)
    (check,) = check_finger_clearance(load_model(asset))
    assert check.outcome == "passed"
    assert check.measured == pytest.approx(0.020, abs=0.001)
    wide = dataclasses.replace(asset.handles[0], extent=(0.1, 0.04, 0.01))
    asset = dataclasses.replace(asset, handles=(wide,))
    (check,) = check_finger_clearance(load_model(asset))
    assert check.outcome == "not_applicable"
    assert check.measured == pytest.approx(0.005, abs=0.001)
