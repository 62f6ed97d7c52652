"""LinkActor: a model that puts parts where they belong."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import Evidence, Prediction
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.gemini import Gemini
from articulate.reconstruct.actors.vlm.model import Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.programs import places_in, written
from articulate.reconstruct.actors.vlm.prompt_text import pieces_of, three
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import Unfit, schema_of
from articulate.reconstruct.program.reference import reference
from articulate.reconstruct.program.result import Built
from articulate.render.camera import Camera
from articulate.transforms import Array, pose


@dataclass(frozen=True, kw_only=True)
class LinkActor:
    """Places parts; says nothing of joints."""

    model: Model = field(default_factory=Gemini)
    cache: Path | None = field(default_factory=cache_folder)
    """Where answers are kept; None: nowhere."""
    name: str = "vlm-link"

    def predict(self, evidence: Evidence) -> Prediction:
        """Where each part belongs.

        Raises:
            UsageError: The model cannot be asked.
        """
        interview = ModelSession(model=self.model, cache=self.cache)
        places: dict[str, Array] = {}
        rejection = ""
        try:
            places = places_of(interview, evidence)
        except Unfit as unfit:
            rejection = str(unfit)
        return Prediction(
            joints=(),
            placements=places,
            trace=tuple(interview.steps),
            calls=interview.calls,
            rejection=rejection,
        )


def places_of(interview: ModelSession, evidence: Evidence) -> dict[str, Array]:
    """Where each part belongs, ``T_op`` (4, 4) by name; as given if the parts are in their places.

    Raises:
        Unfit: The model gives no answer that can be used.
        UsageError: The model cannot be asked.
    """
    if evidence.placed:
        return {part.name: pose((0.0, 0.0, 0.0)) for part in evidence.parts}
    _, built = written(interview, link_request(evidence), evidence.parts, _wrong)
    return places_in(built)


def link_request(evidence: Evidence) -> Request:
    """What a model is asked about parts that have been taken apart."""
    look = "Nothing shows where parts are: go by what they are and how large they are."
    if evidence.image is not None:
        look = "The picture shows where the parts are"
        if evidence.camera is not None:
            look += f"; {_camera_told(evidence.camera)}"
        look += "."
    task = prompt("link_program").filled(look=look, reference=reference())
    return Request(
        title="where parts belong",
        system=f"{prompt('frame').filled()}\n\n{task}",
        turns=(Turn("user", pieces_of(evidence)),),
        schema=schema_of(ProgramAnswer),
    )


def _camera_told(camera: Camera) -> str:
    ahead = camera.T_wc[:3, 2]
    return (
        f"its camera stands at {three(camera.eye_w)}, looks along {three(ahead)}, and has a focal "
        f"length of {camera.fy_px / camera.height_px:.3f} heights of the picture"
    )


def _wrong(built: Built) -> str:
    """What is wrong with a placement; empty if nothing is."""
    if any(joint.kind != "fixed" for joint in built.joints):
        return "it makes a joint; only say where parts are"
    if len({part.pos_w for part in built.parts}) == 1 and len(built.parts) > 1:
        return "all parts lie in the same place; put each where it belongs"
    return ""
