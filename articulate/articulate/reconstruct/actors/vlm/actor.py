"""The actors of the command line: a proposer and a critic in a loop."""

from __future__ import annotations

from dataclasses import dataclass, field

from articulate.reconstruct.actors.geometric.critic import VideoCritic
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import Critic, Evidence, Prediction, Verdict
from articulate.reconstruct.actors.vlm.joint_actor import JointActor
from articulate.reconstruct.actors.vlm.joint_critic import JointCritic

TURNS = 5
"""Most proposals: one for each of the four failures that a critic may name, and one more."""


def vlm_actor() -> Loop:
    """A model writes programs, and a model judges them."""
    return Loop(proposer=JointActor(way="program"), critic=JointCritic(), max_iterations=TURNS)


def hybrid_actor() -> Loop:
    """A model says what is semantic, geometry computes every number, and judges clips."""
    return Loop(proposer=JointActor(way="choice"), critic=HybridCritic(), max_iterations=TURNS)


@dataclass(frozen=True, kw_only=True)
class HybridCritic:
    """Geometry judges what can be measured in a clip; a model judges the rest."""

    measured: Critic = field(default_factory=VideoCritic)
    seen: Critic = field(default_factory=JointCritic)
    name: str = "hybrid"

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """What is wrong with the prediction, if anything is."""
        return self.chosen(evidence).assess(evidence, prediction)

    def chosen(self, evidence: Evidence) -> Critic:
        """Who judges such evidence."""
        can_measure = evidence.video is not None and evidence.camera is not None and evidence.placed
        return self.measured if can_measure else self.seen
