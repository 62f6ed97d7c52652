"""Groups of points, dense tracks and the classifiers' trees."""

import numpy as np

from articulate.video.joint_classifier import Trees
from articulate.video.motion_groups import group_points, travel
from articulate.video.surface_tracks import follow_surface


def textured(height, width, seed):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (height // 6 + 1, width // 6 + 1, 3)).astype(np.uint8)
    return np.kron(coarse, np.ones((6, 6, 1), dtype=np.uint8))[:height, :width]


def test_surface_tracks_move_as_the_image_does():
    frames = np.stack([textured(100, 160, 2)[:, 3 * t : 120 + 3 * t] for t in range(6)])
    tracks = follow_surface(frames)
    both = tracks.visible[0] & tracks.visible[5]
    assert both.sum() > 30
    moved = tracks.uv[5, both] - tracks.uv[0, both]
    assert np.allclose(np.median(moved, axis=0), [-15.0, 0.0], atol=0.4)


def test_points_with_different_motions_are_in_different_groups():
    rng = np.random.default_rng(0)
    start = rng.uniform(50, 200, (90, 2))
    t = np.linspace(0.0, 1.0, 20)[:, None, None]
    shift = np.where(np.arange(90) < 40, 1.0, 0.0)[None, :, None] * np.array([40.0, 10.0])
    turn = 0.6 * t
    off = start[40:] - np.array([120, 120])
    turned = np.concatenate(
        [
            off[:, :1] * np.cos(turn) - off[:, 1:] * np.sin(turn),
            off[:, :1] * np.sin(turn) + off[:, 1:] * np.cos(turn),
        ],
        axis=2,
    ) + np.array([120, 120])
    uv = np.concatenate([start[None, :40] + t * shift[:, :40], turned], axis=1)
    groups = group_points(uv, np.ones((20, 90), dtype=bool), 300.0)
    first, second = groups.members(0), groups.members(1)
    assert {bool((names < 40).all()) for names in (first, second)} == {True, False}
    assert min(len(first), len(second)) > 25


def test_travel_is_the_diagonal_of_the_visible_path():
    uv = np.array([[[0.0, 0.0]], [[3.0, 4.0]], [[90.0, 90.0]]])
    visible = np.array([[True], [True], [False]])
    assert travel(uv, visible) == 5.0


def test_trees_add_the_values_of_their_leaves():
    trees = Trees(
        roots=np.array([0, 3]),
        feature=np.array([0, -1, -1, -1]),
        threshold=np.array([0.5, -1.0, 2.0, 0.25]),
        right=np.array([2, -1, -1, -1]),
        bias=0.1,
    )
    assert trees.log_odds(np.array([0.4])) == -1.0 + 0.25 + 0.1
    assert trees.log_odds(np.array([0.6])) == 2.0 + 0.25 + 0.1
