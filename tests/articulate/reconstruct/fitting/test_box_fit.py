"""Fit of a box and a camera: projections, overlap, recovery of a rendered box."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from articulate.benchmark.rendered_photo import render_photo
from articulate.reconstruct.fitting.box_cost import N_PARAMETERS, overlap, project
from articulate.reconstruct.fitting.box_fit import (
    SizePrior,
    box_corners,
    camera_of,
    fit_box,
    turned,
)
from articulate.render.parts import plain_part

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


@pytest.mark.parametrize("seed", [5, 8])
def test_proportions_of_a_rendered_box_are_found(seed: int) -> None:
    width, depth = 1.3, 0.7
    mesh = trimesh.creation.box(bounds=[[-depth / 2, -width / 2, 0], [depth / 2, width / 2, 1]])
    part = plain_part("box", np.asarray(mesh.vertices), np.asarray(mesh.faces))
    photo = render_photo([part], seed, plain=True)
    fits = fit_box(photo.image, photo.mask, SizePrior(log_width=0.2, log_depth=-0.3, spread=0.5))
    both = [fits[0], turned(fits[0])]  # a plain box has no front
    errors = [max(abs(f.width / width - 1), abs(f.depth / depth - 1)) for f in both]
    assert min(errors) < 0.12
    assert fits[0].overlap > 0.95


def test_turning_twice_gives_the_same_box() -> None:
    mesh = trimesh.creation.box(bounds=[[-0.3, -0.5, 0], [0.3, 0.5, 1]])
    part = plain_part("box", np.asarray(mesh.vertices), np.asarray(mesh.faces))
    photo = render_photo([part], 5, plain=True)
    fit = fit_box(photo.image, photo.mask)[0]
    again = turned(turned(fit))
    np.testing.assert_allclose(again.front(), fit.front(), atol=1e-6)
