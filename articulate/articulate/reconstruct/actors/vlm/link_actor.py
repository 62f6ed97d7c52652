"""Actor that places parts with a program of a model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import GOOD_ENOUGH, Evidence, Prediction
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.examples import example_content, example_object
from articulate.reconstruct.actors.vlm.link_critic import assess_placements
from articulate.reconstruct.actors.vlm.model import Content, Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.programs import placements_in, runnable_program
from articulate.reconstruct.actors.vlm.prompt_text import evidence_content, format_vector
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.providers import default_model
from articulate.reconstruct.actors.vlm.schema import AnswerError, schema_of
from articulate.reconstruct.program.reference import reference
from articulate.reconstruct.program.result import ProgramObject
from articulate.render.camera import Camera
from articulate.transforms import Array, pose

MAX_PLACEMENTS = 3
"""Most programs that a critic assesses."""


@dataclass(frozen=True, kw_only=True)
class LinkActor:
    """Predicts placements of parts, without joints."""

    model: Model = field(default_factory=default_model)
    cache: Path | None = field(default_factory=cache_folder)
    """Folder for answers; None: no cache."""
    examples: int = 0
    """Number of in-context examples."""
    assessed: bool = False
    """Use the link critic."""
    name: str = "vlm-link"

    def predict(self, evidence: Evidence) -> Prediction:
        """Predict the placement of each part.

        Raises:
            UsageError: The request cannot be sent.
        """
        session = ModelSession(model=self.model, cache=self.cache)
        placements: dict[str, Array] = {}
        rejection = ""
        try:
            placements = find_placements(
                session, evidence, examples=self.examples, assessed=self.assessed
            )
        except AnswerError as invalid:
            rejection = str(invalid)
        return Prediction(
            joints=(),
            placements=placements,
            trace=tuple(session.steps),
            calls=session.calls,
            rejection=rejection,
        )


def find_placements(
    session: ModelSession, evidence: Evidence, *, examples: int = 0, assessed: bool = False
) -> dict[str, Array]:
    """Return the pose ``T_op`` (4, 4) of each part by name; identities if parts are placed.

    Args:
        session: Session with the model.
        evidence: Parts and image.
        examples: Number of in-context examples.
        assessed: Compare the rendering with the image, and let the model correct its program.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    if evidence.placed:
        return {part.name: pose((0.0, 0.0, 0.0)) for part in evidence.parts}
    request = link_request(evidence, examples)
    best: dict[str, Array] = {}
    best_rating = -1.0
    for _ in range(MAX_PLACEMENTS):
        source, built = runnable_program(session, request, evidence.parts, _placement_error)
        placements = placements_in(built)
        if not assessed or evidence.image is None:
            return placements
        verdict = assess_placements(session, evidence, placements, examples)
        if verdict.rating > best_rating:
            best, best_rating = placements, verdict.rating
        if verdict.rating > GOOD_ENOUGH:
            break
        request = request.after(
            source,
            f"A critic rates the result {verdict.rating:g} of 10. Differences: "
            f"{verdict.differences} Correction: {verdict.correction}\nWrite the complete program "
            "again.",
        )
    return best


def link_request(evidence: Evidence, examples: int = 0) -> Request:
    """Create the request to place parts that were taken apart."""
    hint = "No image shows the placements: use the names and sizes of the parts."
    if evidence.image is not None:
        hint = "The image shows the placements of the parts"
        if evidence.camera is not None:
            hint += f"; {_describe_camera(evidence.camera)}"
        hint += "."
    task = prompt("link_program").filled(hint=hint, reference=reference())
    return Request(
        title="placements of the parts",
        system=f"{prompt('frame').filled()}\n\n{task}",
        turns=(
            Turn(
                "user",
                (*example_content("link", examples, _example), *evidence_content(evidence)),
            ),
        ),
        schema=schema_of(ProgramAnswer),
    )


def _example(k: int) -> tuple[Iterable[Content], ProgramAnswer]:
    """Return separated parts of an example and the program that places them."""
    known = example_object(k)
    lines = [f"place({p.name!a}, vec{format_vector(p.centre)})" for p in known.part_set.meshes]
    answer = ProgramAnswer(
        observation=f"A {known.part_set.kind} with {len(lines)} parts.",
        program="\n".join(lines) + "\n",
    )
    return evidence_content(known.separated), answer


def _describe_camera(camera: Camera) -> str:
    ahead = camera.T_wc[:3, 2]
    return (
        f"its camera is at {format_vector(camera.eye_w)}, looks along {format_vector(ahead)}, and "
        f"has a focal length of {camera.fy_px / camera.height_px:.3f} image heights"
    )


def _placement_error(built: ProgramObject) -> str:
    """Return the error of a placement; empty if it is valid."""
    if any(joint.kind != "fixed" for joint in built.joints):
        return "it makes a joint; only place the parts"
    if len({part.pos_w for part in built.parts}) == 1 and len(built.parts) > 1:
        return "all parts are at the same position; put each where it belongs"
    return ""
