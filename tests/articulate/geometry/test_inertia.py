from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceInertial, SourceLink
from articulate.geometry.inertia import from_shapes, inertial_of, is_physical
from articulate.geometry.presets import Weight
from articulate.geometry.shapes import Shape
from articulate.transforms import pose

SIDE = st.floats(0.002, 1.0)
SOLID = Weight(density_kg_m3=500.0, sheet_kg_m2=0.0)


def box_shape(half: tuple[float, float, float], at=(0.0, 0.0, 0.0)) -> Shape:
    return Shape(kind="box", T_ps=pose(np.array(at)), half=half)


@given(a=SIDE, b=SIDE, c=SIDE)
def test_a_box_has_the_inertia_of_the_textbook(a: float, b: float, c: float) -> None:
    found = from_shapes((box_shape((a / 2, b / 2, c / 2)),), SOLID)
    mass = 500.0 * a * b * c
    expected = mass / 12.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    assert found.mass_kg == pytest.approx(mass)
    np.testing.assert_allclose(np.diag(found.inertia_p), expected, rtol=1e-4, atol=1e-8)


def test_two_halves_weigh_as_the_whole() -> None:
    whole = from_shapes((box_shape((0.2, 0.1, 0.1)),), SOLID)
    halves = from_shapes(
        tuple(box_shape((0.1, 0.1, 0.1), (x, 0.0, 0.0)) for x in (-0.1, 0.1)), SOLID
    )
    assert halves.mass_kg == pytest.approx(whole.mass_kg)
    np.testing.assert_allclose(halves.com_p, whole.com_p, atol=1e-12)
    np.testing.assert_allclose(halves.inertia_p, whole.inertia_p, atol=1e-9)


@given(a=SIDE, b=SIDE, c=SIDE)
def test_what_is_thinner_than_its_sheet_weighs_as_the_sheet(a: float, b: float, c: float) -> None:
    stuff = Weight(density_kg_m3=500.0, sheet_kg_m2=10.0)  # as 20 mm of it
    thin, *area = sorted((a, b, c))
    found = from_shapes((box_shape((a / 2, b / 2, c / 2)),), stuff)
    assert found.mass_kg == pytest.approx(500.0 * max(thin, 0.02) * area[0] * area[1], rel=1e-4)
    assert is_physical(found.mass_kg, found.inertia_p)


@pytest.mark.parametrize(
    ("mass", "diagonal", "expected"),
    [
        (1.0, (0.1, 0.1, 0.1), True),
        (1.0, (0.1, 0.1, 0.2), True),
        (1.0, (0.1, 0.1, 0.21), False),
        (1.0, (0.0, 0.1, 0.1), False),
        (1.0, (-0.1, 0.1, 0.1), False),
        (0.0, (0.1, 0.1, 0.1), False),
        (np.nan, (0.1, 0.1, 0.1), False),
    ],
)
def test_what_no_body_has_is_not_physical(mass: float, diagonal, expected: bool) -> None:
    assert is_physical(mass, np.diag(diagonal)) is expected


def link(mass: float, diagonal, at=(0.0, 0.0, 0.0)) -> SourceLink:
    inertial = SourceInertial(mass=mass, T_li=pose(np.array(at)), inertia=np.diag(diagonal))
    return SourceLink(name="part", inertial=inertial)


def measured(source: SourceLink, *, rescaled: bool = False):
    repairs = Repairs()
    shapes = (box_shape((0.2, 0.1, 0.1)),)
    members = ((source, np.eye(4)),)
    found = inertial_of(members, shapes, SOLID, rescaled=rescaled, kind="hinge", repairs=repairs)
    return found, repairs


def test_physical_inertia_of_the_source_is_kept() -> None:
    found, repairs = measured(link(2.5, (0.02, 0.03, 0.04), (0.05, 0.0, 0.0)))
    assert found.mass_kg == 2.5
    np.testing.assert_allclose(found.com_p, [0.05, 0.0, 0.0])
    assert not repairs.messages


@pytest.mark.parametrize(
    "source", [link(1.0, (0.1, 0.1, 0.5)), link(0.0, (0, 0, 0)), link(1.0, (1, 1, 1), (3, 0, 0))]
)
def test_inertia_that_is_not_physical_is_computed_and_said(source: SourceLink) -> None:
    found, repairs = measured(source)
    assert found.mass_kg == pytest.approx(500.0 * 0.4 * 0.2 * 0.2)
    assert is_physical(found.mass_kg, found.inertia_p)
    assert "computed" in repairs.messages[0]


def test_masses_of_a_rescaled_source_mean_nothing() -> None:
    found, _ = measured(link(2.5, (0.02, 0.03, 0.04)), rescaled=True)
    assert found.mass_kg == pytest.approx(8.0)


def test_a_button_of_the_least_mass_has_the_inertia_that_fits_it() -> None:
    bare = SourceLink(name="button", inertial=None, visuals=(), collisions=())
    found = inertial_of(
        ((bare, np.eye(4)),),
        (box_shape((0.0033, 0.0033, 0.0015)),),
        SOLID,
        rescaled=True,
        kind="slide",
        repairs=Repairs(),
    )
    assert found.mass_kg == 0.2
    expected = 0.2 / 3.0 * np.array([0.0033**2 + 0.0015**2] * 2 + [2 * 0.0033**2])
    np.testing.assert_allclose(np.diag(found.inertia_p), expected, rtol=1e-3)
