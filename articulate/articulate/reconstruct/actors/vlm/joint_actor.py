"""JointActor: a model that finds joints, by writing a program or by choosing among candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import ActorAttempt, Evidence, Prediction
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.gemini import Gemini
from articulate.reconstruct.actors.vlm.hybrid import chosen_joints
from articulate.reconstruct.actors.vlm.link_actor import places_of
from articulate.reconstruct.actors.vlm.model import Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.programs import joints_in, written, wrong_joints
from articulate.reconstruct.actors.vlm.prompt_text import attempts_told, pieces_of, placed
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.schema import Unfit, schema_of
from articulate.reconstruct.program.reference import reference

Way = Literal["program", "choice"]
WHICH = {
    "video": "Only the part that moves in the clip is asked for, with all that goes along with it.",
    "image": "All parts that can move are asked for, whether they are open or closed.",
    "text": "All parts that can move are asked for.",
}


@dataclass(frozen=True, kw_only=True)
class JointActor:
    """Finds joints, and before that places of parts where these are asked for."""

    way: Way = "program"
    """``program``: the model writes a program; ``choice``: it says what is semantic, and geometry
    computes every number."""
    model: Model = field(default_factory=Gemini)
    cache: Path | None = field(default_factory=cache_folder)
    """Where answers are kept; None: nowhere."""

    @property
    def name(self) -> str:
        """Name in reports."""
        return "vlm" if self.way == "program" else "hybrid"

    def propose(self, evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Prediction:
        """The joints that the model says there are, given every earlier attempt.

        Raises:
            UsageError: The model cannot be asked.
        """
        interview = ModelSession(model=self.model, cache=self.cache)
        try:
            found = self._found(interview, evidence, attempts)
        except Unfit as unfit:
            found = Prediction(joints=(), rejection=str(unfit))
        steps = (*interview.steps, *found.trace)
        return replace(found, trace=steps, calls=interview.calls)

    def _found(
        self, interview: ModelSession, evidence: Evidence, attempts: Sequence[ActorAttempt]
    ) -> Prediction:
        places = {} if evidence.placed else places_of(interview, evidence)
        whole = evidence if evidence.placed else placed(evidence, places)
        if self.way == "choice":
            found = chosen_joints(interview, whole, attempts)
        else:
            request = program_request(whole, attempts)
            source, built = written(interview, request, whole.parts, wrong_joints)
            # A program over placed parts says nothing of parts that were given out of their places.
            kept = source if evidence.placed else ""
            found = Prediction(joints=joints_in(built), program=kept)
        return replace(found, placements=places)


def program_request(evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Request:
    """What is asked of a model that writes the program."""
    task = prompt("joint_program").filled(which=WHICH[evidence.modality], reference=reference())
    pieces = (*pieces_of(evidence), *attempts_told(attempts))
    return Request(
        title="a program with all joints",
        system=f"{prompt('frame').filled()}\n\n{task}",
        turns=(Turn("user", pieces),),
        schema=schema_of(ProgramAnswer),
    )
