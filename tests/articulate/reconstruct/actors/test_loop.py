"""The loop of actor and critic, with both scripted."""

from dataclasses import dataclass, field

import pytest

from articulate.jobs.processor_limit import ProcessorLimitReached, processor_limit
from articulate.reconstruct.actors.loop import Loop
from articulate.reconstruct.actors.protocol import (
    Evidence,
    PredictedJoint,
    Prediction,
    TraceStep,
    Verdict,
)


def joint(name):
    return PredictedJoint(part=name, parent=None, kind="prismatic", lower=0.0, upper=1.0)


@dataclass
class Scripted:
    """Proposes one joint after the other, and records the verdicts it received."""

    names: list
    name: str = "scripted"
    received: list = field(default_factory=list)

    def propose(self, evidence, attempts):
        self.received.append([a.verdict.failure for a in attempts])
        if len(attempts) >= len(self.names):
            return Prediction(joints=(), rejection="nothing more to propose")
        return Prediction(joints=(joint(self.names[len(attempts)]),))


@dataclass
class Rated:
    """Rates by the name of the part."""

    ratings: dict
    name: str = "rated"

    def assess(self, evidence, prediction):
        rating = self.ratings[prediction.joints[0].part]
        failure = "success" if rating > 5.0 else "joint_axis"
        return Verdict(failure=failure, rating=rating)  # type: ignore[arg-type]


EVIDENCE = Evidence(modality="video", parts=())


def run(names, ratings, **options):
    proposer = Scripted(names)
    loop = Loop(proposer=proposer, critic=Rated(ratings), **options)
    return loop.predict(EVIDENCE), proposer


def test_loop_stops_as_soon_as_the_critic_rates_above_five():
    found, _ = run(["a", "b", "c"], {"a": 3.0, "b": 5.1, "c": 9.0})
    assert found.joints[0].part == "b"
    assert len(found.attempts) == 2


def test_a_rating_of_exactly_five_goes_on():
    found, _ = run(["a", "b"], {"a": 5.0, "b": 6.0}, max_iterations=2)
    assert found.joints[0].part == "b"


def test_the_best_rated_is_kept_and_not_the_latest():
    found, _ = run(["a", "b", "c"], {"a": 1.0, "b": 4.0, "c": 2.0})
    assert found.joints[0].part == "b"
    assert found.rating == 4.0
    assert [a.verdict.rating for a in found.attempts] == [1.0, 4.0, 2.0]


def test_of_equals_the_earlier_is_kept():
    found, _ = run(["a", "b", "c"], {"a": 2.0, "b": 2.0, "c": 2.0})
    assert found.joints[0].part == "a"


def test_the_proposer_receives_every_earlier_verdict():
    _, proposer = run(["a", "b"], {"a": 1.0, "b": 9.0})
    assert proposer.received == [[], ["joint_axis"]]


def test_a_refusal_ends_the_loop_and_what_was_best_stays():
    found, _ = run(["a"], {"a": 1.0})
    assert found.joints[0].part == "a"
    assert found.rejection == ""
    assert len(found.attempts) == 1


def test_a_refusal_at_once_is_the_answer():
    found, _ = run([], {})
    assert found.rejection == "nothing more to propose"
    assert found.attempts == ()


@pytest.mark.parametrize("iterations", [1, 3])
def test_without_a_critic_the_first_proposal_is_the_answer(iterations):
    loop = Loop(proposer=Scripted(["a", "b"]), critic=None, max_iterations=iterations)
    found = loop.predict(EVIDENCE)
    assert found.joints[0].part == "a"
    assert found.rating is None
    assert len(found.attempts) == 1


def test_every_verdict_is_a_step_of_the_trace():
    found, _ = run(["a", "b"], {"a": 1.0, "b": 9.0})
    assert [step.title for step in found.trace] == [
        "iteration 1: joint_axis, rated 1.0",
        "iteration 2: success, rated 9.0",
    ]


@dataclass
class Calling:
    """A proposer and a critic in one, both of which ask a model."""

    name: str = "calling"

    def propose(self, evidence, attempts):
        return Prediction(joints=(joint("a"),), calls=2)

    def assess(self, evidence, prediction):
        steps = (TraceStep(title="the critic measures"),)
        return Verdict(failure="joint_axis", rating=1.0, calls=1, trace=steps)


def test_calls_of_all_iterations_and_both_sides_are_summed():
    both = Calling()
    found = Loop(proposer=both, critic=both, max_iterations=3).predict(EVIDENCE)
    assert found.calls == 3 * (2 + 1)
    titles = [step.title.split(":")[0] for step in found.trace]
    assert titles[0::2] == ["the critic measures"] * 3
    assert titles[1::2] == ["iteration 1", "iteration 2", "iteration 3"]


@dataclass
class InTurn:
    """Proposes what the text of the evidence names."""

    name: str = "in turn"

    def propose(self, evidence, attempts):
        return Prediction(joints=(joint(evidence.text),), calls=1)


def sought_besides(ratings):
    def residual(evidence, kept):
        names = ["a", "b", "c"]
        if evidence.text == names[-1]:
            return None
        return Evidence(modality="video", parts=(), text=names[names.index(evidence.text) + 1])

    loop = Loop(proposer=InTurn(), critic=Rated(ratings), max_iterations=1, residual=residual)
    return loop.predict(Evidence(modality="video", parts=(), text="a"))


def test_joints_besides_are_kept_while_the_critic_is_content():
    found = sought_besides({"a": 8.0, "b": 6.0, "c": 9.0})
    assert [j.part for j in found.joints] == ["a", "b", "c"]
    assert found.rating == 8.0
    assert found.calls == 3


def test_a_joint_besides_that_the_critic_doubts_ends_it():
    found = sought_besides({"a": 8.0, "b": 5.0, "c": 9.0})
    assert [j.part for j in found.joints] == ["a"]
    assert found.calls == 2
    assert found.trace


@dataclass
class Endless(Rated):
    """Computes without end from the second proposal on."""

    first: int = 0

    def assess(self, evidence, prediction):
        """Rate the first proposals only."""
        self.first -= 1
        while self.first < 0:
            pass
        return super().assess(evidence, prediction)


def test_a_query_beyond_its_processor_time_is_undecided():
    loop = Loop(proposer=Scripted(["a"]), critic=Endless({}), limit_s=0.05)
    found = loop.predict(EVIDENCE)
    assert found.joints == ()
    assert found.rejection == "undecided: no joint was accepted in 0.05 s of processor time"


def test_an_accepted_joint_remains_if_the_search_for_others_takes_too_long():
    critic = Endless({"a": 9.0}, first=1)
    loop = Loop(
        proposer=Scripted(["a"]),
        critic=critic,
        limit_s=0.05,
        residual=lambda evidence, _: evidence,
    )
    found = loop.predict(EVIDENCE)
    assert [j.part for j in found.joints] == ["a"]
    assert found.rating == 9.0


def test_the_shorter_of_two_limits_ends_a_query():
    loop = Loop(proposer=Scripted(["a"]), critic=Endless({}), limit_s=60.0)
    with pytest.raises(ProcessorLimitReached), processor_limit(0.05):
        loop.predict(EVIDENCE)
