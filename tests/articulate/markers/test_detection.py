"""Corners of markers to a hundredth of a pixel, and what a detector does not return."""

import numpy as np
import pytest

from articulate.markers.detection import MarkerDetector, marker_poses
from articulate.markers.layout import SQUARE, Marker
from articulate.markers.synthetic_images import (
    NO_NOISE,
    ImageNoise,
    Occluder,
    marker_plane,
    render_planes,
)
from articulate.transforms import apply, axis_angle_to_matrix, pose, rotation_angle
from marker_scenes import HD

SIZE_M = 0.05
FACING = np.diag([1.0, -1.0, -1.0])


def plane_at(distance_m, tilt_rad=0.5, number=3):
    marker = Marker(id=number, link="x", size_m=SIZE_M, center_m=(0, 0, 0), normal=(1, 0, 0))
    T_cm = pose((0.03, -0.05, distance_m), axis_angle_to_matrix((0.6, 0.8, 0.0), tilt_rad) @ FACING)
    return marker_plane("4x4_50", marker, T_cm)


@pytest.mark.parametrize(("distance_m", "bound_px"), [(0.5, 0.12), (1.0, 0.2)])
def test_lines_through_the_edges_are_nearer_than_opencvs_corners(distance_m, bound_px):
    plane = plane_at(distance_m)
    image = render_planes(HD, [plane], np.random.default_rng(1))
    exact = HD.projected(apply(plane.T_cp, SIZE_M * SQUARE))
    lines, corners = (
        np.linalg.norm(
            MarkerDetector("4x4_50", refine_edges=refine).detect(image)[3] - exact, axis=1
        )
        for refine in (True, False)
    )
    assert lines.max() < bound_px
    assert lines.mean() < 0.5 * corners.mean()


def test_a_pose_is_right_to_a_millimetre_and_a_tenth_of_a_degree():
    plane = plane_at(0.6)
    image = render_planes(HD, [plane], np.random.default_rng(2))
    best, other = marker_poses(MarkerDetector("4x4_50").detect(image)[3], SIZE_M, HD.K, HD.dist)
    assert np.abs(best.T_cm[:3, 3] - plane.T_cp[:3, 3]).max() < 1e-3
    assert rotation_angle(best.T_cm[:3, :3].T @ plane.T_cp[:3, :3]) < np.radians(0.5)
    assert best.error_px < other.error_px


def test_a_marker_that_is_half_covered_or_appears_twice_is_not_returned():
    rng = np.random.default_rng(3)
    plane = plane_at(0.6)
    u, v = HD.projected(plane.T_cp[None, :3, 3])[0]
    cover = Occluder(np.array([(u, v - 90), (u + 90, v - 90), (u + 90, v + 90), (u, v + 90)]))
    detector = MarkerDetector("4x4_50")
    assert detector.detect(render_planes(HD, [plane], rng, noise=NO_NOISE, occluders=[cover])) == {}
    other = marker_plane(
        "4x4_50",
        Marker(id=3, link="x", size_m=SIZE_M, center_m=(0, 0, 0), normal=(1, 0, 0)),
        pose((-0.15, 0.0, 0.6), FACING),
    )
    assert detector.detect(render_planes(HD, [plane, other], rng, noise=NO_NOISE)) == {}


def test_blur_and_noise_widen_errors_but_leave_the_marker_visible():
    plane = plane_at(0.7)
    image = render_planes(
        HD, [plane], np.random.default_rng(4), noise=ImageNoise(sigma=8.0, blur_px=1.5)
    )
    exact = HD.projected(apply(plane.T_cp, SIZE_M * SQUARE))
    assert np.linalg.norm(MarkerDetector("4x4_50").detect(image)[3] - exact, axis=1).max() < 0.6
