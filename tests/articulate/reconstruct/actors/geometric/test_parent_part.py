"""What holds a part stays at it; what sits on it or lies beside it is left behind."""

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.geometric.parts import find_parent
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.render.parts import PartMesh

UP, OUT = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def part(name, *boxes):
    """Boxes of given size, each about a given middle [m]."""
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
            for size, at in boxes
        ]
    )
    return PartMesh(
        name=name,
        vertices=np.asarray(mesh.vertices),
        faces=np.asarray(mesh.faces),
        rgb=np.full((len(mesh.faces), 3), 0.5),
    )


BODY = part(
    "body",
    ((0.4, 0.02, 0.6), (-0.2, 0.3, 0.0)),
    ((0.4, 0.02, 0.6), (-0.2, -0.3, 0.0)),
    ((0.02, 0.6, 0.6), (-0.4, 0.0, 0.0)),
)
DOOR = part("door", ((0.02, 0.6, 0.6), (0.01, 0.0, 0.0)))
KNOB = part("knob", ((0.04, 0.04, 0.04), (0.04, 0.0, 0.0)))
SWING = JointMotion("turn", UP, np.array([0.0, 0.3, 0.0]), "test")
DRAWERS = [
    part(f"drawer_{k}", ((0.3, 0.5, 0.25), (-0.16, 0.0, z))) for k, z in ((0, 0.14), (1, -0.14))
]


def test_door_hangs_on_the_body_and_not_on_the_knob_that_it_carries():
    way = np.linspace(0.0, -1.5, 20)
    assert find_parent(DOOR, [KNOB, BODY], SWING, way) == "body"
    assert find_parent(DOOR, [BODY, KNOB], SWING, way) == "body"


def test_knob_turns_on_the_door():
    turn = JointMotion("turn", OUT, KNOB.centre, "test")
    assert find_parent(KNOB, [BODY, DOOR], turn, np.linspace(0.0, 6.0, 9)) == "door"


@pytest.mark.parametrize("far", [0.05, 0.25])
def test_drawer_slides_in_the_body_however_far_and_not_on_its_neighbour(far):
    slide = JointMotion("slide", OUT, DRAWERS[0].centre, "test")
    way = np.array([0.0, far])
    assert find_parent(DRAWERS[0], [DRAWERS[1], BODY], slide, way) == "body"


def test_what_alone_stands_still_holds():
    assert find_parent(DOOR, [KNOB], SWING, np.zeros(3)) == "knob"
    assert find_parent(DOOR, [], SWING, np.zeros(3)) is None


def test_part_without_area_is_where_its_corners_are():
    flat = PartMesh(
        name="flat", vertices=np.zeros((3, 3)), faces=np.array([[0, 1, 2]]), rgb=np.ones((1, 3))
    )
    assert find_parent(DOOR, [flat, BODY], SWING, np.array([0.0, -1.5])) == "body"
