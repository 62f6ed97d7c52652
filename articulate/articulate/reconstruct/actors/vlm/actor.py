"""Actors of the command line: a proposer and a critic in a loop."""

from __future__ import annotations

from dataclasses import dataclass, field

from articulate.reconstruct.actors.geometric.critic import VideoCritic
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import Critic, Evidence, Prediction, Verdict
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic

MAX_PROPOSALS = 5
"""One for each of the four failures that a critic may name, and one more."""

N_EXAMPLES = 5
"""In-context examples of each agent: one for each verdict of the critic."""


def vlm_actor() -> Loop:
    """Create the actor in which a model writes programs and assesses them."""
    return Loop(
        proposer=JointActor(
            strategy="program", examples=N_EXAMPLES, assess_placements=True, targeted=True
        ),
        critic=JointCritic(examples=N_EXAMPLES),
        max_iterations=MAX_PROPOSALS,
    )


def hybrid_actor() -> Loop:
    """Create the actor in which a model chooses joint candidates and geometry computes numbers."""
    return Loop(
        proposer=JointActor(strategy="choice", examples=N_EXAMPLES, assess_placements=True),
        critic=HybridCritic(visual=JointCritic(examples=N_EXAMPLES)),
        max_iterations=MAX_PROPOSALS,
    )


@dataclass(frozen=True, kw_only=True)
class HybridCritic:
    """Critic that measures videos with a known camera and uses a model for all other evidence."""

    geometric: Critic = field(default_factory=VideoCritic)
    visual: Critic = field(default_factory=JointCritic)
    name: str = "hybrid"

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """Assess a prediction with the critic that fits the evidence."""
        return self.critic_for(evidence).assess(evidence, prediction)

    def critic_for(self, evidence: Evidence) -> Critic:
        """Return the critic for such evidence."""
        can_measure = evidence.video is not None and evidence.camera is not None and evidence.placed
        return self.geometric if can_measure else self.visual
