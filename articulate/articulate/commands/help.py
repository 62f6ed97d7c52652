"""``--help`` as plain text: every flag with its unit, its default and one sentence."""

from __future__ import annotations

import inspect
import shutil
import textwrap
from typing import Any

from articulate.commands.fields import MISSING, Flag, flag_docs, flags_of

COLUMN = 28
"""Where explanations begin."""
WIDEST = 100
COMMON = (
    ("--config FILE|PRESET", "Take values from a YAML file or a preset; flags win. Repeatable."),
    ("-q, --quiet", "Say nothing but results, warnings and errors."),
    ("-v, --verbose", "Say also what the libraries log."),
    ("-h, --help", "Print this and do nothing."),
)
"""Flags of every command."""


def help_text(cls: type[Any], prog: str, about: str) -> str:
    """What ``--help`` of the command with the flags ``cls`` prints.

    Args:
        cls: A dataclass; its docstrings explain the flags.
        prog: Name of the command.
        about: What it does, with an example.
    """
    width = min(shutil.get_terminal_size((80, 24)).columns, WIDEST)
    docs, flags = flag_docs(cls), list(flags_of(cls))
    loose = [flag for flag in flags if flag.positional]
    usage = " ".join([prog, *map(_argument, loose), "[flags]"])
    lines = [f"usage: {usage}", "", *_paragraphs(about, width)]
    groups: dict[tuple[str, ...], list[Flag]] = {}
    for flag in flags:
        groups.setdefault(flag.path[:-1], []).append(flag)
    for path, members in groups.items():
        title = docs.get(path, "") if path else "Flags."
        lines += ["", f"{title.rstrip('.')}:" if title else f"{'.'.join(path)}:"]
        for flag in members:
            lines += _row(_left(flag), _right(flag, docs.get(flag.path, "")), width)
    lines += ["", "Flags of every command:"]
    for left, right in COMMON:
        lines += _row(left, right, width)
    return "\n".join(lines)


def _argument(flag: Flag) -> str:
    name = f"{flag.name} ..." if flag.is_list else flag.name
    return name if flag.default is MISSING else f"[{name}]"


def _left(flag: Flag) -> str:
    if flag.is_switch and flag.default is True:
        return f"--no-{flag.name.removeprefix('--')}"
    return flag.name if flag.positional else f"{flag.name} {flag.metavar}".rstrip()


def _right(flag: Flag, text: str) -> str:
    """What is said of a flag, with its default."""
    if flag.is_switch:
        return f"Do not: {text[:1].lower()}{text[1:]}" if flag.default is True else text
    if flag.default is MISSING:
        return f"{text} (required)"
    if flag.default is None or flag.default == ():
        return text
    value = flag.default
    shown = " ".join(map(_plain, value if isinstance(value, tuple) else (value,)))
    return f"{text} (default: {shown})"


def _plain(value: Any) -> str:
    return str(value).removesuffix(".0")


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
