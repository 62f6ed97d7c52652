"""Edits against closed forms, and what they reject."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.articulate.studio.objects import write_cupboard

from articulate.errors import UsageError
from articulate.studio.candidates import candidates, front_direction, snap
from articulate.studio.edits import (
    MergeParts,
    SetClosed,
    SetJoint,
    SetOpen,
    SetSize,
    SplitPart,
    apply_edit,
    edit_content,
    parse_edit,
)
from articulate.studio.model import read_model
from articulate.studio.write import write_model


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return read_model(write_cupboard(tmp_path_factory.mktemp("cupboard")))


def mass(model, part):
    inertial = model.link(part).inertial
    assert inertial is not None
    return inertial


def bounds(model, part):
    return model.link(part).bounds_o


def test_a_model_holds_geometry_and_joints_in_one_frame(model):
    joint = model.joint("door")
    assert joint.axis_o == pytest.approx((0, 0, -1))
    assert joint.pivot_o == pytest.approx((-0.21, 0.3, 0.0))
    assert bounds(model, "door") == pytest.approx(np.array([[-0.26, -0.3, 0.0], [-0.2, 0.3, 0.8]]))
    assert front_direction(model) == pytest.approx([-1, 0, 0])


def test_a_written_model_is_read_again_unchanged(model, tmp_path):
    again = read_model(write_model(model, tmp_path))
    assert again.joint("door") == model.joint("door")
    assert bounds(again, "door") == pytest.approx(bounds(model, "door"))
    assert_allclose(mass(again, "door").com_p, mass(model, "door").com_p)
    assert [len(link.collisions) for link in again.links] == [
        len(link.collisions) for link in model.links
    ]


def test_a_type_without_limits_gets_the_usual_range(model):
    edited = apply_edit(model, SetJoint(part="door", kind="prismatic", axis_o=(-2.0, 0.0, 0.0)))
    joint = edited.joint("door")
    assert (joint.kind, joint.lower) == ("prismatic", 0.0)
    assert joint.axis_o == (-1.0, 0.0, 0.0)
    assert joint.upper == pytest.approx(0.8 * 0.06)
    free = apply_edit(model, SetJoint(part="door", kind="continuous"))
    assert free.joint("door").upper is None
    assert model.joint("door").upper == 1.5  # the input is unchanged


def test_the_closed_position_moves_the_part_and_its_range(model):
    edited = apply_edit(model, SetClosed(part="door", q=0.5))
    c, s = math.cos(-0.5), math.sin(-0.5)
    x, y = -0.05, -0.56  # a corner of the knob relative to the hinge
    turned = np.array([c * x - s * y - 0.21, s * x + c * y + 0.3])
    corners = np.concatenate([p.mesh.vertices for p in edited.link("door").visuals])[:, :2]
    assert np.linalg.norm(corners - turned, axis=1).min() < 1e-9
    joint = edited.joint("door")
    assert (joint.lower, joint.upper) == pytest.approx((0.0, 1.0))
    opened = apply_edit(model, SetOpen(part="door", q=0.7)).joint("door")
    assert (opened.lower, opened.upper) == (0.0, 0.7)


def test_one_dimension_scales_everything_but_angles(model):
    edited = apply_edit(model, SetSize(axis=2, size_m=1.6))
    assert np.ptp(edited.bounds_o, axis=0)[2] == pytest.approx(1.6)
    assert edited.joint("door").pivot_o == pytest.approx((-0.42, 0.6, 0.0))
    assert edited.joint("door").upper == 1.5
    slide = apply_edit(
        model, SetJoint(part="door", kind="prismatic", axis_o=(-1.0, 0.0, 0.0), upper=0.2)
    )
    assert apply_edit(slide, SetSize(axis=2, size_m=1.6)).joint("door").upper == pytest.approx(0.4)


def test_masses_follow_the_corrections(model):
    """The door of 5 kg is a slab of 0.6 by 0.8 m; the knob has 0.16 % of its volume."""
    door = mass(model, "door")
    assert_allclose(door.com_p, (-0.21, 0.0, 0.4), atol=1e-9)
    larger = mass(apply_edit(model, SetSize(axis=2, size_m=1.6)), "door")
    assert larger.mass_kg == pytest.approx(8 * 5.0)
    assert_allclose(larger.inertia_p, 32 * door.inertia_p)
    open_door = mass(apply_edit(model, SetClosed(part="door", q=np.pi / 2)), "door")
    assert_allclose(np.diag(open_door.inertia_p), np.diag(door.inertia_p)[[1, 0, 2]], atol=1e-9)
    _, knob = (len(piece.mesh.faces) for piece in model.link("door").visible)
    split = SplitPart(part="door", name="knob", faces=((), tuple(range(knob))))
    parts = apply_edit(model, split)
    masses = [mass(parts, name).mass_kg for name in ("door", "knob")]
    assert masses == pytest.approx([5.0 * 600 / 601, 5.0 / 601])
    merged = apply_edit(parts, MergeParts(part="knob", into="door"))
    assert mass(merged, "door").mass_kg == pytest.approx(5.0)
    assert parts.link("body").inertial is None


def test_split_and_merge_are_inverse(model):
    faces = ((), tuple(range(12)))
    split = apply_edit(model, SplitPart(part="door", name="knob", faces=faces))
    assert bounds(split, "knob")[1] == pytest.approx([-0.22, -0.24, 0.41])
    assert split.joint("knob").kind == "fixed"
    assert (len(split.link("door").collisions), len(split.link("knob").collisions)) == (1, 1)
    merged = apply_edit(split, MergeParts(part="knob", into="door"))
    assert [link.name for link in merged.links] == ["body", "door"]
    assert bounds(merged, "door") == pytest.approx(bounds(model, "door"))


@pytest.mark.parametrize(
    "edit",
    [
        SetJoint(part="window", kind="fixed"),
        SetJoint(part="body", kind="fixed"),
        SetJoint(part="door", parent="door"),
        SetJoint(part="door", lower=2.0),
        SetOpen(part="door", q=0.0),
        SetSize(axis=2, size_m=0.0),
        MergeParts(part="door", into="door"),
        SplitPart(part="door", name="knob", faces=((), ())),
        SplitPart(part="door", name="knob", faces=((12,), ())),
        SplitPart(part="door", name="knob", faces=()),
        SplitPart(part="door", name="body", faces=((0,), ())),
    ],
)
def test_an_impossible_edit_is_one_line(model, edit):
    with pytest.raises(UsageError) as error:
        apply_edit(model, edit)
    assert "\n" not in str(error.value)


def test_edits_survive_json():
    for edit in (
        SetJoint(part="door", kind="revolute", axis_o=(0.0, 0.0, 1.0), lower=0.0),
        SplitPart(part="door", name="knob", faces=((), (1, 2))),
        SetSize(axis=1, size_m=0.5),
    ):
        assert parse_edit(edit_content(edit)) == edit


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"type": "erase"},
        {"type": []},
        {"type": "set_joint"},
        {"type": "set_joint", "part": "door", "kind": "ball"},
        {"type": "set_joint", "part": "door", "axis_o": [0, 0, 0]},
        {"type": "set_joint", "part": "door", "axis_o": [0, 0]},
        {"type": "set_joint", "part": "door", "upper": True},
        {"type": "set_joint", "part": "door", "upper": 1e9},
        {"type": "set_joint", "part": "door", "colour": 1},
        {"type": "set_size", "axis": 3, "size_m": 1},
        {"type": "split_part", "part": "door", "name": "../x", "faces": []},
        {"type": "split_part", "part": "door", "name": "x", "faces": [[-1]]},
        {"type": "split_part", "part": "door", "name": "x", "faces": 3},
    ],
)
def test_a_malformed_edit_is_rejected(content):
    with pytest.raises(UsageError):
        parse_edit(content)


def test_candidates_open_away_from_the_object(model):
    found = {c.label: c.edit for c in candidates(model, "door")}
    left = found["hinge left"]
    assert left.pivot_o is not None
    assert left.pivot_o[1] == pytest.approx(0.3)
    assert left.axis_o == pytest.approx((0, 0, -1))
    for label, edit in found.items():
        if not label.startswith("hinge") or "behind" in label:
            continue
        moved = apply_edit(model, edit)
        opened = moved.joint("door").T_o(0.3) @ np.append(bounds(model, "door").mean(axis=0), 1)
        assert opened[0] < bounds(model, "door").mean(axis=0)[0], label


def test_clicks_snap_to_edges_and_faces(model):
    door = model.link("door")
    edge = snap(door, (-0.2, 0.295, 0.5), "edge")
    assert np.abs(edge.axis_o) == pytest.approx([0, 0, 1])
    assert edge.pivot_o[:2] == pytest.approx((-0.2, 0.3))
    face = snap(door, (-0.22, 0.0, 0.4), "face", (-0.99, 0.05, 0.0))
    assert face.axis_o == (-1.0, 0.0, 0.0)
    axle = snap(door, (-0.22, 0.1, 0.7), "axle", (-1.0, 0.0, 0.0))
    assert axle.pivot_o == pytest.approx((-0.23, 0.0, 0.4))
