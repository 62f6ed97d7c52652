"""Actor that places parts with a program of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import Evidence, Prediction
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.model import Model, Request, Turn
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


@dataclass(frozen=True, kw_only=True)
class LinkActor:
    """Predicts placements of parts, without joints."""

    model: Model = field(default_factory=default_model)
    cache: Path | None = field(default_factory=cache_folder)
    """Folder for answers; None: no cache."""
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
            placements = find_placements(session, evidence)
        except AnswerError as invalid:
            rejection = str(invalid)
        return Prediction(
            joints=(),
            placements=placements,
            trace=tuple(session.steps),
            calls=session.calls,
            rejection=rejection,
        )


def find_placements(session: ModelSession, evidence: Evidence) -> dict[str, Array]:
    """Return the pose ``T_op`` (4, 4) of each part by name; identities if parts are placed.

    Raises:
        AnswerError: No answer of the model is valid.
        UsageError: The request cannot be sent.
    """
    if evidence.placed:
        return {part.name: pose((0.0, 0.0, 0.0)) for part in evidence.parts}
    _, built = runnable_program(session, link_request(evidence), evidence.parts, _placement_error)
    return placements_in(built)


def link_request(evidence: Evidence) -> Request:
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
        turns=(Turn("user", evidence_content(evidence)),),
        schema=schema_of(ProgramAnswer),
    )


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
