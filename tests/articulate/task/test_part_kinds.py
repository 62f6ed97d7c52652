import dataclasses

import numpy as np
import pytest
from tests.assets import make_cupboard

from articulate.assets.asset import Joint
from articulate.task.part_kinds import part_kind

FLAT, UPRIGHT = (0.4, 0.5, 0.02), (0.02, 0.5, 0.4)
"""Sizes of a panel that lies and of one that stands [m]."""


@pytest.fixture(scope="module")
def asset(tmp_path_factory):
    return make_cupboard(tmp_path_factory.mktemp("cupboard"))


def kind_of(asset, *, kind, axis, size=FLAT, link="link_1", closed=0.0, category="Table"):
    joint = Joint(
        name="j",
        kind=kind,
        link=link,
        parent="carcass",
        axis_o=axis,
        pivot_o=(0.0, 0.0, 0.0),
        lower=closed,
        upper=closed + 1.0,
        closed=closed,
        open=closed + 1.0,
        closed_rule="given",
    )
    corner = tuple(0.5 * v for v in size)
    bounds = (tuple(-v for v in corner), corner)
    part = dataclasses.replace(asset.links[1], name=link, bounds_l=bounds)
    made = dataclasses.replace(
        asset,
        links=(asset.links[0], part),
        joints=(joint,),
        handles=(),
        category=category,
        bounds_o=((0.0, 0.0, 0.0), (0.5, 0.5, 0.6)),
    )
    return part_kind(made, joint)


@pytest.mark.parametrize(
    ("kind", "axis", "size", "part"),
    [
        ("slide", (-1.0, 0.0, 0.0), FLAT, "drawer"),
        ("slide", (0.0, 1.0, 0.0), UPRIGHT, "drawer"),
        ("slide", (0.0, 0.0, 1.0), FLAT, "lid"),
        ("hinge", (0.0, 0.0, -1.0), UPRIGHT, "door"),
        ("hinge", (0.6, 0.0, 0.8), FLAT, "door"),
        ("hinge", (0.0, 1.0, 0.0), FLAT, "lid"),
        ("hinge", (0.0, -1.0, 0.0), UPRIGHT, "door"),
        ("hinge", (0.8, 0.0, 0.6), FLAT, "lid"),
    ],
)
def test_without_a_name_axis_and_posture_decide(kind, axis, size, part, asset):
    assert kind_of(asset, kind=kind, axis=axis, size=size) == part


def test_posture_is_that_of_the_closed_part(asset):
    """Drawn upright, but its joint is closed a quarter turn from there."""
    level = (0.0, 1.0, 0.0)
    assert kind_of(asset, kind="hinge", axis=level, size=UPRIGHT, closed=np.pi / 2) == "lid"
    assert kind_of(asset, kind="hinge", axis=level, size=FLAT, closed=np.pi / 2) == "door"


@pytest.mark.parametrize(
    ("link", "kind", "axis", "part"),
    [
        ("lid_0", "hinge", (0.0, 0.0, 1.0), "lid"),
        ("oven_door", "hinge", (0.0, 1.0, 0.0), "door"),
        ("SlidingDoor2", "slide", (0.0, 1.0, 0.0), "door"),
        ("door_handle", "hinge", (0.0, 0.0, 1.0), "joint"),
        ("lid_of_drawer", "slide", (1.0, 0.0, 0.0), "drawer"),
        ("drawer_flap", "hinge", (0.0, 1.0, 0.0), "lid"),
        ("drawer_1", "hinge", (0.0, 0.0, 1.0), "door"),
        ("indoors", "slide", (1.0, 0.0, 0.0), "drawer"),
        ("lever", "hinge", (0.0, 1.0, 0.0), "joint"),
    ],
)
def test_last_word_of_the_links_name_that_tells_decides(link, kind, axis, part, asset):
    assert kind_of(asset, kind=kind, axis=axis, link=link) == part


@pytest.mark.parametrize("category", ["Eyeglasses", "Knife", "Switch", "Scissors"])
def test_parts_of_categories_without_doors_and_drawers_are_joints(category, asset):
    for kind, axis in (("hinge", (0.0, 0.0, 1.0)), ("slide", (1.0, 0.0, 0.0))):
        assert kind_of(asset, kind=kind, axis=axis, category=category) == "joint"
    assert (
        kind_of(asset, kind="hinge", axis=(0.0, 0.0, 1.0), link="door", category="Switch") == "door"
    )


def test_knobs_and_buttons_of_an_oven_are_joints(asset):
    for kind, axis in (("hinge", (0.0, 1.0, 0.0)), ("slide", (1.0, 0.0, 0.0))):
        for size, part in (((0.02, 0.03, 0.03), "joint"), ((0.03, 0.5, 0.4), None)):
            found = kind_of(asset, kind=kind, axis=axis, size=size, category="Oven")
            assert found == (part or {"hinge": "door", "slide": "drawer"}[kind])


def test_the_upright_lid_of_a_laptop_is_a_lid(asset):
    level = (0.0, 1.0, 0.0)
    assert kind_of(asset, kind="hinge", axis=level, size=UPRIGHT, category="Laptop") == "lid"
    assert kind_of(asset, kind="hinge", axis=(0.0, 0.0, 1.0), category="Bottle") == "joint"


def test_motion_decides_in_an_object_of_unknown_category(asset):
    assert kind_of(asset, kind="hinge", axis=(0.0, 0.0, 1.0), category="unknown") == "door"
    assert kind_of(asset, kind="slide", axis=(1.0, 0.0, 0.0), category="unknown") == "drawer"
    tiny = kind_of(asset, kind="slide", axis=(1.0, 0.0, 0.0), size=(0.02,) * 3, category="unknown")
    assert tiny == "joint"
