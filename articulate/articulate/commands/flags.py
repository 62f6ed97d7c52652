"""Flags of a command: a dataclass, presets and the command line, in this order."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import io
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import tyro

from articulate.config import field_values, find_config, read_yaml
from articulate.errors import ConfigError, nearest

T = TypeVar("T")

_FLAG = re.compile(r"(?<![\w-])--[a-z][\w.-]*")
_BOX = re.compile(r"^[│|] ?(.*?)\s*[│|]$")
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_CONFIG_HELP = (
    "--config FILE|PRESET takes values from a YAML file or a preset; flags given here win. "
    "Repeat it to lay one over another."
)
_SHORTER = {"Error parsing ": "", "Unrecognized options: ": "unexpected: "}


def parse(
    cls: type[T],
    argv: Sequence[str],
    default: T | None = None,
    prog: str | None = None,
    description: str | None = None,
) -> T:
    """A ``cls`` of its defaults, then every ``--config``, then the flags in ``argv``.

    ``--help`` prints the flags and raises SystemExit(0).

    Args:
        cls: A frozen dataclass; its docstrings are the help.
        argv: What follows the command's name.
        default: Takes the place of the defaults of ``cls``.
        prog: Name of the command, for ``--help``; that of the running script if None.
        description: First lines of ``--help``; the docstring of ``cls`` if None.

    Raises:
        ConfigError: A flag is not known, or a value not accepted.
    """
    presets, rest = _take_presets(list(argv))
    base: Any = _with_presets(cls, presets, default)
    about = f"{(description or cls.__doc__ or '').strip()}\n{_CONFIG_HELP}"
    kind: Any = (
        cls  # typed as a plain class, so that tyro's overloads with and without a default agree
    )
    name = prog or Path(sys.argv[0]).name
    call = functools.partial(tyro.cli, kind, prog=name, description=about)
    call = call if base is None else functools.partial(call, default=base)
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            return cast("T", call(args=rest))
    except SystemExit as stop:
        if stop.code in (0, None):
            raise
        raise ConfigError(_sentence(rest, _known_flags(call), errors.getvalue())) from None


def _take_presets(argv: list[str]) -> tuple[list[str], list[str]]:
    """What ``--config`` names, in order, and the other arguments."""
    presets, rest = [], []
    words = iter(argv)
    for word in words:
        if word == "--config":
            name = next(words, "")
            if not name or name.startswith("--"):
                raise ConfigError("--config: expects a YAML file or the name of a preset")
            presets.append(name)
        elif word.startswith("--config="):
            presets.append(word.removeprefix("--config="))
        else:
            rest.append(word)
    return presets, rest


def _with_presets(cls: type[T], presets: list[str], default: T | None) -> T | None:
    """``default`` under the presets; fields that nothing gives stay required."""
    if not presets:
        return default
    values: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for preset in presets:
        path = find_config(preset)
        content = read_yaml(path)
        field_values(cls, content, str(path))  # complains of this file by its own name
        values = _merged(values, content)
        sources[str(path)] = preset
    decoded = field_values(cls, values, " + ".join(sources))
    return _partial(cls, decoded, default)


def _merged(low: Mapping[str, Any], high: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(low)
    for key, value in high.items():
        below = merged.get(key)
        both = isinstance(below, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(below, value) if both else value  # type: ignore[arg-type]
    return merged


def _partial(cls: type[T], values: dict[str, Any], default: T | None) -> T:
    """An instance for tyro to read defaults from: unchecked, with holes where none is known."""
    partial = object.__new__(cls)
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        if field.name in values:
            value = values[field.name]
        elif default is not None:
            value = getattr(default, field.name)
        elif field.default is not dataclasses.MISSING:
            value = field.default
        elif field.default_factory is not dataclasses.MISSING:
            value = field.default_factory()
        else:
            value = tyro.MISSING
        object.__setattr__(partial, field.name, value)
    return partial


def _known_flags(call: Callable[..., Any]) -> set[str]:
    """All flags, read from the help, whose form is all that tyro promises to keep."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
        call(args=["--help"])
    return set(_FLAG.findall(text.getvalue()))


def _sentence(argv: Sequence[str], known: set[str], box: str) -> str:
    """One line of what tyro said in a box, with the nearest flag where one is not known."""
    for word in argv:
        flag = word.split("=", 1)[0].replace("_", "-")
        if word.startswith("--") and word != "--" and flag not in known:
            close = nearest(flag, known)
            return f"{flag}: unknown flag{close if 'did you mean' in close else '; see --help'}"
    lines = list(_box_lines(box))
    head = lines[0].strip() if lines else "the command line is not accepted"
    if head.startswith("Missing from"):
        # "Missing from PROG:", on several lines where PROG is long; then flags, then their help.
        start = next((i for i, line in enumerate(lines, 1) if line.endswith(":")), 1)
        rest = lines[start:]
        indent = min((len(line) - len(line.lstrip()) for line in rest), default=0)
        names = [line.strip() for line in rest if not line[indent : indent + 1].isspace()]
        return f"missing: {', '.join(names)}; see --help"
    head = " ".join(line.strip() for line in lines) or head
    for verbose, short in _SHORTER.items():
        head = head.replace(verbose, short)
    return f"{head.rstrip('.')}; see --help"


def _box_lines(box: str) -> Iterator[str]:
    """Lines of the first section of a box."""
    lines = _ANSI.sub("", box).splitlines()
    if not any(map(_BOX.match, lines)):  # where output is not UTF-8: a title, a rule, no sides
        rule = next((i for i, line in enumerate(lines) if set(line.strip()) == {"-"}), -1)
        lines = [f"|{line}|" for line in lines[rule + 1 :]]
    for line in lines:
        match = _BOX.match(line)
        if match and match[1] and set(match[1].strip()) in ({"─"}, {"-"}):
            return
        if match and match[1].strip():
            yield match[1]
