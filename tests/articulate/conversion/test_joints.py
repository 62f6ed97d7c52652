from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from articulate.conversion.joints import travel_of
from articulate.errors import AssetError, ConfigError
from articulate.formats.config import ConvertConfig
from articulate.formats.load_meshes import PartGeometry, Piece
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint

NOTHING = PartGeometry(visuals=(), collisions=(), collides_as_seen=True)


def joint(kind: str = "revolute", **options) -> SourceJoint:
    return SourceJoint(
        name="j", kind=kind, parent="a", child="b", T_pc=np.eye(4), where="x.urdf:1", **options
    )


@pytest.mark.parametrize(
    ("lower", "upper", "closed", "opened"),
    [
        (0.0, 1.5, 0.0, 1.5),
        (-1.5, 0.0, 0.0, -1.5),
        (0.02, 1.5, 0.02, 1.5),
        (-0.3, 1.2, -0.3, 1.2),
        (-1.2, 0.3, 0.3, -1.2),
        (0.5, 2.0, 0.5, 2.0),
        (-1.0, 1.0, -1.0, 1.0),
    ],
)
def test_closed_is_the_limit_nearer_to_zero(
    lower: float, upper: float, closed: float, opened: float
) -> None:
    found = travel_of(joint(lower=lower, upper=upper), NOTHING, ConvertConfig(), Repairs())
    assert (found.closed, found.open) == (closed, opened)
    assert found.closed_rule


@pytest.mark.parametrize(("wanted", "closed"), [("lower", 0.0), ("upper", 1.5)])
def test_closed_can_be_asked_for(wanted, closed: float) -> None:
    config = ConvertConfig(closed=wanted)
    found = travel_of(joint(lower=0.0, upper=1.5), NOTHING, config, Repairs())
    assert found.closed == closed
    assert "asked for" in found.closed_rule


def test_a_continuous_joint_opens_a_quarter_turn_whatever_its_limits() -> None:
    found = travel_of(
        joint("continuous", lower=0.0, upper=0.1), NOTHING, ConvertConfig(), Repairs()
    )
    assert (found.lower, found.upper) == (None, None)
    assert (found.closed, found.open) == (0.0, math.pi / 2)


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 1e16), (-1e3, 1e3), (0.4, 0.4), (None, None)])
def test_limits_that_say_nothing_are_left_out_and_said(lower, upper) -> None:
    repairs = Repairs()
    found = travel_of(joint(lower=lower, upper=upper), NOTHING, ConvertConfig(), repairs)
    assert (found.lower, found.upper) == (None, None)
    assert repairs.sentences


def test_a_zero_axis_is_refused_with_the_place() -> None:
    with pytest.raises(AssetError, match=r"x\.urdf:1: joint 'j' has a zero axis"):
        travel_of(joint(axis=(0.0, 0.0, 0.0)), NOTHING, ConvertConfig(), Repairs())


@pytest.mark.parametrize(
    "options", [{"size_m": 0.0}, {"size_m": 50.0}, {"max_geoms": 0}, {"decompose_s": 0.0}]
)
def test_configurations_are_checked(options) -> None:
    with pytest.raises(ConfigError):
        ConvertConfig(**options)


@pytest.mark.parametrize(("side", "upper"), [(300.0, 250.0), (0.3, None)])
def test_a_slide_of_a_file_in_millimetres_keeps_its_limits(
    side: float, upper: float | None
) -> None:
    box = Piece(name="box", mesh=trimesh.creation.box((side, side, side)))
    part = PartGeometry(visuals=(box,), collisions=(), collides_as_seen=True)
    repairs = Repairs()
    found = travel_of(joint("prismatic", lower=0.0, upper=250.0), part, ConvertConfig(), repairs)
    assert found.upper == pytest.approx(0.8 * side if upper is None else upper)
    assert any("say nothing" in sentence for sentence in repairs.sentences) is (upper is None)
