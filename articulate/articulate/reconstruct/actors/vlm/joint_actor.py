"""Actor that finds joints with a model, by a program or by a choice among candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import ActorAttempt, Evidence, Prediction
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.hybrid import choose_joints
from articulate.reconstruct.actors.vlm.link_actor import find_placements
from articulate.reconstruct.actors.vlm.model import Model, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.programs import (
    joints_error,
    program_joints,
    runnable_program,
)
from articulate.reconstruct.actors.vlm.prompt_text import (
    describe_attempts,
    evidence_content,
    with_placements,
)
from articulate.reconstruct.actors.vlm.prompts import prompt
from articulate.reconstruct.actors.vlm.providers import default_model
from articulate.reconstruct.actors.vlm.schema import AnswerError, schema_of
from articulate.reconstruct.program.reference import reference

Strategy = Literal["program", "choice"]
WHICH = {
    "video": "Describe only the part that moves in the video, with all parts that move along.",
    "image": "Describe all parts that can move, whether they are open or closed.",
    "text": "Describe all parts that can move.",
}


@dataclass(frozen=True, kw_only=True)
class JointActor:
    """Finds joints, after the placements of parts where these are unknown."""

    strategy: Strategy = "program"
    """``program``: the model writes a program; ``choice``: it names moving parts and chooses joint
    candidates, and geometry computes every number."""
    model: Model = field(default_factory=default_model)
    cache: Path | None = field(default_factory=cache_folder)
    """Folder for answers; None: no cache."""

    @property
    def name(self) -> str:
        """Name in reports."""
        return "vlm" if self.strategy == "program" else "hybrid"

    def propose(self, evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Prediction:
        """Predict joints, given all earlier attempts.

        Raises:
            UsageError: The request cannot be sent.
        """
        session = ModelSession(model=self.model, cache=self.cache)
        try:
            found = self._predict(session, evidence, attempts)
        except AnswerError as invalid:
            found = Prediction(joints=(), rejection=str(invalid))
        steps = (*session.steps, *found.trace)
        return replace(found, trace=steps, calls=session.calls)

    def _predict(
        self, session: ModelSession, evidence: Evidence, attempts: Sequence[ActorAttempt]
    ) -> Prediction:
        placements = {} if evidence.placed else find_placements(session, evidence)
        placed = evidence if evidence.placed else with_placements(evidence, placements)
        if self.strategy == "choice":
            found = choose_joints(session, placed, attempts)
        else:
            request = program_request(placed, attempts)
            source, built = runnable_program(session, request, placed.parts, joints_error)
            # A program for placed parts does not apply to parts that were given unplaced.
            program = source if evidence.placed else ""
            found = Prediction(joints=program_joints(built), program=program)
        return replace(found, placements=placements)


def program_request(evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Request:
    """Create the request for a program with all joints."""
    task = prompt("joint_program").filled(which=WHICH[evidence.modality], reference=reference())
    content = (*evidence_content(evidence), *describe_attempts(attempts))
    return Request(
        title="a program with all joints",
        system=f"{prompt('frame').filled()}\n\n{task}",
        turns=(Turn("user", content),),
        schema=schema_of(ProgramAnswer),
    )
