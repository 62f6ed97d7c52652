"""The compiled loops of the search against plain ones."""

from itertools import product

import numpy as np
import pytest

from articulate.reconstruct.actors.geometric.kernels import (
    best_path,
    normal_equations,
    render_over,
    render_poses,
    sweep_costs,
)
from articulate.reconstruct.actors.geometric.parameters import SEARCH
from articulate.transforms import axis_angle_to_matrix, pose

PINHOLE = np.array([40.0, 40.0, 15.5, 11.5])
SIZE = (24, 32)
LIGHT = np.array([[0.5] * 3, [0.3] * 3, [0.2] * 3, [0.0, 0.0, -1.0]])
POINTS = np.array([[-0.3, -0.2, 0.0], [0.3, -0.2, 0.0], [0.3, 0.2, 0.0], [-0.3, 0.2, 0.0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
SURFACE = (POINTS, FACES, np.full((2, 3), 120.0))


def poses(n):
    turns = axis_angle_to_matrix(np.tile([0.0, 1.0, 0.0], (n, 1)), np.linspace(0.0, 1.0, n))
    return pose(np.column_stack([np.linspace(-0.1, 0.1, n), np.zeros(n), np.full(n, 2.0)]), turns)


def setting(n):
    rng = np.random.default_rng(0)
    frames = rng.uniform(0, 255, (*SIZE, 3, n)).astype(np.float32)
    base = rng.uniform(0, 50, (*SIZE, n)).astype(np.float32)
    behind = np.full(SIZE, 0.2, dtype=np.float32)
    behind[:, 18:] = 1.0  # something nearer hides the right
    return frames, base, behind


def test_costs_are_those_of_drawn_pictures():
    frames, base, behind = setting(4)
    T, out = poses(4), np.empty((4, 4))
    sweep_costs(SURFACE, LIGHT, T, PINHOLE, behind, frames, base, False, np.float32(90.0), out)
    for q, t in product(range(4), range(4)):
        picture, shown = np.zeros((*SIZE, 3), np.float32), np.zeros(SIZE, bool)
        render_over(SURFACE, LIGHT, T[q], PINHOLE, behind, picture, shown)
        assert shown.any()
        assert not shown[:, 18:].any()
        off = np.minimum(np.abs(frames[..., t] - picture).sum(axis=-1), 90.0)
        assert out[q, t] == pytest.approx(float((off - base[:, :, t])[shown].sum()), rel=1e-3)


def test_the_diagonal_is_the_diagonal():
    frames, base, behind = setting(5)
    every, own = np.empty((5, 5)), np.empty((5, 1))
    cap = np.float32(90.0)
    sweep_costs(SURFACE, LIGHT, poses(5), PINHOLE, behind, frames, base, False, cap, every)
    sweep_costs(SURFACE, LIGHT, poses(5), PINHOLE, behind, frames, base, True, cap, own)
    assert np.allclose(own[:, 0], np.diagonal(every), rtol=1e-4)


def test_a_face_turned_to_camera_and_lamp_has_all_light():
    picture, shown = np.zeros((*SIZE, 3), np.float32), np.zeros(SIZE, bool)
    nothing = np.zeros(SIZE, dtype=np.float32)
    render_over(SURFACE, LIGHT, poses(1)[0], PINHOLE, nothing, picture, shown)
    assert np.allclose(picture[shown], 120.0, atol=1.5)


@pytest.mark.parametrize("circular", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_the_cheapest_path_is_that_of_trying_all(seed, circular):
    """Every first column and every step of a path of five rows."""
    costs = np.random.default_rng(seed).uniform(0, 10, (5, 5))
    largest, change_cost = 2, 1.5
    path = best_path(costs, change_cost, largest, circular)

    def price(columns):
        if not circular and not all(0 <= c < 5 for c in columns):
            return np.inf
        steps = np.diff(columns)
        total = sum(costs[t, c % 5] for t, c in enumerate(columns))
        total += change_cost * SEARCH.motion_cost_share * np.abs(steps).sum()
        return total + change_cost * (np.diff(steps) ** 2).clip(max=SEARCH.max_step_change**2).sum()

    steps = range(-largest, largest + 1)
    tried = (np.cumsum([q, *d]) for q in range(5) for d in product(steps, repeat=4))
    assert price(path) == pytest.approx(min(price(columns) for columns in tried))
    assert np.abs(np.diff(path)).max() <= largest


def test_a_turn_that_passes_the_end_of_the_circle_goes_on_counting():
    costs = np.ones((6, 8))
    for t in range(6):
        costs[t, (6 + t) % 8] = 0.0
    assert best_path(costs, 0.01, 2, True).tolist()[-1] - best_path(costs, 0.01, 2, True)[0] == 5


def test_what_is_hidden_goes_on_as_before():
    """Two steps a row; from the fifth row on nothing shows."""
    costs = np.zeros((8, 20))
    for t in range(5):
        costs[t] = 10.0
        costs[t, 1 + 2 * t] = 0.0
    assert best_path(costs, 1.0, 4, False).tolist() == [1, 3, 5, 7, 9, 11, 13, 15]


def test_what_shows_nothing_rests():
    assert np.ptp(best_path(np.ones((6, 9)), 1.0, 3, True)) == 0


def test_pictures_within_their_box_are_those_drawn_one_by_one():
    _, _, behind = setting(1)
    still = np.random.default_rng(1).uniform(0, 255, (*SIZE, 3)).astype(np.float32)
    out, box = np.full((3, *SIZE, 3), np.nan, np.float32), np.empty(4, np.int64)
    render_poses(SURFACE, LIGHT, poses(3), PINHOLE, behind, still, box, out)
    left, right, top, bottom = box
    inside = np.s_[top : bottom + 1, left : right + 1]
    for k in range(3):
        whole, shown = still.copy(), np.zeros(SIZE, bool)
        render_over(SURFACE, LIGHT, poses(3)[k], PINHOLE, behind, whole, shown)
        assert np.array_equal(out[k][inside], whole[inside])
        rest = ~np.isnan(out[k]).any(axis=-1)
        rest[inside] = False
        assert not rest.any()
        shown[inside] = False
        assert not shown.any()


def test_equations_are_those_of_weighted_columns():
    """The same by matrices: columns of what each step changes, weighted by how far it is off."""
    rng, soft = np.random.default_rng(2), 24.0
    pictures = rng.uniform(0, 255, (5, 4, 6, 3)).astype(np.float32)
    pictures[:, 2] = 7.0  # nothing changes there
    frame = rng.uniform(0, 255, (4, 6, 3)).astype(np.float32)
    small, force = np.empty((2, 2)), np.empty(2)
    normal_equations(pictures, np.array([1, 5, 0, 3]), frame, soft, small, force)
    seen = pictures[:, :, 1:].reshape(5, -1).astype(float)
    columns = 0.5 * np.stack([seen[1] - seen[2], seen[3] - seen[4]])
    off = frame[:, 1:].reshape(-1) - seen[0]
    weight = 1.0 / np.maximum(np.abs(off), soft)
    weight[np.abs(off) > 4.0 * soft] *= 0.25
    assert small == pytest.approx((columns * weight) @ columns.T, rel=1e-5)
    assert force == pytest.approx((columns * weight) @ off, rel=1e-5)
