"""Fields of a dataclass as flags, for parsing, ``--help`` and completion.

A field is a flag ``--name-of-field``; fields of a nested dataclass are ``--set outer.inner=value``.
A field ``Annotated[Path, POSITIONAL]`` is an argument without a name, and one that is marked
``ADVANCED`` is listed by ``--help-all`` only.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import re
import sys
import textwrap
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from articulate.config import number_of, options_of
from articulate.errors import ConfigError, nearest, quote

MISSING = dataclasses.MISSING
_WORDS = {
    int: ("INT", "an integer"),
    float: ("NUMBER", "a number"),
    bool: ("true|false", "true or false"),
    str: ("TEXT", "text"),
    Path: ("PATH", "a path"),
}
_ROLES = re.compile(r":\w+:`([^`]*)`|``?([^`]*)``?")


class _Mark:
    """Annotation of a field, compared by its name."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


POSITIONAL = _Mark("Positional")
"""Marks a field as an argument without a name."""
ADVANCED = _Mark("Advanced")
"""Marks a flag that ``--help`` omits and ``--help-all`` lists."""


@dataclass(frozen=True)
class Flag:
    """One flag or argument."""

    path: tuple[str, ...]
    """Names of the fields from the outermost to the innermost."""
    hint: Any
    """Type, without None and annotations."""
    default: Any
    """Default value; MISSING if the flag is required."""
    positional: bool = False
    optional: bool = False
    """True if it may be None."""
    advanced: bool = False
    """True if ``--help`` omits it."""

    @property
    def name(self) -> str:
        """Text on the command line: ``--out``, ``--set ppo.batch_size`` or ``RUN``."""
        if self.positional:
            return self.path[-1].upper().replace("_", "-")
        return f"--set {self.key}" if self.is_nested else "--" + self.key.replace("_", "-")

    @property
    def key(self) -> str:
        """Key of ``--set`` and of YAML files: ``ppo.batch_size``."""
        return ".".join(self.path)

    @property
    def is_nested(self) -> bool:
        """True for fields of nested dataclasses, which are set by ``--set``."""
        return len(self.path) > 1

    @property
    def is_switch(self) -> bool:
        """True if it has no value."""
        return self.hint is bool

    @property
    def items(self) -> tuple[Any, ...] | None:
        """Types of its values if it has a fixed number of several; None otherwise."""
        args = typing.get_args(self.hint)
        fixed = typing.get_origin(self.hint) is tuple and args[-1] is not Ellipsis
        return args if fixed else None

    @property
    def is_list(self) -> bool:
        """True if it has any number of values."""
        args = typing.get_args(self.hint)
        return typing.get_origin(self.hint) is tuple and args[-1] is Ellipsis

    @property
    def choices(self) -> tuple[str, ...]:
        """Accepted values of a ``Literal``."""
        item = typing.get_args(self.hint)[0] if self.is_list else self.hint
        return tuple(map(str, typing.get_args(item))) if _is_literal(item) else ()

    @property
    def metavar(self) -> str:
        """Placeholder of its value in ``--help``."""
        if self.is_switch:
            return ""
        if self.items is not None:
            return " ".join(_metavar(item) for item in self.items)
        if self.is_list:
            return f"{_metavar(typing.get_args(self.hint)[0])} ..."
        return _metavar(self.hint)

    def value(self, words: list[str]) -> Any:
        """Convert ``words`` to the value.

        Raises:
            ConfigError: They are not accepted.
        """
        if self.optional and words in (["None"], ["null"]):
            return None
        if self.items is not None:
            if len(words) != len(self.items):
                count = f"{len(words)} value{'s' * (len(words) != 1)}"
                raise ConfigError(f"{self.name} has {count}; it takes {len(self.items)}")
            return tuple(self._one(i, w) for i, w in zip(self.items, words, strict=True))
        if self.is_list:
            item = typing.get_args(self.hint)[0]
            return tuple(self._one(item, word) for word in words)
        return self._one(self.hint, words[0])

    def value_of_text(self, text: str) -> Any:
        """Convert the text after ``--set key=``; several values are separated by commas or spaces.

        Raises:
            ConfigError: It is not accepted.
        """
        if self.items is None and not self.is_list:
            return self.value([text])
        return self.value(text.strip("[]()").replace(",", " ").split())

    def _one(self, hint: Any, word: str) -> Any:
        for option in _options(hint):
            if _is_literal(option):
                for choice in typing.get_args(option):
                    if str(choice) == word:
                        return choice
            elif option in (str, Path):
                return option(word)
            elif option in (int, float):
                number = number_of(option, word)
                if number is not None:
                    return number
            elif option is bool and word in ("true", "false"):
                return word == "true"
        close = nearest(word, self.choices) if self.choices else ""
        close = close if "did you mean" in close else ""
        raise ConfigError(f"{self.name} is {quote(word)}; it must be {_accepted(hint)}{close}")


def flags_of(cls: type[Any], default: Any = None, path: tuple[str, ...] = ()) -> Iterator[Flag]:
    """Yield all flags of a dataclass, including those of nested dataclasses.

    Args:
        cls: The dataclass.
        default: Replaces the defaults of ``cls``: an instance, or a mapping of some fields.
        path: Names of the outer fields.
    """
    hints = typing.get_type_hints(cls, include_extras=True)
    for field in dataclasses.fields(cls):
        if not field.init:
            continue
        hint, marks = _bare(hints[field.name])
        value = _default(field, default)
        nested = next((o for o in _options(hint) if dataclasses.is_dataclass(o)), None)
        if nested is not None:
            yield from flags_of(nested, None if value is MISSING else value, (*path, field.name))  # type: ignore[arg-type]  # it is a type
            continue
        yield Flag(
            path=(*path, field.name),
            hint=_without_none(hint),
            default=value,
            positional=any(repr(mark) == "Positional" for mark in marks),
            optional=types.NoneType in options_of(hint),
            advanced=any(repr(mark) == "Advanced" for mark in marks),
        )


def field_docs(cls: type[Any]) -> dict[str, str]:
    """Return the docstrings of the fields of ``cls``, including those of bases."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if dataclasses.is_dataclass(base):
            docs |= _docs_in(base.__module__).get(base.__qualname__, {})
    return docs


def default_of(field: dataclasses.Field[Any]) -> Any:
    """Return the default of ``field``; MISSING if it is required."""
    factory = field.default_factory
    return field.default if factory is MISSING else factory()


def flag_docs(cls: type[Any]) -> dict[tuple[str, ...], str]:
    """Return the documentation of each flag and group of flags by path."""
    docs: dict[tuple[str, ...], str] = {(n,): text for n, text in field_docs(cls).items()}
    for name, hint in typing.get_type_hints(cls).items():
        for option in _options(hint):
            if dataclasses.is_dataclass(option) and isinstance(option, type):
                docs |= {(name, *path): text for path, text in flag_docs(option).items()}
    return docs


@functools.cache
def _docs_in(module: str) -> dict[str, dict[str, str]]:
    """Return the docstrings of fields by class and name; empty without source."""
    try:
        file = inspect.getsourcefile(sys.modules[module])
        tree = ast.parse(Path(file or "").read_text(encoding="utf-8"))
    except (OSError, TypeError, KeyError, SyntaxError):
        return {}
    found: dict[str, dict[str, str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            found[node.name] = {}
            for line, after in zip(node.body, node.body[1:], strict=False):
                text = _string(after)
                if text and isinstance(line, ast.AnnAssign) and isinstance(line.target, ast.Name):
                    found[node.name][line.target.id] = text
    return found


def _string(node: ast.stmt) -> str:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        value = node.value.value
        if isinstance(value, str):
            text = " ".join(textwrap.dedent(value).split())
            return _ROLES.sub(lambda m: m[1] or m[2] or "", text)
    return ""


def _default(field: dataclasses.Field[Any], default: Any) -> Any:
    if isinstance(default, dict):
        if field.name in default:
            return default[field.name]
    elif default is not None:
        return getattr(default, field.name)
    return default_of(field)


def _bare(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    if typing.get_origin(hint) is Annotated:
        inner, *marks = typing.get_args(hint)
        return inner, tuple(marks)
    return hint, ()


def _options(hint: Any) -> tuple[Any, ...]:
    return tuple(option for option in options_of(hint) if option is not types.NoneType)


def _without_none(hint: Any) -> Any:
    """Return ``hint`` without None if one option is left."""
    options = _options(hint)
    return options[0] if len(options) == 1 else hint


def _is_literal(hint: Any) -> bool:
    return typing.get_origin(hint) is Literal


def _metavar(hint: Any) -> str:
    options = _options(hint)
    if _is_literal(options[0]):
        return "{" + ",".join(map(str, typing.get_args(options[0]))) + "}"
    return "|".join(_WORDS[option][0] for option in options)


def _accepted(hint: Any) -> str:
    options = _options(hint)
    if _is_literal(options[0]):
        return f"one of {', '.join(map(str, typing.get_args(options[0])))}"
    return " or ".join(_WORDS[option][1] for option in options)
