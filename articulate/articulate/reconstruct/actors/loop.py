"""Loop of proposer and critic: until the critic accepts a proposal or the iterations end.

The proposal of the best rating is returned, the earliest of equals. Ground truth is never used.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from articulate.jobs.processor_limit import ProcessorLimitReached, processor_limit
from articulate.reconstruct.actors.protocol import (
    GOOD_ENOUGH,
    ActorAttempt,
    Critic,
    Evidence,
    Prediction,
    TraceStep,
)

MAX_ITERATIONS = 3
LIMIT_S = 600.0
"""Default processor time of a query [s]."""


class Proposer(Protocol):
    """Actor that can propose again after its proposals were rejected."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def propose(self, evidence: Evidence, attempts: Sequence[ActorAttempt]) -> Prediction:
        """Return the next proposal, given all earlier attempts with their verdicts.

        A prediction with a ``rejection`` ends the loop: there is nothing more to propose.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A proposer and a critic as one actor."""

    proposer: Proposer
    critic: Critic | None
    """None: the first proposal is returned."""
    max_iterations: int = MAX_ITERATIONS
    """Proposals at most."""
    prepare: Callable[[Evidence], tuple[Evidence, tuple[TraceStep, ...]]] | None = None
    """Preprocessing of the evidence before the first proposal, with its trace."""
    residual: Callable[[Evidence, Prediction], Evidence | None] | None = None
    """Evidence without the motion that an accepted prediction explains, in which further joints are
    sought; None if nothing is left."""
    limit_s: float = LIMIT_S
    """Processor time after which a query ends, undecided unless a proposal was accepted [s]."""

    @property
    def name(self) -> str:
        """Name in reports."""
        return self.proposer.name

    def predict(self, evidence: Evidence) -> Prediction:
        """Return the proposal of the best rating, and further moving joints.

        Each of these must be accepted by the critic; the verdict is that of the first. A query that
        reaches its limit of processor time is undecided: it has no joint.
        """
        known: list[Prediction] = []
        try:
            with processor_limit(self.limit_s):
                return self._predict(evidence, known)
        except ProcessorLimitReached as error:
            if error.seconds != self.limit_s:  # a shorter limit of the caller
                raise
            if known:  # accepted; only further joints were sought
                return known[-1]
            reason = f"undecided: no joint was accepted in {self.limit_s:g} s of processor time"
            return Prediction(joints=(), rejection=reason)

    def _predict(self, evidence: Evidence, accepted: list[Prediction]) -> Prediction:
        """Return the prediction; each state of it with an accepted joint goes to ``accepted``."""
        steps: tuple[TraceStep, ...] = ()
        if self.prepare is not None:
            evidence, steps = self.prepare(evidence)
        kept = self._best(evidence)
        kept = replace(kept, trace=(*steps, *kept.trace))
        while self.residual is not None and self.critic is not None and not kept.rejection:
            if _rating(kept) > GOOD_ENOUGH:
                accepted.append(kept)
            remaining = self.residual(evidence, kept)
            if remaining is None:
                break
            evidence, more = remaining, self._best(remaining)
            known = {joint.part for joint in kept.joints}
            new = tuple(joint for joint in more.joints if joint.part not in known)
            trace, calls = (*kept.trace, *more.trace), kept.calls + more.calls
            kept = replace(kept, trace=trace, calls=calls)
            if more.rejection or not new or _rating(more) <= GOOD_ENOUGH:
                break
            kept = replace(kept, joints=(*kept.joints, *new))
        return kept

    def _best(self, evidence: Evidence) -> Prediction:
        """Return the proposal of the best rating."""
        attempts: list[ActorAttempt] = []
        trace: list[TraceStep] = []
        kept: Prediction | None = None
        calls = 0
        for iteration in range(max(1, self.max_iterations if self.critic else 1)):
            start = time.monotonic()
            proposal = self.proposer.propose(evidence, attempts)
            trace += proposal.trace
            calls += proposal.calls
            if proposal.rejection:
                kept = kept or proposal
                break
            assessed = self._assessed(evidence, proposal)
            seconds = time.monotonic() - start
            attempts.append(
                ActorAttempt(joints=proposal.joints, verdict=assessed.verdict, seconds=seconds)
            )
            if assessed.verdict is not None:
                trace += [*assessed.verdict.trace, _step(iteration, assessed)]
                calls += assessed.verdict.calls
            if kept is None or _rating(assessed) > _rating(kept):
                kept = assessed
            if self.critic is None or _rating(assessed) > GOOD_ENOUGH:
                break
        assert kept is not None
        return replace(kept, attempts=tuple(attempts), trace=tuple(trace), calls=calls)

    def _assessed(self, evidence: Evidence, proposal: Prediction) -> Prediction:
        if self.critic is None:
            return proposal
        verdict = self.critic.assess(evidence, proposal)
        return replace(proposal, verdict=verdict, rating=verdict.rating)


def _rating(prediction: Prediction) -> float:
    return -1.0 if prediction.rating is None else prediction.rating


def _step(iteration: int, assessed: Prediction) -> TraceStep:
    verdict = assessed.verdict
    assert verdict is not None
    return TraceStep(
        title=f"iteration {iteration + 1}: {verdict.failure}, rated {verdict.rating:.1f}",
        text=verdict.reason,
        figures=verdict.figures,
        images=verdict.images,
    )
