"""Text of ``--help`` and ``--help-all``: flags with unit, default and one sentence."""

from __future__ import annotations

import inspect
import shutil
import textwrap
from typing import Any

from articulate.commands.fields import MISSING, Flag, flag_docs, flags_of

COLUMN = 28
"""Column of the explanations."""
MAX_WIDTH = 100
COMMON = (
    ("--config FILE|PRESET", "Read values from a YAML file or a preset; flags win. Repeatable."),
    ("-q, --quiet", "Print results, warnings and errors only."),
    ("-v, --verbose", "Print the logs of libraries too."),
    ("-h, --help", "Print the common flags."),
    ("--help-all", "Print all flags and settings."),
)
"""Flags of every command."""
SET = ("--set KEY=VALUE", "Set any setting of --help-all, e.g. --set {key}={value}. Repeatable.")


def help_text(cls: type[Any], prog: str, about: str, *, everything: bool = False) -> str:
    """Return the text of ``--help`` of a command.

    Args:
        cls: Dataclass of the flags; its docstrings explain them.
        prog: Name of the command.
        about: Description with an example.
        everything: Include advanced flags and the settings of nested dataclasses.
    """
    width = min(shutil.get_terminal_size((80, 24)).columns, MAX_WIDTH)
    docs, flags = flag_docs(cls), list(flags_of(cls))
    positional = [flag for flag in flags if flag.positional]
    usage = " ".join([prog, *map(_argument, positional), "[flags]"])
    lines = [f"usage: {usage}", "", *_paragraphs(about, width)]
    groups: dict[tuple[str, ...], list[Flag]] = {}
    for flag in flags:
        if everything or not (flag.is_nested or flag.advanced):
            groups.setdefault(flag.path[:-1], []).append(flag)
    for path, members in groups.items():
        title = docs.get(path, "").rstrip(".") if path else "Flags"
        lines += ["", f"{title or '.'.join(path)}{' (--set)' if path else ''}:"]
        for flag in members:
            lines += _row(_left(flag), _right(flag, docs.get(flag.path, "")), width)
    lines += ["", "Flags of every command:"]
    nested = next((flag for flag in flags if flag.is_nested), None)
    for left, right in (*((SET,) if nested else ()), *COMMON):
        text = right if nested is None else right.format(key=nested.key, value=_default(nested))
        lines += _row(left, text, width)
    if not everything and nested:
        sections = dict.fromkeys(flag.path[0] for flag in flags if flag.is_nested)
        text = f"Further settings of --help-all: {', '.join(sections)}."
        lines += ["", *textwrap.wrap(text, width)]
    return "\n".join(lines)


def _argument(flag: Flag) -> str:
    name = f"{flag.name} ..." if flag.is_list else flag.name
    return name if flag.default is MISSING else f"[{name}]"


def _left(flag: Flag) -> str:
    if flag.is_nested:
        return f"{flag.key}={flag.metavar or 'true|false'}"
    if flag.is_switch and flag.default is True:
        return f"--no-{flag.name.removeprefix('--')}"
    return flag.name if flag.positional else f"{flag.name} {flag.metavar}".rstrip()


def _right(flag: Flag, text: str) -> str:
    """Return the explanation of a flag with its default."""
    if flag.is_switch and not flag.is_nested:
        return f"Do not: {text[:1].lower()}{text[1:]}" if flag.default is True else text
    if flag.default is MISSING:
        return f"{text} (required)"
    if flag.default is None or flag.default == ():
        return text
    return f"{text} (default: {_default(flag)})"


def _default(flag: Flag) -> str:
    value = flag.default
    separator = "," if flag.is_nested else " "
    values = value if isinstance(value, tuple) else (value,)
    return separator.join(str(v).removesuffix(".0") for v in values)


def _row(left: str, right: str, width: int) -> list[str]:
    indent = " " * COLUMN
    rows = textwrap.wrap(right, width, initial_indent=indent, subsequent_indent=indent)
    if len(left) + 4 > COLUMN or not rows:
        return [f"  {left}", *rows]
    return [f"  {left:<{COLUMN - 2}}{rows[0].lstrip()}", *rows[1:]]


def _paragraphs(text: str, width: int) -> list[str]:
    lines: list[str] = []
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        lines += ["", *textwrap.wrap(" ".join(paragraph.split()), width)]
    return lines[1:]
