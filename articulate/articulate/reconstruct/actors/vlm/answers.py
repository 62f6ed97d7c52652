"""Types of the answers of a model; docstrings and annotations go into the JSON schema."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Literal

from articulate.errors import ConfigError, quote
from articulate.reconstruct.actors.protocol import Failure

MovingKind = Literal["revolute", "prismatic", "continuous"]
Direction = Literal["positive", "negative", "both"]
MAX_RATING = 10.0
MAX_PARTS = 8
MIN_SIDE_M, MAX_SIDE_M = 0.002, 10.0
"""Smallest and largest side of a planned part [m]."""


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
        check_rating(self.rating)


@dataclass(frozen=True, kw_only=True)
class PlacementCriticAnswer:
    """Assessment of a placement of parts by its appearance."""

    differences: Annotated[str, "Visible differences between the image and the rendering."]
    correction: Annotated[str, "The part that is misplaced and its correction; empty if none is."]
    rating: Annotated[float, "0 (nothing fits) to 10 (no visible difference); above 5: accepted."]

    def __post_init__(self) -> None:
        """Check that the rating is on the scale."""
        check_rating(self.rating)


@dataclass(frozen=True, kw_only=True)
class MovedPart:
    """The part that moves in a video."""

    observation: Annotated[str, "Visible motion: which part, along or about what. One sentence."]
    part: Annotated[str, "Name of the part that moves, as in the list of parts."]
    colour: Annotated[str, "Colour of that part in the coloured image, as #rrggbb."]


@dataclass(frozen=True, kw_only=True)
class DetectedObject:
    """The object of an image or video, and its affordance."""

    description: Annotated[str, "Appearance of the object: kind, shape, parts. Two sentences."]
    kind: Annotated[str, "Kind of object in one to three words, e.g. washing machine."]
    affordance: Annotated[str, "The part that moves or can move, and its motion. One sentence."]


@dataclass(frozen=True, kw_only=True)
class SelectedCategories:
    """The categories of a library that fit a description."""

    reason: Annotated[str, "Reason for the selection, in one sentence."]
    categories: Annotated[tuple[str, ...], "Names from the list, the best first; one to three."]


@dataclass(frozen=True, kw_only=True)
class SelectedObject:
    """The candidate that is most similar to an object."""

    reason: Annotated[str, "Same parts, arrangement and proportions as the object: one sentence."]
    candidate: Annotated[int, "Number of the most similar candidate."]


@dataclass(frozen=True, kw_only=True)
class DenseDescription:
    """A short request extended to a description of all visible parts."""

    reason: Annotated[str, "Usual parts of such an object, and which of them move. One sentence."]
    description: Annotated[str, "The object with all parts, their number and arrangement."]


@dataclass(frozen=True, kw_only=True)
class PlannedPart:
    """A part of a planned object."""

    name: Annotated[str, "Name: a word or two with underscores, unique, e.g. drawer_1."]
    description: Annotated[str, "Shape, material and function, in a few words."]
    size: Annotated[
        tuple[float, float, float], "Extent along x (depth), y (width), z (height) [m]."
    ]

    def __post_init__(self) -> None:
        """Check name and size."""
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,39}", self.name):
            raise ConfigError(f"name {quote(self.name)} must be lower-case letters, digits and _")
        if not all(MIN_SIDE_M <= side <= MAX_SIDE_M for side in self.size):
            raise ConfigError(f"size of {self.name} must be {MIN_SIDE_M:g} to {MAX_SIDE_M:g} m")


@dataclass(frozen=True, kw_only=True)
class Layout:
    """The parts of an object and their sizes."""

    parts: Annotated[tuple[PlannedPart, ...], "Two to eight parts; the body first."]

    def __post_init__(self) -> None:
        """Check the number of parts and that names are unique."""
        if not 2 <= len(self.parts) <= MAX_PARTS:
            raise ConfigError(f"{len(self.parts)} parts; there must be 2 to {MAX_PARTS}")
        names = [part.name for part in self.parts]
        if len(set(names)) < len(names):
            raise ConfigError("two parts have the same name; make names unique")


@dataclass(frozen=True, kw_only=True)
class PartCaption:
    """Caption of one part."""

    part: Annotated[str, "Name of the part, as in the list."]
    caption: Annotated[str, "Shape, material and function without colour, in a few words."]


@dataclass(frozen=True, kw_only=True)
class PartCaptions:
    """Captions of all parts of an object."""

    captions: Annotated[tuple[PartCaption, ...], "One for each part of the list."]


def check_rating(rating: float) -> None:
    """Check that a rating is on the scale.

    Raises:
        ConfigError: It is not.
    """
    if not 0.0 <= rating <= MAX_RATING:
        raise ConfigError(f"rating is {rating:g}; it must be in [0, 10]")
