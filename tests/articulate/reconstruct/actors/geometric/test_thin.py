"""Parts of wire and wheels with spokes: they look alike, or hide, in many poses of their turn."""

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.geometric.video import video_actor
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene

N_FRAMES = 30


def bars(name, ends, thick, rgb, sections=6):
    """One part of straight bars between pairs of points."""
    made = [
        trimesh.creation.cylinder(thick / 2.0, sections=sections, segment=pair) for pair in ends
    ]
    mesh = trimesh.util.concatenate(made)
    return plain_part(name, mesh.vertices, mesh.faces, rgb)


def block(name, low, high, rgb):
    mesh = trimesh.creation.box(bounds=[low, high])
    return plain_part(name, mesh.vertices, mesh.faces, rgb)


def arc(n, radius, middle, a, b):
    """Pairs of points along half a circle in the plane of the axes ``a`` and ``b``."""
    turn = np.linspace(0.0, np.pi, n + 1)[:, None]
    points = middle + radius * (np.cos(turn) * a + np.sin(turn) * b)
    return np.stack([points[:-1], points[1:]], axis=1)


def joint_in_clip(parts, joint, low, high):
    q = np.linspace(high, low, N_FRAMES)
    moving = [i for i, part in enumerate(parts) if part.name == joint.part]
    camera = front_camera(240, 180)
    clip = render_video(PartScene(parts), camera, poses_of_parts(len(parts), moving, joint.T_o(q)))
    evidence = Evidence(
        modality="video", parts=parts, video=clip.frames, times_s=clip.times_s, camera=camera
    )
    found = video_actor().predict(evidence)
    (said,) = [j for j in found.joints if j.kind != "fixed"]
    assert said.part == joint.part
    assert abs(np.dot(said.axis_o, joint.axis_o)) > np.cos(0.05)
    off = np.cross(np.subtract(said.pivot_o, joint.pivot_o), joint.axis_o)
    assert np.linalg.norm(off) < 0.02
    return said, np.sign(np.dot(said.axis_o, joint.axis_o))


def test_a_handle_of_wire_is_followed_round_its_bucket():
    _, y, z = np.eye(3)
    bucket = block("bucket", (-0.45, -0.45, 0.0), (0.45, 0.45, 0.9), (0.5, 0.6, 0.7))
    hooks = [[0.8 * z + 0.52 * side * y, 0.775 * z + 0.52 * side * y] for side in (-1, 1)]
    wire = np.concatenate([arc(16, 0.52, 0.8 * z, y, z), hooks])
    wire = bars("wire", wire, 0.02, (0.25, 0.25, 0.3))
    joint = PredictedJoint(
        part="wire", parent="bucket", kind="revolute", axis_o=(0.0, 1.0, 0.0),
        pivot_o=(0.0, 0.0, 0.8), lower=-2.2, upper=1.9,
    )  # fmt: skip
    said, sign = joint_in_clip((bucket, wire), joint, -2.2, 1.9)
    assert said.kind == "revolute"
    assert sorted([sign * said.lower, sign * said.upper]) == pytest.approx([-2.2, 1.9], abs=0.1)


def test_a_knob_turns_about_the_axis_of_its_sloping_front():
    tilt = 0.19
    out = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    middle = np.array([0.5, 0.1, 0.6])
    disc = bars("disc", [[middle, middle + 0.03 * out]], 0.16, (0.6, 0.6, 0.65))
    grip = trimesh.creation.box(extents=(0.16, 0.05, 0.08))
    turn, across = np.eye(4), np.array([0.0, 1.0, 0.0])
    turn[:3, :3] = np.stack([across, np.cross(out, across), out], axis=1)
    turn[:3, 3] = middle + 0.07 * out + 0.03 * turn[:3, 0]
    grip.apply_transform(turn)
    knob = plain_part("knob", grip.vertices, grip.faces, (0.3, 0.2, 0.2))
    body = block("body", (-0.4, -0.5, 0.0), (0.49, 0.5, 1.0), (0.8, 0.75, 0.7))
    joint = PredictedJoint(
        part="knob", parent="body", kind="revolute", axis_o=tuple(out),
        pivot_o=tuple(middle), lower=-2.0, upper=2.5,
    )  # fmt: skip
    said, sign = joint_in_clip((body, disc, knob), joint, -2.0, 2.5)
    assert sorted([sign * said.lower, sign * said.upper]) == pytest.approx([-2.0, 2.5], abs=0.1)


def test_a_wheel_with_spokes_turns_without_end():
    x, _, z = np.eye(3)
    middle, rim = np.array([0.1, -0.5, 0.5]), []
    for turn in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        spots = (turn, turn + 2.0 * np.pi / 24)
        rim.append([middle + 0.45 * (np.cos(a) * x + np.sin(a) * z) for a in spots])
    for turn in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        rim.append([middle, middle + 0.45 * (np.cos(turn) * x + np.sin(turn) * z)])
    wheel = bars("wheel", rim, 0.05, (0.3, 0.25, 0.2))
    cart = block("cart", (-0.6, -0.4, 0.5), (0.6, 0.4, 0.9), (0.7, 0.5, 0.3))
    joint = PredictedJoint(
        part="wheel", parent="cart", kind="continuous", axis_o=(0.0, 1.0, 0.0),
        pivot_o=(0.1, -0.5, 0.5),
    )  # fmt: skip
    said, _ = joint_in_clip((cart, wheel), joint, 0.0, 2.0 * np.pi + 0.5)
    assert said.kind == "continuous"


@pytest.mark.slow  # the wheel above has more to see
def test_a_wheel_with_little_to_see_on_it_turns_in_its_place():
    _, y, _ = np.eye(3)
    middle = np.array([0.5, 0.1, 0.35])
    out = np.array([1.0, 0.0, 0.0])
    wheel = bars("wheel", [[middle, middle + 0.05 * out]], 0.3, (0.12, 0.12, 0.13), sections=48)
    hub = trimesh.creation.box(extents=(0.02, 0.05, 0.05))
    hub.apply_translation(middle + 0.055 * out + 0.09 * y)
    mesh = trimesh.util.concatenate([trimesh.Trimesh(wheel.vertices, wheel.faces), hub])
    wheel = plain_part("wheel", mesh.vertices, mesh.faces, (0.12, 0.12, 0.13))
    body = block("body", (-0.5, -0.5, 0.1), (0.49, 0.5, 0.9), (0.7, 0.6, 0.5))
    joint = PredictedJoint(
        part="wheel", parent="body", kind="continuous", axis_o=tuple(out), pivot_o=tuple(middle),
    )  # fmt: skip
    said, _ = joint_in_clip((body, wheel), joint, 0.0, 2.0 * np.pi + 0.5)
    assert said.kind == "continuous"
