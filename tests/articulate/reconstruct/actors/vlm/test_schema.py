from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import pytest

from articulate.reconstruct.actors.vlm.answers import (
    Choices,
    CriticAnswer,
    MovingParts,
    ProgramAnswer,
)
from articulate.reconstruct.actors.vlm.schema import AnswerError, decode_answer, schema_of


@dataclass(frozen=True, kw_only=True)
class Leaf:
    """A leaf.

    More of it, which models are not told.
    """

    kind: Annotated[Literal["a", "b"], "Which."]
    size: Annotated[float | None, "How large, if known."]


@dataclass(frozen=True, kw_only=True)
class Tree:
    """A tree."""

    leaves: Annotated[tuple[Leaf, ...], "All leaves."]
    at: Annotated[tuple[float, float, float], "Where."]
    old: Annotated[bool, "Whether it is."]


def test_a_schema_says_names_types_and_meaning_of_all_fields():
    leaf = {
        "type": "object",
        "description": "A leaf.",
        "properties": {
            "kind": {"type": "string", "enum": ["a", "b"], "description": "Which."},
            "size": {"type": ["number", "null"], "description": "How large, if known."},
        },
        "required": ["kind", "size"],
        "additionalProperties": False,
    }
    where = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    assert schema_of(Tree) == {
        "type": "object",
        "description": "A tree.",
        "properties": {
            "leaves": {"type": "array", "items": leaf, "description": "All leaves."},
            "at": {**where, "description": "Where."},
            "old": {"type": "boolean", "description": "Whether it is."},
        },
        "required": ["leaves", "at", "old"],
        "additionalProperties": False,
    }


def test_an_answer_is_decode_answer_into_its_type():
    text = '{"leaves": [{"kind": "b", "size": null}], "at": [1, 2.5, -3], "old": true}'
    leaf = Leaf(kind="b", size=None)
    assert decode_answer(Tree, text) == Tree(leaves=(leaf,), at=(1.0, 2.5, -3.0), old=True)


LEAF = '{"leaves": [{"kind": "c", "size": 1}], "at": [1, 2, 3], "old": true}'


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "not JSON"),
        ("null", "must be a JSON object"),
        ('{"leaves": [], "at": [1, 2], "old": true}', "at is [1, 2]; it must be a list of 3"),
        ('{"leaves": [], "at": [1, 2, Infinity], "old": true}', "Infinity is not a number"),
        (LEAF, "leaves[0].kind is 'c'; it must be one of a, b"),
        ('{"leaves": [], "at": [1, 2, 3], "old": "yes"}', "old is 'yes'; it must be true or false"),
        ('{"leaves": [], "at": [1, 2, 3]}', "old is missing"),
        ('{"leaves": ' + "[" * 200_000, "nested too deeply"),
        ('{"leaves": [], "at": [1, 2, 3], "old": "\\ud800"}', "contains a surrogate"),
        ('{"leaves": "' + "x" * 1_000_000, "characters; at most"),
        ('{"\\udc00": 1}', "contains a surrogate"),
    ],
)
def test_what_does_not_fit_is_said_with_its_place(text, complaint):
    with pytest.raises(AnswerError) as caught:
        decode_answer(Tree, text)
    assert complaint in str(caught.value)


@pytest.mark.parametrize("cls", [ProgramAnswer, MovingParts, Choices, CriticAnswer])
def test_every_field_of_every_answer_is_explained(cls):
    def fields(schema):
        for field in schema.get("properties", {}).values():
            yield field
            yield from fields(field.get("items", {}))

    found = list(fields(schema_of(cls)))
    assert found
    assert all(field["description"].endswith(".") for field in found)
