"""What models are asked to answer, as types."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from articulate.errors import ConfigError
from articulate.reconstruct.actors.protocol import Failure

TurningKind = Literal["revolute", "prismatic", "continuous"]
Way = Literal["positive", "negative", "both"]
MOST_RATING = 10.0


@dataclass(frozen=True, kw_only=True)
class ProgramAnswer:
    """A program that says how the object is put together."""

    seen: Annotated[str, "What is seen: the object, which parts move, how. Two sentences."]
    program: Annotated[str, "The whole program, and nothing else."]


@dataclass(frozen=True, kw_only=True)
class Mover:
    """A part that moves."""

    part: Annotated[str, "Name of the part, as in the list of parts."]
    kind: Annotated[
        TurningKind,
        "prismatic: it slides; revolute: it turns between two ends; continuous: it turns for ever.",
    ]
    why: Annotated[str, "What shows it, in a few words."]


@dataclass(frozen=True, kw_only=True)
class Movers:
    """Which parts move, and of what kind their joints are."""

    seen: Annotated[str, "What is seen: the object, and what happens to it. Two sentences."]
    movers: Annotated[tuple[Mover, ...], "The parts that move; empty if none does."]


@dataclass(frozen=True, kw_only=True)
class Pick:
    """The joint of one part, chosen among candidates."""

    part: Annotated[str, "Name of the part."]
    candidate: Annotated[int, "Number of the candidate."]
    opens: Annotated[
        Way,
        "Which way the part goes from where it is given: the way that is called positive, the "
        "other, or both.",
    ]


@dataclass(frozen=True, kw_only=True)
class Picks:
    """The joints, chosen among candidates."""

    seen: Annotated[str, "Why these, in one or two sentences."]
    picks: Annotated[tuple[Pick, ...], "One for each part that was asked for."]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What is wrong with a prediction, if anything is."""

    given: Annotated[str, "How the part moves in what was given. One sentence."]
    predicted: Annotated[str, "How it moves in the prediction. One sentence."]
    failure: Annotated[Failure, "success, or the first of these that is wrong, in this order."]
    rating: Annotated[
        float, "0 (nothing fits) to 10 (no difference is seen); above 5: good enough."
    ]
    reason: Annotated[str, "What is wrong and what to change, in one sentence."]

    def __post_init__(self) -> None:
        """Refuse ratings beyond the scale."""
        if not 0.0 <= self.rating <= MOST_RATING:
            raise ConfigError(f"rating is {self.rating:g}; it must be in [0, 10]")
