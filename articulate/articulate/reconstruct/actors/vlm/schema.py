"""Schema: the JSON schema of a dataclass, and answers decoded into it."""

from __future__ import annotations

import dataclasses
import inspect
import json
import types
import typing
from typing import Any, Literal, TypeVar, Union

from articulate.config import from_mapping
from articulate.errors import ConfigError

T = TypeVar("T")
_WORDS: dict[Any, str] = {bool: "boolean", int: "integer", float: "number", str: "string"}


class Unfit(Exception):  # noqa: N818  # a verdict
    """An answer that does not fit its schema; the sentence is for the model."""


def schema_of(cls: type[Any]) -> dict[str, Any]:
    """JSON schema of a dataclass, its fields in their order.

    What stands behind the type in ``Annotated`` is what a model is told of the field.
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


def decoded(cls: type[T], text: str) -> T:
    """The answer that ``text`` holds.

    Raises:
        Unfit: It is not JSON, or not of the schema.
    """
    try:
        content = json.loads(text, parse_constant=_refused)
        json.dumps(content, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise Unfit("the answer is nested too deeply") from None
    except UnicodeEncodeError:
        raise Unfit("the answer holds half a character (a surrogate); write all of it") from None
    except ValueError as error:
        raise Unfit(f"the answer is not JSON: {error}") from None
    if not isinstance(content, dict):
        raise Unfit(f"the answer is {type(content).__name__}; it must be a JSON object")
    try:
        return from_mapping(cls, content, "the answer")
    except ConfigError as error:
        raise Unfit(str(error)) from None


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


def _refused(word: str) -> Any:
    raise ValueError(f"{word} is no number of JSON")
