"""Critic that compares a rendering of placed parts with the image, by a model."""

from __future__ import annotations

from collections.abc import Mapping

from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.vlm.answers import PlacementCriticAnswer
from articulate.reconstruct.actors.vlm.images import evidence_images, placement_image
from articulate.reconstruct.actors.vlm.model import Content, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import describe_parts, with_placements
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of
from articulate.transforms import Array


def assess_placements(
    session: ModelSession, evidence: Evidence, placements: Mapping[str, Array]
) -> PlacementCriticAnswer:
    """Assess placements (4, 4) of parts by name.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    request = link_critic_request(evidence, placements)
    return session.generate(request, PlacementCriticAnswer)


def link_critic_request(evidence: Evidence, placements: Mapping[str, Array]) -> Request:
    """Create the request to assess placements."""
    placed = with_placements(evidence, dict(placements))
    content: tuple[Content, ...] = (
        prompt("link_critic").filled(),
        *evidence_images(evidence),
        placement_image(placed),
        describe_parts(placed),
    )
    return Request(
        title="errors of the placement",
        system=prompt("frame").filled(),
        turns=(Turn("user", content),),
        schema=schema_of(PlacementCriticAnswer),
    )
