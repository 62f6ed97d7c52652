"""Critic that compares a rendering of the prediction with the evidence, by a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import GOOD_ENOUGH, Evidence, Prediction, Verdict
from articulate.reconstruct.actors.vlm.answers import CriticAnswer
from articulate.reconstruct.actors.vlm.images import prediction_image
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import (
    describe_joints,
    describe_parts,
    with_placements,
)
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.providers import default_model
from articulate.reconstruct.actors.vlm.schema import AnswerError, schema_of

CRITERION = {
    "video": "its appearance next to the video",
    "image": "its appearance next to the image",
    "text": "the usual motion of such objects",
}
UNKNOWN_RATING = 3.0
"""Rating where the model sends no valid verdict."""


@dataclass(frozen=True, kw_only=True)
class JointCritic:
    """Assesses joints by their appearance."""

    model: Model = field(default_factory=default_model)
    cache: Path | None = field(default_factory=cache_folder)
    """Folder for answers; None: no cache."""
    name: str = "vlm"

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """Return the first error of a prediction, if there is one.

        A rating above :data:`GOOD_ENOUGH` is lowered to it where a failure is named.

        Raises:
            UsageError: The request cannot be sent.
        """
        if all(joint.kind == "fixed" for joint in prediction.joints):
            return Verdict(failure="joint_type", rating=0.0, reason="no joint is predicted to move")
        session = ModelSession(model=self.model, cache=self.cache)
        request = critic_request(evidence, prediction)
        rendering = request.turns[-1].content[-1]
        assert isinstance(rendering, CaptionedImage)
        images = {rendering.caption: rendering.png}
        try:
            answer = session.generate(request, CriticAnswer)
        except AnswerError as invalid:
            return Verdict(
                failure="success",
                rating=UNKNOWN_RATING,
                reason=f"no verdict: {invalid}",
                images=images,
                trace=tuple(session.steps),
                calls=session.calls,
            )
        rating = answer.rating if answer.failure == "success" else min(answer.rating, GOOD_ENOUGH)
        return Verdict(
            failure=answer.failure,
            rating=rating,
            reason=answer.reason,
            images=images,
            trace=tuple(session.steps),
            calls=session.calls,
        )


def critic_request(evidence: Evidence, prediction: Prediction) -> Request:
    """Create the request to assess a prediction; its last content is the rendering."""
    if not evidence.placed:
        evidence = with_placements(evidence, dict(prediction.placements))
    task = prompt("critic").filled(
        criterion=CRITERION[evidence.modality], joints=describe_joints(prediction.joints)
    )
    content = (task, describe_parts(evidence), prediction_image(evidence, prediction.joints))
    return Request(
        title="errors of the prediction",
        system=prompt("frame").filled(),
        turns=(Turn("user", content),),
        schema=schema_of(CriticAnswer),
    )
