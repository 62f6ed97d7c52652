"""A model that writes programs, on a server of this machine, with Google's own client."""

from __future__ import annotations

import numpy as np

from articulate.actors.loop import Loop
from articulate.actors.vlm.critic import JointCritic
from articulate.actors.vlm.joint import JointActor
from tests.articulate.actors.vlm.conftest import DOOR, DOOR_PROGRAM, KEY
from tests.articulate.actors.vlm.server import saying


def program(text):
    return saying({"seen": "a cupboard whose door opens", "program": text})


def verdict(failure, rating, reason=""):
    told = {"given": "the door turns", "predicted": "see above"}
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
            'revolute("part_02", "part_01", axis=vec(0, 0, -1), pivot=vec(0.3, 0.05, 0), '
            "lower=0.0, upper=1.4)",
            "joint_origin",
        ),
        (
            'revolute("part_02", "part_01", axis=vec(0, 0, -1), pivot=vec(0.3, 0.6, 0), '
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
    found = actor(gemini, tmp_path, max_turns=8).predict(video)
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
