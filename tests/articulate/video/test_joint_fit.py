"""Fits of hinges and slides to tracks of known motion."""

import numpy as np
import pytest

from articulate.transforms import axis_angle_to_matrix
from articulate.video.joint_fit import best_fit, residuals_under
from articulate.video.joint_starts import hinge_starts, slide_starts, track_set

SIZE_PX = (480, 360)
FOCAL_PX = 1.1 * 480


def board(seed=0, count=60):
    """Points of a tilted board in front of the camera (N, 3)."""
    rng = np.random.default_rng(seed)
    flat = np.column_stack([rng.uniform(-0.2, 0.2, (count, 2)), np.zeros(count)])
    tilt = axis_angle_to_matrix(np.array([0.0, 1.0, 0.0]), 0.5)
    return flat @ tilt.T + np.array([0.0, 0.05, 1.0])


def tracks_of(poses, noise_px=0.2):
    """Tracks of the board, moved by ``poses`` of its points (T times N, 3)."""
    rng = np.random.default_rng(1)
    points = np.stack(poses)
    uv = FOCAL_PX * points[..., :2] / points[..., 2:] + 0.5 * np.array(SIZE_PX)
    uv += noise_px * rng.standard_normal(uv.shape)
    visible = np.ones(uv.shape[:2], dtype=bool)
    visible[:10, ::3] = False
    tracks = track_set(uv, visible, np.arange(uv.shape[1]), SIZE_PX)
    assert tracks is not None
    return tracks


def turned(axis, pivot, angles):
    return [
        (board() - pivot) @ axis_angle_to_matrix(np.asarray(axis), float(a)).T + pivot
        for a in angles
    ]


@pytest.mark.parametrize("axis", [(0.0, 0.96, 0.28), (1.0, 0.0, 0.0)])
def test_a_hinge_is_found_and_no_slide_explains_it(axis):
    edge = np.array([-0.2, 0.25, 1.0])
    tracks = tracks_of(turned(axis, edge, np.linspace(0.0, 1.1, 30)))
    hinge = best_fit("revolute", tracks, hinge_starts(tracks))
    slide = best_fit("prismatic", tracks, slide_starts(tracks))
    assert abs(hinge.axis @ np.asarray(axis)) > np.cos(np.radians(6.0))
    assert np.ptp(hinge.positions) == pytest.approx(1.1, rel=0.1)
    assert hinge.cost < 0.3 * slide.cost


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (0.0, 0.0, -1.0)])
def test_a_slide_is_found_and_fits_as_well_as_a_hinge(axis):
    path = [board() + 0.3 * s * np.asarray(axis) for s in np.linspace(0.0, 1.0, 30)]
    tracks = tracks_of(path)
    slide = best_fit("prismatic", tracks, slide_starts(tracks))
    hinge = best_fit("revolute", tracks, hinge_starts(tracks))
    forward = np.sign(slide.positions[-1] - slide.positions[0])
    assert forward * (slide.axis @ np.asarray(axis)) > np.cos(np.radians(8.0))
    assert slide.cost < 1.5 * hinge.cost + 0.1


def test_points_of_another_motion_do_not_fit():
    edge = np.array([-0.2, 0.0, 1.0])
    tracks = tracks_of(turned((0.0, 1.0, 0.0), edge, np.linspace(0.0, 1.0, 30)))
    hinge = best_fit("revolute", tracks, hinge_starts(tracks))
    assert np.median(residuals_under(hinge, tracks)) < 0.5
    other = tracks_of([board() + np.array([0.0, 0.2 * s, 0.0]) for s in np.linspace(0.0, 1.0, 30)])
    assert np.median(residuals_under(hinge, other)) > 3.0
