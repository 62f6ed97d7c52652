"""Joints compared with one image of the open object: boxes whose joints are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.placement.actor import PlacementActor
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction
from articulate.render.camera import front_camera
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene

CAMERA = front_camera(320, 240)
DRAWER = PredictedJoint(
    part="drawer",
    parent="body",
    kind="prismatic",
    axis_o=(1.0, 0.0, 0.0),
    lower=0.0,
    upper=0.5,
)
FLAP = PredictedJoint(
    part="flap",
    parent="body",
    kind="revolute",
    axis_o=(0.0, 1.0, 0.0),
    pivot_o=(0.55, 0.0, 0.1),
    lower=0.0,
    upper=1.5,
)
DOOR = replace(FLAP, axis_o=(0.0, 0.0, 1.0), pivot_o=(0.55, -0.5, 0.4), lower=-1.5, upper=0.0)
"""The hinge of the flap at its left edge."""


def box(name, low, high, rgb):
    mesh = trimesh.creation.box(np.subtract(high, low))
    middle = 0.5 * np.add(low, high)
    return plain_part(name, np.asarray(mesh.vertices) + middle, np.asarray(mesh.faces), rgb)


PARTS = (
    box("body", (-0.5, -0.55, 0.0), (0.5, 0.55, 1.3), (0.7, 0.6, 0.5)),
    box("flap", (0.5, -0.5, 0.1), (0.55, 0.5, 0.7), (0.4, 0.5, 0.7)),
    box("drawer", (0.0, -0.5, 0.8), (0.55, 0.5, 1.2), (0.6, 0.7, 0.4)),
)


@dataclass(frozen=True)
class Fixed:
    """An actor with a fixed answer."""

    joints: tuple[PredictedJoint, ...]
    name: str = "fixed"

    def predict(self, evidence: Evidence) -> Prediction:
        """Return the answer."""
        return Prediction(joints=self.joints)


def image_at(flap_rad: float, drawer_m: float) -> Evidence:
    """Render the object with flap and drawer at these positions."""
    poses = np.stack([np.eye(4), FLAP.T_o(flap_rad), DRAWER.T_o(drawer_m)])
    image = PartScene(PARTS).render_image(CAMERA, poses)
    return Evidence(modality="image", parts=PARTS, image=image, camera=CAMERA)


def corrected(evidence: Evidence, *joints: PredictedJoint) -> dict[str, PredictedJoint]:
    """Return the joints of the image actor, where names suggest ``joints``."""
    found = PlacementActor(joints=Fixed(joints)).predict(evidence)
    return {joint.part: joint for joint in found.joints}


@pytest.fixture(scope="module")
def half_open() -> Evidence:
    return image_at(0.9, 0.25)


@pytest.mark.parametrize("wrong", [DOOR, replace(DRAWER, part="flap")])
def test_an_image_of_the_open_object_refutes_a_wrong_joint(half_open, wrong):
    found = corrected(half_open, wrong, DRAWER)
    flap = found["flap"]
    assert flap.kind == "revolute"
    assert abs(flap.axis_o[1]) > 0.99
    across = np.subtract(flap.pivot_o, FLAP.pivot_o)[[0, 2]]
    assert np.linalg.norm(across) < 0.06
    assert found["drawer"] == DRAWER


def test_a_slide_replaces_a_hinge(half_open):
    drawer = corrected(half_open, FLAP, replace(DOOR, part="drawer"))["drawer"]
    assert drawer.kind == "prismatic"
    assert abs(drawer.axis_o[0]) > 0.99


def test_joints_that_explain_the_image_stay(half_open):
    assert corrected(half_open, FLAP, DRAWER) == {"flap": FLAP, "drawer": DRAWER}


def test_a_closed_object_adds_nothing():
    wrong = (DOOR, replace(DRAWER, part="drawer", axis_o=(0.0, 0.0, 1.0)))
    assert corrected(image_at(0.0, 0.0), *wrong) == {joint.part: joint for joint in wrong}


def test_an_image_of_something_else_is_not_used(half_open):
    noise = np.random.default_rng(0).integers(0, 255, half_open.image.shape, dtype=np.uint8)
    assert corrected(replace(half_open, image=noise), DOOR, DRAWER)["flap"] == DOOR


def test_the_image_shows_the_direction_of_opening(half_open):
    inwards = replace(FLAP, lower=-1.5, upper=0.0)
    assert corrected(half_open, inwards, DRAWER)["flap"] == FLAP


def test_parts_that_move_along_are_rendered_with_their_parent(half_open):
    knob = box("knob", (0.55, -0.1, 0.55), (0.62, 0.1, 0.65), (0.8, 0.2, 0.2))
    fixed = PredictedJoint(part="knob", parent="flap", kind="fixed")
    poses = np.stack([np.eye(4), FLAP.T_o(0.9), DRAWER.T_o(0.25), FLAP.T_o(0.9)])
    image = PartScene((*PARTS, knob)).render_image(CAMERA, poses)
    evidence = replace(half_open, parts=(*PARTS, knob), image=image)
    assert corrected(evidence, FLAP, DRAWER, fixed)["flap"] == FLAP
    flap = corrected(evidence, DOOR, DRAWER, fixed)["flap"]
    assert abs(flap.axis_o[1]) > 0.99
