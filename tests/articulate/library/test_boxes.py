"""Mass, inertia and triangles of boxes."""

import io

import mujoco
import numpy as np
import trimesh

from articulate.library.procedural.boxes import Box, mass_properties, number, obj_text


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
    whole = mass_properties([_box((-0.1, -0.2, 0.0), (0.3, 0.4, 0.5))])
    parts = mass_properties(
        [_box((-0.1, -0.2, 0.0), (0.05, 0.4, 0.5)), _box((0.05, -0.2, 0.0), (0.3, 0.4, 0.5))]
    )
    np.testing.assert_allclose(parts.com_l, whole.com_l, atol=1e-12)
    np.testing.assert_allclose(parts.inertia_l, whole.inertia_l, rtol=1e-9, atol=1e-12)


def test_two_boxes_across_the_diagonal_have_the_integral_of_their_mesh():
    boxes = [_box((0.0, 0.0, 0.0), (0.1, 0.2, 0.3), "a"), _box((1.0, 2.0, -1.0), (2, 2.1, 0), "b")]
    mesh = trimesh.load(io.StringIO(obj_text(boxes)), file_type="obj", force="mesh")
    mesh.density = 1000.0
    what = mass_properties(boxes)
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.mass, what.mass_kg, rtol=1e-9)
    np.testing.assert_allclose(mesh.center_mass, what.com_l, rtol=1e-9)
    np.testing.assert_allclose(mesh.moment_inertia, what.inertia_l, rtol=1e-9)


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
