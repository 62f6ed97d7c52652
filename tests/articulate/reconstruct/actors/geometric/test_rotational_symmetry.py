"""Round parts whose turning is told by the marks on them."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.reconstruct.actors.geometric import fit
from articulate.reconstruct.actors.geometric.fit import (
    MotionConstraints,
    find_motion,
    has_visible_motion,
)
from articulate.reconstruct.actors.geometric.parameters import IMAGE
from articulate.reconstruct.actors.geometric.rotational_symmetry import (
    SpinEstimate,
    SurfaceMarks,
    estimate_spin,
)
from articulate.reconstruct.actors.geometric.video import scene_from_evidence, video_actor
from articulate.reconstruct.actors.protocol import Evidence
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene
from articulate.transforms import axis_angle_to_matrix

FRAMES, RINGS, AROUND = 40, 4, 90


def marks_that_turn(end_rad, seed=0, noise=0.0):
    """Four rings of a random texture that turns evenly by ``end_rad``, as fixed pixels see it."""
    rng = np.random.default_rng(seed)
    angle = np.tile(np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False), RINGS)
    ring = np.repeat(np.arange(RINGS), AROUND)
    texture = rng.uniform(0.0, 255.0, (RINGS, AROUND, 3))
    back = np.linspace(0.0, end_rad, FRAMES)[:, None]
    place = np.round((angle - back) / (2.0 * np.pi) * AROUND).astype(int) % AROUND
    colours = texture[ring, place] + noise * rng.normal(size=(FRAMES, len(angle), 3))
    return SurfaceMarks(angle, ring, colours - colours.mean(axis=0))


def told(marks) -> SpinEstimate:
    spin = estimate_spin(marks)
    assert spin is not None
    return spin


@settings(max_examples=10, deadline=None)
@given(end_rad=st.floats(0.5, 5.9), sign=st.sampled_from([-1.0, 1.0]), seed=st.integers(0, 99))
def test_marks_tell_how_far_and_which_way(end_rad, sign, seed):
    spin = told(marks_that_turn(sign * end_rad, seed, noise=20.0))
    assert spin.clear
    assert spin.sharp
    assert not spin.full_turn
    assert spin.end_rad == pytest.approx(sign * end_rad, abs=0.1)


def test_a_whole_turn_and_more_has_no_ends():
    spin = told(marks_that_turn(2.0 * np.pi + 0.5))
    assert spin.clear
    assert spin.full_turn


def test_blurred_marks_tell_that_something_turns_and_not_how_far():
    """A texture that changes once around, and noise: turns near the right one are as good."""
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    turned = angle - np.linspace(0.0, 4.0, FRAMES)[:, None]
    noise = 20.0 * np.random.default_rng(0).normal(size=(FRAMES, AROUND, 3))
    colours = 60.0 * np.cos(turned)[..., None] + noise
    marks = SurfaceMarks(angle, np.zeros(AROUND, dtype=np.int64), colours - colours.mean(axis=0))
    spin = told(marks)
    assert spin.clear
    assert not spin.sharp


def test_noise_is_not_clear_and_what_stands_still_turns_by_nothing():
    marks = marks_that_turn(1.0)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=marks.change.shape)
    assert not told(SurfaceMarks(marks.angle, marks.ring, noise - noise.mean(axis=0))).clear
    assert estimate_spin(SurfaceMarks(marks.angle, marks.ring, np.zeros_like(noise))) is None


def knob(name, y, radius, mark=None):
    """A disc with its front towards +x; two of its 24 slices have the colour ``mark``."""
    disc = trimesh.creation.cylinder(radius=radius, height=0.1, sections=24)
    disc.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], [1, 0, 0]))
    disc.apply_translation([0.15, y, 0.5])
    part = plain_part(name, disc.vertices, disc.faces, (0.6, 0.5, 0.4))
    arm = disc.triangles_center - [0.15, y, 0.5]
    slices = np.floor(np.arctan2(arm[:, 2], arm[:, 1]) / (2.0 * np.pi) * 24.0) % 24
    if mark is not None:
        part.rgb[slices < 2.0] = mark
    return part


def clip_of(end_rad, mark):
    """A clip of the left, larger of two knobs, whose mark is not in its model, as it turns."""
    pivot = np.array([0.15, -0.3, 0.5])
    T_o = np.tile(np.eye(4), (FRAMES, 1, 1))
    for k, turn in enumerate(np.linspace(0.0, end_rad, FRAMES)):
        T_o[k, :3, :3] = axis_angle_to_matrix(np.array([1.0, 0.0, 0.0]), turn)
        T_o[k, :3, 3] = pivot - T_o[k, :3, :3] @ pivot
    return clip_of_knobs(T_o, mark)


def clip_of_knobs(T_o, mark=None):
    """A clip of two knobs, the left of which is moved by ``T_o`` (FRAMES, 4, 4)."""
    block = trimesh.creation.box(bounds=[(-0.5, -0.6, 0.0), (0.1, 0.6, 1.0)])
    body = plain_part("body", block.vertices, block.faces, (0.4, 0.4, 0.5))
    right = knob("right", 0.3, 0.12)
    camera = front_camera(320, 240)
    seen = PartScene((body, knob("left", -0.3, 0.16, mark), right))
    clip = render_video(seen, camera, poses_of_parts(3, [1], T_o))
    return Evidence(
        modality="video",
        parts=(body, knob("left", -0.3, 0.16), right),
        video=clip.frames,
        times_s=clip.times_s,
        camera=camera,
    )


def said_of(end_rad, mark):
    """The joint of such a clip."""
    prediction = video_actor().predict(clip_of(end_rad, mark))
    (said,) = [j for j in prediction.joints if j.kind != "fixed"]
    return said


def test_a_knob_whose_mark_is_not_known_turns_as_far_as_the_mark_goes():
    said = said_of(5.0, (0.1, 0.1, 0.1))
    assert (said.part, said.kind) == ("left", "revolute")
    assert said.upper - said.lower == pytest.approx(5.0, abs=0.15)
    assert abs(said.axis_o[0]) == pytest.approx(1.0, abs=1e-6)


def test_where_next_to_nothing_shows_the_part_that_changes_most_turns():
    """Not the smallest, though nothing of it is enough to be looked at as a change."""
    said = said_of(7.0, (0.61, 0.51, 0.41))
    assert (said.part, said.kind) == ("left", "continuous")


def test_a_round_part_of_which_little_shows_may_be_pressed():
    T_o = np.tile(np.eye(4), (FRAMES, 1, 1))
    T_o[:, 0, 3] = np.linspace(0.0, -0.04, FRAMES)
    prediction = video_actor().predict(clip_of_knobs(T_o))
    (said,) = [j for j in prediction.joints if j.kind != "fixed"]
    assert (said.part, said.kind) == ("left", "prismatic")
    assert abs(said.axis_o[0]) == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow  # the two above run the same search
def test_a_round_part_is_not_said_to_turn_where_a_slide_is_asked_for():
    scene = scene_from_evidence(clip_of(5.0, (0.1, 0.1, 0.1)))
    turn = find_motion(scene)
    assert turn is not None
    assert turn.motion.kind == "turn"
    slide = find_motion(scene, MotionConstraints(kind="slide"))
    assert slide is None or slide.motion.kind == "slide"


@pytest.mark.slow  # the two above run the same search
def test_where_no_motion_explains_anything_the_round_part_that_changes_turns(monkeypatch):
    """As where the model is so wrong that it is cheapest to hide a part all the time."""
    scene = scene_from_evidence(clip_of(5.0, (0.1, 0.1, 0.1)))
    monkeypatch.setattr(fit, "_turn_in_place", lambda *_: None)
    monkeypatch.setattr(fit, "moves", lambda *_: False)
    found = find_motion(scene)
    assert found is not None
    assert ([scene.parts[k].name for k in found.parts], found.motion.kind) == (["left"], "turn")
    other = find_motion(scene, MotionConstraints(excluded_parts=found.parts))
    assert other is None or found.parts[0] not in other.parts[:1]


def test_a_square_drawer_that_begins_half_open_slides():
    """All that changes lies where it is at rest, and turned it looks nearly as it did."""
    legs = [
        trimesh.creation.box(bounds=[(x, y, 0.0), (x + 0.05, y + 0.05, 0.9)])
        for x in (-0.3, 0.25)
        for y in (-0.5, 0.45)
    ]
    top = trimesh.creation.box(bounds=[(-0.35, -0.55, 0.9), (0.35, 0.55, 0.95)])
    table = trimesh.util.concatenate([*legs, top])
    wood = (0.6, 0.6, 0.6)
    walls = [
        trimesh.creation.box(bounds=bounds)
        for bounds in (
            [(-0.05, -0.26, 0.76), (0.47, 0.26, 0.78)],
            [(-0.05, -0.26, 0.78), (0.47, -0.24, 0.88)],
            [(-0.05, 0.24, 0.78), (0.47, 0.26, 0.88)],
            [(-0.05, -0.24, 0.78), (-0.03, 0.24, 0.88)],
            [(0.45, -0.24, 0.78), (0.47, 0.24, 0.88)],
        )
    ]
    drawer = trimesh.util.concatenate(walls)
    parts = (
        plain_part("table", table.vertices, table.faces, wood),
        plain_part("drawer", drawer.vertices, drawer.faces, wood),
    )
    T_o = np.tile(np.eye(4), (FRAMES, 1, 1))
    T_o[:, 0, 3] = np.linspace(-0.2, 0.2, FRAMES)
    camera = front_camera(320, 240)
    clip = render_video(PartScene(parts), camera, poses_of_parts(2, [1], T_o))
    evidence = Evidence(
        modality="video", parts=parts, video=clip.frames, times_s=clip.times_s, camera=camera
    )
    (said,) = [j for j in video_actor().predict(evidence).joints if j.kind != "fixed"]
    assert (said.part, said.kind) == ("drawer", "prismatic")
    assert said.lower is not None
    assert said.upper is not None
    assert said.upper - said.lower == pytest.approx(0.4, abs=0.02)


def test_a_square_door_is_seen_to_leave_its_place_and_a_knob_is_not():
    """It is round about the direction that it faces, and is hinged about another."""
    block = trimesh.creation.box(bounds=[(-0.5, -0.6, 0.0), (0.1, 0.6, 1.0)])
    leaf = trimesh.creation.box(bounds=[(0.1, -0.4, 0.1), (0.14, 0.4, 0.9)])
    parts = (
        plain_part("body", block.vertices, block.faces, (0.6, 0.6, 0.6)),
        plain_part("door", leaf.vertices, leaf.faces, (0.6, 0.6, 0.6)),
    )
    pivot, T_o = np.array([0.1, 0.4, 0.0]), np.tile(np.eye(4), (FRAMES, 1, 1))
    T_o[:, :3, :3] = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), np.linspace(0, 1.6, FRAMES))
    T_o[:, :3, 3] = pivot - T_o[:, :3, :3] @ pivot
    camera = front_camera(320, 240)
    clip = render_video(PartScene(parts), camera, poses_of_parts(2, [1], T_o))
    door = Evidence(
        modality="video", parts=parts, video=clip.frames, times_s=clip.times_s, camera=camera
    )
    for evidence, leaves in ((door, True), (clip_of(5.0, (0.1, 0.1, 0.1)), False)):
        scene = scene_from_evidence(evidence)
        level = scene.level(IMAGE.quick_px, IMAGE.quick_frames)
        assert has_visible_motion(level, 1, 0.5 * scene.size_m) == leaves
