"""Sizes and offsets of the messages: the table of libfranka-common's headers."""

import pytest

from articulate_deploy.wire.messages import (
    ERRORS,
    GRIPPER_HEADER,
    GRIPPER_STATE,
    PAYLOADS,
    PROTOCOLS,
    Request,
    Stream,
)

OFFSETS = {
    "message_id": (0, 0),
    "O_T_EE": (8, 8),
    "O_T_EE_d": (136, 72),
    "F_T_EE": (264, 136),
    "EE_T_K": (392, 200),
    "F_T_NE": (520, 264),
    "NE_T_EE": (648, 328),
    "m_ee": (776, 392),
    "I_ee": (784, 396),
    "F_x_Cee": (856, 432),
    "m_load": (880, 444),
    "I_load": (888, 448),
    "F_x_Cload": (960, 484),
    "elbow": (984, 496),
    "elbow_d": (1000, 504),
    "tau_J": (1016, 512),
    "tau_J_d": (1072, 540),
    "dtau_J": (1128, 568),
    "q": (1184, 596),
    "q_d": (1240, 624),
    "dq": (1296, 652),
    "dq_d": (1352, 680),
    "ddq_d": (1408, 708),
    "joint_contact": (1464, 736),
    "cartesian_contact": (1520, 764),
    "joint_collision": (1568, 788),
    "cartesian_collision": (1624, 816),
    "tau_ext_hat_filtered": (1672, 840),
    "O_F_ext_hat_K": (1728, 868),
    "K_F_ext_hat_K": (1776, 892),
    "O_dP_EE_d": (1824, 916),
    "O_ddP_O": (1872, 940),
    "elbow_c": (1896, 952),
    "delbow_c": (1912, 960),
    "ddelbow_c": (1928, 968),
    "O_T_EE_c": (1944, 976),
    "O_dP_EE_c": (2072, 1040),
    "O_ddP_EE_c": (2120, 1064),
    "theta": (2168, 1088),
    "dtheta": (2224, 1116),
    "motion_generator_mode": (2280, 1288),
    "controller_mode": (2281, 1289),
    "errors": (2282, 1290),
    "reflex_reason": (2323, 1331),
    "robot_mode": (2364, 1372),
    "control_command_success_rate": (2365, 1373),
}


def offset(kind, name):
    assert kind.fields is not None
    return kind.fields[name][1]


@pytest.mark.parametrize(("version", "column", "size"), [(5, 0, 2373), (10, 1, 1377)])
def test_the_fields_of_a_state_are_at_their_offsets(version, column, size):
    kind = PROTOCOLS[version].state_type
    assert kind.itemsize == size
    found = {name: offset(kind, name) for name in OFFSETS}
    assert found == {name: offsets[column] for name, offsets in OFFSETS.items()}
    extra = {"accelerometer_top": 1144, "accelerometer_bottom": 1216} if version == 10 else {}
    assert {n: offset(kind, n) for n in kind.names or () if n not in OFFSETS} == extra


@pytest.mark.parametrize(("version", "size"), [(5, 370), (10, 371)])
def test_the_fields_of_a_command_are_at_their_offsets(version, size):
    kind = PROTOCOLS[version].command_type
    assert kind.itemsize == size
    offsets = [offset(kind, name) for name in kind.names or ()]
    assert offsets[:9] == [0, 8, 64, 120, 248, 296, 312, 313, 314]
    assert offsets[9:] == ([370] if version == 10 else [])


def test_requests_have_their_sizes():
    assert 12 + PROTOCOLS[5].move_request.size == 68
    assert 12 + PROTOCOLS[10].move_request.size == 125
    assert 12 + PAYLOADS["SetCollisionBehavior"].size == 428
    assert GRIPPER_STATE.size == 23
    assert len(ERRORS) == 41


def test_commands_and_statuses_have_their_numbers():
    five, ten = PROTOCOLS[5], PROTOCOLS[10]
    assert (five.commands["AutomaticErrorRecovery"], five.commands["LoadModelLibrary"]) == (12, 13)
    assert (ten.commands["AutomaticErrorRecovery"], ten.commands["GetRobotModel"]) == (10, 11)
    assert (ten.commands["SetCollisionBehavior"], ten.commands["SetLoad"]) == (3, 9)
    assert [five.move[name] for name in ("reflex", "emergency", "aborted")] == [6, 7, 9]
    assert [ten.move[name] for name in ("not_possible", "reflex", "emergency")] == [5, 8, 9]
    assert (five.stop["emergency"], ten.stop["emergency"]) == (2, 3)
    assert (five.recovery["reflex"], ten.recovery["reflex"]) == (3, 4)


@pytest.mark.parametrize(("header", "size"), [("<III", 12), (GRIPPER_HEADER, 10)])
def test_a_stream_joins_and_splits_messages(header, size):
    stream = Stream(header)
    message = stream.reply(Request(3, 7, b""), b"abc")
    assert len(message) == size + 3
    assert stream.add(message[:5]) == []
    assert stream.add(message[5:] + message) == [Request(3, 7, b"abc")] * 2


@pytest.mark.parametrize("size", [8, 70_000])
def test_a_stream_rejects_an_impossible_size(size):
    with pytest.raises(ValueError, match="bytes"):
        Stream().add(b"\0" * 8 + size.to_bytes(4, "little"))
