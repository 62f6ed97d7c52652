"""Hybrid: the model chooses, geometry computes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import DOOR, LABELS
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.semantic.part_relations import build_labelled_scene
from articulate.reconstruct.actors.vlm.actor import HybridCritic, hybrid_actor, vlm_actor
from articulate.reconstruct.actors.vlm.answers import MovingPart
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.joint_candidates import (
    describe_candidates,
    joint_candidates,
    typical_joint,
    with_carriers,
)
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic

DOOR_MOVES = {"part": "part_02", "kind": "revolute", "why": "its edge comes to the front"}
MOVERS = {"observation": "a door is opened", "movers": [DOOR_MOVES]}


def picks(candidate, opens="positive", part="part_02"):
    chosen = [{"part": part, "candidate": candidate, "opens": opens}]
    return saying({"reason": "the hinge at the right", "choices": chosen})


def at_the_right(heard):
    """A model that looks for the upright hinge at the right."""
    if "movers" in heard.fields:
        return saying(MOVERS)
    lines = [line for line in heard.text.splitlines() if "at its right side" in line]
    return picks(int(lines[0].split(":")[0]))


def offers(evidence, part="part_02", kind="revolute"):
    mover = MovingPart(part=part, kind=kind, why="")
    scene = with_carriers(build_labelled_scene(evidence), [mover])
    return joint_candidates([mover], scene), scene


def hybrid(gemini):
    return JointActor(strategy="choice", model=gemini, cache=None)


def test_a_choice_from_text_gives_the_joint_that_geometry_offers(serve, gemini, text):
    server = serve(at_the_right)
    found = hybrid(gemini).propose(text, ())
    joint, *rest = found.joints
    assert (joint.part, joint.parent, joint.kind) == ("part_02", "part_01", "revolute")
    np.testing.assert_allclose(np.abs(joint.axis_o), (0.0, 0.0, 1.0), atol=1e-9)
    assert joint.pivot_o[1] == pytest.approx(0.6, abs=0.03)
    opened = joint.T_o(joint.upper)[:3, :3] @ np.array([0.0, -1.0, 0.0])
    assert opened[0] > 0.9  # it opens to the front
    assert (joint.lower, joint.upper) == (0.0, pytest.approx(np.pi / 2))
    assert {j.part: j.parent for j in rest} == {"part_03": "part_02"}
    assert (found.calls, len(server.heard)) == (2, 2)
    assert len(found.trace) == 2


def test_a_choice_from_a_clip_is_measured(serve, gemini, video):
    serve(at_the_right)
    found = hybrid(gemini).propose(video, ())
    joint = found.joints[0]
    assert (joint.part, joint.kind) == ("part_02", "revolute")
    assert abs(joint.axis_o[2]) > 0.99
    assert np.linalg.norm(np.subtract(joint.pivot_o, DOOR.pivot_o)[:2]) < 0.03
    ends = np.sort([joint.axis_o[2] * joint.lower, joint.axis_o[2] * joint.upper])
    np.testing.assert_allclose(ends, (0.0, 1.4), atol=0.08)
    assert {j.part: j.parent for j in found.joints[1:]} == {"part_03": "part_02"}


@pytest.mark.parametrize(
    ("movers", "complaint"),
    [
        ([{"part": "lid", "kind": "revolute", "why": ""}], "there is no part 'lid'"),
        ([DOOR_MOVES, DOOR_MOVES], "part_02 is named twice"),
        (
            [{"part": p, "kind": "revolute", "why": ""} for p in LABELS],
            "at least one part is fixed",
        ),
        ([{**DOOR_MOVES, "kind": "screw"}], "one of revolute, prismatic, continuous"),
    ],
)
def test_parts_that_cannot_be_meant_go_back(serve, gemini, text, movers, complaint):
    server = serve(saying({"observation": "", "movers": movers}), saying(MOVERS), picks(1))
    hybrid(gemini).propose(text, ())
    assert complaint in server.heard[1].text


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        (picks(99), "candidate 99 is not one of part_02; known: 1 to "),
        (picks(0), "candidate 0 is not one of part_02"),
        (picks(1, part="part_03"), "choose one candidate for each of part_02"),
        (picks(1, opens="outwards"), "one of positive, negative, both"),
    ],
)
def test_candidates_that_were_not_offered_go_back(serve, gemini, text, bad, complaint):
    server = serve(saying(MOVERS), bad, picks(1))
    assert hybrid(gemini).propose(text, ()).joints
    assert complaint in server.heard[2].text


def test_a_model_that_sees_nothing_move_is_a_refusal(serve, gemini, text):
    serve(saying({"observation": "a stone", "movers": []}))
    found = hybrid(gemini).propose(text, ())
    assert (found.joints, found.rejection) == ((), "gemini-3.8-flash names no moving part")
    assert found.calls == 1


def test_the_candidates_are_drawn_and_told(serve, gemini, image):
    server = serve(saying(MOVERS), picks(1))
    hybrid(gemini).propose(image, ())
    first, second = server.heard
    assert (len(first.pictures), len(second.pictures)) == (2, 3)
    assert "For part_02, revolute:" in second.text
    assert "the candidates of part_02, numbered on their arrows:" in second.text


def test_among_the_candidates_of_a_door_is_its_hinge_whatever_parts_are_called(text):
    for labels in (LABELS, {}):
        found, _ = offers(replace(text, labels=labels))
        off = [
            np.linalg.norm(np.cross(o.pivot_o - np.array(DOOR.pivot_o), DOOR.axis_o))
            for o in found
            if abs(o.axis_o[2]) > 0.99
        ]
        assert min(off) < 0.05
        assert [o.number for o in found] == list(range(1, len(found) + 1))


def test_words_say_which_way_a_candidate_leads(text):
    found, scene = offers(text)
    centre = text.part("part_02").centre
    told = [offer for offer in found if "through its centre" not in offer.description]
    assert len(told) >= 6
    for offer in told:
        moved = typical_joint(offer, "positive", scene).T_o(0.01) @ np.append(centre, 1.0)
        way = moved[:3] - centre
        words = offer.description.split("moves its centre ")[1].split(" and ")
        names = {"front": way[0], "back": -way[0], "right": way[1], "left": -way[1]}
        names |= {"up": way[2], "down": -way[2]}
        assert all(names[word] > 0.2 * np.linalg.norm(way) for word in words)


@pytest.mark.parametrize(
    ("way", "ends"), [("positive", (0.0, 1.0)), ("negative", (-1.0, 0.0)), ("both", (-0.5, 0.5))]
)
def test_ways_are_ranges(text, way, ends):
    found, scene = offers(text, "part_03", "prismatic")
    joint = typical_joint(found[0], way, scene)
    assert joint.lower is not None
    assert joint.upper is not None
    reach = joint.upper - joint.lower
    np.testing.assert_allclose((joint.lower, joint.upper), np.multiply(ends, reach))
    assert reach > 0.0
    assert "positive moves" in describe_candidates(found)


def test_what_turns_for_ever_has_no_limits(text):
    found, scene = offers(text, "part_03", "continuous")
    joint = typical_joint(found[0], "both", scene)
    assert (joint.kind, joint.lower, joint.upper) == ("continuous", None, None)


def test_geometry_judges_clips_and_a_model_the_rest(video, image, text):
    critic = HybridCritic()
    assert critic.critic_for(video) is critic.geometric
    assert critic.critic_for(replace(video, camera=None)) is critic.visual
    assert critic.critic_for(image) is critic.critic_for(text) is critic.visual


@pytest.mark.parametrize(
    ("make", "name", "critic"),
    [(vlm_actor, "vlm", JointCritic), (hybrid_actor, "hybrid", HybridCritic)],
)
def test_both_actors_are_loops_with_a_turn_for_each_failure(make, name, critic):
    actor = make()
    assert isinstance(actor, Loop)
    assert (actor.name, actor.max_iterations) == (name, 5)
    assert isinstance(actor.critic, critic)
