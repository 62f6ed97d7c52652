"""Critic that compares a rendering of the prediction with the evidence, by a model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import (
    FAILURES,
    GOOD_ENOUGH,
    Evidence,
    Failure,
    JointKind,
    PredictedJoint,
    Prediction,
    Verdict,
)
from articulate.reconstruct.actors.vlm.answers import CriticAnswer
from articulate.reconstruct.actors.vlm.examples import (
    ExampleObject,
    example_content,
    example_object,
)
from articulate.reconstruct.actors.vlm.images import prediction_image
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Content, Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.prompt_text import (
    describe_joint,
    describe_joints,
    describe_parts,
    format_vector,
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
    examples: int = 0
    """Number of in-context examples."""
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
        request = critic_request(evidence, prediction, self.examples)
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


def critic_request(evidence: Evidence, prediction: Prediction, examples: int = 0) -> Request:
    """Create the request to assess a prediction; its last content is the rendering."""
    if not evidence.placed:
        evidence = with_placements(evidence, dict(prediction.placements))
    task = prompt("critic").filled(
        criterion=CRITERION[evidence.modality], joints=describe_joints(prediction.joints)
    )
    content = (
        *example_content("critic", examples, _example),
        task,
        describe_parts(evidence),
        prediction_image(evidence, prediction.joints),
    )
    return Request(
        title="errors of the prediction",
        system=prompt("frame").filled(),
        turns=(Turn("user", content),),
        schema=schema_of(CriticAnswer),
    )


def _example(k: int) -> tuple[Iterable[Content], CriticAnswer]:
    """Return a prediction for an example, correct or with one of the four failures."""
    known, failure = example_object(k), FAILURES[k % len(FAILURES)]
    true = next(joint for joint in known.joints if joint.kind != "fixed")
    wrong, rating, reason = _with_failure(true, failure, known)
    joints = [wrong if joint is true else joint for joint in known.joints]
    answer = CriticAnswer(
        observed=f"A {known.part_set.kind}: {describe_joint(true)}.",
        predicted=f"{describe_joint(wrong)}.",
        failure=failure,
        rating=rating,
        reason=reason,
    )
    image = prediction_image(known.evidence, joints)
    return (f"The prediction: {describe_joints(joints)}", image), answer


def _with_failure(
    true: PredictedJoint, failure: Failure, known: ExampleObject
) -> tuple[PredictedJoint, float, str]:
    """Return a joint with a failure, the rating, and the reason."""
    x, y, z = true.axis_o
    if failure == "joint_type":
        other: JointKind = "revolute" if true.kind == "prismatic" else "prismatic"
        changed = replace(true, kind=other, lower=0.0, upper=0.3)
        return changed, 0.0, f"{true.part} must be {true.kind}, not {other}."
    if failure == "joint_axis":
        return replace(true, axis_o=(z, x, y)), 1.0, f"Its axis must be {format_vector((x, y, z))}."
    if failure == "joint_origin":
        size = np.ptp(next(m for m in known.part_set.meshes if m.name == true.part).bounds, axis=0)
        px, py, pz = (float(v) for v in np.asarray(true.pivot_o) + 0.7 * size)
        pivot = format_vector(true.pivot_o)
        return replace(true, pivot_o=(px, py, pz)), 2.0, f"Its axis must pass through {pivot}."
    if failure == "joint_limit":
        upper = 1.0 if true.upper is None else true.upper
        changed = replace(true, lower=-upper, upper=0.0)
        return changed, 3.0, f"{true.part} moves into the body; it must move the other way."
    return true, 9.0, "No difference is visible."
