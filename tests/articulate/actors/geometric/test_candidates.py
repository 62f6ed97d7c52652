"""Candidates: where the axis of a part may pass, from its shape alone."""

import numpy as np
import pytest

from articulate.actors.geometric.candidates import pivots_of


@pytest.mark.parametrize("tilt", [0.0, 0.4, 0.8, 2.0])
def test_a_handle_of_wire_may_hang_by_its_ends_however_it_leans(tilt):
    turn = np.linspace(0.0, np.pi, 4000)
    out = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    hung = np.array([0.1, 0.0, 0.9])
    wire = hung + 0.5 * (np.cos(turn)[:, None] * [0.0, 1.0, 0.0] + np.sin(turn)[:, None] * out)
    found = pivots_of(wire, np.empty((0, 3)), np.array([0.0, 1.0, 0.0]), 0.03)
    off = [np.linalg.norm((pivot - hung)[[0, 2]]) for _, pivot in found]
    assert min(off) < 0.04


def test_candidates_lie_no_nearer_to_each_other_than_was_said():
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (500, 3)) * [1.0, 0.4, 0.1]
    axis = np.array([0.0, 0.0, 1.0])
    spots = np.array([pivot[:2] for _, pivot in pivots_of(points, points[:50], axis, 0.1)])
    apart = np.linalg.norm(spots[:, None] - spots[None], axis=-1)
    assert apart[~np.eye(len(spots), dtype=bool)].min() >= 0.1
