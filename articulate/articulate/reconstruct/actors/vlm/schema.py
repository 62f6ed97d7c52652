"""JSON schemas of dataclasses, and answers decoded into them."""

from __future__ import annotations

import dataclasses
import inspect
import json
import types
import typing
from typing import Any, Literal, TypeVar, Union

from articulate.config import from_mapping
from articulate.errors import ConfigError, shorten

T = TypeVar("T")
MAX_CHARACTERS = 1_000_000
"""Longest answer that is decoded."""
MAX_ERROR = 400
"""Most characters of an error that is sent back to the model."""
_WORDS: dict[Any, str] = {bool: "boolean", int: "integer", float: "number", str: "string"}


class AnswerError(Exception):
    """An answer is invalid; the message is sent to the model."""


def schema_of(cls: type[Any]) -> dict[str, Any]:
    """Return the JSON schema of a dataclass, its fields in their order.

    The text behind the type in ``Annotated`` becomes the description of the field.
    """
    hints = typing.get_type_hints(cls, include_extras=True)
    properties = {}
    for field in dataclasses.fields(cls):
        hint, *about = typing.get_args(hints[field.name])
        properties[field.name] = {**_schema(hint), "description": about[0]}
    return {
        "type": "object",
        "description": inspect.cleandoc(cls.__doc__ or "").splitlines()[0],
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def decode_answer(cls: type[T], text: str) -> T:
    """Decode an answer.

    Args:
        cls: Dataclass of the answer.
        text: JSON text of the model.

    Raises:
        AnswerError: It is too long, not JSON, or does not match the schema.
    """
    if len(text) > MAX_CHARACTERS:
        raise AnswerError(f"the answer has {len(text)} characters; at most {MAX_CHARACTERS}")
    try:
        content = json.loads(text, parse_constant=_reject_constant)
        json.dumps(content, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise AnswerError("the answer is nested too deeply") from None
    except UnicodeEncodeError:
        raise AnswerError("the answer contains a surrogate; write complete characters") from None
    except ValueError as error:
        raise AnswerError(f"the answer is not JSON: {shorten(error)}") from None
    if not isinstance(content, dict):
        raise AnswerError(f"the answer is {type(content).__name__}; it must be a JSON object")
    try:
        return from_mapping(cls, content, "the answer")
    except ConfigError as error:
        raise AnswerError(shorten(error, MAX_ERROR)) from None


def _schema(hint: Any) -> dict[str, Any]:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        return {"type": "string", "enum": list(args)}
    if origin is tuple:
        if len(args) == 2 and args[1] is Ellipsis:
            return {"type": "array", "items": _schema(args[0])}
        n = len(args)
        return {"type": "array", "items": _schema(args[0]), "minItems": n, "maxItems": n}
    if origin in (Union, types.UnionType):
        [one] = [_schema(a) for a in args if a is not types.NoneType]
        return {**one, "type": [one["type"], "null"]}
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return schema_of(hint)
    return {"type": _WORDS[hint]}


def _reject_constant(word: str) -> Any:
    raise ValueError(f"{word} is not a number in JSON")
