"""A model that writes programs, on a server of this machine, with Google's own client."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import DOOR, DOOR_PROGRAM, KEY
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate.reconstruct.actors.geometric.critic import VideoCritic
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import ActorAttempt, Prediction, Verdict
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic
from articulate.reconstruct.actors.vlm.link_actor import LinkActor
from articulate.reconstruct.actors.vlm.prompt_text import with_placements
from articulate.transforms import pose


def program(text):
    return saying({"observation": "a cupboard whose door opens", "program": text})


def verdict(failure, rating, reason=""):
    told = {"observed": "the door turns", "predicted": "see above"}
    return saying({**told, "failure": failure, "rating": rating, "reason": reason})


def actor(gemini, tmp_path, **more):
    cache = tmp_path / "cache" / "articulate"
    proposer = JointActor(model=gemini, cache=cache)
    return Loop(proposer=proposer, critic=JointCritic(model=gemini, cache=cache), **more)


def test_wrong_type_axis_origin_and_limit_are_mended_in_turn_and_the_loop_stops(
    serve, gemini, video, tmp_path
):
    wrong = [
        (
            'prismatic("part_02", "part_01", axis=vec(1, 0, 0), lower=0.0, upper=0.3)',
            "joint_type",
        ),
        (
            'revolute("part_02", "part_01", axis=vec(0, 1, 0), pivot=vec(0.3, 0, 0.75), '
            "lower=0.0, upper=0.5)",
            "joint_axis",
        ),
        (
            'revolute("part_02", "part_01", axis=vec(0, 0, 1), pivot=vec(0.3, 0.05, 0), '
            "lower=0.0, upper=1.4)",
            "joint_origin",
        ),
        (
            'revolute("part_02", "part_01", axis=vec(0, 0, 1), pivot=vec(0.3, 0.6, 0), '
            "lower=0.0, upper=0.2)",
            "joint_limit",
        ),
    ]

    def answer(heard):
        if "failure" in heard.fields:
            k = sum("failure" in h.fields for h in server.heard) - 1
            if k < len(wrong):
                return verdict(wrong[k][1], k + 1.0, f"mend the {wrong[k][1]}")
            return verdict("success", 9.0, "no difference is seen")
        # The script goes by what the model is told, as a model would.
        said = [reason in heard.text for _, reason in wrong]
        k = said.index(False) if False in said else len(wrong)
        return program(wrong[k][0] if k < len(wrong) else DOOR_PROGRAM)

    server = serve(answer)
    found = actor(gemini, tmp_path, max_iterations=8).predict(video)
    failures = [attempt.verdict.failure for attempt in found.attempts]
    assert failures == [reason for _, reason in wrong] + ["success"]
    assert found.rating == 9.0
    assert found.calls == len(server.heard) == 10
    moving = [joint for joint in found.joints if joint.kind != "fixed"]
    assert [(j.part, j.kind) for j in moving] == [("part_02", "revolute")]
    np.testing.assert_allclose(moving[0].T_o(0.7), DOOR.T_o(0.7), atol=1e-9)
    assert (moving[0].lower, moving[0].upper) == (0.0, 1.4)
    fixed = {joint.part: joint.parent for joint in found.joints if joint.kind == "fixed"}
    assert fixed == {"part_03": "part_02", "part_00": "part_01"}
    assert found.program == DOOR_PROGRAM
    assert all(heard.headers["x-goog-api-key"] == KEY for heard in server.heard)


def test_the_geometric_critic_may_judge_what_a_model_says(serve, gemini, video):
    slide = 'prismatic("part_02", "part_01", axis=vec(1, 0, 0), lower=0.0, upper=0.3)'
    server = serve(lambda h: program(DOOR_PROGRAM if "joint_type" in h.text else slide))
    proposer = JointActor(model=gemini, cache=None)
    found = Loop(proposer=proposer, critic=VideoCritic(), max_iterations=4).predict(video)
    failures = [a.verdict and a.verdict.failure for a in found.attempts]
    assert failures == ["joint_type", "success"]
    # The critic's own picture, a WebP, is shown to the model as a PNG.
    assert len(server.heard[1].pictures) == len(server.heard[0].pictures) + 1
    assert all(picture.startswith(b"\x89PNG") for picture in server.heard[1].pictures)
    assert found.rating is not None
    assert found.rating > 5.0
    assert found.calls == len(server.heard) == 2


def test_a_model_is_shown_frames_parts_and_their_colours(serve, gemini, video):
    server = serve(program(DOOR_PROGRAM))
    JointActor(model=gemini, cache=None).propose(video, ())
    [heard] = server.heard
    assert len(heard.pictures) == 8 + 1 + 1
    assert all(picture.startswith(b"\x89PNG") for picture in heard.pictures)
    assert "frame 1 of 14, at 0.00 s:" in heard.text
    assert "frame 14 of 14, at 0.54 s:" in heard.text
    assert "- part_02 (door), colour #17e6e6, box from (0.300, 0.050, 0.750)" in heard.text
    for word in ("revolute(child, parent, axis, pivot", "place_relative_to", "right-hand rule"):
        assert word in heard.system


HOSTILE = [
    ('x = 1\nimport os\nos.system("touch owned")', 2),
    ('root("part_01")\nx = parts().__class__.__mro__', 2),
    ('open("/etc/passwd")', 1),
    ("while True: pass", 1),
]


@pytest.mark.parametrize(("source", "line"), HOSTILE)
def test_a_hostile_program_is_refused_and_goes_back_with_line_and_column(
    serve, gemini, text, source, line, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    server = serve(program(source), program(DOOR_PROGRAM))
    found = JointActor(model=gemini, cache=None).propose(text, ())
    assert [j.part for j in found.joints if j.kind != "fixed"] == ["part_02"]
    told = server.heard[1].body["contents"][-1]["parts"][0]["text"]
    assert told.startswith(f"The program is invalid: line {line}, column ")
    assert not (tmp_path / "owned").exists()
    assert found.calls == 2


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        (f'move("part_03", vec(0, 0, 1))\n{DOOR_PROGRAM}', "it moves part_03"),
        (f'frame("extra")\n{DOOR_PROGRAM}', "it makes a frame"),
        ('root("part_01")', "nothing moves in it"),
        (DOOR_PROGRAM.replace('"part_02"', '"door"'), "'door'"),
        (DOOR_PROGRAM.replace("upper=1.4", "upper=1.4("), "line 4, column "),
    ],
)
def test_a_program_that_says_what_cannot_be_goes_back(serve, gemini, text, source, complaint):
    server = serve(program(source), program(DOOR_PROGRAM))
    JointActor(model=gemini, cache=None).propose(text, ())
    assert complaint in server.heard[1].body["contents"][-1]["parts"][0]["text"]


def test_a_program_in_a_fence_is_taken_out_of_it(serve, gemini, text):
    serve(program(f"```python\n{DOOR_PROGRAM}```"))
    assert JointActor(model=gemini, cache=None).propose(text, ()).program == DOOR_PROGRAM


def test_programs_that_never_run_are_a_refusal(serve, gemini, text):
    server = serve(program("import os"))
    found = JointActor(model=gemini, cache=None).propose(text, ())
    assert found.joints == ()
    assert "4 invalid programs in a row; line 1" in found.rejection
    assert found.calls == len(server.heard) == 4
    assert len(found.trace) == 4


def test_a_refusal_keeps_what_was_proposed_before(serve, gemini, image, tmp_path):
    def answer(heard):
        if "failure" in heard.fields:
            return verdict("joint_axis", 2.0, "turned")
        return program(DOOR_PROGRAM) if "turned" not in heard.text else saying("nonsense")

    server = serve(answer)
    found = actor(gemini, tmp_path, max_iterations=3).predict(image)
    assert (found.rejection, found.rating, len(found.attempts)) == ("", 2.0, 1)
    assert found.calls == len(server.heard) == 4


def test_the_critics_pictures_of_the_last_proposal_are_shown(serve, gemini, text):
    server = serve(program(DOOR_PROGRAM))
    png = b"\x89PNG\r\n\x1a\n of a critic"
    said = Verdict(failure="joint_axis", rating=2.0, reason="it tilts", images={"rendering": png})
    attempt = ActorAttempt(joints=(DOOR,), verdict=said)
    JointActor(model=gemini, cache=None).propose(text, [attempt])
    [heard] = server.heard
    assert png in heard.pictures
    assert "joint_axis, rated 2.0 of 10. it tilts" in heard.text
    assert "part_02 against part_01: revolute, axis (0.000, 0.000, 1.000) through" in heard.text


PLACES = """\
place("part_01", vec(0, 0, 0.35))
place("part_00", vec(-0.35, 0, 0.7))
b = box("part_01")
place("part_02", vec(b.high.x + 0.02, 0.325, 1.05))
place_relative_to("part_03", "part_02", "front", snap=False, align=True)
"""


def apart(evidence):
    """The same evidence, each part with the middle of its box at the origin."""
    taken = tuple(part.moved(pose(-part.centre)) for part in evidence.parts)
    return replace(evidence, parts=taken, placed=False)


def test_parts_that_were_taken_apart_are_placed_by_a_program(serve, gemini, image):
    server = serve(program(DOOR_PROGRAM), program(PLACES))
    found = LinkActor(model=gemini, cache=None).predict(apart(image))
    assert "only place the parts" in server.heard[1].text
    assert "its camera is at (3.000, 1.500, 2.000)" in server.heard[0].system
    assert found.calls == 2
    for name in ("part_00", "part_01", "part_02"):
        np.testing.assert_allclose(found.placements[name][:3, 3], image.part(name).centre)
    whole = with_placements(apart(image), dict(found.placements))
    np.testing.assert_allclose(
        whole.part("part_01").bounds, image.part("part_01").bounds, atol=1e-12
    )
    assert whole.part("part_03").bounds[0, 0] == pytest.approx(0.34)


def test_joints_of_parts_that_were_taken_apart_come_after_their_places(
    serve, gemini, image, tmp_path
):
    def answer(heard):
        if "failure" in heard.fields:
            return verdict("success", 8.0)
        return program(PLACES if "taken apart" in heard.system else DOOR_PROGRAM)

    serve(answer)
    found = actor(gemini, tmp_path).predict(apart(image))
    assert set(found.placements) == {part.name for part in image.parts}
    joint = next(j for j in found.joints if j.kind != "fixed")
    np.testing.assert_allclose(joint.pivot_o, (0.3, 0.6, 0.0), atol=1e-9)
    assert found.program == ""
    assert (found.calls, found.rating) == (3, 8.0)


def test_a_critic_that_names_a_failure_cannot_be_content(serve, gemini, text, tmp_path):
    serve(lambda h: verdict("joint_limit", 9.0) if "failure" in h.fields else program(DOOR_PROGRAM))
    found = actor(gemini, tmp_path, max_iterations=2).predict(text)
    assert [a.verdict.rating for a in found.attempts] == [5.0, 5.0]


def test_a_critic_whose_rating_is_beyond_the_scale_is_asked_again(serve, gemini, image):
    server = serve(verdict("success", 11.0), verdict("success", 7.0))
    said = JointCritic(model=gemini, cache=None).assess(image, Prediction(joints=(DOOR,)))
    assert (said.failure, said.rating, said.calls) == ("success", 7.0, 2)
    assert "rating is 11; it must be in [0, 10]" in server.heard[1].text
    [(caption, picture)] = said.images.items()
    assert caption == "the image, and the prediction: closed, half open, open"
    assert picture in server.heard[0].pictures


def test_a_critic_without_a_verdict_is_not_content(serve, gemini, text):
    serve(saying("I cannot tell."))
    said = JointCritic(model=gemini, cache=None).assess(text, Prediction(joints=(DOOR,)))
    assert said.rating == 3.0
    assert said.reason.startswith("no verdict: ")


def test_a_prediction_in_which_nothing_moves_needs_no_model(gemini, text):
    said = JointCritic(model=gemini, cache=None).assess(text, Prediction(joints=()))
    assert (said.failure, said.rating, said.calls) == ("joint_type", 0.0, 0)
