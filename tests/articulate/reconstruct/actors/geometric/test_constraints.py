"""What is asked of a motion: its part, its kind, and what it lies near."""

import numpy as np
import pytest

from articulate.reconstruct.actors.geometric.fit import MotionConstraints
from articulate.reconstruct.actors.geometric.search import MotionFit
from articulate.reconstruct.actors.geometric.surface import JointMotion

X, Z = np.eye(3)[0], np.eye(3)[2]
HINGE = JointMotion("turn", Z, np.array([0.3, 0.6, 0.0]), "wanted")


def fit(kind, axis, pivot):
    return MotionFit(JointMotion(kind, axis, np.asarray(pivot), "found"), np.zeros(2), 0.0, (0,))


@pytest.mark.parametrize(
    ("found", "allowed"),
    [
        (fit("turn", Z, (0.3, 0.6, 5.0)), True),  # the same line, farther up
        (fit("turn", -Z, (0.35, 0.6, 0.0)), True),
        (fit("turn", Z, (0.45, 0.6, 0.0)), False),
        (fit("turn", X, (0.3, 0.6, 0.0)), False),
        (fit("slide", Z, (0.3, 0.6, 0.0)), False),
    ],
)
def test_a_turn_is_near_another_by_kind_direction_and_line(found, allowed):
    assert MotionConstraints(near=HINGE, near_m=0.1).allows(found) is allowed


def test_where_a_slide_is_said_to_be_does_not_matter():
    wanted = JointMotion("slide", X, np.zeros(3), "wanted")
    assert MotionConstraints(near=wanted).allows(fit("slide", X, (5.0, 5.0, 5.0)))
