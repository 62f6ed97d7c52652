"""Fit of a box and a camera: projections, overlap, predicted corners, recovery of a box."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.ndimage import correlate

from articulate.reconstruct.fitting import box_fit
from articulate.reconstruct.fitting.box_cost import N_PARAMETERS, overlap, project
from articulate.reconstruct.fitting.box_fit import box_corners, camera_of
from articulate.reconstruct.fitting.box_network import (
    GRID,
    WEIGHTS_FILE,
    BoxPrediction,
    square_crop,
)
from articulate.reconstruct.fitting.decoder import Network, read_network
from articulate.reconstruct.recognition.classifier import SIDE_PX
from articulate.render.parts import plain_part
from articulate.render.rendered_photo import render_photo

PARAMETERS = np.array([0.3, -0.2, 0.5, 0.4, 0.02, 1.6, 0.2, 0.51, 0.46])


def test_compiled_projection_equals_that_of_the_camera() -> None:
    assert len(PARAMETERS) == N_PARAMETERS
    uv = np.empty((8, 2))
    assert project(PARAMETERS, 640.0, uv)
    camera = camera_of(PARAMETERS, (640, 480))
    expected, _ = camera.project(box_corners(np.exp(0.3), np.exp(-0.2)))
    np.testing.assert_allclose(uv - 0.5, expected, atol=1e-9)


def test_overlap_of_rectangles_is_their_intersection_over_union() -> None:
    mask = np.zeros((40, 60), dtype=bool)
    mask[10:30, 20:50] = True  # 20 x 30
    sums = np.zeros((40, 61), dtype=np.int64)
    sums[:, 1:] = np.cumsum(mask, axis=1)
    u, v = np.array([20.0, 49.999]), np.array([10.0, 29.999])
    uv = np.array([[u[i], v[j]] for i in (0, 1) for j in (0, 1)] * 2)
    assert overlap(uv, sums) == pytest.approx(1.0, abs=0.01)
    half = uv.copy()
    half[:, 0] = np.where(half[:, 0] > 30, 34.999, half[:, 0])
    assert overlap(half, sums) == pytest.approx(0.5, abs=0.01)


def test_a_fit_follows_the_predicted_corners(monkeypatch: pytest.MonkeyPatch) -> None:
    width, depth = 1.3, 0.7
    mesh = trimesh.creation.box(bounds=[[-depth / 2, -width / 2, 0], [depth / 2, width / 2, 1]])
    part = plain_part("box", np.asarray(mesh.vertices), np.asarray(mesh.faces))
    photo = render_photo([part], 5, plain=True)
    uv, _ = photo.camera.project(box_corners(width, depth))
    eye = photo.camera.T_wc[:3, 3] - [0.0, 0.0, 0.5]
    view = [np.arctan2(eye[1], eye[0]), np.arcsin(eye[2] / np.linalg.norm(eye))]
    prediction = BoxPrediction(
        corners=uv + 0.5 + np.random.default_rng(0).normal(size=(8, 2)) * 6.0,
        corner_spread=np.full(8, 12.0),
        values=np.array([0.1, -0.2, *view, np.log(photo.camera.fx_px)]),
        spread=np.full(5, 0.4),
    )
    monkeypatch.setattr(box_fit, "predict_box", lambda image, mask: prediction)
    fit = box_fit.fit_box(photo.image, photo.mask)
    assert max(abs(fit.width / width - 1), abs(fit.depth / depth - 1)) < 0.1
    assert fit.overlap > 0.95
    assert fit.cost < 0.2


def test_the_square_around_an_object_keeps_its_place() -> None:
    image = np.full((300, 400, 3), 255, dtype=np.uint8)
    image[100:200, 150:250] = 0
    crop, (scale, u, v) = square_crop(image, np.array([150.0, 100.0, 250.0, 200.0]))
    rows, columns = np.nonzero(crop[..., 0] < 128)
    assert scale * 150.0 + u == pytest.approx(columns.min() / SIDE_PX, abs=0.01)
    assert scale * 200.0 + v == pytest.approx((rows.max() + 1) / SIDE_PX, abs=0.01)


def test_a_layer_is_a_zero_padded_convolution() -> None:
    rng = np.random.default_rng(0)
    x, weight, bias = rng.normal(size=(2, 5, 4)), rng.normal(size=(3, 2, 3, 3)), rng.normal(size=3)
    network = Network(weights={"one.weight": weight, "one.bias": bias})
    expected = bias[:, None, None] + np.array(
        [sum(correlate(x[c], weight[o, c], mode="constant") for c in range(2)) for o in range(3)]
    )
    np.testing.assert_allclose(network.layer("one", x, relu=False), expected, atol=1e-9)
    halved = network.layer("one", x, 2)
    np.testing.assert_allclose(halved, np.maximum(expected, 0.0)[:, ::2, ::2], atol=1e-9)


def test_the_weights_predict_the_corners_of_a_map() -> None:
    network = read_network(WEIGHTS_FILE)
    maps = {"stride_32": np.zeros((1, 320, 7, 7)), "stride_16": np.zeros((1, 112, 14, 14))}
    found, context = network.decode(maps)
    assert network.layer("heat", found, relu=False).shape == (8, GRID, GRID)
    assert network.linear("spread", context).shape == (8,)
