from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.program.result import ProgramObject
from articulate.reconstruct.program.run import run_program
from articulate.reconstruct.program_writer import program_of, tree_of
from articulate.render.parts import plain_part

NAMES = ("body", "door", "knob", "lid")


def parts():
    """Boxes of falling size, by name."""
    return {name: trimesh.creation.box((1.0 / (k + 1),) * 3) for k, name in enumerate(NAMES)}


def meshes():
    return [
        plain_part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces))
        for name, mesh in parts().items()
    ]


def joint(part, parent, kind="revolute", **more):
    return PredictedJoint(part=part, parent=parent, kind=kind, lower=0.0, upper=1.0, **more)


def built(joints):
    root, part_joints = tree_of(joints, meshes())
    found = run_program(program_of(root, part_joints, actor="me", query="a\nquestion"), parts())
    assert isinstance(found, ProgramObject), found
    return found


def test_a_program_says_what_the_actor_said():
    found = built(
        [
            joint("door", "body", axis_o=(0.0, 0.0, 2.0), pivot_o=(0.1, 0.2, 0.3)),
            joint("knob", "door", "continuous", axis_o=(1.0, 0.0, 0.0)),
            joint("lid", "body", "prismatic", axis_o=(0.0, 1.0, 0.0)),
        ]
    )
    by_child = {j.child: j for j in found.joints}
    assert found.root == "body"
    door = by_child["door"]
    assert (door.kind, door.axis_w, door.pivot_w) == ("revolute", (0, 0, 1), (0.1, 0.2, 0.3))
    assert (door.lower, door.upper) == (0.0, 1.0)
    assert (by_child["knob"].kind, by_child["knob"].parent) == ("continuous", "door")
    assert (by_child["lid"].kind, by_child["lid"].axis_w) == ("prismatic", (0, 1, 0))


def test_parts_of_which_nothing_is_said_are_fixed_to_the_largest():
    found = built([joint("door", None)])
    kinds = {j.child: (j.kind, j.parent) for j in found.joints}
    assert kinds["knob"] == kinds["lid"] == ("fixed", "body")
    assert kinds["door"] == ("revolute", "body")


@pytest.mark.parametrize("parent", ["door", "nobody", None])
def test_what_hangs_on_itself_or_on_nothing_hangs_on_the_root(parent):
    found = built([joint("door", parent)])
    assert next(j.parent for j in found.joints if j.child == "door") == "body"


@pytest.mark.parametrize("order", [1, -1])
def test_knob_that_goes_along_with_its_door_turns_on_it(order):
    said = [
        joint("knob", "body", "continuous", axis_o=(1.0, 0.0, 0.0)),
        joint("door", "body", axis_o=(0.0, 0.0, 1.0)),
        PredictedJoint(part="knob", parent="door", kind="fixed"),
    ]
    _, part_joints = tree_of(said[::order], meshes())
    assert (part_joints["knob"].kind, part_joints["knob"].parent) == ("continuous", "door")
    assert (part_joints["door"].kind, part_joints["door"].parent) == ("revolute", "body")


def test_if_all_parts_are_said_to_move_the_largest_stands_still():
    found = built([joint(name, "knob") for name in NAMES])
    assert found.root == "body"
    assert len(found.joints) == 3


def test_turning_without_limits_is_turning_without_end():
    found = built([PredictedJoint(part="door", parent="body", kind="revolute")])
    assert next(j.kind for j in found.joints if j.child == "door") == "continuous"


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.sampled_from(NAMES), st.sampled_from([*NAMES, "nobody", None])), max_size=6
    )
)
def test_whatever_hangs_on_whatever_it_becomes_a_tree(pairs):
    root, part_joints = tree_of([joint(part, parent) for part, parent in pairs], meshes())
    assert set(part_joints) == set(NAMES) - {root}
    for name in part_joints:
        at: str | None = name
        steps = 0
        while at != root:
            assert at is not None
            at, steps = part_joints[at].parent, steps + 1
            assert steps <= len(NAMES)


def test_names_and_questions_are_text_whatever_they_hold():
    name = "a'); root('b\"\n# é"
    mesh = [plain_part(n, *arrays()) for n in (name, "body")]
    root, part_joints = tree_of([joint(name, "body")], mesh)
    text = program_of(root, part_joints, actor="me", query="x\nroot('door')\u2028y")
    assert text.isascii()
    assert len(text.splitlines()) == 3


def arrays():
    mesh = trimesh.creation.box((1, 1, 1))
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


@pytest.mark.parametrize("name", ["coding=1.mp4", "encoding:utf-7.png", "a coding: x"])
def test_a_question_that_reads_like_an_encoding_is_no_declaration_of_one(name):
    root, part_joints = tree_of([joint("door", "body")], meshes())
    source = program_of(root, part_joints, actor="me", query=f"the clip {name}")
    assert isinstance(run_program(source, parts()), ProgramObject)
