import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.reward_terms import (
    AWAY,
    CONFIG,
    FAR_M,
    HOME,
    SHUT,
    TASK,
    UNCAPPED,
    configured,
    state,
    terms,
)

from articulate.assets.asset import Handle
from articulate.errors import ConfigError
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import tool_pose
from articulate.task.grasp import MAX_ALONG_M, grasp_of
from articulate.task.object_placement import ObjectPlacement
from articulate.transforms import pose
from articulate_envs.compiled.post_step import (
    handle_offset,
)
from articulate_envs.config import InitialStatesConfig
from articulate_envs.rewards import (
    TERMS,
    Force,
    RewardConfig,
    RewardState,
    Success,
    force,
    success,
)


def test_a_term_is_a_function_of_its_parameters_and_a_state():
    params = Force(weight=-0.1, final_weight=-0.5, free_n=15.0)
    assert force(params, RewardState(force=14.0)) == 0.0
    assert force(params, RewardState(force=20.0)) == pytest.approx(-0.5)
    assert force(params, RewardState(force=20.0, progress=1.0)) == pytest.approx(-2.5)


def test_each_term_has_its_field_in_the_configuration():
    names = [f.name for f in dataclasses.fields(RewardConfig)]
    assert names == [*TERMS, "travel", "until"]


def test_far_away_with_the_hand_told_to_stay_open_nothing_is_gained_or_lost():
    assert_allclose(list(terms(AWAY, action=-SHUT).values()), 0.0, atol=1e-3)


def handle(along_m):
    """A bar of a length."""
    return Handle(
        name="h",
        link="l",
        joint="j",
        pos_l=(0.0, 0.0, 0.0),
        normal_l=(-1.0, 0.0, 0.0),
        along_l=(0.0, 1.0, 0.0),
        extent=(along_m, 0.01, 0.01),
        kind="bar",
        source="given",
    )


def test_distance_to_a_long_handle_is_that_to_its_nearest_point():
    """Along the bar the first 4 cm are free; across it nothing is."""
    T_wh = tool_pose(PANDA, HOME)
    for offset, expected in (
        ([0.04, 0.0, 0.0], 0.0),
        ([-0.04, 0.0, 0.0], 0.0),
        ([0.05, 0.0, 0.0], 0.01),
        ([0.0, 0.03, 0.0], 0.03),
        ([-0.07, 0.0, 0.04], 0.05),
    ):
        T_wt = T_wh @ pose(np.array(offset))
        distance = np.linalg.norm(handle_offset(T_wt[0], T_wh[0], 0.04, 0.0))
        assert_allclose(distance, expected, atol=1e-12)


@pytest.mark.parametrize("beside_m", [0.012, -0.012])
def test_all_places_between_the_frame_and_the_handle_beside_it_are_its_middle(beside_m):
    """A gripper that approaches beside a handle is moved onto it when it closes."""
    T_wh = tool_pose(PANDA, HOME)
    for share, expected in ((0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.5, 0.5), (-0.5, -0.5)):
        T_wt = T_wh @ pose(np.array([0.0, share * beside_m, 0.0]))
        y = handle_offset(T_wt[0], T_wh[0], 0.0, beside_m)[1]
        assert_allclose(y, expected * beside_m, atol=1e-12)


def test_a_flipped_gripper_has_the_handle_on_its_other_side():
    placement = ObjectPlacement(
        pos_w=(0.0, 0.0, 0.0), yaw_rad=0.0, flip=False, start_q=(0.0,) * 7,
        joint_margin_rad=1.0, manipulability=1.0, reachable_share=1.0, beside_m=0.01,
    )  # fmt: skip
    flipped = dataclasses.replace(placement, flip=True)
    assert grasp_of(handle(0.1), placement).beside_m == -0.01
    assert grasp_of(handle(0.1), flipped).beside_m == 0.01


def test_fingers_must_fit_on_the_part_of_a_handle_that_counts_as_its_middle():
    assert grasp_of(None).along_m == grasp_of(handle(0.02)).along_m == 0.0
    assert grasp_of(handle(0.1)).along_m == pytest.approx(0.9 * (0.05 - 0.011))
    assert grasp_of(handle(0.6)).along_m == MAX_ALONG_M
    assert grasp_of(handle(0.6)).thick_m == 0.01


def test_a_knob_is_held_at_its_middle():
    """Beside it the sides of a ball lean outward and push fingers off."""
    knob = dataclasses.replace(handle(0.1), kind="knob")
    assert grasp_of(knob).along_m == 0.0
    assert grasp_of(knob).thick_m == grasp_of(handle(0.1)).thick_m


def test_approach_pays_for_coming_nearer_and_takes_it_back():
    near, far = state(offset=[0, 0, 0.1]), state(offset=[0, 0, 0.13])
    gained = terms(near, before=far)["approach"]
    assert gained == pytest.approx(0.03 * CONFIG.approach.weight)
    assert terms(far, before=near)["approach"] == pytest.approx(-gained)


def test_approach_counts_the_way_across_the_fingers_and_the_turn_by_their_weights():
    beside, turned = state(offset=[0, 0.02, 0]), state(turn=0.3)
    across = terms(state(), before=beside)["approach"]
    assert across == pytest.approx(0.02 * CONFIG.approach.across * CONFIG.approach.weight)
    back = terms(state(), before=turned)["approach"]
    assert back == pytest.approx(0.3 * CONFIG.approach.turn_m * CONFIG.approach.weight)


@pytest.mark.parametrize(
    ("across", "ahead", "thick", "out"),
    [
        (0.0, 0.0, 0.01, 0.0),
        (0.030, 0.0, 0.02, 0.030 - 0.45 * 0.03),  # half of 80 mm less 20 mm is beside the handle
        (-0.030, 0.0, 0.02, 0.030 - 0.45 * 0.03),
        (0.030, 0.035, 0.02, 0.030 - 0.45 * 0.03),
        (0.030, 0.045, 0.02, 0.030 - 0.45 * 0.03 - 0.01),  # it widens as the distance grows
        (0.030, 0.2, 0.02, 0.0),
        (0.010, 0.0, 0.2, 0.010),  # thicker than the hand opens: straight ahead alone
        (0.0, -0.01, 0.01, 0.0),
        (0.0, -0.03, 0.01, 0.02),  # the hand is beyond the handle
    ],
)
def test_leaving_the_way_between_the_fingers_costs_by_the_metre(across, ahead, thick, out):
    config = configured(
        UNCAPPED
        | {
            "lateral_offset.weight": -50.0,
            "lateral_offset.free_from_m": 0.035,
            "lateral_offset.overreach_m": 0.01,
        }
    )
    for along in (0.0, 0.03):
        after = state(offset=[along, across, ahead])
        cost = terms(after, config=config, along_m=0.03, thick_m=thick, progress=1.0)[
            "lateral_offset"
        ]
        assert cost == pytest.approx(-50.0 * out, abs=1e-9)


@pytest.mark.parametrize(
    ("width", "across", "ahead", "free"),
    [
        (0.03, 0.01, 0.0, True),  # what is held lies beside the middle of the hand
        (0.03, 0.01, 0.02, False),  # it lies before the pads
        (0.03, 0.025, 0.0, False),  # it lies beside a finger
        (0.0, 0.01, 0.0, False),  # closed on nothing
    ],
)
def test_what_is_between_closed_fingers_costs_nothing(width, across, ahead, free):
    after = dataclasses.replace(state(offset=[0.0, across, ahead]), gripper_width=np.full(1, width))
    assert (terms(after, thick_m=0.03, progress=1.0)["lateral_offset"] == 0.0) == free


@pytest.mark.parametrize(
    ("width", "thick", "free"),
    [
        (0.08, 0.03, False),  # open
        (0.039, 0.03, False),  # one finger may touch it
        (0.03, 0.03, True),
        (0.0, 0.03, False),  # closed on nothing
        (0.005, 0.0, False),  # there is no handle to hold
    ],
)
def test_a_hand_that_holds_a_handle_may_be_beyond_it(width, thick, free):
    config = configured(
        UNCAPPED | {"lateral_offset.weight": -50.0, "lateral_offset.overreach_m": 0.01}
    )
    after = dataclasses.replace(state(offset=[0.0, 0.0, -0.03]), gripper_width=np.full(1, width))
    cost = terms(after, config=config, thick_m=thick, progress=1.0)["lateral_offset"]
    assert cost == pytest.approx(0.0 if free else -50.0 * 0.02, abs=1e-9)


@pytest.mark.parametrize(("share", "part"), [(0.25, 0.0), (0.5, 0.0), (0.75, 0.5), (1.0, 1.0)])
def test_what_one_finger_touches_costs_from_half_way_on(share, part):
    """Fingers 20 mm wider than the handle leave it 4.5 mm to either side."""
    config = configured(UNCAPPED | {"lateral_offset.weight": -50.0})
    after = dataclasses.replace(state(offset=[0.0, 0.012, 0.0]), gripper_width=np.full(1, 0.05))
    cost = terms(after, config=config, thick_m=0.03, progress=share * config.until)[
        "lateral_offset"
    ]
    assert cost == pytest.approx(-50.0 * share * part * (0.012 - 0.45 * 0.01), abs=1e-9)
    held = dataclasses.replace(after, gripper_width=np.full(1, 0.037))
    assert terms(held, config=config, thick_m=0.03, progress=share)["lateral_offset"] == 0.0


def test_a_handle_that_lies_far_beside_costs_no_more_than_one_that_does_so_a_little():
    config = configured({"lateral_offset.weight": -50.0, "lateral_offset.max_m": 0.02})
    costs = [
        terms(state(offset=[0.0, y, 0.0]), config=config, thick_m=0.02, progress=1.0)[
            "lateral_offset"
        ]
        for y in (0.03, 0.06, 0.3)
    ]
    assert costs[0] > costs[1]
    assert costs[1:] == pytest.approx([-1.0, -1.0])


def test_the_way_is_the_narrower_the_less_the_hand_is_open():
    config = configured(
        UNCAPPED | {"lateral_offset.weight": -50.0, "lateral_offset.free_from_m": 0.035}
    )
    after = state(offset=[0.0, 0.03, 0.0])
    for width, room in ((0.08, 0.03), (0.05, 0.015), (0.02, 0.0), (0.0, 0.0)):
        half = dataclasses.replace(after, gripper_width=np.full(1, width))
        cost = terms(half, config=config, thick_m=0.02, progress=1.0)["lateral_offset"]
        assert cost == pytest.approx(-50.0 * (0.03 - 0.45 * room))
    early = terms(after, config=config, thick_m=0.02, progress=0.25 * CONFIG.until)[
        "lateral_offset"
    ]
    assert early == pytest.approx(-50.0 * 0.25 * (0.03 - 0.45 * 0.03))


def test_grip_beside_the_middle_of_a_long_handle_is_a_grip():
    beside = state(offset=[0.03, 0, 0], smooth=1.0, closing=1.0)
    assert terms(beside, action=SHUT)["premature_close"] < 0.4 * CONFIG.premature_close.weight
    assert terms(beside, action=SHUT, along_m=0.03)["premature_close"] == pytest.approx(
        0.0, abs=1e-9
    )
    assert terms(beside, action=SHUT, along_m=0.03)["grip"] == pytest.approx(CONFIG.grip.weight)


def test_tool_at_the_handle_earns_the_whole_of_reach():
    assert terms(state())["reach"] == pytest.approx(CONFIG.reach.weight)


@pytest.mark.parametrize("scales", [(0.1, 0.1), (0.2, 0.02), CONFIG.reach.scales_m])
def test_reach_is_the_mean_over_its_scales_each_half_at_its_own_distance(scales):
    config = configured(UNCAPPED | {"reach.scales_m": scales})
    for distance in scales:
        away = terms(state(offset=[0, distance, 0]), config=config)["reach"]
        shares = [1 / (1 + (distance / scale) ** 2) for scale in scales]
        assert 0.5 in shares
        assert away == pytest.approx(CONFIG.reach.weight * np.mean(shares))


def test_reach_grows_all_the_way_to_the_handle():
    way = [terms(state(offset=[0, d, 0]))["reach"] for d in (0.5, 0.2, 0.05, 0.01, 0.003, 0.0)]
    assert np.all(np.diff(way) > 0)


@pytest.mark.parametrize(
    ("turn", "share"), [(0.0, 1.0), (CONFIG.align.scale_rad, np.exp(-1.0)), (np.pi, 0.0)]
)
def test_hand_turned_like_the_handle_earns_and_turned_away_does_not(turn, share):
    assert terms(state(turn=turn))["align"] == pytest.approx(share * CONFIG.align.weight, abs=1e-9)


def test_closing_at_the_handle_earns_and_away_from_it_costs():
    at = terms(state(smooth=1.0, closing=1.0), action=SHUT)
    away = terms(state(offset=[0, 0, FAR_M], smooth=1.0, closing=1.0), action=SHUT)
    assert at["grip"] == pytest.approx(CONFIG.grip.weight)
    assert at["premature_close"] == pytest.approx(0.0, abs=1e-9)
    assert away["grip"] == pytest.approx(0.0, abs=1e-9)
    assert away["premature_close"] == pytest.approx(CONFIG.premature_close.weight)


@pytest.mark.parametrize(("progress", "share"), [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (2.0, 1.0)])
def test_closing_away_from_the_handle_grows_dearer_with_the_training(progress, share):
    config = configured(
        UNCAPPED | {"premature_close.weight": -0.2, "premature_close.final_weight": -1.0}
    )
    away = state(offset=[0, 0, FAR_M], smooth=1.0, closing=1.0)
    cost = terms(away, action=SHUT, config=config, progress=progress * config.until)[
        "premature_close"
    ]
    assert cost == pytest.approx(-0.2 - 0.8 * share)


@pytest.mark.parametrize("progress", [0.0, 1.0])
def test_what_counts_as_away_narrows_with_what_counts_as_at_the_handle(progress):
    config = configured(
        UNCAPPED | {"premature_close.weight": -0.2, "premature_close.final_weight": -0.2}
    )
    config_term = CONFIG.premature_close
    scale_m = config_term.final_scale_m if progress else config_term.scale_m
    away = state(offset=[0, 0.02, 0], smooth=1.0, closing=1.0)
    cost = terms(away, action=SHUT, config=config, progress=progress * config.until)[
        "premature_close"
    ]
    assert cost == pytest.approx(-0.2 * (1.0 - np.exp(-((0.02 / scale_m) ** 2))))


@pytest.mark.parametrize(
    ("width", "thick", "share"),
    [(0.02, 0.04, 0.0), (0.03, 0.04, 1.0), (0.08, 0.04, 1.0), (0, 0, 1.0)],
)
def test_hand_that_has_closed_on_nothing_at_the_handle_earns_no_grip(width, thick, share):
    shut = dataclasses.replace(
        state(smooth=1.0, closing=1.0), gripper_width=np.array([width], dtype=np.float64)
    )
    paid = terms(shut, action=SHUT, thick_m=thick)["grip"]
    assert_allclose(paid, share * CONFIG.grip.weight, atol=1e-12)


@pytest.mark.parametrize("offset", [0.0, 0.015, FAR_M])
def test_hand_that_has_closed_on_nothing_costs_the_same_wherever_it_is(offset):
    shut = state(offset=[0, 0, offset], smooth=1.0, closing=1.0)
    empty = dataclasses.replace(shut, gripper_width=np.array([0.0]))
    assert terms(empty, action=SHUT, thick_m=0.02)["premature_close"] == pytest.approx(
        CONFIG.premature_close.weight
    )
    opening = dataclasses.replace(empty, gripper=empty.gripper._replace(closing=-np.ones(1)))
    assert (
        terms(opening, action=SHUT, thick_m=0.02)["premature_close"]
        > 0.9 * CONFIG.premature_close.weight
    )
    assert (
        terms(opening, action=-SHUT, thick_m=0.02)["premature_close"]
        > 0.5 * CONFIG.premature_close.weight
    )


def test_end_of_an_episode_pays_for_successes_only():
    assert success(Success(weight=7.0), RewardState(succeeded=True)) == 7.0
    assert success(Success(weight=7.0), RewardState()) == 0.0
    assert TERMS[-1] == "success"


def test_open_hand_that_is_told_to_stay_open_neither_earns_nor_costs():
    for offset in (0.0, 0.03, FAR_M):
        still = terms(state(offset=[0, 0, offset]), action=-SHUT)
        assert still["grip"] == 0
        assert still["premature_close"] == 0


@pytest.mark.parametrize(
    ("action", "smooth", "closing", "share"),
    [
        (1.0, -1.0, -1.0, 0.25),
        (0.4, -1.0, -1.0, 0.175),
        (-0.4, -1.0, -1.0, 0.075),
        (-1.0, 1.0, -1.0, 0.25),
        (1.0, 0.5, -1.0, 0.4375),
        (-1.0, -1.0, 1.0, 0.5),
        (1.0, 1.0, 1.0, 1.0),
    ],
)
def test_telling_the_hand_to_close_counts_before_it_does(action, smooth, closing, share):
    """The command and its average count a quarter each, the hand itself a half."""
    told = action * SHUT
    at = terms(state(smooth=smooth, closing=closing), action=told)
    away = terms(state(offset=[0, 0, FAR_M], smooth=smooth, closing=closing), action=told)
    assert at["grip"] == pytest.approx(share * CONFIG.grip.weight)
    assert away["premature_close"] == pytest.approx(share * CONFIG.premature_close.weight)


def test_grip_falls_with_the_distance_to_one_over_e_and_early_takes_its_place():
    near = terms(state(offset=[0, CONFIG.grip.scale_m, 0], smooth=1.0, closing=1.0), action=SHUT)
    assert near["grip"] == pytest.approx(CONFIG.grip.weight / np.e)
    way = [state(offset=[0, d, 0], smooth=1.0, closing=1.0) for d in (0.0, 0.005, 0.02, 0.05, 0.2)]
    both = [terms(after, action=SHUT) for after in way]
    assert np.all(np.diff([each["grip"] for each in both]) < 0)
    assert np.all(np.diff([each["premature_close"] for each in both]) < 0)


GOAL = TASK.target * (1 + CONFIG.travel.margin)
"""Opening is paid for up to here, a little beyond the target."""


@pytest.mark.parametrize(("share", "paid"), [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)])
def test_part_earns_the_share_of_its_way_to_a_little_beyond_the_target(share, paid):
    assert terms(state(opened=share * GOAL))["open"] == pytest.approx(paid * CONFIG.open.weight)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 1.5])
def test_part_earns_less_the_nearer_it_comes_to_its_stop(share):
    opened = GOAL + share * (1.0 - GOAL)
    paid = 1.0 - CONFIG.travel.overshoot * min(share, 1.0)
    assert terms(state(opened=opened))["open"] == pytest.approx(paid * CONFIG.open.weight)
    change = terms(state(opened=opened), before=state(opened=GOAL))["progress"]
    assert change == pytest.approx((paid - 1.0) * CONFIG.progress.weight)


def test_part_whose_target_is_the_end_of_its_range_loses_nothing_there():
    task = dataclasses.replace(TASK, target=1.0)
    assert terms(state(opened=1.0), task=task)["open"] == pytest.approx(CONFIG.open.weight)


SHUTS = dataclasses.replace(TASK, name="close_drawer", target=0.05, begin=(0.4, 0.8), stop=0.0)
"""A drawer that is to be closed. It is paid for up to a fifth of its target."""


@pytest.mark.parametrize(
    ("opened", "paid"),
    [(0.8, 0.0), (0.9, 0.0), (0.405, 0.5), (0.01, 1.0), (0.0, 1.0 - 0.1 * CONFIG.travel.overshoot)],
)
def test_closing_earns_its_way_from_the_farthest_begin_to_a_fifth_of_the_target(opened, paid):
    assert terms(state(opened=opened), task=SHUTS)["open"] == pytest.approx(
        paid * CONFIG.open.weight
    )
    first = state(opened=0.8)
    change = terms(state(opened=opened), before=first, task=SHUTS)["progress"]
    assert change == pytest.approx(paid * CONFIG.progress.weight)


def test_progress_of_closing_is_paid_for_closing_and_taken_back_for_opening():
    two = state(opened=0.5), state(opened=0.4)
    gained = terms(two[1], before=two[0], task=SHUTS)["progress"]
    assert gained == pytest.approx(CONFIG.progress.weight * 0.1 / 0.79)
    assert terms(two[0], before=two[1], task=SHUTS)["progress"] == pytest.approx(-gained)


def test_rest_of_closing_is_earned_near_the_closed_end_alone():
    assert terms(state(opened=0.01), task=SHUTS)["rest"] == pytest.approx(CONFIG.rest.weight)
    assert terms(state(opened=-0.03), task=SHUTS)["rest"] == pytest.approx(CONFIG.rest.weight / 2)
    assert terms(state(opened=0.06), task=SHUTS)["rest"] == 0
    assert terms(state(opened=0.01, speed=-2 * TASK.slow), task=SHUTS)["rest"] == 0


def test_part_that_turns_without_end_has_no_stop_to_keep_off():
    """Opened farther it loses nothing; closed, it must not turn on beyond its closed end."""
    opens = dataclasses.replace(TASK, kind="hinge", target=1.0, stop=None)
    for opened in (1.12, 1.5, 4.0):
        assert terms(state(opened=opened), task=opens)["open"] == pytest.approx(CONFIG.open.weight)
    assert terms(state(opened=1.0), task=opens)["open"] < CONFIG.open.weight
    shuts = dataclasses.replace(SHUTS, kind="hinge", begin=(0.5, 1.0), stop=None)
    paid = [terms(state(opened=o), task=shuts)["open"] for o in (1.0, 0.3, 0.0, -0.3, -1.0)]
    assert paid == pytest.approx([0.0, paid[1], CONFIG.open.weight, paid[1], 0.0])


@given(way=st.lists(st.floats(-0.2, 1.2), min_size=2, max_size=20))
def test_progress_telescopes(way):
    """Its sum depends on where the part began and ended, not on the way between."""
    states = [state(opened=o) for o in way]
    total = sum(terms(b, before=a)["progress"] for a, b in itertools.pairwise(states))
    first, last = (terms(each)["open"] / CONFIG.open.weight for each in (states[0], states[-1]))
    assert total == pytest.approx(CONFIG.progress.weight * (last - first), abs=1e-9)


@pytest.mark.parametrize(("beyond", "share"), [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (1.5, 1.0)])
def test_rest_is_earned_by_how_far_beyond_the_target_the_part_stands(beyond, share):
    """A policy that is paid for the target itself rests at it, and is found short of it."""
    opened = TASK.target * (1.0 + beyond * CONFIG.travel.margin)
    assert terms(state(opened=opened))["rest"] == pytest.approx(share * CONFIG.rest.weight)


def test_rest_at_a_target_that_is_the_end_of_the_way_is_earned_whole():
    task = dataclasses.replace(TASK, target=1.0)
    assert terms(state(opened=1.0), task=task)["rest"] == CONFIG.rest.weight
    assert terms(state(opened=0.9), task=task)["rest"] == 0


def test_rest_is_earned_standing_still_alone():
    assert terms(state(opened=0.9))["rest"] == CONFIG.rest.weight
    assert terms(state(opened=0.9, speed=2 * TASK.slow))["rest"] == 0
    assert terms(state(opened=0.7))["rest"] == 0


def test_force_costs_beyond_what_is_free():
    assert terms(state(fx=0.9 * CONFIG.force.free_n))["force"] == 0
    loaded = terms(state(fx=0.0, fz=-(CONFIG.force.free_n + 10)))
    assert loaded["force"] == pytest.approx(10 * CONFIG.force.weight)


@pytest.mark.parametrize("progress", [0.0, 0.3, 1.0])
def test_price_of_force_goes_from_the_first_to_the_last_with_training(progress):
    config = configured(UNCAPPED | {"force.weight": -0.1, "force.final_weight": -0.5, "until": 1.0})
    loaded = terms(state(fy=CONFIG.force.free_n + 1), config=config, progress=progress)
    assert loaded["force"] == pytest.approx(-0.1 - 0.4 * progress)


def test_weights_stay_as_they_are_after_their_share_of_the_training():
    config = configured(UNCAPPED | {"force.weight": -0.1, "force.final_weight": -0.5, "until": 0.5})
    loaded = state(fy=CONFIG.force.free_n + 1)
    costs = [terms(loaded, config=config, progress=p)["force"] for p in (0.25, 0.5, 0.75, 1.0)]
    assert costs == pytest.approx([-0.3, -0.5, -0.5, -0.5])


@pytest.mark.parametrize("until", [0.0, -1.0, 1.1, math.nan])
def test_a_share_of_the_training_that_is_none_is_refused(until):
    for config, name in ((RewardConfig, "reward"), (InitialStatesConfig, "initial_states")):
        with pytest.raises(ConfigError, match=rf"^{name}\.until is "):
            config(until=until)


@pytest.mark.parametrize(("kind", "length"), [("slide", 1.0), ("hinge", 0.2)])
def test_speed_of_the_part_costs_beyond_what_is_free_in_both_directions(kind, length):
    task = dataclasses.replace(TASK, kind=kind)
    for sign in (1, -1):
        free = sign * 0.99 * CONFIG.speed.free_m_s / length
        fast = sign * (CONFIG.speed.free_m_s + 0.1) / length
        assert terms(state(speed=free), task=task)["speed"] == 0
        assert terms(state(speed=fast), task=task)["speed"] == pytest.approx(
            0.1 * CONFIG.speed.weight
        )


def test_motions_cost_their_mean_square_and_the_hand_is_free():
    action = np.zeros((1, 8))
    action[0, 0], action[0, 7] = 1.0, 1.0
    assert terms(AWAY, action=action)["action"] == pytest.approx(CONFIG.action.weight / 7)


@pytest.mark.parametrize("progress", [0.0, 0.5, 1.0])
def test_violation_costs_once_and_in_proportion_to_the_progress(progress):
    broken = state(code=3.0)
    cost = terms(broken, progress=progress)["violation"]
    assert cost == pytest.approx(CONFIG.violation.weight * min(progress / CONFIG.until, 1))
    assert terms(broken, before=broken, progress=progress)["violation"] == 0


def test_what_is_wished_is_rewarded_and_what_is_not_costs():
    for name in ("approach", "reach", "align", "grip", "open", "progress", "rest"):
        assert getattr(CONFIG, name).weight >= 0, name
    for name in {
        "premature_close",
        "lateral_offset",
        "force",
        "speed",
        "action",
        "violation",
    } & set(TERMS):
        assert getattr(CONFIG, name).weight <= 0, name


@pytest.mark.parametrize("progress", [0.0, 0.25, 1.0])
def test_opening_after_a_violation_earns_less_the_further_training_is(progress):
    after = {"opened": 0.9, "code": 3.0}
    whole = terms(state(opened=0.9), before=state(), progress=progress)
    spoiled = terms(state(**after), before=state(code=3.0), progress=progress)
    left = 1 + min(progress / CONFIG.until, 1) * (CONFIG.travel.violated_share - 1)
    for name in ("open", "progress", "rest"):
        assert whole[name] > 0
        assert spoiled[name] == pytest.approx(left * whole[name])
    for name in set(TERMS) - {"open", "progress", "rest"}:
        assert spoiled[name] == whole[name]


@pytest.mark.parametrize("name", TERMS)
def test_each_weight_rules_its_own_term_alone(name):
    busy = state(
        offset=[0.0, 0.0, 0.01], opened=0.9, smooth=0.8, closing=1.0, fx=30.0, speed=0.0, code=2.0
    )
    fast = dataclasses.replace(busy, speed=np.array([1.0]))
    for after in (busy, fast):
        action = np.ones((1, 8))
        a = terms(after, action=action)
        doubled = configured({f"{name}.weight": 2 * getattr(CONFIG, name).weight}, CONFIG)
        b = terms(after, action=action, config=doubled)
        for other in TERMS:
            factor = 2 if other == name else 1
            assert b[other] == pytest.approx(factor * a[other], abs=1e-12)
