"""The way to contact by closed forms, then against FCL's distances and PyBullet's depths."""

import tracemalloc

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.program import contact_distance
from articulate.reconstruct.program.contact_distance import (
    Hull,
    bullet_depth,
    contact_along,
    hull_of,
)
from articulate.transforms import pose

CUBE = trimesh.creation.box((1.0, 1.0, 1.0))


def moved(mesh, by):
    return hull_of(np.asarray(mesh.vertices) + by)


def hollow(outer=1.0, wall=0.1):
    """A cup: a cube open at the top with walls of ``wall``."""
    h, t = outer / 2, wall
    sides = [
        ((outer, outer, t), (0, 0, -h + t / 2)),
        ((t, outer, outer), (-h + t / 2, 0, 0)),
        ((t, outer, outer), (h - t / 2, 0, 0)),
        ((outer, t, outer), (0, -h + t / 2, 0)),
        ((outer, t, outer), (0, h - t / 2, 0)),
    ]
    boxes = [
        trimesh.creation.box(e, trimesh.transformations.translation_matrix(c)) for e, c in sides
    ]
    return trimesh.util.concatenate(boxes)


@pytest.mark.parametrize(("axis", "sign"), [(a, s) for a in range(3) for s in (1, -1)])
def test_cubes_meet_face_to_face(axis, sign):
    by = np.array([0.2, -0.1, 0.3])
    by[axis] = -sign * 3.0
    found = contact_along([moved(CUBE, by)], CUBE.triangles, axis, sign)
    assert found.distance_m == pytest.approx(2.0, abs=1e-9)
    assert not found.overlaps


def test_a_cube_beside_the_way_is_not_met():
    assert contact_along([moved(CUBE, [1.001, 0, 3])], CUBE.triangles, 2, -1).distance_m is None


def test_what_slides_along_a_face_is_not_stopped():
    assert contact_along([moved(CUBE, [1.0, 0, 3])], CUBE.triangles, 2, -1).distance_m is None


def test_what_lies_behind_is_not_met():
    assert contact_along([moved(CUBE, [0, 0, 3])], CUBE.triangles, 2, 1).distance_m is None


def test_touching_pieces_are_in_contact_and_do_not_overlap():
    found = contact_along([moved(CUBE, [0, 0, 1.0])], CUBE.triangles, 2, -1)
    assert found.distance_m == pytest.approx(0.0, abs=1e-9)
    assert not found.overlaps


def test_a_piece_that_cuts_in_is_told_and_not_stopped_by_what_it_cuts():
    found = contact_along([moved(CUBE, [0.3, 0.2, 0.9])], CUBE.triangles, 2, -1)
    assert found.overlaps


def test_a_ball_meets_a_ball_where_spheres_do():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    found = contact_along([moved(ball, [0.3, 0.2, 4.0])], ball.triangles, 2, -1)
    exact = 4.0 - np.sqrt(1.0 - 0.3**2 - 0.2**2)
    assert found.distance_m == pytest.approx(exact, abs=0.02)  # facets lie within the sphere
    assert found.distance_m >= exact


def test_crossed_edges_meet_between_their_corners():
    """Two roofs, turned by a quarter: neither has a corner over a face of the other."""
    roof = np.array([[-1, 0, 1], [1, 0, 1], [-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]], float)
    lower = hull_of(roof)
    upper = hull_of(roof[:, [1, 0, 2]] * [1, 1, -1] + [0, 0, 5])
    found = contact_along([upper], lower.points[lower.faces], 2, -1)
    assert found.distance_m == pytest.approx(3.0, abs=1e-6)


def test_a_cube_goes_into_a_hollow_down_to_its_floor():
    small = trimesh.creation.box((0.5, 0.5, 0.5))
    found = contact_along([moved(small, [0, 0, 2.0])], hollow().triangles, 2, -1)
    assert found.distance_m == pytest.approx(2.0 - 0.25 - (-0.4), abs=1e-9)


def test_a_fitting_drawer_reaches_the_back_of_its_carcass():
    """Its sides touch the walls: sliding contact stops nothing."""
    drawer = trimesh.creation.box((0.8, 0.8, 0.5))
    found = contact_along([moved(drawer, [0, 0, 2.0])], hollow().triangles, 2, -1)
    assert found.distance_m == pytest.approx(2.0 - 0.25 + 0.4, abs=1e-9)


def test_a_flat_plate_has_a_hull_and_meets_things():
    plate = hull_of(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float) - [0.5, 0.5, -2])
    assert contact_along([plate], CUBE.triangles, 2, -1).distance_m == pytest.approx(1.5, abs=1e-9)


def random_meshes(seed):
    rng = np.random.default_rng(seed)
    meshes = [trimesh.convex.convex_hull(rng.normal(size=(12, 3)) * 0.3) for _ in range(2)]
    return meshes, np.array([*rng.uniform(-0.3, 0.3, 2), 4.0])


@pytest.mark.parametrize("seed", range(12))
def test_fcl_agrees_with_the_way_of_random_hulls(seed):
    (still, free), by = random_meshes(seed)
    found = contact_along([moved(free, by)], still.triangles, 2, -1)
    manager = trimesh.collision.CollisionManager()
    manager.add_object("still", still)
    if found.distance_m is None:
        return
    for share, touching in ((0.999, False), (1.001, True)):
        T = np.eye(4)
        T[:3, 3] = by - [0, 0, found.distance_m * share]
        assert manager.in_collision_single(free, T) is touching


def test_bullet_sees_depth_and_touch():
    pytest.importorskip("pybullet")
    for depth in (-0.01, 0.0, 0.01, 0.1):
        seen = bullet_depth([moved(CUBE, [0.1, 0, 1.0 - depth])], CUBE.triangles)
        assert seen == pytest.approx(max(depth, 0.0), abs=1e-6)


def test_bullet_agrees_that_the_result_does_not_cut(capfd):
    pytest.importorskip("pybullet")
    small = trimesh.creation.box((0.5, 0.5, 0.5))
    hull = moved(small, [0, 0, 2.0])
    way = contact_along([hull], hollow().triangles, 2, -1).distance_m
    down = Hull(hull.points - [0, 0, way], hull.faces)
    assert bullet_depth([down], hollow().triangles) <= 1e-6
    assert capfd.readouterr() == ("", "")


def test_slices_of_a_hull_give_what_the_whole_hull_gives(monkeypatch):
    (still, free), by = random_meshes(7)
    ways = [(a, s) for a in range(3) for s in (1, -1)]
    hulls = [moved(free, by * (0.1, 0.1, 0.05))]
    whole = [contact_along(hulls, still.triangles, axis, sign) for axis, sign in ways]
    assert any(found.distance_m is not None for found in whole)
    monkeypatch.setattr(contact_distance, "SLICE", 5)
    assert [contact_along(hulls, still.triangles, axis, sign) for axis, sign in ways] == whole


def test_a_hull_of_many_edges_takes_little_memory():
    ball = hull_of(trimesh.creation.uv_sphere(radius=0.1, count=[70, 140]).vertices)
    tracemalloc.start()
    contact_along([ball.moved(pose([0, 0, 2.0]))], CUBE.triangles, 2, -1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6  # 12 triangles against 29,000 edges at once take 120 MB


def test_a_sweep_ends_when_the_clock_says_so():
    looks = []

    def late():
        looks.append(1)
        if len(looks) == 2:
            raise TimeoutError

    with pytest.raises(TimeoutError):
        contact_along([moved(CUBE, [0, 0, 3])], CUBE.triangles, 2, -1, late)
