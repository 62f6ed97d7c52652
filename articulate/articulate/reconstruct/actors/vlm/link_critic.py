"""Critic that compares a rendering of placed parts with the image, by a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from articulate.reconstruct.actors.protocol import Evidence
from articulate.reconstruct.actors.vlm.answers import PlacementCriticAnswer
from articulate.reconstruct.actors.vlm.examples import (
    bounds_of,
    example_content,
    example_object,
)
from articulate.reconstruct.actors.vlm.images import evidence_images, placement_image
from articulate.reconstruct.actors.vlm.model import Content, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import describe_parts, with_placements
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import schema_of
from articulate.transforms import Array, pose

SHIFT = 0.6
"""Displacement of the misplaced part of an example, as a share of the object's size."""


def assess_placements(
    session: ModelSession, evidence: Evidence, placements: Mapping[str, Array], examples: int = 0
) -> PlacementCriticAnswer:
    """Assess placements (4, 4) of parts by name, with a number of in-context examples.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    request = link_critic_request(evidence, placements, examples)
    return session.generate(request, PlacementCriticAnswer)


def link_critic_request(
    evidence: Evidence, placements: Mapping[str, Array], examples: int = 0
) -> Request:
    """Create the request to assess placements."""
    placed = with_placements(evidence, dict(placements))
    content: tuple[Content, ...] = (
        *example_content("placement", examples, _example),
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


def _example(k: int) -> tuple[Iterable[Content], PlacementCriticAnswer]:
    """Return the image of an example and a rendering: correct, or with one part misplaced."""
    known = example_object(k)
    evidence = known.evidence
    if k % 2:
        part = next(joint.part for joint in known.joints if joint.kind != "fixed")
        axis, side = ((2, "up"), (1, "to the right"))[k // 2 % 2]
        size = float(np.ptp(bounds_of(known.part_set)[:, axis]))
        offset = SHIFT * size * np.eye(3)[axis]
        wrong = with_placements(evidence, {part: pose(offset)})
        answer = PlacementCriticAnswer(
            differences=f"{part} is too far {side}.",
            correction=f"Move {part} back by {SHIFT * size:.2f} m.",
            rating=2.0,
        )
    else:
        wrong = evidence
        answer = PlacementCriticAnswer(differences="none", correction="", rating=9.0)
    return (*evidence_images(evidence), placement_image(wrong), describe_parts(wrong)), answer
