"""Parts that a image hardly shows: a handle of wire, a button in the face of what it is in."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.placement.actor import default_light
from articulate.reconstruct.actors.placement.initial_placements import (
    THIN,
    is_small,
    thin_part_candidates,
)
from articulate.reconstruct.actors.placement.placement_problem import (
    PlacementProblem,
    build_problem,
)
from articulate.reconstruct.actors.placement.search import solve
from articulate.render.camera import front_camera
from articulate.render.parts import PartMesh, plain_part
from articulate.render.scene import PartScene
from articulate.transforms import apply, pose

CAMERA = front_camera(320, 240)


def part(name: str, mesh: trimesh.Trimesh, rgb: tuple[float, float, float]) -> PartMesh:
    return plain_part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces), rgb)


def puzzle_and_truth(parts: list[PartMesh]) -> tuple[PlacementProblem, dict[int, np.ndarray]]:
    """The parts apart, a image of them together, and where each one's middle is."""
    image = PartScene(parts).render_image(CAMERA)
    apart = [p.moved(pose(-p.centre)) for p in parts]
    problem = build_problem(apart, image, CAMERA, default_light(CAMERA))
    return problem, {i: apply(CAMERA.T_cw, p.centre) for i, p in enumerate(parts)}


@pytest.fixture(scope="module")
def bucket():
    """A drum, and a half ring of wire 16 mm thick above it."""
    drum = trimesh.creation.cylinder(radius=0.5, height=0.9)
    drum.apply_translation([0.0, 0.0, 0.45])
    angles = np.linspace(0.0, np.pi, 25)
    path = np.stack([np.zeros(25), 0.52 * np.cos(angles), 0.9 + 0.52 * np.sin(angles)], axis=1)
    wire = trimesh.util.concatenate(
        [trimesh.creation.cylinder(radius=0.008, segment=ends) for ends in pairwise(path)]
    )
    return puzzle_and_truth(
        [part("drum", drum, (0.7, 0.7, 0.75)), part("wire", wire, (0.3, 0.3, 0.35))]
    )


@pytest.fixture(scope="module")
def remote():
    """A case, and a button that is raised by a millimetre proud of its face, 3.5 m away."""
    case = trimesh.creation.box((0.3, 0.8, 1.2))
    case.apply_translation([0.0, 0.0, 0.6])
    button = trimesh.creation.box((0.1, 0.2, 0.15))
    button.apply_translation([0.101, 0.15, 0.8])
    return puzzle_and_truth(
        [part("case", case, (0.8, 0.8, 0.8)), part("button", button, (0.8, 0.1, 0.1))]
    )


def test_a_wire_fills_little_of_its_outline_and_a_drum_nearly_all(bucket):
    problem, _ = bucket
    assert problem.filled[1] < THIN
    assert problem.filled[0] == pytest.approx(1.0, abs=0.1)
    assert is_small(problem, 1, {0: np.array([0.0, 0.0, 3.0])})


def test_a_wire_is_tried_along_what_is_unexplained(bucket):
    """Two pixels beside its place a wire of two pixels explains nothing."""
    problem, true = bucket
    placements = {0: true[0]}
    candidates = thin_part_candidates(problem, 1, 1, placements, problem.rendered(1, 1, placements))
    across = np.linalg.norm((candidates - true[1])[:, :2], axis=1)
    assert across[0] < 0.05
    assert not len(
        thin_part_candidates(problem, 1, 0, {1: true[1]}, problem.rendered(1, 0, {1: true[1]}))
    )


@pytest.mark.slow  # 10 s; the case and its button below take 2 s
def test_a_handle_of_wire_is_put_where_it_is(bucket):
    problem, true = bucket
    found = solve(problem)
    for i, place in true.items():
        assert np.linalg.norm(found[i] - place) < 0.05


@pytest.mark.parametrize("moved", [0, 1])
def test_a_button_is_visible_in_its_panel_whichever_is_moved(remote, moved):
    """At one depth the smaller part wins, so that neither order of drawing hides it."""
    problem, true = remote
    level = problem.levels[2]
    together = level.total(level.rendered(true, problem.light))
    rendered = problem.rendered(2, moved, true)
    added, _ = level.costs(moved, true[moved][None], rendered, problem.light)
    assert level.total(rendered) + added[0] == pytest.approx(together, abs=10.0)


def test_a_case_rendered_last_would_hide_its_button(remote):
    problem, true = remote
    level = problem.levels[2]
    rendered = level.rendered(true, problem.light, without=(0,))
    added, _ = level.costs(0, true[0][None], rendered, problem.light)
    assert (
        level.total(rendered) + added[0] > level.total(level.rendered(true, problem.light)) + 100.0
    )


def test_a_case_and_its_button_are_put_where_they_are(remote):
    problem, true = remote
    found = solve(problem)
    for i, place in true.items():
        assert np.linalg.norm(found[i] - place) < 0.05
