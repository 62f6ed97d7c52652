"""Boxes whose joints anybody would know."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.errors import UsageError
from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.registry import make_actor
from articulate.reconstruct.actors.semantic.actor import SemanticActor
from articulate.render.parts import plain_part

CLOSE = 0.05


def box(name, low, high):
    size, middle = np.subtract(high, low), 0.5 * np.add(low, high)
    mesh = trimesh.creation.box(size)
    return plain_part(name, np.asarray(mesh.vertices) + middle, np.asarray(mesh.faces))


def disc(name, centre, radius, height, axis):
    mesh = trimesh.creation.cylinder(radius, height, sections=24)
    mesh.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], axis))
    return plain_part(name, np.asarray(mesh.vertices) + centre, np.asarray(mesh.faces))


def carcass():
    """An open box, its front at x = 0.5, of five walls."""
    walls = [
        ((-0.5, -0.5, 0.0), (-0.47, 0.5, 1.2)),
        ((-0.5, -0.5, 0.0), (0.5, -0.47, 1.2)),
        ((-0.5, 0.47, 0.0), (0.5, 0.5, 1.2)),
        ((-0.5, -0.5, 0.0), (0.5, 0.5, 0.03)),
        ((-0.5, -0.5, 1.17), (0.5, 0.5, 1.2)),
    ]
    boxes = [box("wall", low, high) for low, high in walls]
    starts = np.cumsum([0] + [len(b.vertices) for b in boxes])
    return plain_part(
        "p0",
        np.concatenate([b.vertices for b in boxes]),
        np.concatenate([b.faces + s for b, s in zip(boxes, starts, strict=False)]),
    )


def said(parts, labels, text=""):
    evidence = Evidence(modality="text", parts=tuple(parts), labels=labels, text=text)
    return {joint.part: joint for joint in SemanticActor().predict(evidence).joints}


def line_off(joint, point, axis):
    """Distance of a joint's axis from a point of the true one, and the angle between both."""
    a = np.asarray(joint.axis_o) / np.linalg.norm(joint.axis_o)
    away = np.cross(np.subtract(joint.pivot_o, point), axis)
    return np.linalg.norm(away), np.arccos(min(1.0, abs(float(a @ np.asarray(axis)))))


def right(joint, point, axis, close=CLOSE):
    distance, angle = line_off(joint, point, axis)
    return distance <= close and angle <= 0.1


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_door_turns_about_the_upright_edge_opposite_its_handle(side):
    door = box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.2))
    handle = box("p2", (0.54, side * 0.42 - 0.02, 0.5), (0.6, side * 0.42 + 0.02, 0.8))
    labels = {"p0": "furniture body", "p1": "door", "p2": "handle"}
    joints = said([carcass(), door, handle], labels)
    assert joints["p1"].kind == "revolute"
    assert right(joints["p1"], (0.52, -0.5 * side, 0.0), (0.0, 0.0, 1.0))
    assert (joints["p2"].kind, joints["p2"].parent) == ("fixed", "p1")
    assert "p0" not in joints


def test_a_door_opens_away_from_the_body():
    door = box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.2))
    joint = said([carcass(), door], {"p0": "safe body", "p1": "door"})["p1"]
    end = joint.upper if abs(joint.upper) > abs(joint.lower) else joint.lower
    moved = joint.T_o(end)[:3, :3] @ (door.centre - joint.pivot_o) + joint.pivot_o
    assert moved[0] > door.centre[0] + 0.2


def test_two_doors_turn_about_their_outer_edges():
    doors = [
        box("p1", (0.5, -0.5, 0.0), (0.53, -0.005, 1.2)),
        box("p2", (0.5, 0.005, 0.0), (0.53, 0.5, 1.2)),
    ]
    joints = said([carcass(), *doors], {"p0": "furniture body", "p1": "door", "p2": "door"})
    assert right(joints["p1"], (0.515, -0.5, 0.0), (0, 0, 1))
    assert right(joints["p2"], (0.515, 0.5, 0.0), (0, 0, 1))


def test_an_oven_door_turns_about_its_lower_edge():
    door = box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.0))
    joint = said([carcass(), door], {"p0": "oven body", "p1": "door"})["p1"]
    assert right(joint, (0.52, 0.0, 0.02), (0, 1, 0))


def test_a_lid_turns_about_its_rear_edge_and_a_screen_where_it_touches():
    body = box("p0", (-0.5, -0.6, 0.0), (0.5, 0.6, 0.5))
    lid = box("p1", (-0.5, -0.6, 0.5), (0.5, 0.6, 0.54))
    joint = said([body, lid], {"p0": "box body", "p1": "lid"})["p1"]
    assert right(joint, (-0.5, 0.0, 0.52), (0, 1, 0))
    base = box("p0", (-0.4, -0.6, 0.0), (0.4, 0.6, 0.04))
    screen = box("p1", (-0.44, -0.6, 0.03), (-0.41, 0.6, 0.8))
    joint = said([base, screen], {"p0": "laptop base", "p1": "screen"})["p1"]
    assert right(joint, (-0.42, 0.0, 0.03), (0, 1, 0))


def test_drawers_slide_to_the_front_unless_something_stands_there():
    drawer = box("p1", (-0.4, -0.45, 0.4), (0.5, 0.45, 0.7))
    labels = {"p0": "furniture body", "p1": "drawer"}
    joint = said([carcass(), drawer], labels)["p1"]
    assert joint.kind == "prismatic"
    np.testing.assert_allclose(joint.axis_o, (1, 0, 0), atol=1e-9)
    assert joint.lower == 0.0
    assert 0.3 < joint.upper < 0.9
    turned = [p.moved(np.diag([-1.0, -1.0, 1.0, 1.0])) for p in (carcass(), drawer)]
    joint = said(turned, labels)["p1"]
    np.testing.assert_allclose(joint.axis_o, (-1, 0, 0), atol=1e-9)


def test_knobs_and_wheels_turn_about_the_axis_about_which_they_are_round():
    body = box("p0", (-0.5, -0.5, 0.2), (0.5, 0.5, 1.0))
    knob = disc("p1", (0.53, 0.2, 0.8), 0.06, 0.06, (1, 0, 0))
    wheel = disc("p2", (0.3, 0.52, 0.15), 0.15, 0.04, (0, 1, 0))
    joints = said([body, knob, wheel], {"p0": "oven body", "p1": "knob", "p2": "wheel"})
    assert joints["p1"].kind == joints["p2"].kind == "continuous"
    assert right(joints["p1"], (0.0, 0.2, 0.8), (1, 0, 0))
    assert right(joints["p2"], (0.3, 0.0, 0.15), (0, 1, 0))


def test_a_button_is_pressed_into_the_tilted_panel_it_sits_on():
    tilt = trimesh.transformations.rotation_matrix(-0.5, [0, 1, 0])
    body = box("p0", (-0.5, -0.5, -0.4), (0.3, 0.5, 0.4)).moved(tilt)
    button = box("p1", (0.3, -0.03, -0.03), (0.33, 0.03, 0.03)).moved(tilt)
    joint = said([body, button], {"p0": "coffee machine body", "p1": "button"})["p1"]
    assert joint.kind == "prismatic"
    np.testing.assert_allclose(joint.axis_o, tilt[:3, 0], atol=0.05)
    assert joint.lower < 0.0 == joint.upper


def test_a_bow_swings_about_its_two_ends():
    body = disc("p0", (0, 0, 0.5), 0.5, 1.0, (0, 0, 1))
    arch = trimesh.creation.annulus(0.5, 0.53, 0.03, sections=48)
    arch = arch.slice_plane([0, 0, 0], [0, 1, 0], cap=False)
    arch.apply_transform(np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0.97], [0, 0, 0, 1.0]]))
    bow = plain_part("p1", np.asarray(arch.vertices), np.asarray(arch.faces))
    joint = said([body, bow], {"p0": "bucket body", "p1": "handle"})["p1"]
    assert right(joint, (0.0, 0.0, 1.0), (0, 1, 0), close=0.08)


def test_a_knob_on_a_door_goes_with_the_door():
    door = box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.2))
    knob = disc("p2", (0.57, 0.4, 0.6), 0.05, 0.06, (1, 0, 0))
    labels = {"p0": "safe body", "p1": "door", "p2": "knob"}
    assert said([carcass(), door, knob], labels)["p2"].parent == "p1"


def test_parts_whose_names_say_nothing_stand_still():
    parts = [carcass(), box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.2))]
    assert said(parts, {"p0": "body", "p1": "thingummy"})["p1"].kind == "fixed"
    assert said(parts, {})["p1"].kind == "fixed"


@settings(max_examples=6)
@given(scale=st.floats(0.05, 20.0), swap=st.booleans())
def test_the_joint_does_not_hang_on_size_or_order(scale, swap):
    parts = [carcass(), box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.2))]
    labels = {"p0": "safe body", "p1": "door"}
    plain = said(parts, labels)["p1"]
    large = [p.with_vertices(scale * p.vertices) for p in parts]
    joint = said(large[::-1] if swap else large, labels)["p1"]
    np.testing.assert_allclose(np.divide(joint.pivot_o, scale), plain.pivot_o, atol=0.02)
    assert abs(np.dot(joint.axis_o, plain.axis_o)) > 0.999


def test_parts_out_of_their_places_and_lone_parts_are_refused(error_line):
    parts = (carcass(), box("p1", (0.5, -0.5, 0.0), (0.54, 0.5, 1.2)))
    unplaced = Evidence(modality="text", parts=parts, placed=False)
    error_line("NamedActor().predict(unplaced parts)", lambda: SemanticActor().predict(unplaced))
    lone = Evidence(modality="text", parts=parts[:1])
    error_line("NamedActor().predict(one part)", lambda: SemanticActor().predict(lone))
    with pytest.raises(UsageError):
        SemanticActor().predict(lone)


def test_it_is_known_by_name():
    assert make_actor("geometric-text").name == "geometric-text"
