"""Candidates: where the axis of a part may pass, from its shape alone."""

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.geometric.surface import (
    PartSurface,
    candidate_axes,
    candidate_pivots,
)
from articulate.transforms import axis_angle_to_matrix


@pytest.mark.parametrize("tilt", [0.0, 0.4, 0.8, 2.0])
def test_a_handle_of_wire_may_hang_by_its_ends_however_it_leans(tilt):
    turn = np.linspace(0.0, np.pi, 4000)
    out = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    hung = np.array([0.1, 0.0, 0.9])
    wire = hung + 0.5 * (np.cos(turn)[:, None] * [0.0, 1.0, 0.0] + np.sin(turn)[:, None] * out)
    found = candidate_pivots(wire, np.empty((0, 3)), np.array([0.0, 1.0, 0.0]), 0.03)
    off = [np.linalg.norm((pivot - hung)[[0, 2]]) for _, pivot in found]
    assert min(off) < 0.04


def test_candidates_lie_no_nearer_to_each_other_than_was_said():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (500, 3)) * [1.0, 0.4, 0.1]
    axis = np.array([0.0, 0.0, 1.0])
    spots = np.array([pivot[:2] for _, pivot in candidate_pivots(points, points[:50], axis, 0.1)])
    apart = np.linalg.norm(spots[:, None] - spots[None], axis=-1)
    assert apart[~np.eye(len(spots), dtype=bool)].min() >= 0.1


@pytest.mark.parametrize("tilt", [0.3, -0.6])
def test_a_lever_that_leans_and_is_as_wide_as_high_may_turn_across_itself(tilt):
    lever = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    lean = axis_angle_to_matrix(np.array([0.0, 1.0, 0.0]), tilt)
    points = np.asarray(lever.vertices) * [0.5, 0.1, 0.1] @ lean.T
    n = len(lever.faces)
    surface = PartSurface(points, np.asarray(lever.faces), np.zeros((n, 3)), np.zeros(n, dtype=int))
    across = lean @ [0.0, 0.0, 1.0]
    assert max(abs(float(axis @ across)) for _, axis in candidate_axes(surface)) > 0.999
