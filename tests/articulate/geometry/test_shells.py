"""Thin curved walls become staves that follow them, not a solid."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from articulate.geometry import shells
from articulate.geometry.convex_fit import is_near
from articulate.geometry.rays import Surface
from articulate.geometry.shapes import Shape, sample_surface
from articulate.geometry.shells import shell_shapes

RADIUS, HEIGHT, TOL = 0.15, 0.3, 0.004


def bucket(sections: int = 48, wall: float = 0.004) -> trimesh.Trimesh:
    """A bucket that is open at the top, made by turning its outline."""
    outline = np.array(
        [[0, 0], [RADIUS, 0], [RADIUS, HEIGHT], [RADIUS - wall, HEIGHT], [RADIUS - wall, wall],
         [0, wall]]
    )  # fmt: skip
    return trimesh.creation.revolve(outline, sections=sections)


@pytest.fixture(scope="module")
def staves():
    return made(bucket(), 96)


def made(mesh: trimesh.Trimesh, most: int) -> list[Shape]:
    """The shapes of a mesh, which are not too many."""
    shapes = shell_shapes(mesh, TOL, "bucket", most)
    assert shapes is not None
    return shapes


def test_a_bucket_stays_hollow(staves):
    inside = np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.2], [0.0, -0.12, 0.29]])
    assert all(float(shape.outside(inside).min()) > 0.0 for shape in staves)


def test_its_whole_surface_is_covered(staves):
    points, _ = sample_surface(bucket(), 2000)
    nearest = np.min([shape.outside(points) for shape in staves], axis=0)
    assert float((nearest <= TOL).mean()) > 0.99


def test_every_stave_lies_on_the_wall(staves):
    mesh = bucket()
    assert all(is_near(shape, Surface(mesh), 2.0 * TOL) for shape in staves)
    assert len(staves) < 60


def test_more_than_allowed_is_given_up():
    assert shell_shapes(bucket(), TOL, "bucket", 3) is None


def test_the_same_mesh_gives_the_same_shapes(staves):
    shells._full_patch.cache_clear()
    again = made(bucket(), 96)
    assert [s.kind for s in again] == [s.kind for s in staves]
    assert all(np.array_equal(a.corners, b.corners) for a, b in zip(again, staves, strict=True))


def test_a_flat_sheet_is_one_shape():
    sheet = trimesh.Trimesh(
        vertices=[[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0], [0, 0.2, 0]], faces=[[0, 1, 2], [0, 2, 3]]
    )
    (shape,) = made(sheet, 8)
    assert shape.kind == "box"


def test_with_few_staves_all_is_covered_and_more_of_them_hold_less_besides():
    mesh = bucket()
    points, _ = sample_surface(mesh, 1000)
    volume = []
    for most in (12, 48):
        shapes = shells.staves(mesh, TOL, "bucket", most)
        assert shapes is not None
        assert len(shapes) <= most
        nearest = np.min([shape.outside(points) for shape in shapes], axis=0)
        assert float((nearest <= TOL).mean()) > 0.99
        volume.append(sum(shape.volume for shape in shapes))
    assert volume[1] < 0.7 * volume[0]


def test_staves_leave_free_what_they_are_told_to():
    """A closed shell fits its own hull; points inside tell that it is hollow."""
    shell = trimesh.creation.box((0.4, 0.05, 0.6))
    inside = np.random.default_rng(0).uniform([-0.19, -0.02, -0.29], [0.19, 0.02, 0.29], (400, 3))
    for free, count in ((inside[:0], 1), (inside, 6)):
        shapes = shells.staves(shell, TOL, "door", 12, free)
        assert shapes is not None
        assert len(shapes) == count
        assert not len(free) or all(float(s.outside(inside).min()) > 0.0 for s in shapes)
