"""Flags of a command: a dataclass, presets and the command line, in this order.

The command line is read here, and not by a library for it: ``--help`` has to answer in a third of
a second, and every mistake has to be one line that names the nearest flag or value.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from articulate.commands import console
from articulate.commands.fields import MISSING, Flag, default_of, flag_docs, flags_of
from articulate.commands.help import help_text
from articulate.config import field_values, find_config, read_yaml
from articulate.errors import ConfigError, nearest

T = TypeVar("T")
Values = dict[tuple[str, ...], Any]
"""What was given, by the path of its field."""

LEVELS = {
    "-q": console.QUIET,
    "--quiet": console.QUIET,
    "-v": console.VERBOSE,
    "--verbose": console.VERBOSE,
}
"""Flags of every command, besides ``--config`` and ``--help``."""
_NUMBER = re.compile(r"-(\d|\.\d|inf)")


def parse(
    cls: type[T],
    argv: Sequence[str],
    default: T | None = None,
    prog: str | None = None,
    description: str | None = None,
) -> T:
    """A ``cls`` of its defaults, then every ``--config``, then the flags in ``argv``.

    ``--help`` prints the flags and raises SystemExit(0); ``-q`` and ``-v`` are heeded here.

    Args:
        cls: A frozen dataclass; its docstrings are the help.
        argv: What follows the command's name.
        default: Takes the place of the defaults of ``cls``.
        prog: Name of the command, for ``--help``; that of the running script if None.
        description: First lines of ``--help``; the docstring of ``cls`` if None.

    Raises:
        ConfigError: A flag is not known, or a value not accepted.
    """
    name = prog or Path(sys.argv[0]).name
    if any(word in ("-h", "--help") for word in argv):
        console.emit(help_text(cls, name, description or cls.__doc__ or ""))
        raise SystemExit(0)
    presets, rest = _take_common(list(argv))
    base = _base(cls, presets, default)
    flags = list(flags_of(cls, base))
    given = _read(flags, rest, name)
    missing = [f for f in flags if f.default is MISSING and f.path not in given]
    if missing:
        docs = flag_docs(cls)
        told = [f"{usage(f)} ({first_sentence(docs.get(f.path, ''))})" for f in missing]
        raise ConfigError(f"missing: {', '.join(told)}; see {name} --help")
    return cls(**_laid_over(cls, base, given))


def _take_common(argv: list[str]) -> tuple[list[str], list[str]]:
    """What ``--config`` names, in order, and the other arguments; ``-q`` and ``-v`` are heeded."""
    presets, rest = [], []
    words = iter(argv)
    for word in words:
        if word == "--config":
            name = next(words, "")
            if not name or name.startswith("--"):
                known = "give a YAML file or the name of a preset"
                raise ConfigError(f"--config: a value is missing; {known}")
            presets.append(name)
        elif word.startswith("--config="):
            presets.append(word.removeprefix("--config="))
        elif word in LEVELS:
            console.set_level(LEVELS[word])
        else:
            rest.append(word)
    return presets, rest


def _base(cls: type[Any], presets: list[str], default: Any) -> dict[str, Any]:
    """Values of fields of ``default`` under the presets, as far as any are known."""
    base: dict[str, Any] = {}
    if default is not None:
        base = {f.name: getattr(default, f.name) for f in dataclasses.fields(cls)}
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for preset in presets:
        path = find_config(preset)
        content = read_yaml(path)
        field_values(cls, content, str(path))  # complains of this file by its own name
        values = _merged(values, content)
        sources[str(path)] = preset
    return base | (field_values(cls, values, " + ".join(sources)) if presets else {})


def _merged(low: Mapping[str, Any], high: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(low)
    for key, value in high.items():
        below = merged.get(key)
        both = isinstance(below, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(below, value) if both else value  # type: ignore[arg-type]
    return merged


def _read(flags: Sequence[Flag], argv: Sequence[str], prog: str) -> Values:
    """Values of the flags that stand in ``argv``; the last of the same counts."""
    named = {f.name: f for f in flags if not f.positional}
    named |= {_negated(f.name): f for f in flags if f.is_switch}
    given: Values = {}
    loose: list[str] = []
    words = list(argv)
    while words:
        word = words.pop(0)
        if word == "--":
            loose += words
            break
        if not _is_flag(word):
            loose.append(word)
            continue
        name, equals, value = word.partition("=")
        name = name.replace("_", "-")
        flag = named.get(name)
        if flag is None:
            close = nearest(name, named)
            more = close if "did you mean" in close else f"; see {prog} --help"
            raise ConfigError(f"{name}: unknown flag{more}")
        if flag.is_switch:
            if equals:
                raise ConfigError(f"{name} is a switch; leave out {equals}{value}")
            given[flag.path] = name == flag.name
            continue
        taken = [value] if equals else _taken(flag, words)
        if not taken:
            raise ConfigError(f"{name}: a value is missing; give {usage(flag)}, see {prog} --help")
        given[flag.path] = flag.value(taken)
    _place(flags, loose, given, prog)
    return given


def _is_flag(word: str) -> bool:
    return word.startswith("-") and word != "-" and not _NUMBER.match(word)


def _negated(name: str) -> str:
    return f"--no-{name.removeprefix('--')}"


def _taken(flag: Flag, words: list[str]) -> list[str]:
    """The words that belong to ``flag``, taken from the front of ``words``."""
    most = len(words) if flag.is_list else len(flag.items or (None,))
    taken: list[str] = []
    while words and len(taken) < most and not _is_flag(words[0]):
        taken.append(words.pop(0))
    return taken


def usage(flag: Flag) -> str:
    """A flag as it is to be given."""
    return flag.name if flag.positional else f"{flag.name} {flag.metavar}"


def first_sentence(text: str) -> str:
    """The first sentence of an explanation, without its full stop."""
    return re.split(r"(?<!\be\.g)(?<!\bi\.e)(?:[.;:] |[.]$)", text, maxsplit=1)[0]


def _place(flags: Sequence[Flag], loose: list[str], given: Values, prog: str) -> None:
    """Hand words without a flag to the arguments without a name."""
    for flag in (f for f in flags if f.positional):
        if not loose:
            break
        count = len(loose) if flag.is_list else 1
        given[flag.path] = flag.value(loose[:count])
        del loose[:count]
    if loose:
        lacking = [f.name for f in flags if f.default is MISSING and f.path not in given]
        hint = f"did you mean {lacking[0]} {loose[0]}?" if lacking else f"see {prog} --help"
        raise ConfigError(f"unexpected: {' '.join(loose)}; {hint}")


def _laid_over(cls: type[Any], values: dict[str, Any], given: Values) -> dict[str, Any]:
    """``values`` of fields of ``cls`` with what was given laid over them."""
    inner: dict[str, Values] = {}
    for (first, *rest), value in given.items():
        if rest:
            inner.setdefault(first, {})[tuple(rest)] = value
        else:
            values[first] = value
    for name, changes in inner.items():
        old = values.get(name)
        if old is None:
            field = next(f for f in dataclasses.fields(cls) if f.name == name)
            old = default_of(field)
        values[name] = dataclasses.replace(old, **_laid_over(type(old), _kept(old), changes))
    return values


def _kept(old: Any) -> dict[str, Any]:
    return {field.name: getattr(old, field.name) for field in dataclasses.fields(old) if field.init}
