"""Loop: an actor proposes, a critic judges, until the critic is content or turns run out.

What is kept is what the critic rated best, and of equals the earlier. The truth is never asked.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from articulate.reconstruct.actors.protocol import (
    GOOD_ENOUGH,
    ActorAttempt,
    Critic,
    Evidence,
    Prediction,
    TraceStep,
)

MAX_ITERATIONS = 3


class Proposer(Protocol):
    """An actor that can try again, knowing what was said of what it proposed before."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def propose(self, evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Prediction:
        """What to say next, given every earlier attempt with its verdict.

        A prediction with a ``rejection`` ends the loop: there is nothing more to propose.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A proposer and a critic as one actor."""

    proposer: Proposer
    critic: Critic | None
    """None: the first proposal is the answer."""
    max_iterations: int = MAX_ITERATIONS
    """Most proposals."""
    prepare: Callable[[Evidence], tuple[Evidence, tuple[TraceStep, ...]]] | None = None
    """What is done with the evidence before the first proposal, and what is told of it."""
    rest: Callable[[Evidence, Prediction], Evidence | None] | None = None
    """What is left of the evidence once a prediction is believed, in which more joints are sought;
    None if nothing is."""

    @property
    def name(self) -> str:
        """Name in reports."""
        return self.proposer.name

    def predict(self, evidence: Evidence) -> Prediction:
        """The proposal that the critic rated best, and joints that move besides.

        Of these the critic must be content with each; the verdict is that of the first.
        """
        steps: tuple[TraceStep, ...] = ()
        if self.prepare is not None:
            evidence, steps = self.prepare(evidence)
        kept = self._best(evidence)
        kept = replace(kept, trace=(*steps, *kept.trace))
        while self.rest is not None and self.critic is not None and not kept.rejection:
            left = self.rest(evidence, kept)
            if left is None:
                break
            evidence, more = left, self._best(left)
            known = {joint.part for joint in kept.joints}
            new = tuple(joint for joint in more.joints if joint.part not in known)
            trace, calls = (*kept.trace, *more.trace), kept.calls + more.calls
            kept = replace(kept, trace=trace, calls=calls)
            if more.rejection or not new or _rating(more) <= GOOD_ENOUGH:
                break
            kept = replace(kept, joints=(*kept.joints, *new))
        return kept

    def _best(self, evidence: Evidence) -> Prediction:
        """The proposal that the critic rated best."""
        attempts: list[ActorAttempt] = []
        trace: list[TraceStep] = []
        kept: Prediction | None = None
        calls = 0
        for turn in range(max(1, self.max_iterations if self.critic else 1)):
            start = time.monotonic()
            proposal = self.proposer.propose(evidence, attempts)
            trace += proposal.trace
            calls += proposal.calls
            if proposal.rejection:
                kept = kept or proposal
                break
            judged = self._judged(evidence, proposal)
            seconds = time.monotonic() - start
            attempts.append(
                ActorAttempt(joints=proposal.joints, verdict=judged.verdict, seconds=seconds)
            )
            if judged.verdict is not None:
                trace += [*judged.verdict.trace, _step(turn, judged)]
                calls += judged.verdict.calls
            if kept is None or _rating(judged) > _rating(kept):
                kept = judged
            if self.critic is None or _rating(judged) > GOOD_ENOUGH:
                break
        assert kept is not None
        return replace(kept, attempts=tuple(attempts), trace=tuple(trace), calls=calls)

    def _judged(self, evidence: Evidence, proposal: Prediction) -> Prediction:
        if self.critic is None:
            return proposal
        verdict = self.critic.assess(evidence, proposal)
        return replace(proposal, verdict=verdict, rating=verdict.rating)


def _rating(prediction: Prediction) -> float:
    return -1.0 if prediction.rating is None else prediction.rating


def _step(turn: int, judged: Prediction) -> TraceStep:
    verdict = judged.verdict
    assert verdict is not None
    return TraceStep(
        title=f"turn {turn + 1}: {verdict.failure}, rated {verdict.rating:.1f}",
        text=verdict.reason,
        figures=verdict.figures,
        images=verdict.images,
    )
