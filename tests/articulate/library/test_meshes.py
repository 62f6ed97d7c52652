"""Mass, inertia and files of solids."""

import io

import numpy as np
import pytest
import trimesh

from articulate.library.procedural.meshes import mass_properties, number, obj_text, smooth_normals
from articulate.library.procedural.solids import Box, Ring, Rod, cone, prism, tube, volume
from articulate.simulator import mujoco
from articulate.transforms import rpy_to_matrix


def _box(low, high, name="box", density=1000.0):
    return Box(name=name, low=low, high=high, density_kg_m3=density)


def test_inertia_of_one_box_is_the_closed_form():
    what = mass_properties([_box((1.0, 2.0, 3.0), (1.2, 2.3, 3.4))])
    mass, (a, b, c) = 1000.0 * 0.2 * 0.3 * 0.4, (0.2, 0.3, 0.4)
    expected = mass / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    np.testing.assert_allclose(what.mass_kg, mass, rtol=1e-12)
    np.testing.assert_allclose(what.com_l, [1.1, 2.15, 3.2], rtol=1e-12)
    np.testing.assert_allclose(what.inertia_l, expected, rtol=1e-9, atol=1e-12)


def test_a_box_cut_in_two_keeps_its_inertia():
    single = mass_properties([_box((-0.1, -0.2, 0.0), (0.3, 0.4, 0.5))])
    parts = mass_properties(
        [_box((-0.1, -0.2, 0.0), (0.05, 0.4, 0.5)), _box((0.05, -0.2, 0.0), (0.3, 0.4, 0.5))]
    )
    np.testing.assert_allclose(parts.com_l, single.com_l, atol=1e-12)
    np.testing.assert_allclose(parts.inertia_l, single.inertia_l, rtol=1e-9, atol=1e-12)


def test_two_boxes_across_the_diagonal_have_the_integral_of_their_mesh():
    boxes = [_box((0.0, 0.0, 0.0), (0.1, 0.2, 0.3), "a"), _box((1.0, 2.0, -1.0), (2, 2.1, 0), "b")]
    mesh = trimesh.load(io.StringIO(obj_text(boxes)), file_type="obj", force="mesh")
    mesh.density = 1000.0
    what = mass_properties(boxes)
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.mass, what.mass_kg, rtol=1e-9)
    np.testing.assert_allclose(mesh.center_mass, what.com_l, rtol=1e-9)
    np.testing.assert_allclose(mesh.moment_inertia, what.inertia_l, rtol=1e-9)


def test_a_rod_has_the_inertia_of_its_prism_which_nears_the_cylinder():
    rod = Rod(
        name="rod", start=(0.1, 0.2, 0.3), end=(0.1, 0.2, 0.8), radius_m=0.05, density_kg_m3=1e3
    )
    what = mass_properties([rod])
    mass = 1e3 * np.pi * 0.05**2 * 0.5
    across = mass / 12.0 * (3.0 * 0.05**2 + 0.5**2)
    expected = np.diag([across, across, mass / 2.0 * 0.05**2])
    np.testing.assert_allclose(what.mass_kg, mass, rtol=0.007)  # 32 corners lack 0.64 %
    np.testing.assert_allclose(what.com_l, [0.1, 0.2, 0.55], atol=1e-12)
    np.testing.assert_allclose(what.inertia_l, expected, rtol=0.014, atol=1e-12)


def test_a_cone_has_the_volume_of_the_frustum():
    corners, triangles = cone(1, (0.0, 0.0, 0.0), (0.1, 0.2), (0.4, 0.1)).mesh()
    polygon = 32 * 0.5 * np.sin(2 * np.pi / 32)
    expected = polygon * 0.3 / 3.0 * (0.2**2 + 0.2 * 0.1 + 0.1**2)
    np.testing.assert_allclose(volume(corners, triangles), expected, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_ring_holds_what_lies_between_its_walls_and_its_wedges_hold_as_much(axis):
    ring = tube(axis, (0.3, 0.2, 0.1), (0.0, 0.2), 0.08, 0.1)
    corners, triangles = ring.mesh()
    count = 2 * ring.wedges
    area = 0.5 * count * np.sin(2 * np.pi / count) * (0.1**2 - 0.08**2)
    np.testing.assert_allclose(volume(corners, triangles), 0.2 * area, rtol=1e-9)
    hulls = [volume(*piece.mesh) for piece in ring.colliders()]  # type: ignore[misc]
    np.testing.assert_allclose(sum(hulls), 0.2 * np.pi * (0.1**2 - 0.08**2), rtol=0.03)
    assert min(hulls) > 0.0


def test_a_hole_stays_free_of_the_wedges_of_a_ring():
    ring = Ring(low=(0.0, 0.06, 0.08), high=(0.1, 0.08, 0.1), stretch=(1.2, 1.0))
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    inside = np.stack([0.058 * 1.2 * np.cos(turn), 0.058 * np.sin(turn), 0 * turn + 0.05], axis=-1)
    for piece in ring.colliders():
        hull = trimesh.Trimesh(*piece.mesh)  # type: ignore[misc]
        assert hull.is_watertight
        assert hull.is_convex
        assert not hull.contains(inside).any()


def test_every_collider_holds_the_corners_of_what_it_stands_for():
    for solid in (
        prism(2, [(0.0, 0.0), (0.2, 0.0), (0.0, 0.1)], (0.1, 0.3)),
        prism(0, [(0.0, 0.0), (0.0, 0.1), (0.2, 0.0)], (0.1, 0.3)),
        Box(low=(0.0, 0.1, 0.2), high=(0.3, 0.3, 0.3)),
    ):
        corners, triangles = solid.mesh()
        assert volume(corners, triangles) > 0.0
        (piece,) = solid.colliders()
        if piece.kind == "box":
            np.testing.assert_allclose(np.ptp(corners, axis=0), piece.size)
        else:
            np.testing.assert_array_equal(piece.mesh[0], corners)  # type: ignore[index]


def test_a_collider_of_a_rod_lies_along_it():
    rod = Rod(start=(0.1, 0.2, 0.3), end=(0.4, -0.2, 0.5), radius_m=0.02)
    (piece,) = rod.colliders()
    along = rpy_to_matrix(np.array(piece.rpy)) @ [0.0, 0.0, piece.size[1]]
    np.testing.assert_allclose(along, np.subtract(rod.end, rod.start), atol=1e-12)
    np.testing.assert_allclose(piece.centre, [0.25, 0.0, 0.4], atol=1e-12)


def test_normals_are_round_where_the_solid_is_and_flat_at_its_ends():
    corners, triangles = Rod(start=(0, 0, 0), end=(0, 0, 1), radius_m=0.1).mesh()
    normals = smooth_normals(corners, triangles)
    side = np.abs(normals[..., 2]) < 0.5
    radial = corners[triangles] * [1.0, 1.0, 0.0] / 0.1
    np.testing.assert_allclose(normals[side], radial[side], atol=0.04)  # flat ones: 0.1
    np.testing.assert_allclose(np.abs(normals[~side][:, 2]), 1.0)


def test_a_picture_keeps_its_size_on_every_side_and_runs_along_the_solid():
    text = obj_text([_box((0.0, 0.0, 0.0), (0.2, 0.3, 1.2))], "oak", tile_m=0.5)
    mesh = trimesh.load(io.StringIO(text), file_type="obj", force="mesh", process=False)
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    length = np.linalg.norm(np.diff(mesh.vertices[edges], axis=1)[:, 0], axis=-1)
    on_picture = np.linalg.norm(np.diff(mesh.visual.uv[edges], axis=1)[:, 0], axis=-1)
    np.testing.assert_allclose(on_picture, length / 0.5, rtol=1e-6)
    assert np.ptp(mesh.visual.uv[:, 0]) == pytest.approx(2.4)


def test_numbers_carry_no_noise_and_no_negative_zero():
    assert number(0.1 + 0.2) == "0.3"
    assert number(-1e-17) == "0"
    assert number(-0.0) == "0"
    assert number(-1.5) == "-1.5"


def test_mujoco_draws_every_box_of_the_file():
    """It reads the first object of an OBJ only, so all boxes must be one object."""
    boxes = [_box((0, 0, 0), (1, 1, 1), "a"), _box((2, 0, 0), (3, 1, 1), "b")]
    xml = """<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody><geom type="mesh"
        mesh="m"/></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml, {"m.obj": obj_text(boxes).encode()})
    assert model.mesh_facenum[0] == 24
