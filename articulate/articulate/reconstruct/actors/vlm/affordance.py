"""Targeted affordance extractor: the part that moves in a video."""

from __future__ import annotations

from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.vlm.answers import MovedPart
from articulate.reconstruct.actors.vlm.images import colours_of
from articulate.reconstruct.actors.vlm.model import Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import evidence_content
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of


def moved_part(session: ModelSession, evidence: Evidence) -> str:
    """Return the name of the part that moves in the video.

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

    return session.generate(affordance_request(evidence), MovedPart, check).part


def affordance_request(evidence: Evidence) -> Request:
    """Create the request for the part that moves."""
    return Request(
        title="part that moves",
        system=prompt("frame").filled(),
        turns=(Turn("user", (prompt("affordance").filled(), *evidence_content(evidence))),),
        schema=schema_of(MovedPart),
    )
