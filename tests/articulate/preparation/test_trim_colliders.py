"""Cuts leave what lies below a plane, and are refused where they would bare what is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.checks.coverage import SAMPLES
from articulate.conversion.write_asset import Body
from articulate.formats.load_meshes import Piece
from articulate.geometry.inertia import Inertial
from articulate.geometry.shapes import Shape
from articulate.preparation.trim_colliders import Part, carved, cut_back
from articulate.transforms import Array, axis_angle_to_matrix, pose

BOX = Shape(kind="box", T_ps=pose((0.1, 0.0, 0.0)), half=(0.1, 0.05, 0.02))
units = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


def body(*shapes: Shape) -> Body:
    """A part that shows what its first shape is."""
    shown = Piece(mesh=shapes[0].mesh, rgba=(1, 1, 1, 1), name="x", element="x", link="x")
    inertial = Inertial(mass_kg=1.0, com_p=np.zeros(3), inertia_p=np.eye(3))
    return Body(
        name="x",
        parent=None,
        T_pc=np.eye(4),
        visuals=(shown,),
        shapes=shapes,
        inertial=inertial,
        joint=None,
        axis_l=None,
    )


def left(shape: Shape, normal: Array, depth_m: float) -> Shape:
    """What is left of a shape, and there is something."""
    found = cut_back(shape, normal, depth_m)
    assert found is not None
    return found


def rest(depth_m: float) -> tuple[Shape, ...]:
    """What is left of the box without so much of its top."""
    return (left(BOX, np.array([0.0, 0.0, 1.0]), depth_m),)


def test_a_box_cut_along_its_axis_is_a_shorter_box():
    rest = left(BOX, np.array([1.0, 0.0, 0.0]), 0.03)
    assert rest.kind == "box"
    np.testing.assert_allclose(rest.bounds, [[0.0, -0.05, -0.02], [0.17, 0.05, 0.02]], atol=1e-12)


def test_a_turned_box_cut_along_its_axis_is_a_box():
    turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), np.array(0.4))
    box = Shape(kind="box", T_ps=pose((0.0, 0.2, 0.0), turn), half=BOX.half)
    rest = left(box, -turn[:, 1], 0.01)
    assert rest.kind == "box"
    assert rest.half == pytest.approx((0.1, 0.045, 0.02))


def test_a_corner_that_is_cut_off_has_the_volume_of_a_pyramid():
    normal = np.ones(3) / np.sqrt(3.0)
    cube = Shape(kind="box", T_ps=np.eye(4), half=(0.1, 0.1, 0.1))
    depth = 0.03
    rest = left(cube, normal, depth)
    edge = depth * np.sqrt(3.0)  # of the three that meet in the corner
    assert rest.volume == pytest.approx(0.2**3 - edge**3 / 6.0, rel=1e-9)


@given(units, st.floats(0.001, 0.03))
def test_what_is_left_lies_below_the_plane_and_inside(normal, depth):
    normal = np.array(normal) / np.linalg.norm(normal)
    rest = cut_back(BOX, normal, depth)
    limit = float((BOX.corners @ normal).max()) - depth
    if rest is not None:
        assert float((rest.corners @ normal).max()) <= limit + 5e-5  # a box stays a box
        assert float(BOX.outside(rest.corners).max()) <= 1e-9
        assert rest.volume < BOX.volume


def test_next_to_nothing_is_nothing():
    assert cut_back(BOX, np.array([0.0, 0.0, 1.0]), 0.0398) is None


def test_a_cut_within_the_tolerance_costs_nothing():
    evaluate = Part(body(BOX)).evaluate(0, rest(0.0025))
    assert evaluate.allowed
    assert evaluate.lost == 0.0
    assert evaluate.removed_m3 == pytest.approx(0.2 * 0.1 * 0.0025)


def test_a_cut_that_bares_what_is_seen_is_refused():
    evaluate = Part(body(BOX)).evaluate(0, rest(0.01))
    assert evaluate.lost > 0.3  # the top and a quarter of the sides
    assert not evaluate.allowed


def test_what_is_left_is_no_thin_slice_unless_the_shape_was_one():
    slab = replace(BOX, half=(0.1, 0.05, 0.005))
    top = np.array([0.0, 0.0, 1.0])
    evaluate = Part(body(slab)).evaluate(0, (left(slab, top, 0.008), left(slab, -top, 0.008)))
    assert evaluate.rest == ()  # though all that is seen has a slice beside it
    assert not evaluate.allowed
    assert Part(body(slab)).evaluate(0, (left(slab, top, 0.0028),)).allowed
    sheet = Shape(kind="box", T_ps=BOX.T_ps, half=(0.1, 0.05, 0.001))
    part = Part(body(sheet))
    assert part.evaluate(0, (left(sheet, np.array([1.0, 0.0, 0.0]), 0.0028),)).allowed
    assert part.evaluate(0, (left(sheet, np.array([0.0, 0.0, 1.0]), 0.0013),)).rest
    assert not part.evaluate(0, (left(sheet, np.array([0.0, 0.0, 1.0]), 0.00145),)).rest


def test_an_edge_may_go_but_no_way_through_a_wall():
    wall = Shape(kind="box", T_ps=np.eye(4), half=(0.5, 0.5, 0.005))
    around = [
        replace(wall, T_ps=pose((x, y, 0.0)), half=half)
        for x, y, half in (
            (-0.3, 0.0, (0.2, 0.5, 0.005)), (0.3, 0.0, (0.2, 0.5, 0.005)),
            (0.0, 0.29, (0.1, 0.21, 0.005)), (0.0, -0.31, (0.1, 0.19, 0.005)),
        )
    ]  # fmt: skip
    part = Part(body(wall))
    evaluate = part.evaluate(0, tuple(around))  # but for 200 by 200 mm
    assert evaluate.lost < 0.04
    assert evaluate.bared
    assert not part.evaluate(0, (left(wall, np.array([1.0, 0.0, 0.0]), 0.015),)).bared


def test_what_another_shape_covers_is_not_lost():
    other = Shape(kind="box", T_ps=pose((0.1, 0.0, 0.015)), half=(0.1, 0.05, 0.005))
    part = Part(body(BOX, other))
    evaluate = part.evaluate(0, rest(0.01))
    assert evaluate.lost == 0.0
    part.apply(evaluate)
    part.remove_empty()
    assert len(part.trimmed_body().shapes) == 2
    assert part.cuts == {0}


@settings(max_examples=15)
@given(units, st.floats(0.001, 0.03))
def test_an_offer_costs_what_counting_all_points_again_says(normal, depth):
    other = Shape(kind="box", T_ps=pose((0.1, 0.0, 0.015)), half=(0.06, 0.04, 0.005))
    part = Part(body(BOX, other))
    piece = cut_back(BOX, np.array(normal) / np.linalg.norm(normal), depth)
    after = [other] if piece is None else [other, piece]
    points = part._points[:SAMPLES]
    before = np.min([shape.outside(points) for shape in (BOX, other)], axis=0) <= part.near_m
    near = np.zeros(len(points), dtype=bool)
    for shape in after:
        mesh = trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces)
        away = trimesh.proximity.closest_point(mesh, points)[1]
        near |= (away <= part.near_m) | (shape.outside(points) <= 0.0)
    evaluate = part.evaluate(0, () if piece is None else (piece,))
    assert evaluate.lost == pytest.approx(float((before & ~near).mean()), abs=0.0021)


def test_the_only_shape_of_a_part_never_goes():
    part = Part(body(Shape(kind="box", T_ps=np.eye(4), half=(0.001, 0.001, 0.001))))
    assert not part.evaluate(0, ()).allowed


def test_going_back_forgets_shapes_that_were_to_go():
    other = Shape(kind="box", T_ps=BOX.T_ps, half=(0.05, 0.02, 0.01))
    part = Part(body(BOX, other))
    state = part.state()
    part.apply(part.evaluate(1, ()))
    part.restore(state)
    part.remove_empty()
    assert part.trimmed_body().shapes == (BOX, other)


def test_a_shape_carved_out_of_another_leaves_pieces_around_it():
    cube = Shape(kind="box", T_ps=np.eye(4), half=(0.1, 0.1, 0.1))
    inner = Shape(kind="box", T_ps=pose((0.1, 0.0, 0.0)), half=(0.05, 0.02, 0.02))
    pieces = carved(cube, inner.planes)
    assert len(pieces) == 4
    assert sum(piece.volume for piece in pieces) > 0.9 * (cube.volume - 0.05 * 0.04 * 0.04) - 1e-4
    for piece in pieces:
        assert piece.kind == "box"
        assert float(np.max(inner.outside(piece.corners))) > 0.0
        inside = (np.abs(piece.T_ps[:3, 3] - [0.1, 0, 0]) < [0.05, 0.02, 0.02]).all()
        assert not inside


def test_a_shape_inside_another_leaves_nothing():
    small = Shape(kind="box", T_ps=np.eye(4), half=(0.01, 0.01, 0.01))
    assert carved(small, BOX.planes[:0]) == ()
    around = Shape(kind="box", T_ps=np.eye(4), half=(0.1, 0.1, 0.1))
    assert carved(small, around.planes) == ()


def test_a_part_goes_back_to_an_earlier_state():
    part = Part(body(BOX))
    state = part.state()
    part.apply(part.evaluate(0, rest(0.002)))
    assert part.cut_count == 1
    part.restore(state)
    assert part.trimmed_body().shapes == (BOX,)
    assert part.cut_count == 0
    assert not part.cuts
    assert isinstance(part.trimmed_body().shapes[0].mesh, trimesh.Trimesh)
