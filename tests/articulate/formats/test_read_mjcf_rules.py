"""Constraints between the bodies of an MJCF file, and their masses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.articulate.conversion.mjcf import BALL, has_message, joint_of, model, read, write

from articulate.errors import AssetError
from articulate.formats.read_mjcf import read_mjcf
from articulate.formats.source_object import SourceObject
from articulate.simulator import mujoco

pytestmark = pytest.mark.usefixtures("quick")

TWO = (
    f'<body name="base">{BALL}<site name="spot"/><body name="plate">{BALL}</body>'
    f'<body name="a"><joint name="ja"/>{BALL}<site name="tip"/>'
    f'<body name="knob">{BALL}</body></body>'
    f'<body name="b"><joint name="jb"/>{BALL}</body></body>'
)
"""A base with a plate that is part of it, and two bodies that move, one with a knob."""


def tied(equality: str, body: str = TWO, head: str = "") -> str:
    text = model(body, head=head)
    return text.replace("</worldbody>", f"</worldbody><equality>{equality}</equality>")


@pytest.mark.parametrize(
    ("equality", "one", "two"),
    [
        ('<weld body1="a" body2="base"/>', "a", "base"),
        ('<weld body1="b"/>', "b", "world"),
        ('<weld body1="a" body2="b"/>', "a", "b"),
        ('<connect body1="b" body2="a" anchor="0 -.05 0"/>', "b", "a"),
        ('<connect site1="tip" site2="spot"/>', "a", "base"),
    ],
)
def test_moving_bodies_that_are_tied_are_rejected(
    tmp_path: Path, equality: str, one: str, two: str
) -> None:
    with pytest.raises(AssetError) as caught:
        read(tmp_path, tied(equality))
    assert f"thing.xml:1: a constraint ties body '{one}' to '{two}'" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "equality",
    [
        '<weld body1="plate" body2="base"/>',
        '<weld body1="base"/>',
        '<weld body1="knob" body2="a"/>',
        '<weld body1="a" body2="b" active="false"/>',
        '<weld class="off" body1="a" body2="b"/>',
        '<connect site1="spot" site2="spot"/>',
    ],
)
def test_ties_that_hold_nothing_that_moves_are_left_out_with_a_word(
    tmp_path: Path, equality: str
) -> None:
    head = '<default><default class="off"><equality active="false"/></default></default>'
    source = read(tmp_path, tied(equality, head=head))
    assert has_message(source, "note: 1 constraints between bodies left out")
    assert {joint.name for joint in source.joints if joint.kind != "fixed"} == {"ja", "jb"}


def test_a_body_that_is_fixed_at_its_pose_may_be_welded(tmp_path: Path) -> None:
    free = f'<body name="base"><freejoint/>{BALL}<body name="a"><joint/>{BALL}</body></body>'
    source = read(tmp_path, tied('<weld body1="base"/>', free))
    assert has_message(source, "1 constraints between bodies left out")


CHAIN = (
    '<joint joint1="c" joint2="b" polycoef="0.1 0.5 0 0 0"/>',
    '<joint joint1="b" joint2="a" polycoef="0.2 3 0 0 0"/>',
)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_chain_of_couplings_is_read_in_any_order(tmp_path: Path, order: tuple[int, int]) -> None:
    body = "".join(f'<body name="l{n}"><joint name="{n}"/>{BALL}</body>' for n in "abc")
    source = read(tmp_path, tied("".join(CHAIN[k] for k in order), body))
    assert joint_of(source, "b").mimic == pytest.approx(("a", 3.0, 0.2))
    assert joint_of(source, "c").mimic == pytest.approx(("b", 0.5, 0.1))
    assert not has_message(source, "coupling")


def test_couplings_that_go_round_are_cut_once(tmp_path: Path) -> None:
    body = "".join(f'<body name="l{n}"><joint name="{n}"/>{BALL}</body>' for n in "abc")
    source = read(tmp_path, tied("".join(CHAIN) + '<joint joint1="a" joint2="c"/>', body))
    assert joint_of(source, "a").mimic is None
    assert has_message(source, "coupling of joint a to c left out: c follows a")


HEAVY = (
    '<body name="base"><geom type="box" size=".2 .2 .01" mass="5"/>'
    '<body name="a"><joint name="ja"/><geom type="box" size=".01 .02 .03" mass="20"/></body>'
    f'<body name="b"><joint name="jb"/>{BALL}</body></body>'
)


def as_mujoco_has_it(source: SourceObject, path: Path) -> None:
    """Compare masses and principal inertias with those of MuJoCo's own reading."""
    raw = mujoco.MjModel.from_xml_path(str(path))
    for name, link in source.links.items():
        b = raw.body(name).id
        assert link.inertial is not None
        assert link.inertial.mass == pytest.approx(raw.body_mass[b])
        own = np.linalg.eigvalsh(link.inertial.inertia)
        np.testing.assert_allclose(own, np.sort(raw.body_inertia[b]), rtol=1e-6)


def test_the_total_mass_is_shared_as_by_the_compiler(tmp_path: Path) -> None:
    path = write(tmp_path, model(HEAVY, head='<compiler settotalmass="2"/>'))
    source = read_mjcf(path)
    as_mujoco_has_it(source, path)
    assert has_message(source, "kg, the settotalmass of the file")


def test_a_total_of_what_is_not_known_is_left_out_with_a_word(tmp_path: Path) -> None:
    head = '<compiler settotalmass="2"/><asset><mesh file="absent.stl"/></asset>'
    body = HEAVY + '<body name="m"><geom type="mesh" mesh="absent" density="5"/></body>'
    source = read(tmp_path, model(body, head=head))
    assert has_message(source, "settotalmass=2 left out: the mass of base, a, b is not known")


def test_masses_and_inertias_are_no_less_than_in_the_compiler(tmp_path: Path) -> None:
    body = HEAVY.replace(BALL, '<geom type="box" size=".01 .02 .03" mass="0.5"/>')
    path = write(tmp_path, model(body, head='<compiler boundmass="7" boundinertia="0.004"/>'))
    source = read_mjcf(path)
    as_mujoco_has_it(source, path)
    for name in ("base", "a", "b"):
        assert has_message(source, f"mass and inertia of body {name} raised")
