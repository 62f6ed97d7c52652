"""Paths through positions, once the search has found them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from articulate.reconstruct.actors.geometric.image_pyramid import build_scene
from articulate.reconstruct.actors.geometric.parameters import IMAGE, SEARCH
from articulate.reconstruct.actors.geometric.search import (
    MotionFit,
    coarse_fits,
    turn_steps,
    without_jumps,
    wrap_angle,
)
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene


def test_a_path_without_a_jump_stays_as_it_is():
    q = np.linspace(0.0, 5.0, 40)
    assert without_jumps(q) is q


def test_frames_in_which_a_wire_hid_are_put_between_their_neighbours():
    q = np.linspace(0.0, -4.9, 50)
    seen = q.copy()
    seen[10:] += 2.0 * np.pi
    seen[[9, 13, 35]] = 2.0
    assert without_jumps(seen) == pytest.approx(q, abs=1e-9)


@given(
    st.floats(-0.25, 0.25),
    st.lists(st.integers(1, 28), max_size=4, unique=True),
    st.lists(st.integers(-2, 2), min_size=30, max_size=30),
)
def test_an_even_turn_comes_back_whatever_hid_and_wherever_it_is_counted_from(step, hid, turns):
    q = step * np.arange(30.0)
    seen = q + 2.0 * np.pi * np.array(turns)
    seen[hid] = q[hid] + 2.5
    found = without_jumps(seen)
    if np.abs(np.diff(seen)).max() > 0.3 and len(hid) < 3:
        assert np.diff(found) == pytest.approx(np.full(29, step), abs=1e-9)


@given(st.floats(-50.0, 50.0))
def test_wrapped_angles_are_the_same_poses(angle):
    inside = float(wrap_angle(np.array(angle)))
    assert -np.pi <= inside <= np.pi
    assert np.cos(inside) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(inside) == pytest.approx(np.sin(angle), abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "q", "score"),
    [
        ("turn", [0.1, 0.9], 8.0),
        ("turn", [6.0, 7.0], 8.0),  # passes through a full turn, where the part rests
        ("turn", [2.8, 3.1], 4.0),
        ("turn", [-2.8, -0.7], 8.0),
        ("slide", [2.8, 3.1], 8.0),
    ],
)
def test_a_turn_that_never_comes_near_rest_is_worth_less(kind, q, score):
    motion = JointMotion(kind, np.array([0.0, 0.0, 1.0]), np.zeros(3), "given")
    fit = MotionFit(motion, np.array(q), cost=1.0, parts=(0,), gain=8.0)
    assert fit.score == pytest.approx(score)
    assert replace(fit, gain=-8.0).score == pytest.approx(score - 16.0)


def test_a_slide_shorter_than_the_steps_of_its_reach_is_found():
    lifted_m, reach_m = 0.02, 1.0
    bounds = {
        "pot": ((-0.5, -0.5, 0.0), (0.5, 0.5, 0.8)),
        "lid": ((-0.4, -0.4, 0.8), (0.4, 0.4, 1)),
    }
    meshes = {name: trimesh.creation.box(bounds=ends) for name, ends in bounds.items()}
    parts = [
        plain_part(name, mesh.vertices, mesh.faces, (0.8, 0.1 + 0.5 * k, 0.2))
        for k, (name, mesh) in enumerate(meshes.items())
    ]
    lift = JointMotion("slide", np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.9]), "truth")
    camera, q = front_camera(640, 480), np.linspace(0.0, lifted_m, 12)
    clip = render_video(PartScene(parts), camera, poses_of_parts(2, [1], lift.T_o(q)))
    level = build_scene(clip.frames, camera, parts).level(IMAGE.coarse_px, IMAGE.coarse_frames)
    free, _ = coarse_fits(lift, level.compositing([1]), (1,), reach_m, near=True)
    assert np.ptp(free.q) == pytest.approx(lifted_m, abs=0.01)
    assert free.gain > 0.0


def test_a_wire_is_turned_in_steps_in_which_it_overlaps_itself():
    """Between the positions of thick parts it would not meet its picture."""
    bounds = {
        "thick": ((-0.25, -0.5, 0.25), (0.25, 0.5, 0.75)),
        "wire": ((-0.01, -0.5, 0.74), (0.01, 0.5, 0.76)),
    }
    turn = JointMotion("turn", np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.25]), "truth")
    camera, q = front_camera(320, 240), 0.05 + np.linspace(0.0, 1.5, 12)
    n_steps, found = {}, {}
    for name, ends in bounds.items():
        mesh = trimesh.creation.box(bounds=ends)
        parts = [plain_part(name, mesh.vertices, mesh.faces, (0.3, 0.3, 0.3))]
        clip = render_video(PartScene(parts), camera, poses_of_parts(1, [0], turn.T_o(q)))
        layers = (
            build_scene(clip.frames, camera, parts)
            .level(IMAGE.coarse_px, IMAGE.coarse_frames)
            .compositing([0])
        )
        n_steps[name] = turn_steps(turn, layers)
        found[name] = coarse_fits(turn, layers, (0,), 1.0)[0]
    assert n_steps["thick"] == SEARCH.turn_positions < n_steps["wire"]
    assert wrap_angle(found["wire"].q - q) == pytest.approx(0.0, abs=0.06)
