from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.reconstruct.scan.scan_objects import double_doors, merged

from articulate.reconstruct.actors.protocol import PredictedJoint, Prediction, Verdict
from articulate.reconstruct.query import Query
from articulate.reconstruct.scan import view_parts
from articulate.reconstruct.scan.propose import propose_parts
from articulate.reconstruct.scan.read_scan import standing
from articulate.reconstruct.scan.registration import Registration, register
from articulate.reconstruct.scan.view_parts import SEEN, add_view, seen_joint
from articulate.render.camera import look_at, pinhole
from articulate.render.scene import PartScene
from articulate.transforms import axis_angle_to_matrix, pose

EYE, TARGET = (2.2, 0.7, 1.1), (0.0, 0.0, 0.42)


@pytest.fixture(scope="module")
def cabinet():
    mesh, label = merged(*double_doors())
    rgb = np.array([[0.7, 0.6, 0.5], [0.5, 0.3, 0.2], [0.3, 0.4, 0.6]])[label + 1]
    return replace(standing(mesh), rgb=rgb), label


def camera():
    return pinhole(width_px=480, height_px=360, fovy_rad=0.5, T_wc=look_at(EYE, TARGET))


def frames(mesh, label, angles):
    """Images of the cabinet whose left door, seen from the front, turns about its left edge."""
    parts = [mesh.part(str(k), np.flatnonzero(label == k)) for k in (-1, 0, 1)]
    scene = PartScene(parts)
    corner = parts[1].bounds
    pivot = np.array([corner[0, 0], corner[0, 1], 0.0])
    images = []
    for angle in angles:
        rotation = axis_angle_to_matrix(np.array([0.0, 0.0, -1.0]), angle)
        poses = np.tile(np.eye(4), (3, 1, 1))
        poses[1] = pose(pivot - rotation @ pivot, rotation)
        images.append(scene.render_image(camera(), poses, background=(0.5, 0.6, 0.5)))
    return np.stack(images)


def test_the_camera_of_an_image_is_found(cabinet):
    mesh, label = cabinet
    image = frames(mesh, label, [0.0])[0]
    mask = np.abs(image.astype(int) - image[0, 0]).max(axis=-1) > 10
    found = register(mesh, image, mask)
    turn = found.camera.T_wc[:3, :3].T @ camera().T_wc[:3, :3]
    assert np.degrees(np.arccos((np.trace(turn) - 1.0) / 2.0)) < 5.0
    assert found.overlap > 0.93


def operated_video(mesh, label, *, backwards=False):
    """A video in which the left door opens, or closes."""
    angles = np.linspace(0.0, 1.2, 12)[:: -1 if backwards else 1]
    return Query(
        modality="video",
        description="the video",
        video=frames(mesh, label, angles),
        times_s=np.arange(12) / 10.0,
    )


@pytest.mark.slow
@pytest.mark.parametrize("backwards", [False, True])
def test_the_door_that_moves_gets_the_joint_of_the_video(cabinet, backwards):
    mesh, label = cabinet
    query = operated_video(mesh, label, backwards=backwards)
    found = add_view(mesh, propose_parts(mesh).parts, query)
    assert found.doubts == ()
    (door,) = (part for part in found.parts if part.evidence == (SEEN,))
    assert (door.kind, door.joint, len(found.parts)) == ("door", "revolute", 2)
    np.testing.assert_allclose(door.axis, [0.0, 0.0, -1.0], atol=0.05)
    assert door.upper >= 1.1
    assert mesh.triangles[door.faces][..., 1].max() < 0.01


class Actor:
    """Actor with a fixed answer."""

    def __init__(self, prediction):
        self.prediction = prediction
        self.names = []

    def predict(self, evidence):
        self.names = [part.name for part in evidence.parts]
        return self.prediction


def sliding(part):
    return PredictedJoint(
        part=part,
        parent="body",
        kind="prismatic",
        axis_o=(-1.0, 0.0, 0.0),
        pivot_o=(0.0, 0.0, 0.0),
        lower=-0.3,
        upper=0.0,
    )


def rated(rating):
    return Verdict(failure="joint_axis", rating=rating, reason="the axis is wrong")


@pytest.mark.parametrize(
    ("prediction", "doubt"),
    [
        (Prediction(joints=(sliding("door_2"),)), ""),
        (Prediction(joints=(sliding("door_2"),), verdict=rated(9.0)), ""),
        (Prediction(joints=(sliding("door_2"),), verdict=rated(2.0)), "the axis is wrong"),
        (Prediction(joints=(), rejection="nothing moves"), "no part of the mesh explains"),
    ],
)
def test_only_explained_motions_change_parts(cabinet, monkeypatch, prediction, doubt):
    mesh, label = cabinet
    actor = Actor(prediction)
    placed = Registration(camera=camera(), overlap=0.95, cost=0.1)
    monkeypatch.setattr(view_parts, "make_actor", lambda name: actor)
    monkeypatch.setattr(view_parts, "register", lambda mesh, image, mask: placed)
    parts = propose_parts(mesh).parts
    found = add_view(mesh, parts, operated_video(mesh, label))
    assert actor.names == ["body", "door_1", "door_2"]
    assert found.parts[0] is parts[0]
    if doubt:
        assert doubt in found.doubts[0]
        assert found.parts[1] is parts[1]
    else:
        assert found.doubts == ()
        assert (found.parts[1].kind, found.parts[1].joint) == ("drawer", "prismatic")


def test_a_video_of_another_object_is_doubtful(cabinet):
    mesh, _ = cabinet
    image = np.full((360, 480, 3), 128, dtype=np.uint8)
    image[20:340, 220:260] = 250
    query = Query(modality="image", description="the image", image=image)
    found = add_view(mesh, propose_parts(mesh).parts, query)
    assert "does not show the mesh" in found.doubts[0]
    assert len(found.parts) == 2


@pytest.mark.parametrize(
    ("kind", "axis", "limits", "expected"),
    [
        ("prismatic", (1.0, 0.0, 0.0), (0.0, 0.3), ("drawer", (1.0, 0.0, 0.0), 0.3)),
        ("prismatic", (-1.0, 0.0, 0.0), (-0.3, 0.0), ("drawer", (1.0, 0.0, 0.0), 0.3)),
        ("revolute", (0.0, 0.0, -1.0), (-1.9, 0.01), ("door", (0.0, 0.0, 1.0), 1.9)),
        ("revolute", (0.0, 1.0, 0.0), (0.0, 1.0), ("flap", (0.0, 1.0, 0.0), np.pi / 2)),
    ],
)
def test_positive_positions_open(cabinet, kind, axis, limits, expected):
    part = propose_parts(cabinet[0]).parts[0]
    joint = PredictedJoint(
        part="door_1",
        parent="body",
        kind=kind,
        axis_o=axis,
        pivot_o=(0.0, 0.0, 0.0),
        lower=limits[0],
        upper=limits[1],
    )
    seen = seen_joint(part, joint)
    assert seen.kind == expected[0]
    np.testing.assert_allclose(seen.axis, expected[1])
    assert seen.lower == 0.0
    assert seen.upper == pytest.approx(expected[2])
