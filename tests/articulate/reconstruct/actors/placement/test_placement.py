"""Parts put where a image shows them: boxes whose places are known."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.errors import UsageError
from articulate.reconstruct.actors.placement.actor import (
    PlacementActor,
    default_light,
    placements_of,
)
from articulate.reconstruct.actors.placement.initial_placements import (
    above_ground,
    symmetric_candidates,
)
from articulate.reconstruct.actors.placement.placement_problem import (
    SMALLEST_GAP,
    PlacementProblem,
    build_problem,
    region_of,
)
from articulate.reconstruct.actors.placement.search import total_cost, unexplained_share
from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.semantic.actor import SemanticActor
from articulate.render.camera import front_camera
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene
from articulate.transforms import apply, pose

CAMERA = front_camera(320, 240)
BODY, DOOR, KNOB = (0.8, 1.2, 1.4), (0.06, 1.1, 0.6), (0.1, 0.12, 0.12)
CENTRES = {
    "body": np.array([-0.2, 0.1, 0.7]),
    "door": np.array([0.23, 0.1, 0.95]),
    "knob": np.array([0.31, 0.5, 0.9]),
}
RGB = {"body": (0.7, 0.6, 0.5), "door": (0.4, 0.5, 0.7), "knob": (0.8, 0.2, 0.2)}
SIZES = {"body": BODY, "door": DOOR, "knob": KNOB}


def box(name, centre=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box(SIZES[name])
    return plain_part(name, np.asarray(mesh.vertices) + centre, np.asarray(mesh.faces), RGB[name])


def question(names) -> Evidence:
    """Boxes with the middle of each at the origin, and a image of them in their places."""
    scene = PartScene([box(name, CENTRES[name]) for name in names])
    return Evidence(
        modality="image",
        parts=tuple(box(name) for name in names),
        labels={name: name for name in names},
        placed=False,
        image=scene.render_image(CAMERA),
        camera=CAMERA,
    )


@pytest.fixture(scope="module")
def three() -> Evidence:
    return question(["knob", "body", "door"])


@pytest.fixture(scope="module")
def three_places(three):
    return placements_of(three)


@functools.cache
def puzzle_of_three() -> PlacementProblem:
    evidence = question(["knob", "body", "door"])
    assert evidence.image is not None
    return build_problem(evidence.parts, evidence.image, CAMERA, default_light(CAMERA))


@pytest.fixture
def problem() -> PlacementProblem:
    return puzzle_of_three()


def camera_places(problem: PlacementProblem, centres=CENTRES):
    return {i: apply(CAMERA.T_cw, centres[p.name]) for i, p in enumerate(problem.parts)}


@pytest.mark.parametrize("name", ["knob", "body", "door"])
def test_a_body_a_door_and_a_knob_are_placed_within_two_hundredths_of_the_object(
    three_places, name
):
    off = np.linalg.norm(three_places[name][:3, 3] - CENTRES[name])
    assert off < 0.02 * float(np.linalg.norm(BODY))
    assert np.array_equal(three_places[name][:3, :3], np.eye(3))


def test_names_labels_order_and_offsets_do_not_reach_the_search(three, three_places):
    """The same parts under other names, shifted, without labels: the same places of the boxes."""
    shift = {"body": [5.0, -3.0, 2.0], "door": [0.0, 0.0, 9.0], "knob": [-1.0, 0.5, 0.25]}
    moved = {"body": "part_01", "door": "part_02", "knob": "part_00"}
    parts = tuple(p.renamed(moved[p.name]).moved(pose(shift[p.name])) for p in three.parts)
    other = placements_of(dataclasses.replace(three, parts=parts, labels={}, seed=7))
    for name, place in three_places.items():
        middle = other[moved[name]][:3, 3] + shift[name]
        assert middle == pytest.approx(place[:3, 3], abs=1e-6)


def test_the_true_places_explain_the_image_and_others_do_not(problem):
    share = unexplained_share(problem, camera_places(problem))
    assert share < 0.015  # soft edges of a small image made larger
    true = total_cost(problem, 2, camera_places(problem))
    for name in CENTRES:
        moved = {**CENTRES, name: CENTRES[name] + np.array([0.0, 0.1, 0.0])}
        assert total_cost(problem, 2, camera_places(problem, moved)) > true + 5.0


@settings(max_examples=20, deadline=None)
@given(
    st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-0.6, -0.2)),
    st.integers(0, 2),
)
def test_what_a_part_adds_is_the_difference_of_the_images_with_and_without_it(shift, part):
    problem = puzzle_of_three()
    placements = camera_places(problem)
    level = problem.levels[0]
    here = placements[part] + np.array(shift)
    rendered = level.rendered(placements, problem.light, without=(part,))
    added, _ = level.costs(part, here[None], rendered, problem.light)
    others = {i: place for i, place in placements.items() if i != part}
    # rendered last, like the added part
    complete = level.rendered({**others, part: here}, problem.light)
    assert level.total(complete) == pytest.approx(level.total(rendered) + added[0], abs=1.0)


@pytest.mark.parametrize("apart", [0.0, 0.05, 0.3])
def test_a_gap_is_the_distance_of_the_surfaces(problem, apart):
    placements = camera_places(problem)
    names = [p.name for p in problem.parts]
    centre = CENTRES["body"] + [0.5 * (BODY[0] + DOOR[0]) + apart, 0.0, 0.0]
    only = {names.index("body"): placements[names.index("body")]}
    found = problem.gap(names.index("door"), apply(CAMERA.T_cw, centre), only)
    assert found == pytest.approx(max(0.0, apart - SMALLEST_GAP), abs=0.02)


def test_nothing_is_tried_below_the_ground(problem):
    door = [p.name for p in problem.parts].index("door")
    high = apply(CAMERA.T_cw, [[0.0, 0.0, 0.3], [0.0, 0.0, 0.1], [0.0, 0.0, 1.0]])
    assert len(above_ground(problem, door, high)) == 2


def test_a_part_like_another_may_be_opposite_to_it():
    evidence = question(["body", "knob"])
    twin = evidence.parts[1].renamed("twin")
    parts = (*evidence.parts, twin)
    assert evidence.image is not None
    problem = build_problem(parts, evidence.image, CAMERA, default_light(CAMERA))
    placements = {i: apply(CAMERA.T_cw, CENTRES[n]) for i, n in enumerate(("body", "knob"))}
    candidates = apply(CAMERA.T_wc, symmetric_candidates(problem, 2, placements))
    opposite = CENTRES["knob"] * [1, -1, 1] + 2.0 * CENTRES["body"] * [0, 1, 0]
    assert np.linalg.norm(candidates - opposite, axis=1).min() < 1e-9


def test_the_region_of_a_image_holds_what_is_seen(three):
    left, right, top, bottom = region_of(three.image)
    rows, columns = np.nonzero((three.image < 230).any(axis=-1))
    assert left <= columns.min() < columns.max() < right
    assert top <= rows.min() < rows.max() < bottom


def test_a_image_of_nothing_is_all_region():
    assert region_of(np.full((24, 32, 3), 255, np.uint8)) == (0, 32, 0, 24)


def test_placed_parts_are_left_where_they_are():
    parts = tuple(box(name, CENTRES[name]) for name in ("body", "door"))
    labels = {"body": "cabinet body", "door": "door"}
    found = PlacementActor().predict(Evidence(modality="image", parts=parts, labels=labels))
    assert found.placements == {}
    assert [j.part for j in found.joints] == ["door"]


def test_a_image_changes_nothing_where_parts_are_in_their_places(three):
    parts = tuple(p.moved(pose(CENTRES[p.name])) for p in three.parts)
    seen = dataclasses.replace(three, parts=parts, placed=True)
    blind = dataclasses.replace(seen, modality="text", image=None, camera=None)
    assert PlacementActor().predict(seen).joints == SemanticActor().predict(blind).joints


@pytest.mark.parametrize("missing", ["image", "camera"])
def test_without_image_or_camera_nothing_can_be_placed(three, missing):
    with pytest.raises(UsageError, match="image and its camera"):
        placements_of(dataclasses.replace(three, **{missing: None}))
