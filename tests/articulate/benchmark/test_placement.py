from __future__ import annotations

import numpy as np
import pytest

from articulate.benchmark.placement import (
    placement_errors,
    placement_success,
    released_placement,
)
from articulate.render.parts import PartMesh, plain_part
from articulate.transforms import axis_angle_to_matrix, pose

TETRA = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def lump(name: str, centre, size) -> PartMesh:
    """A part whose box has this middle and these sides."""
    corners = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]], dtype=float) - 0.5
    return plain_part(name, np.asarray(centre) + corners * np.asarray(size), TETRA)


PARTS = [
    lump("body", (0, 0, 0.5), (1, 1, 1)),
    lump("drawer_a", (0.4, 0, 0.3), (0.3, 0.5, 0.2)),
    lump("drawer_b", (0.4, 0, 0.7), (0.3, 0.5, 0.2)),
]
LABELS = {"body": "body", "drawer_a": "drawer", "drawer_b": "drawer"}


def right() -> dict[str, np.ndarray]:
    return {part.name: pose(part.centre) for part in PARTS}


def success(placements, *, anchored=True) -> tuple[bool, bool]:
    found = placement_success(placement_errors(PARTS, LABELS, placements, anchored=anchored))
    return found["paper"], found["strict"]


def test_parts_in_their_places_are_right():
    assert success(right()) == (True, True)


def test_doing_nothing_is_wrong():
    assert success({part.name: np.eye(4) for part in PARTS}) == (False, False)


def test_parts_that_are_alike_may_stand_for_each_other_but_each_for_one():
    swapped = right() | {"drawer_a": right()["drawer_b"], "drawer_b": right()["drawer_a"]}
    assert success(swapped) == (True, True)
    twice = right() | {"drawer_b": right()["drawer_a"]}
    errors = placement_errors(PARTS, LABELS, twice, anchored=True)
    assert sorted(errors.position) == pytest.approx([0.0, 0.0, 0.4])


def test_of_parts_that_are_equally_far_each_stands_for_itself():
    unplaced = placement_errors(PARTS, LABELS, {}, anchored=True)
    assert unplaced.match.tolist() == [0, 1, 2]
    heap = placement_errors(PARTS, LABELS, {p.name: np.eye(4) for p in PARTS}, anchored=True)
    assert heap.match.tolist() == [0, 1, 2]


def test_one_part_out_of_place_is_lost_in_the_published_mean_but_not_in_strict():
    off = right()
    off["drawer_a"] = pose(PARTS[1].centre + np.array([0.2, 0.0, 0.0]))
    assert success(off) == (True, False)


def test_a_part_that_is_not_placed_is_wrong():
    missing = right()
    del missing["drawer_a"]
    errors = placement_errors(PARTS, LABELS, missing, anchored=True)
    assert success(missing) == (False, False)
    assert errors.right.tolist().count(False) == 1


def test_a_placement_that_is_not_a_number_is_wrong():
    broken = right() | {"drawer_a": np.full((4, 4), np.nan)}
    assert success(broken) == (False, False)


def test_a_turned_part_is_wrong_beyond_a_quarter_of_a_radian():
    for angle, good in ((0.24, True), (0.26, False)):
        turned = right()
        turned["body"] = pose(PARTS[0].centre, axis_angle_to_matrix([0.0, 0.0, 1.0], angle))
        assert success(turned)[1] is good


def test_without_a_camera_the_whole_may_stand_elsewhere():
    moved = {name: pose([5.0, 1.0, 0.0]) @ T for name, T in right().items()}
    assert success(moved) == (False, False)
    assert success(moved, anchored=False) == (True, True)


def test_rounding_of_a_quaternion_is_no_angle():
    """Left unclipped, an inner product above 1 gives NaN, as in the released code."""
    slightly_long = np.array([0.5, 0.5, 0.5, 0.5000000001])
    T = np.eye(4)
    T[:3, 3] = PARTS[0].centre
    T[0, 0] = 1.0 + 1e-12
    errors = placement_errors(PARTS, LABELS, right() | {"body": T}, anchored=True)
    assert errors.angle_rad[0] == pytest.approx(0.0, abs=1e-5)
    spot = np.zeros(3)
    assert not released_placement({"a": (spot, slightly_long)}, {"a": (spot, slightly_long)})


def test_the_released_code_takes_no_common_name_for_success():
    spot = (np.zeros(3), UPRIGHT)
    assert released_placement({"door": spot}, {"lid": spot})


def test_the_released_code_ignores_parts_that_only_one_side_knows():
    spot, far = (np.zeros(3), UPRIGHT), (np.full(3, 9.0), UPRIGHT)
    assert released_placement({"door": spot, "lid": spot}, {"door": spot, "cap": far})


def test_the_released_code_takes_the_nearest_of_the_same_first_word_for_several():
    near, far = (np.zeros(3), UPRIGHT), (np.array([0.0, 0.0, 3.0]), UPRIGHT)
    truth = {"door_left": near, "door_right": near}
    assert released_placement(truth, {"door_left": far, "door_right": near})


def test_the_released_code_allows_100_mm_where_the_orientation_is_right():
    for off, good in ((0.099, True), (0.101, False)):
        moved = (np.array([off, 0.0, 0.0]), UPRIGHT)
        assert released_placement({"door": (np.zeros(3), UPRIGHT)}, {"door": moved}) is good
