"""Targeted affordance extractor: the part that moves in a video."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.vlm.answers import MovedPart
from articulate.reconstruct.actors.vlm.examples import example_content, example_object
from articulate.reconstruct.actors.vlm.images import colours_of, poses_at
from articulate.reconstruct.actors.vlm.model import Content, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import evidence_content, format_vector
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of
from articulate.render.scene import PartScene

EXAMPLE_SHARES = (0.0, 0.4, 0.8)
"""Positions of the frames of an example, as shares of the range."""


def moved_part(session: ModelSession, evidence: Evidence, examples: int = 0) -> str:
    """Return the name of the part that moves in the video, with a number of in-context examples.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    colours = colours_of(evidence.parts)

    def check(answer: MovedPart) -> str:
        if answer.part not in colours:
            return f"part must be one of {', '.join(colours)}"
        if answer.colour.lower() != colours[answer.part]:
            return f"{answer.part} has the colour {colours[answer.part]}; name and colour differ"
        return ""

    return session.generate(affordance_request(evidence, examples), MovedPart, check).part


def affordance_request(evidence: Evidence, examples: int = 0) -> Request:
    """Create the request for the part that moves."""
    return Request(
        title="part that moves",
        system=prompt("frame").filled(),
        turns=(
            Turn(
                "user",
                (
                    *example_content("affordance", examples, _example),
                    prompt("affordance").filled(),
                    *evidence_content(evidence),
                ),
            ),
        ),
        schema=schema_of(MovedPart),
    )


def _example(k: int) -> tuple[Iterable[Content], MovedPart]:
    """Return frames of an example in which its first joint moves, and the part."""
    known = example_object(k)
    joint = next(joint for joint in known.joints if joint.kind != "fixed")
    still = known.evidence
    assert still.camera is not None
    fixed = {j.part: j for j in known.joints if j.kind == "fixed"}
    joints = fixed | {joint.part: joint}
    scene = PartScene(still.parts)
    poses = [poses_at(still.parts, joints, share) for share in EXAMPLE_SHARES]
    frames = np.stack([scene.render_image(still.camera, T) for T in poses])
    evidence = replace(still, modality="video", image=None, video=frames)
    how = "slides" if joint.kind == "prismatic" else "turns"
    answer = MovedPart(
        observation=f"{joint.part} {how} along or about {format_vector(joint.axis_o)}.",
        part=joint.part,
        colour=colours_of(still.parts)[joint.part],
    )
    return evidence_content(evidence), answer
