"""What a model is shown is what it is told."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import DOOR

from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.actors.vlm.images import (
    camera_of,
    colours_of,
    evidence_images,
    frame_indices,
    parts_image,
    poses_at,
    prediction_image,
    scale_down,
)
from articulate.reconstruct.actors.vlm.prompt_text import describe_direction
from articulate.render.image import as_png
from articulate.render.scene import PartScene

HANDLE = PredictedJoint(part="part_03", parent="part_02", kind="fixed")


def read(content):
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), 1)
    assert picture is not None
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def test_each_part_has_in_the_picture_the_colour_that_is_told(video):
    picture = read(parts_image(video).png)
    seen = PartScene(video.parts).rasterize(camera_of(video))
    for k, (name, colour) in enumerate(colours_of(video.parts).items()):
        told = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])
        where = seen.part_ids == k
        assert where.any(), name
        same = (picture[where] == told).all(axis=1)
        assert same.mean() > 0.9  # arrows and their names may cover some


def test_frames_are_spread_evenly_with_both_ends():
    assert frame_indices(50) == [0, 7, 14, 21, 28, 35, 42, 49]
    assert frame_indices(3) == [0, 1, 2]


def test_frames_are_sent_whole_and_unchanged_if_they_are_small(video):
    for k, picture in zip(frame_indices(14), evidence_images(video)[:-1], strict=True):
        np.testing.assert_array_equal(read(picture.png), video.video[k])


def test_large_pictures_are_made_smaller_in_their_own_shape():
    assert scale_down(np.zeros((1200, 1600, 3), np.uint8)).shape == (480, 640, 3)
    assert scale_down(np.zeros((30, 40, 3), np.uint8)).shape == (30, 40, 3)


def beside(video, joint):
    """How much rows of the clip differ from the rows of the prediction below them."""
    picture = read(prediction_image(video, [joint, HANDLE]).png).astype(float)
    a, b, c, d = np.split(picture, 4)
    return np.abs(np.concatenate([a - b, c - d])).mean()


def test_the_right_prediction_looks_like_the_clip_and_wrong_ones_do_not(video):
    right = beside(video, DOOR)
    slide = replace(DOOR, kind="prismatic", axis_o=(1.0, 0.0, 0.0), upper=0.3)
    tilted = replace(DOOR, axis_o=(0.0, 1.0, 0.0), pivot_o=(0.3, 0.0, 0.75))
    other_edge = replace(DOOR, axis_o=(0.0, 0.0, -1.0), pivot_o=(0.3, 0.05, 0.0))
    short = replace(DOOR, upper=0.3)
    assert right < 0.8 * min(beside(video, j) for j in (slide, tilted, other_edge, short))


def test_what_is_fixed_to_a_part_goes_along(video):
    held = {"part_02": DOOR, "part_03": HANDLE}
    poses = poses_at(video.parts, held, 1.0)
    np.testing.assert_allclose(poses[2], DOOR.T_o(1.4))
    np.testing.assert_allclose(poses[3], poses[2])
    np.testing.assert_allclose(poses[:2], np.broadcast_to(np.eye(4), (2, 4, 4)))


def test_parts_that_hang_on_each_other_in_a_circle_are_drawn_all_the_same(video):
    a = replace(DOOR, part="part_02", parent="part_03")
    b = replace(DOOR, part="part_03", parent="part_02")
    assert np.isfinite(poses_at(video.parts, {"part_02": a, "part_03": b}, 0.5)).all()


def test_without_a_camera_all_parts_are_seen(text):
    camera = camera_of(text)
    corners = np.concatenate([part.vertices for part in text.parts])
    uv, depth = camera.project(corners)
    assert (depth > 0.0).all()
    assert (uv >= 0.0).all()
    assert (uv < [camera.width_px, camera.height_px]).all()


def test_a_webp_becomes_a_png():
    picture = np.full((8, 8, 3), 120, np.uint8)
    content = cv2.imencode(".webp", picture)[1].tobytes()
    assert abs(int(read(as_png(content)).mean()) - 120) < 4
    assert as_png(as_png(content)) == as_png(content)


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ((1, 0, 0), "front"),
        ((-2, 0, 0.1), "back"),
        ((0, 1, 0), "right"),
        ((0, -1, 1.5), "up and left"),
        ((0, 0, -1), "down"),
    ],
)
def test_directions_in_words(way, words):
    assert describe_direction(np.array(way, dtype=float)) == words
