"""Actor that finds joints with a model, by a program or by a choice among candidates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from articulate.cache import cache_folder
from articulate.reconstruct.actors.protocol import ActorAttempt, Evidence, Prediction
from articulate.reconstruct.actors.vlm.affordance import moved_part
from articulate.reconstruct.actors.vlm.answers import ProgramAnswer
from articulate.reconstruct.actors.vlm.examples import example_content, example_object
from articulate.reconstruct.actors.vlm.hybrid import choose_joints
from articulate.reconstruct.actors.vlm.link_actor import find_placements
from articulate.reconstruct.actors.vlm.model import Content, Model, Request, Turn
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
    examples: int = 0
    """Number of in-context examples."""
    assess_placements: bool = False
    """Use the link critic for parts that are not placed."""
    targeted: bool = False
    """Let the model name the part that moves in a video before it writes a program."""

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
        placements = {}
        if not evidence.placed:
            placements = find_placements(
                session, evidence, examples=self.examples, assessed=self.assess_placements
            )
        placed = evidence if evidence.placed else with_placements(evidence, placements)
        if self.strategy == "choice":
            found = choose_joints(session, placed, attempts)
        else:
            target = ""
            if self.targeted and evidence.video is not None and not _wrong_part(attempts):
                target = moved_part(session, evidence, self.examples)
            request = program_request(placed, attempts, examples=self.examples, target=target)
            source, built = runnable_program(session, request, placed.parts, joints_error)
            # A program for placed parts does not apply to parts that were given unplaced.
            program = source if evidence.placed else ""
            found = Prediction(joints=program_joints(built), program=program)
        return replace(found, placements=placements)


def program_request(
    evidence: Evidence,
    attempts: Sequence[ActorAttempt],
    *,
    examples: int = 0,
    target: str = "",
) -> Request:
    """Create the request for a program with all joints.

    Args:
        evidence: Parts and input.
        attempts: Earlier proposals.
        examples: Number of in-context examples.
        target: Part that moves in the video; empty if it is unknown.
    """
    task = prompt("joint_program").filled(which=WHICH[evidence.modality], reference=reference())
    hint = (f"The part that moves in the video is {target}.",) if target else ()
    content = (
        *example_content("joint", examples, _example),
        *evidence_content(evidence),
        *hint,
        *describe_attempts(attempts),
    )
    return Request(
        title="a program with all joints",
        system=f"{prompt('frame').filled()}\n\n{task}",
        turns=(Turn("user", content),),
        schema=schema_of(ProgramAnswer),
    )


def _example(k: int) -> tuple[Iterable[Content], ProgramAnswer]:
    """Return placed parts of an example and the program that joins them."""
    known = example_object(k)
    moving = [f"{j.part} ({j.kind})" for j in known.joints if j.kind != "fixed"]
    answer = ProgramAnswer(
        observation=f"A {known.part_set.kind}. These parts move: {', '.join(moving)}.",
        program=known.program,
    )
    return evidence_content(known.evidence), answer


def _wrong_part(attempts: Sequence[ActorAttempt]) -> bool:
    """Return whether the critic rejected part or kind of the last proposal."""
    last = attempts[-1].verdict if attempts else None
    return last is not None and last.failure == "joint_type"
