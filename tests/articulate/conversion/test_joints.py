from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from articulate.conversion.joints import are_degrees, travel_of
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
def test_closed_can_be_requested(wanted, closed: float) -> None:
    config = ConvertConfig(closed=wanted)
    found = travel_of(joint(lower=0.0, upper=1.5), NOTHING, config, Repairs())
    assert found.closed == closed
    assert "requested" in found.closed_rule


def test_a_continuous_joint_opens_a_quarter_turn_whatever_its_limits() -> None:
    found = travel_of(
        joint("continuous", lower=0.0, upper=0.1), NOTHING, ConvertConfig(), Repairs()
    )
    assert (found.lower, found.upper) == (None, None)
    assert (found.closed, found.open) == (0.0, math.pi / 2)


@pytest.mark.parametrize(("lower", "upper"), [(0.0, 1e16), (-1e3, 1e3), (0.4, 0.4), (None, None)])
def test_meaningless_limits_are_left_out_and_listed(lower, upper) -> None:
    repairs = Repairs()
    found = travel_of(joint(lower=lower, upper=upper), NOTHING, ConvertConfig(), repairs)
    assert (found.lower, found.upper) == (None, None)
    assert repairs.messages


def test_a_zero_axis_is_rejected_with_the_place() -> None:
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
    assert any("meaningless" in message for message in repairs.messages) is (upper is None)


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (0.0, 90.0, True),
        (-90.0, 0.0, True),
        (-120.0, 0.0, True),
        (0.0, 180.0, True),
        (-180.0, 180.0, True),
        (0.0, 114.5, True),
        (0.0, 10.0, True),
        (0.0, 3.0, False),
        (0.0, 6.2832, False),
        (0.0, 9.42478, False),
        (0.0, 7.3, False),
        (0.0, 31.4159, False),
        (-1000.0, 1000.0, False),
        (0.0, 1e16, False),
    ],
)
def test_limits_beyond_a_turn_are_degrees_unless_they_are_quarter_turns(
    lower: float, upper: float, expected: bool
) -> None:
    assert are_degrees(lower, upper) is expected


@pytest.mark.parametrize(
    ("lower", "upper"), [(0.0, 90.0), (-90.0, 0.0), (-120.0, 0.0), (0.0, 10.0)]
)
def test_limits_in_degrees_are_converted_keep_their_sign_and_are_listed(
    lower: float, upper: float
) -> None:
    repairs = Repairs()
    found = travel_of(joint(lower=lower, upper=upper), NOTHING, ConvertConfig(), repairs)
    assert (found.lower, found.upper) == (math.radians(lower), math.radians(upper))
    assert found.closed == 0.0
    assert found.open == math.radians(lower + upper)
    assert any("are degrees" in message for message in repairs.messages)


def test_the_sign_of_meaningless_limits_is_kept() -> None:
    found = travel_of(joint(lower=-1e16, upper=0.0), NOTHING, ConvertConfig(), Repairs())
    assert (found.lower, found.upper, found.closed) == (None, None, 0.0)
    assert found.open == -math.pi / 2


def test_a_range_of_a_few_degrees_is_questioned() -> None:
    repairs = Repairs()
    turn = math.radians(math.pi / 2)
    travel_of(joint(lower=0.0, upper=turn), NOTHING, ConvertConfig(), repairs)
    assert any("are its limits in radians" in message for message in repairs.messages)


@pytest.mark.parametrize(
    ("volume", "closed", "opened", "words"),
    [
        (lambda q: 1.0 + abs(q), 0.0, 1.57, "closed is 0"),
        (lambda q: 4.0 + q, -1.57, 1.57, "closed is the lower limit"),
        (lambda q: 4.0 - q, 1.57, -1.57, "closed is the upper limit"),
        (lambda q: 3.0 - abs(q), -1.57, 1.57, "a tie"),
        (lambda q: 1.0, 0.0, 1.57, "a tie"),
    ],
)
def test_where_zero_is_inside_the_range_closed_is_where_the_object_is_most_compact(
    volume, closed: float, opened: float, words: str
) -> None:
    repairs = Repairs()
    hinge = joint(lower=-1.57, upper=1.57)
    found = travel_of(hinge, NOTHING, ConvertConfig(), repairs, volume)
    assert (found.closed, found.open) == (closed, opened)
    assert words in found.closed_rule
    assert (found.lower, found.upper) == ((0.0, 1.57) if closed == 0.0 else (-1.57, 1.57))
    assert any("opens to both sides" in s for s in repairs.messages) is (closed == 0.0)


def test_a_small_lever_that_does_not_show_its_closed_position_is_closed_at_a_limit() -> None:
    lever = joint(lower=-0.2, upper=0.2)
    found = travel_of(lever, NOTHING, ConvertConfig(), Repairs(), lambda q: 1.0)
    assert (found.closed, found.open) == (-0.2, 0.2)
    assert "tie" in found.closed_rule


@pytest.mark.parametrize(
    ("lower", "upper", "ends"),
    [
        (-1.57, 1.57, (0.0, 1.57)),
        (-1.5, 0.5, (0.0, -1.5)),
        (0.0, 1.5, (0.0, 1.5)),
        (0.4, 1.5, (0.4, 1.5)),
    ],
)
def test_closed_at_zero_can_be_requested(lower: float, upper: float, ends) -> None:
    config = ConvertConfig(closed="zero")
    found = travel_of(joint(lower=lower, upper=upper), NOTHING, config, Repairs())
    assert (found.closed, found.open) == ends
