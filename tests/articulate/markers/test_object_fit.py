"""The joint's position from corners: accuracy, the second pose of a square, layouts that lie."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.markers.detection import MarkerDetector
from articulate.markers.layout import Marker, MarkerLayout, marker_model
from articulate.markers.object_fit import PosePrior, fit_object, pose_difference, rotation_vector
from articulate.markers.tracker import MAX_CONTRADICTIONS, ObjectTracker
from articulate.transforms import axis_angle_to_matrix, pose
from marker_scenes import HD, marked_object, projected_corners, render_object

BOUND = {"slide": 0.002, "hinge": np.radians(0.5)}


def fitted(thing, corners, prior=None) -> Any:
    return fit_object(
        marker_model(thing.asset, thing.joint, thing.layout), HD, corners, prior=prior
    )


@settings(max_examples=25)
@given(
    kind=st.sampled_from(["slide", "hinge"]),
    seed=st.integers(0, 999),
    share=st.floats(0.0, 0.75),
    distance_m=st.floats(0.5, 1.0),
)
def test_position_and_pose_follow_from_corners(kind, seed, share, distance_m):
    thing = marked_object(kind, seed, distance_m=distance_m)
    q = share * thing.asset.joint(thing.joint).open
    found = fitted(thing, projected_corners(thing, q, np.random.default_rng(seed), sigma_px=0.05))
    assert found is not None
    assert abs(found.q - q) < max(BOUND[kind], 5.0 * found.q_std)
    assert np.abs(pose_difference(thing.T_co, found.T_co)[:3]).max() < 0.015


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_position_follows_from_an_image(kind):
    thing = marked_object(kind, 7, distance_m=0.8)
    q = 0.4 * thing.asset.joint(thing.joint).open
    image = render_object(thing, q, np.random.default_rng(7))
    found = fitted(thing, MarkerDetector("4x4_50").detect(image))
    assert found is not None
    assert abs(found.q - q) < BOUND[kind]


def test_the_joint_rules_out_the_second_pose_of_a_square():
    wrong = 0
    for seed in range(20):  # corners of small squares far away, where both poses fit
        thing = marked_object("slide", seed, size_m=0.03, distance_m=1.2)
        corners = projected_corners(thing, 0.1, np.random.default_rng(seed), sigma_px=0.3)
        found = fitted(thing, corners)
        wrong += found is None or np.abs(pose_difference(thing.T_co, found.T_co)[3:]).max() > 0.5
    assert wrong <= 1


def test_without_a_marker_on_the_body_a_prior_is_needed():
    thing = marked_object("slide", 1)
    corners = projected_corners(thing, 0.1, np.random.default_rng(0))
    del corners[0]
    assert fitted(thing, corners) is None
    known = PosePrior(thing.T_co, np.diag([1e-6] * 6))
    assert abs(fitted(thing, corners, known).q - 0.1) < 0.003
    del corners[1]
    assert fitted(thing, corners, known) is None


def test_without_a_marker_on_the_part_its_position_is_unknown():
    thing = marked_object("slide", 1)
    corners = projected_corners(thing, 0.1, np.random.default_rng(0))
    del corners[1]
    found = fitted(thing, corners)
    assert found.q is None
    assert found.q_std == np.inf


def test_a_layout_that_contradicts_the_image_gives_no_fit():
    thing = marked_object("slide", 1)
    corners = projected_corners(thing, 0.1, np.random.default_rng(0))
    corners[1] = corners[1] + np.array([0.0, 60.0])  # not on the path of the joint
    assert fitted(thing, corners) is None


def test_a_tracker_follows_while_markers_are_covered_and_notices_a_moved_object():
    thing = marked_object("slide", 3)
    moved = dataclasses.replace(thing, T_wo=thing.T_wo @ pose((0.0, 0.1, 0.0)))
    tracker: Any = ObjectTracker(thing.asset, thing.joint, thing.layout, HD)
    rng = np.random.default_rng(0)
    for k in range(5):
        measured = tracker.process_detections(projected_corners(thing, 0.02 * k, rng), 0.03 * k)
        assert abs(measured.q - 0.02 * k) < 0.002
    corners = projected_corners(thing, 0.15, rng)
    del corners[0]
    assert abs(tracker.process_detections(corners, 0.2).q - 0.15) < 0.002
    found = [
        tracker.process_detections(projected_corners(moved, 0.15, rng), 0.3)
        for _ in range(MAX_CONTRADICTIONS)
    ]
    assert found[0] is None
    assert abs(found[-1].q - 0.15) < 0.003
    assert tracker.moved_m == pytest.approx(0.1, abs=0.02)


def test_an_image_of_another_size_is_an_error(error_line):
    thing = marked_object("slide", 3)
    tracker: Any = ObjectTracker(thing.asset, thing.joint, thing.layout, HD)
    error_line(
        "ObjectTracker.process(640x480)",
        lambda: tracker.process(np.zeros((480, 640), dtype=np.uint8), 0.0),
    )


def test_layouts_without_body_or_part_are_errors(error_line):
    thing = marked_object("slide", 3)
    first = thing.layout.markers[0]
    for name, markers in {
        "body only": (first,),
        "unknown link": (first, dataclasses.replace(first, id=1, link="drawr")),
    }.items():
        error_line(
            f"marker_model({name})",
            lambda markers=markers: marker_model(
                thing.asset, thing.joint, MarkerLayout(markers=markers)
            ),
        )
    error_line("MarkerLayout(id twice)", lambda: MarkerLayout(markers=(first, first)))
    error_line(
        "MarkerLayout(id 60)", lambda: MarkerLayout(markers=(dataclasses.replace(first, id=60),))
    )
    error_line(
        "Marker(normal parallel to up)",
        lambda: Marker(id=1, link="x", size_m=0.04, center_m=(0, 0, 0), normal=(0, 0, 1)),
    )


@given(angle=st.floats(0.0, 3.0), axis=st.tuples(*[st.floats(-1, 1)] * 3))
def test_rotation_vectors_invert_rotations(angle, axis):
    length = np.linalg.norm(axis)
    if length < 1e-3:
        return
    vector = angle * np.array(axis) / length
    matrix = axis_angle_to_matrix(np.array(axis) / length, angle)
    assert np.allclose(rotation_vector(matrix), vector, atol=1e-7)
