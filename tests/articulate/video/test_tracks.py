"""Point tracks in frames of known motion."""

import numpy as np
import pytest

from articulate.errors import UsageError
from articulate.video.moving_region import camera_motion, moving_points
from articulate.video.tracks import PointTracks, follow_points


def textured(height, width, seed):
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (height // 6 + 1, width // 6 + 1, 3)).astype(np.uint8)
    return np.kron(coarse, np.ones((6, 6, 1), dtype=np.uint8))[:height, :width]


def sliding(n_frames=8, step=3, camera=0):
    """A textured patch that slides over a textured wall, seen by a camera that slides too."""
    wall, patch = textured(120, 200, 0), textured(48, 48, 1)
    frames = []
    for t in range(n_frames):
        scene = wall.copy()
        scene[40:88, 20 + step * t : 68 + step * t] = patch
        frames.append(scene[:, 10 + camera * t : 150 + camera * t])
    return np.stack(frames)


def test_tracked_points_move_as_the_image_does():
    frames = np.stack([textured(100, 160, 2)[:, 3 * t : 120 + 3 * t] for t in range(6)])
    tracks = follow_points(frames)
    both = tracks.visible[0] & tracks.visible[5]
    assert both.sum() > 30
    moved = tracks.uv[5, both] - tracks.uv[0, both]
    assert np.allclose(np.median(moved, axis=0), [-15.0, 0.0], atol=0.2)


def test_plain_frames_have_no_points():
    tracks = follow_points(np.full((4, 40, 40, 3), 90, dtype=np.uint8))
    assert tracks.uv.shape == (4, 0, 2)


@pytest.mark.parametrize("camera", [0, 2])
def test_moving_points_are_separated_from_the_camera(camera):
    frames = sliding(camera=camera)
    moving = moving_points(follow_points(frames), (140, 120))
    assert moving.uv.shape[1] > 10
    steps = []
    for n in range(moving.uv.shape[1]):
        seen = moving.uv[moving.visible[:, n], n]
        steps.append((seen[-1] - seen[0]) / (len(seen) - 1))
    assert np.allclose(np.median(steps, axis=0), [3.0, 0.0], atol=0.3)


def test_a_static_camera_has_no_motion():
    motion = camera_motion(follow_points(sliding()))
    centre = motion @ np.array([70.0, 60.0, 1.0])
    assert np.allclose(centre[:, :2], [70.0, 60.0], atol=0.5)


def test_shapes_that_do_not_belong_together_are_rejected():
    with pytest.raises(UsageError, match="were expected"):
        PointTracks(uv=np.zeros((5, 3, 2)), visible=np.ones((5, 4), dtype=bool))
