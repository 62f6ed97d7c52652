"""Agents before the joints: retrieval, layout, placement critic, affordance; and their examples."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import DOOR_PROGRAM, LABELS, PARTS
from tests.articulate.reconstruct.actors.vlm.server import saying
from tests.articulate.reconstruct.actors.vlm.test_joint_actor import PLACES, apart, program

from articulate.errors import AssetError
from articulate.reconstruct.actors.protocol import FAILURES, ActorAttempt, Verdict
from articulate.reconstruct.actors.vlm import (
    affordance,
    examples,
    joint_actor,
    joint_critic,
    link_actor,
    link_critic,
)
from articulate.reconstruct.actors.vlm.affordance import moved_part
from articulate.reconstruct.actors.vlm.answers import DetectedObject
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.layout import build_parts
from articulate.reconstruct.actors.vlm.link_actor import LinkActor
from articulate.reconstruct.actors.vlm.model import CaptionedImage
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.motion_traces import video_traces
from articulate.reconstruct.actors.vlm.programs import (
    joints_error,
    parts_of_meshes,
    placements_in,
    program_joints,
)
from articulate.reconstruct.actors.vlm.retrieval import LibraryObject, retrieve, select_object
from articulate.reconstruct.actors.vlm.schema import AnswerError
from articulate.reconstruct.part_set import PartSet
from articulate.reconstruct.program.result import ProgramObject
from articulate.reconstruct.program.run import run_program

DETECTED = DetectedObject(description="A cupboard with a door.", kind="cupboard", affordance="it")


def library_object(k, category="Cupboard"):
    def load():
        if k == 3:
            raise AssetError("broken")
        meshes = tuple(part.with_vertices(part.vertices * (1.0 + 0.05 * k)) for part in PARTS)
        parts = parts_of_meshes(meshes)
        name = f"object_{k}"
        return PartSet(name=name, meshes=meshes, parts=parts, labels=LABELS, source=name)

    return LibraryObject(object_id=str(k), category=category, load=load)


@pytest.fixture
def session(gemini):
    return ModelSession(model=gemini, cache=None)


def test_a_tournament_selects_one_of_many(serve, session, image):
    def answer(heard):  # prefer the last candidate of each group
        n = sum(part.get("text", "").startswith("candidate") for _, p in heard.turns for part in p)
        assert n <= 4
        assert len(heard.pictures) == n + 1
        return saying({"reason": "similar", "candidate": n})

    server = serve(answer)
    pool = [library_object(k) for k in range(10)]
    found = select_object(session, image, DETECTED, pool, max_num_images=4)
    assert found.name == "object_9"  # 9 candidates in groups of 3, then 3
    assert len(server.heard) == 4


def test_an_object_is_retrieved_by_description_category_and_tournament(serve, session, video):
    server = serve(
        saying({"description": "A cupboard.", "kind": "cupboard", "affordance": "a door"}),
        saying({"reason": "", "categories": ["Boat"]}),
        saying({"reason": "", "categories": ["Cupboard"]}),
        saying({"reason": "", "candidate": 9}),
        saying({"reason": "", "candidate": 2}),
    )
    pool = [library_object(k, "Table" if k == 0 else "Cupboard") for k in range(3)]
    found, step = retrieve(session, video, pool)
    assert (found.name, step.title) == ("object_2", "retrieved object_2 of 2")
    first = server.heard[0].body["contents"][0]["parts"]
    assert first[1]["inlineData"]["mimeType"] == "video/mp4"
    assert "categories must be one to three of: Cupboard, Table" in server.heard[2].text
    assert "candidate must be 1 to 2" in server.heard[4].text


def test_parts_for_a_text_are_scaled_to_the_layout(serve, session):
    def answer(heard):
        if "captions" in heard.fields:
            return saying(
                {
                    "captions": [
                        {"part": name, "caption": f"flat {label}"} for name, label in LABELS.items()
                    ]
                }
            )
        if "parts" in heard.fields:
            entry = {"description": "flat", "size": [0.5, 0.6, 0.7]}
            door = {"name": "door", "description": "flat door", "size": [0.02, 0.5, 0.6]}
            return saying({"parts": [{"name": "body", **entry}, door]})
        if "categories" in heard.fields:
            return saying({"reason": "", "categories": ["Cupboard"]})
        return saying({"reason": "", "description": "A cupboard with one door."})

    server = serve(answer)
    made, step = build_parts(session, "a cupboard", [library_object(k) for k in (0, 3, 1)])
    assert [mesh.name for mesh in made.meshes] == ["body", "door"]
    assert not made.placed
    sizes = [np.ptp(mesh.bounds, axis=0) for mesh in made.meshes]
    np.testing.assert_allclose(sizes, [[0.5, 0.6, 0.7], [0.02, 0.5, 0.6]])
    np.testing.assert_allclose(made.meshes[1].centre, 0.0, atol=1e-12)
    assert "door: door: flat door" in step.text
    assert "A cupboard with one door." in server.heard[1].text
    placed = made.with_placements({"door": np.diag([1.0, 1.0, 1.0, 1.0])})
    assert placed.placed


def test_a_layout_with_impossible_parts_goes_back(serve, session):
    bad = {"name": "Body!", "description": "", "size": [0.5, 0.6, 0.7]}
    serve(saying({"reason": "", "description": "x"}), saying({"parts": [bad, bad]}))
    with pytest.raises(AnswerError, match="2 invalid answers in a row"):
        build_parts(session, "a cupboard", [library_object(0)])


def test_the_link_critic_lets_the_program_be_corrected(serve, gemini, image):
    wrong = PLACES.replace("0.325, 1.05", "-0.325, 0.2")

    def answer(heard):
        if "correction" in heard.fields:
            n = sum("correction" in h.fields for h in server.heard)
            assert len(heard.pictures) == 2
            text = {"differences": "the door is low", "correction": "move part_02 up"}
            return saying({**text, "rating": 3 if n == 1 else 8})
        return program(PLACES if "move part_02 up" in heard.text else wrong)

    server = serve(answer)
    found = LinkActor(model=gemini, cache=None, assessed=True).predict(apart(image))
    assert found.calls == 4
    np.testing.assert_allclose(found.placements["part_02"][:3, 3], image.part("part_02").centre)


def test_the_moved_part_has_name_and_colour(serve, session, video):
    wrong = {"observation": "", "part": "part_02", "colour": "#000000"}
    right = {"observation": "", "part": "part_02", "colour": "#17E6E6"}
    server = serve(saying(wrong), saying(right))
    assert moved_part(session, video) == "part_02"
    assert "part_02 has the colour #17e6e6" in server.heard[1].text


def test_the_moved_part_is_a_hint_until_the_critic_rejects_it(serve, gemini, video):
    def answer(heard):
        if "colour" in heard.fields:
            return saying({"observation": "", "part": "part_02", "colour": "#17e6e6"})
        return program(DOOR_PROGRAM)

    server = serve(answer)
    actor = JointActor(model=gemini, cache=None, targeted=True)
    actor.propose(video, ())
    assert "The part that moves in the video is part_02." in server.heard[1].text
    rejected = ActorAttempt(joints=(), verdict=Verdict(failure="joint_type", rating=0.0))
    actor.propose(video, [rejected])
    assert len(server.heard) == 3
    assert "The part that moves" not in server.heard[2].text


def test_traces_follow_what_moves(video):
    textured = video.video.copy()
    rows, columns = np.indices(textured.shape[1:3])
    moving = (np.abs(textured[:1].astype(int) - textured.astype(int)).max(axis=-1) > 8)[..., None]
    textured = np.where(moving, textured // 2 + ((rows // 6 + columns // 6) % 2 * 90)[..., None], 0)
    evidence = replace(video, video=textured.astype(np.uint8))
    assert all(trace.shape == (14, 2) for trace in video_traces(evidence))
    assert video_traces(replace(video, video=video.video[:1].repeat(6, axis=0))) == ()


def check_example(k):
    known = examples.example_object(k)
    built = run_program(known.program, parts_of_meshes(known.part_set.meshes))
    assert isinstance(built, ProgramObject), built
    assert joints_error(built) == ""
    kinds = {joint.part: joint.kind for joint in known.joints}
    assert {joint.part: joint.kind for joint in program_joints(built)} == kinds
    content, answer = link_actor._example(k)
    built = run_program(answer.program, parts_of_meshes(known.separated.parts))
    assert isinstance(built, ProgramObject), built
    for name, T in placements_in(built).items():
        centre = known.evidence.part(name).centre
        np.testing.assert_allclose(T[:3, 3], centre, atol=1e-3)
    for agent in (joint_actor, link_actor, joint_critic, link_critic, affordance):
        content, answer = agent._example(k)
        assert sum(isinstance(piece, CaptionedImage) for piece in content) >= 1
        json.dumps(vars(answer))
    assert joint_critic._example(k)[1].failure == FAILURES[k % 5]


def test_an_example_is_correct_and_is_cached(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    check_example(11)
    first = examples._cached("joint", 11, joint_actor._example)
    again = examples._cached("joint", 11, None)  # type: ignore[arg-type]  # not called
    assert again == first


@pytest.mark.slow
@pytest.mark.parametrize("k", range(20))
def test_every_example_is_correct(k):
    check_example(k)


def test_examples_are_no_objects_of_a_benchmark():
    assert len(set(examples.CATEGORIES)) == 20
    assert examples.SEED >= 5  # the benchmark uses seeds 0 to 4 of each category
