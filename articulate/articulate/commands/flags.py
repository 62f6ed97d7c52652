"""Parse the flags of a command: defaults, presets and the command line, in this order.

No library is used for it: ``--help`` must be fast, and every error is one line that names the
nearest flag or value.
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
from articulate.errors import ConfigError, nearest, quote, shorten

T = TypeVar("T")
Values = dict[tuple[str, ...], Any]
"""Given values by the path of their field."""

LEVELS = {
    "-q": console.QUIET,
    "--quiet": console.QUIET,
    "-v": console.VERBOSE,
    "--verbose": console.VERBOSE,
}
"""Verbosity flags of every command."""
HELP = ("-h", "--help", "--help-all")
_NUMBER = re.compile(r"-(\d|\.\d|inf)")


def parse(
    cls: type[T],
    argv: Sequence[str],
    default: T | None = None,
    prog: str | None = None,
    description: str | None = None,
) -> T:
    """Build a ``cls`` from its defaults, then every ``--config``, then the flags in ``argv``.

    ``--help`` and ``--help-all`` print the flags and raise SystemExit(0); ``-q`` and ``-v`` set the
    verbosity.

    Args:
        cls: A frozen dataclass; its docstrings are the help.
        argv: Words after the command's name.
        default: Replaces the defaults of ``cls``.
        prog: Name of the command, for ``--help``; that of the running script if None.
        description: First lines of ``--help``; the docstring of ``cls`` if None.

    Raises:
        ConfigError: A flag is not known, or a value not accepted.
    """
    name = prog or Path(sys.argv[0]).name
    if any(word in HELP for word in argv):
        everything = "--help-all" in argv
        console.emit(help_text(cls, name, description or cls.__doc__ or "", everything=everything))
        raise SystemExit(0)
    presets, rest = _take_common(list(argv))
    base = _base(cls, presets, default)
    flags = list(flags_of(cls, base))
    parsed = _read(flags, rest, name)
    missing = [f for f in flags if f.default is MISSING and f.path not in parsed]
    if missing:
        docs = flag_docs(cls)
        usages = [f"{usage(f)} ({summary_of(docs.get(f.path, ''))})" for f in missing]
        raise ConfigError(f"missing: {', '.join(usages)}; see {name} --help")
    return cls(**_laid_over(cls, base, parsed))


def _take_common(argv: list[str]) -> tuple[list[str], list[str]]:
    """Split off ``--config``, ``-q`` and ``-v``; return the presets and the other words."""
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
    """Return the values of ``default``, overridden by the presets."""
    base: dict[str, Any] = {}
    if default is not None:
        base = {f.name: getattr(default, f.name) for f in dataclasses.fields(cls)}
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for preset in presets:
        path = find_config(preset)
        content = read_yaml(path)
        field_values(cls, content, str(path))  # its errors name this file
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
    """Return the values of the flags in ``argv``; of repeated flags the last counts."""
    named = {f.name: f for f in flags if not f.positional and not f.is_nested}
    named |= {_negated(f.name): f for f in flags if f.is_switch and not f.is_nested}
    by_key = {f.key: f for f in flags if not f.positional}
    parsed: Values = {}
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
        if name == "--set":
            text = value if equals else (words.pop(0) if words else "")
            flag, setting = _setting(text, by_key, prog)
            parsed[flag.path] = setting
            continue
        if name not in named:
            raise _unknown_flag(name, named, by_key, prog)
        flag = named[name]
        if flag.is_switch:
            if equals:
                raise ConfigError(f"{name} is a switch; omit {equals}{value}")
            parsed[flag.path] = name == flag.name
            continue
        values = [value] if equals else _pop_values(flag, words)
        if not values:
            raise ConfigError(f"{name}: a value is missing; give {usage(flag)}, see {prog} --help")
        parsed[flag.path] = flag.value(values)
    _assign_positional(flags, loose, parsed, prog)
    return parsed


def _setting(text: str, by_key: Mapping[str, Flag], prog: str) -> tuple[Flag, Any]:
    """Return the flag and the value of ``--set KEY=VALUE``.

    Raises:
        ConfigError: The key is not known, or the value is not accepted.
    """
    key, equals, value = text.partition("=")
    flag = by_key.get(key.replace("-", "_"))
    if flag is None:
        close = nearest(key, by_key)
        last = [known for known in by_key if known.rsplit(".", 1)[-1] == key]
        close = f"; did you mean {last[0]}?" if last else close
        more = close if "did you mean" in close else f"; {prog} --help-all lists the keys"
        raise ConfigError(f"--set {quote(key)}: unknown key{more}")
    if not equals:
        raise ConfigError(f"--set {key}: a value is missing; give --set {key}={flag.metavar}")
    return flag, flag.value_of_text(value)


def _unknown_flag(
    name: str, named: Mapping[str, Flag], by_key: Mapping[str, Flag], prog: str
) -> ConfigError:
    """Return the error for an unknown flag, with the nearest flag or key of ``--set``."""
    key = name.removeprefix("--").replace("-", "_")
    if key in by_key:
        return ConfigError(f"{shorten(name)}: unknown flag; did you mean --set {key}=VALUE?")
    nested = {f"--{k.replace('_', '-')}": k for k, f in by_key.items() if f.is_nested}
    plain = {f.removeprefix("--"): f for f in (*named, *nested) if _can_be_meant(name, f)}
    close = nearest(name.removeprefix("--"), plain)
    for word, f in plain.items():
        close = close.replace(f"did you mean {word}?", f"did you mean {f}?")
    for dotted, k in nested.items():
        close = close.replace(f"did you mean {dotted}?", f"did you mean --set {k}=VALUE?")
    more = close if "did you mean" in close else f"; see {prog} --help"
    return ConfigError(f"{shorten(name)}: unknown flag{more}")


def _can_be_meant(name: str, known: str) -> bool:
    """Return whether an unknown flag may stand for a known one; negations are not suggested."""
    return known.startswith("--no-") == name.startswith("--no-")


def _is_flag(word: str) -> bool:
    return word.startswith("-") and word != "-" and not _NUMBER.match(word)


def _negated(name: str) -> str:
    return f"--no-{name.removeprefix('--')}"


def _pop_values(flag: Flag, words: list[str]) -> list[str]:
    """Remove the values of ``flag`` from the front of ``words`` and return them."""
    most = len(words) if flag.is_list else len(flag.items or (None,))
    values: list[str] = []
    while words and len(values) < most and not _is_flag(words[0]):
        values.append(words.pop(0))
    return values


def usage(flag: Flag) -> str:
    """Return a flag with the placeholder of its value."""
    if flag.is_nested:
        return f"{flag.name}={flag.metavar}"
    return flag.name if flag.positional else f"{flag.name} {flag.metavar}"


def summary_of(text: str) -> str:
    """Return the first sentence of a text, without its full stop."""
    return re.split(r"(?<!\be\.g)(?<!\bi\.e)(?:[.;:] |[.]$)", text, maxsplit=1)[0]


def _assign_positional(flags: Sequence[Flag], loose: list[str], parsed: Values, prog: str) -> None:
    """Assign words without a flag to the positional arguments."""
    for flag in (f for f in flags if f.positional):
        if not loose:
            break
        count = len(loose) if flag.is_list else 1
        parsed[flag.path] = flag.value(loose[:count])
        del loose[:count]
    if loose:
        lacking = [f.name for f in flags if f.default is MISSING and f.path not in parsed]
        hint = f"did you mean {lacking[0]} {loose[0]}?" if lacking else f"see {prog} --help"
        raise ConfigError(f"unexpected: {shorten(' '.join(loose))}; {hint}")


def _laid_over(cls: type[Any], values: dict[str, Any], parsed: Values) -> dict[str, Any]:
    """Return ``values`` of fields of ``cls``, overridden by the given values."""
    inner: dict[str, Values] = {}
    for (first, *rest), value in parsed.items():
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
