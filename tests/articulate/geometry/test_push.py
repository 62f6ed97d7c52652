"""Closed fingers push a part at a flat place of its front."""

import numpy as np
import pytest
import trimesh

from articulate.geometry.grasp import TIP_M
from articulate.geometry.push import RADIUS, push_place

X, Y, Z = np.eye(3)


def front(*pieces):
    """A front of 0.4 m by 0.3 m in the plane x = 0 seen from +x, with further pieces."""
    panel = trimesh.creation.box((0.02, 0.4, 0.3))
    panel.apply_translation((-0.01, 0.0, 0.0))
    mesh = trimesh.util.concatenate([panel, *pieces])
    return mesh, np.ones(len(mesh.faces))


def pushed(mesh_owner, far_from=None):
    place = push_place(*mesh_owner, opening=X, far_from=far_from)
    assert place is not None
    return place


def test_a_drawer_is_pushed_at_the_middle_of_its_front():
    place = pushed(front())
    assert place.pos_o == pytest.approx([TIP_M, 0.0, 0.0], abs=0.006)
    assert place.kind == "push"
    assert place.normal_o == pytest.approx(X)


def test_a_door_is_pushed_far_from_its_hinge():
    hinge = np.array([[0.0, -0.2, 0.0], Z])
    place = pushed(front(), hinge)
    widest = 0.4 - 0.012
    assert place.pos_o[1] + 0.2 == pytest.approx(RADIUS * widest, abs=0.012)


def test_a_place_beside_a_knob_is_flat():
    knob = trimesh.creation.icosphere(radius=0.015)
    knob.apply_translation((0.015, 0.0, 0.0))
    place = pushed(front(knob))
    assert place.pos_o[0] == pytest.approx(TIP_M, abs=1e-6)
    assert np.abs(place.pos_o[1:]).max() >= 0.015 + 0.012 - 0.004


def test_a_front_without_a_flat_place_is_not_pushed():
    bar = trimesh.creation.cylinder(radius=0.004, height=0.3)
    assert push_place(bar, np.ones(len(bar.faces)), opening=X, far_from=None) is None
