from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from tests.articulate.conversion.cabinets import bar, box, tray

from articulate.formats.config import ConvertConfig
from articulate.formats.load_meshes import PartGeometry, Piece
from articulate.formats.repairs import Repairs
from articulate.geometry.collision import collision_shapes, is_handle, piece_shapes
from articulate.geometry.convex_decomposition import decompose
from articulate.geometry.convex_fit import fitted, hull, thick
from articulate.geometry.merge_shapes import merged, within_budget, without_spare
from articulate.geometry.rays import Surface
from articulate.geometry.shapes import Shape
from articulate.transforms import pose

NO_DECOMPOSITION = ConvertConfig(decompose=False)


RAILS = ((0.25, 0.0), (-0.25, 0.0), (0.0, 0.08), (0.0, -0.08))


def shapes_of(mesh: trimesh.Trimesh, name: str = "part", config: ConvertConfig = NO_DECOMPOSITION):
    return piece_shapes(Piece(name=name, mesh=mesh), "part", config, Repairs())


def occupied(shapes, points) -> np.ndarray:
    outside = np.array([shape.outside(np.array(points)) for shape in shapes])
    return np.asarray(outside.min(axis=0) <= 0.0)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("link handle-12 original-3", True),
        ("door_left_nob_link", True),
        ("drawer_pull", True),
        ("KNOB", True),
        ("grip_bar", True),
        ("pulley", False),
        ("drawer_front-7", False),
        ("snobbish", False),
    ],
)
def test_handles_are_known_by_their_names(name: str, expected: bool) -> None:
    assert is_handle(name) is expected


def test_a_box_is_one_box_also_when_turned() -> None:
    mesh = box((0.4, 0.02, 0.3), (0.1, 0.2, 0.3))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.6, [0.3, 1.0, 0.2]))
    (shape,) = shapes_of(mesh)
    assert shape.kind == "box"
    np.testing.assert_allclose(sorted(shape.half), [0.01, 0.15, 0.2], atol=1e-6)
    np.testing.assert_allclose(shape.T_ps[:3, 3], mesh.centroid, atol=1e-6)


def test_a_flat_mesh_becomes_a_thin_box() -> None:
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    (shape,) = shapes_of(mesh)
    assert shape.kind == "box"
    assert min(shape.half) == pytest.approx(0.001)


def test_a_cylinder_is_one_hull_of_few_corners() -> None:
    (shape,) = shapes_of(trimesh.creation.cylinder(radius=0.05, height=0.3, sections=128))
    assert shape.kind == "hull"
    assert shape.vertices is not None
    assert len(shape.vertices) <= 32


def test_a_tray_stays_open_above() -> None:
    shapes = shapes_of(tray())
    assert len(shapes) == 5
    assert not occupied(shapes, [[0.18, 0.0, z] for z in (0.03, 0.06, 0.10)]).any()
    assert occupied(shapes, [[0.18, 0.0, 0.015], [0.18, 0.185, 0.06], [0.008, 0.0, 0.07]]).all()


def test_a_welded_tray_of_one_component_stays_open_above() -> None:
    mesh = trimesh.boolean.difference(
        [box((0.3, 0.4, 0.12), (0, 0, 0.06)), box((0.28, 0.38, 0.12), (0, 0, 0.07))]
    )
    assert mesh.body_count == 1
    shapes = shapes_of(mesh)
    assert len(shapes) <= 8
    assert not occupied(shapes, [[0.0, 0.0, z] for z in (0.02, 0.06, 0.1)]).any()
    assert occupied(shapes, [[0.0, 0.0, 0.001], [0.1495, 0.0, 0.06], [0.0, -0.1995, 0.06]]).all()


def test_a_frame_keeps_its_hole() -> None:
    mesh = trimesh.boolean.difference(
        [box((0.02, 0.6, 0.2), (0, 0, 0)), box((0.1, 0.4, 0.12), (0, 0, 0))]
    )
    shapes = shapes_of(mesh)
    assert not occupied(shapes, [[0.0, y, 0.0] for y in (-0.15, 0.0, 0.15)]).any()
    assert occupied(shapes, [[x, y, z] for x in (-0.0095, 0.0095) for y, z in RAILS]).all()


def test_a_bar_handle_is_free_behind() -> None:
    shapes = shapes_of(bar(), "handle")
    assert not occupied(shapes, [[-0.02, 0.0, 0.08], [-0.01, 0.03, 0.08]]).any()
    assert occupied(shapes, [[-0.036, 0.0, 0.08]]).all()


def test_the_budget_is_kept_and_said() -> None:
    posts = [box((0.02, 0.02, 0.4), (0.1 * i, 0.1 * (i % 3), 0.2)) for i in range(12)]
    mesh = trimesh.util.concatenate(posts)
    geometry = PartGeometry(
        visuals=(Piece(name="p", mesh=mesh, link="p"),), collisions=(), collides_as_seen=True
    )
    repairs = Repairs()
    config = ConvertConfig(max_geoms=5, decompose=False)
    assert len(collision_shapes(geometry, "p", config, repairs)) == 5
    assert "merged into 5" in repairs.messages[-1]


def test_a_sealed_shell_is_made_hollow_and_keeps_its_outside() -> None:
    door = box((0.5, 0.06, 1.0), (0, 0, 0))
    piece = Piece(name="door", mesh=door, link="p")
    geometry = PartGeometry(visuals=(piece,), collisions=(), collides_as_seen=True)
    cavity = np.random.default_rng(0).uniform(-1.0, 1.0, (1000, 3)) * [0.247, 0.027, 0.497]
    config = ConvertConfig(decompose=False, finer=("p",))
    (sealed,) = collision_shapes(geometry, "p", config, Repairs())
    assert sealed.kind == "box"
    walls = collision_shapes(geometry, "p", config, Repairs(), cavity)
    assert len(walls) <= 6
    assert not occupied(walls, cavity).any()
    seen, _ = trimesh.sample.sample_surface(door, 500, seed=0)
    away = np.min([wall.outside(seen) for wall in walls], axis=0)
    assert float((away < 0.003).mean()) > 0.95


def test_shapes_that_may_not_stray_are_more_than_wanted() -> None:
    posts = [box((0.02, 0.02, 0.4), (0.1 * i, 0.1 * (i % 3), 0.2)) for i in range(12)]
    halves = [box((0.02, 0.02, 0.2), (1.2, 0.0, z)) for z in (0.1, 0.3)]
    surface = Surface(trimesh.util.concatenate([*posts, *halves]))
    shapes = [fitted(p.vertices, Surface(p), 0.003, "p") for p in (*posts, *halves)]
    given = [shape for shape in shapes if shape is not None]
    assert len(given) == 14
    assert len(within_budget(given, 5, "p", Repairs())) == 5
    repairs = Repairs()
    assert len(within_budget(given, 5, "p", repairs, surface)) == 13
    assert repairs.messages == ("part p: 14 collision shapes merged into 13",)


def test_good_collision_geometry_of_the_source_is_kept() -> None:
    panels = (box((0.3, 0.02, 0.3), (0, 0, 0)), box((0.3, 0.02, 0.3), (0, 0.4, 0)))
    seen = Piece(name="p", mesh=trimesh.util.concatenate(panels), link="p")
    given = tuple(Piece(name="c", mesh=panel, link="p") for panel in panels)
    sealed = (Piece(name="c", mesh=box((0.3, 0.42, 0.3), (0, 0.2, 0)), link="p"),)
    for collisions, kept in ((given, True), (sealed, False)):
        geometry = PartGeometry(visuals=(seen,), collisions=collisions, collides_as_seen=False)
        repairs = Repairs()
        shapes = collision_shapes(geometry, "p", NO_DECOMPOSITION, repairs)
        assert len(shapes) == 2
        assert any("replaced" in sentence for sentence in repairs.messages) is not kept


def test_collision_geometry_of_the_source_that_did_not_pass_the_proof_is_made_anew() -> None:
    panel = box((0.3, 0.02, 0.3), (0, 0, 0))
    seen, given = (Piece(name=n, mesh=panel, link="p") for n in ("p", "c"))
    geometry = PartGeometry(visuals=(seen,), collisions=(given,), collides_as_seen=False)
    repairs = Repairs()
    config = ConvertConfig(decompose=False, finer=("p",))
    assert len(collision_shapes(geometry, "p", config, repairs)) == 1
    assert any("replaced" in sentence for sentence in repairs.messages)


def test_neighbours_in_one_plane_are_joined() -> None:
    halves = [box((0.2, 0.01, 0.3), (x, 0, 0)) for x in (-0.1, 0.1)]
    shapes = [s for h in halves if (s := fitted(h.vertices, Surface(h), 0.003, "p")) is not None]
    assert len(merged(shapes, Surface(trimesh.util.concatenate(halves)), 0.003)) == 1


def test_a_hull_of_flat_points_has_thickness() -> None:
    shape = hull(thick(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])), "p")
    assert shape is not None
    assert shape.volume == pytest.approx(0.005 * 0.002, rel=1e-6)


@pytest.mark.slow
def test_decompositions_are_kept_by_content(tmp_path: Path) -> None:
    mesh = trimesh.creation.torus(0.2, 0.05, major_sections=24, minor_sections=12)
    first = decompose(mesh, 0.02, 16, time_s=60.0, cache_dir=tmp_path)
    assert first is not None
    assert len(first) > 2
    again = decompose(mesh, 0.02, 16, time_s=1e-3, cache_dir=tmp_path)
    assert again is not None
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_a_decomposition_that_takes_too_long_is_given_up() -> None:
    mesh = trimesh.creation.torus(0.2, 0.05)
    assert decompose(mesh, 0.02, 16, time_s=1e-3) is None


@pytest.mark.slow
def test_the_time_of_a_decomposition_is_the_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock of a busy machine decides nothing."""
    monkeypatch.setattr("articulate.geometry.convex_decomposition.PATIENCE", 1e6)
    mesh = trimesh.creation.torus(0.2, 0.05, major_sections=96, minor_sections=64)
    assert decompose(mesh, 0.002, 16, time_s=1.0) is None


def test_handles_that_use_up_the_budget_leave_one_shape_to_the_rest():
    surface = trimesh.creation.box((0.2, 0.2, 0.2))
    shapes = [Shape(kind="box", T_ps=np.eye(4), half=(0.1, 0.1, 0.1)) for _ in range(3)]
    assert len(without_spare(shapes, surface, -3)) == 1


def test_what_many_small_shapes_stand_for_is_told_by_enough_points():
    cubes = [box((0.02, 0.02, 0.02), (0.1 * (i % 20), 0.1 * (i // 20), 0.0)) for i in range(400)]
    shapes = [Shape(kind="box", T_ps=pose(cube.centroid), half=(0.01,) * 3) for cube in cubes]
    surface = trimesh.util.concatenate(cubes)
    assert len(without_spare(shapes, surface, 48)) < 0.95 * 400  # each stands for a 400th
    assert len(without_spare(shapes, surface, 48, sure=True)) >= 0.955 * 400


def test_spare_shapes_go_before_those_that_stand_alone():
    plate, rim = box((1.0, 1.0, 0.02), (0, 0, 0)), box((0.05, 0.05, 0.2), (0.9, 0, 0))
    shapes = [
        Shape(kind="box", T_ps=pose((0.0, 0.0, 0.0)), half=(0.5, 0.5, 0.01)),
        *(Shape(kind="box", T_ps=pose((x, 0.0, 0.0)), half=(0.1, 0.5, 0.01)) for x in (0.1, 0.3)),
        Shape(kind="box", T_ps=pose((0.9, 0.0, 0.0)), half=(0.025, 0.025, 0.1)),
    ]
    kept = without_spare(shapes, trimesh.util.concatenate([plate, rim]), 2, sure=True)
    assert [shapes.index(shape) for shape in kept] in ([0], [0, 3])


def added_m3(one, other) -> float:
    """Volume that the common upright box of two boxes (2, 3) has more than both [m3]."""
    common = np.maximum(one[1], other[1]) - np.minimum(one[0], other[0])
    return float(np.prod(common) - np.prod(one[1] - one[0]) - np.prod(other[1] - other[0]))


def test_joining_takes_the_pair_that_adds_least_each_time():
    rng = np.random.default_rng(3)
    shapes = [
        Shape(kind="box", T_ps=pose(rng.uniform(0, 1, 3)), half=tuple(rng.uniform(0.01, 0.1, 3)))
        for _ in range(14)
    ]
    left = list(shapes)
    while len(left) > 5:
        pairs = [
            (added_m3(left[i].bounds, left[j].bounds), i, j)
            for j in range(len(left))
            for i in range(j)
        ]
        _, i, j = min(pairs)
        joint = hull(np.vstack([left[i].corners, left[j].corners]), "")
        assert joint is not None
        left = [*(s for k, s in enumerate(left) if k not in (i, j)), joint]
    found = within_budget(shapes, 5, "p", Repairs())
    assert len(found) == 5
    for one, other in zip(found, left, strict=True):
        np.testing.assert_allclose(one.bounds, other.bounds, atol=1e-12)
