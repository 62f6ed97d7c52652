"""Types of the answers of a model; docstrings and annotations go into the JSON schema."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from articulate.errors import ConfigError
from articulate.reconstruct.actors.protocol import Failure

MovingKind = Literal["revolute", "prismatic", "continuous"]
Direction = Literal["positive", "negative", "both"]
MAX_RATING = 10.0


@dataclass(frozen=True, kw_only=True)
class ProgramAnswer:
    """A program that describes how the object is put together."""

    observation: Annotated[
        str, "What is visible: the object, which parts move, how. Two sentences."
    ]
    program: Annotated[str, "The complete program, and nothing else."]


@dataclass(frozen=True, kw_only=True)
class MovingPart:
    """A part that moves."""

    part: Annotated[str, "Name of the part, as in the list of parts."]
    kind: Annotated[
        MovingKind,
        "prismatic: it slides; revolute: it turns between two limits; continuous: it turns without "
        "limits.",
    ]
    why: Annotated[str, "The visible evidence for it, in a few words."]


@dataclass(frozen=True, kw_only=True)
class MovingParts:
    """The parts that move, and the kinds of their joints."""

    observation: Annotated[
        str, "What is visible: the object, and what happens to it. Two sentences."
    ]
    movers: Annotated[tuple[MovingPart, ...], "The parts that move; empty if none does."]


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The joint of one part, chosen among candidates."""

    part: Annotated[str, "Name of the part."]
    candidate: Annotated[int, "Number of the candidate."]
    opens: Annotated[
        Direction,
        "Direction in which the part moves from its present pose: the one that is called positive, "
        "the opposite one, or both.",
    ]


@dataclass(frozen=True, kw_only=True)
class Choices:
    """The joints, chosen among candidates."""

    reason: Annotated[str, "The reason for the choice, in one or two sentences."]
    choices: Annotated[tuple[Choice, ...], "One for each part that moves."]


@dataclass(frozen=True, kw_only=True)
class CriticAnswer:
    """The first error of a prediction, if there is one."""

    observed: Annotated[str, "How the part moves in the evidence. One sentence."]
    predicted: Annotated[str, "How it moves in the prediction. One sentence."]
    failure: Annotated[Failure, "success, or the first of these that is wrong, in this order."]
    rating: Annotated[
        float, "0 (nothing fits) to 10 (no visible difference); above 5: good enough."
    ]
    reason: Annotated[str, "What is wrong and what to change, in one sentence."]

    def __post_init__(self) -> None:
        """Check that the rating is on the scale."""
        if not 0.0 <= self.rating <= MAX_RATING:
            raise ConfigError(f"rating is {self.rating:g}; it must be in [0, 10]")
