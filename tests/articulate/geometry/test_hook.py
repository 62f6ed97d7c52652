"""Closed fingers hook a part behind an edge with room for them."""

import numpy as np
import pytest
import trimesh

from articulate.geometry.grasp import TIP_M
from articulate.geometry.hook import ABOVE_M, DEPTH_M, SLACK_M, TIP_SIZE_M, hook_places

X, Y, Z = np.eye(3)
THICK_M = 0.09


def block(low, high):
    out = trimesh.creation.box(np.subtract(high, low))
    out.apply_translation(np.add(low, high) / 2.0)
    return out


def front(*, above_m, gap_m=None):
    """A thick front in x from 0 that rises above a body of 0.3 m, with a wall ``gap_m`` behind it.

    It opens along +x.
    """
    part = block((0.0, -0.15, 0.0), (THICK_M, 0.15, 0.3 + above_m))
    others = [block((-0.4, -0.15, 0.0), (-0.003, 0.15, 0.3))]
    if gap_m is not None:
        others.append(block((-0.4, -0.15, 0.3), (-gap_m, 0.15, 0.3 + above_m)))
    mesh = trimesh.util.concatenate([part, *others])
    owner = np.zeros(len(mesh.faces))
    owner[: len(part.faces)] = 1.0
    return mesh, owner


def from_above(mesh_owner, far_from=None):
    """The place that fingers enter from above."""
    places = hook_places(*mesh_owner, opening=X, far_from=far_from)
    (place,) = (one for one in places if one.normal_o @ Z > 0.9)
    return place


def test_fingers_enter_from_above_behind_a_front_that_rises_above_the_body():
    place = from_above(front(above_m=0.06))
    assert place.kind == "hook"
    assert place.normal_o == pytest.approx(Z)
    assert place.along_o == pytest.approx(X)
    assert place.extent[1] == 0.0  # nothing is between the fingers
    tip = place.pos_o - TIP_M * Z
    assert tip[2] == pytest.approx(0.36 - DEPTH_M[1], abs=1e-6)  # as deep as suffices
    room = -tip[0] - TIP_SIZE_M[0] / 2.0
    assert SLACK_M - 0.002 <= room <= SLACK_M + 0.010
    assert abs(tip[1]) < 0.01


def test_tips_keep_a_distance_to_the_body_behind_a_low_edge():
    place = from_above(front(above_m=0.024))
    assert place.pos_o[2] - TIP_M == pytest.approx(0.3 + ABOVE_M, abs=1e-6)
    assert place.extent[2] == pytest.approx(0.024 - ABOVE_M, abs=1e-6)


@pytest.mark.parametrize(("above_m", "gap_m"), [(0.015, None), (0.06, 0.02)])
def test_without_depth_or_room_there_is_no_place(above_m, gap_m):
    assert hook_places(*front(above_m=above_m, gap_m=gap_m), opening=X, far_from=None) == []


def test_a_gap_as_wide_as_the_fingers_and_their_slack_has_room():
    wide_m = TIP_SIZE_M[0] + 2.0 * SLACK_M + 0.012
    assert hook_places(*front(above_m=0.06, gap_m=wide_m), opening=X, far_from=None)


def test_a_door_is_hooked_far_from_its_hinge():
    place = from_above(front(above_m=0.06), np.array([[0.0, -0.15, 0.0], Z]))
    assert place.pos_o[1] > 0.1
