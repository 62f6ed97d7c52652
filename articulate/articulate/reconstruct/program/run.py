"""Running programs: source in, plain data or a sentence out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import trimesh

from articulate.reconstruct.program.api import Builder
from articulate.reconstruct.program.compile import write_object
from articulate.reconstruct.program.language import MAX_SOURCE
from articulate.reconstruct.program.program_parts import Parts, parts_of
from articulate.reconstruct.program.result import ProgramError, ProgramObject
from articulate.reconstruct.program.sandbox import ChildEnded, Sandbox, SandboxLimits
from articulate.reconstruct.program.values import InvalidValueError

CHILD = Path(__file__).with_name("child.py")
PartSet = Parts | Path | Mapping[str, Path | trimesh.Trimesh]
"""Parts, a folder of meshes, a URDF, or meshes by name."""


def run_program(
    source: str, parts: PartSet, limits: SandboxLimits | None = None
) -> ProgramObject | ProgramError:
    """What a program describes, run in a locked-up process.

    Args:
        source: Text of the program, from whomever.
        parts: What it may place and join.
        limits: What it may take; the default suits programs of people and models.

    Raises:
        AssetError: The parts cannot be read.
    """
    limits = limits or SandboxLimits()
    given = parts if isinstance(parts, Parts) else parts_of(parts)
    if len(source) > MAX_SOURCE:
        what = f"the program has {len(source)} characters; {MAX_SOURCE} are accepted"
        return ProgramError(0, 0, what)
    layers: tuple[str, ...] = ()
    last = (0, 0)
    with Sandbox(CHILD, limits) as child:
        builder = Builder(given, child.check_time)
        try:
            layers = _layers(child.receive())
            child.send({"source": source})
            while True:
                message = child.receive()
                if "call" not in message:
                    return _outcome(message, builder, layers)
                last = _number(message.get("line")), _number(message.get("column"))
                child.send(_answer(builder, message))
        except ChildEnded as ended:
            return ProgramError(*last, f"the program was stopped: {ended}", "limit", layers)


def compile_program(
    source: str,
    parts: PartSet,
    out: Path,
    limits: SandboxLimits | None = None,
    *,
    name: str = "object",
) -> Path | ProgramError:
    """Run a program and write what it describes into the folder ``out``.

    Args:
        source: Text of the program, from whomever.
        parts: What it may place and join.
        out: Folder for ``<name>.urdf``, ``meshes/``, ``built.json`` and ``program.py``.
        limits: What the program may take.
        name: Name of the object.

    Returns:
        Path of the URDF, or why there is none.

    Raises:
        AssetError: The parts cannot be read.
        UsageError: The folder cannot be written.
    """
    given = parts if isinstance(parts, Parts) else parts_of(parts)
    found = run_program(source, given, limits)
    if isinstance(found, ProgramError):
        return found
    return write_object(found, given, out, source=source, name=name)


def _layers(message: dict[str, Any]) -> tuple[str, ...]:
    said = message.get("layers")
    return tuple(str(layer) for layer in said) if isinstance(said, list) else ()


def _answer(builder: Builder, message: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"value": builder.answer(message.get("call"), message.get("arguments"))}
    except InvalidValueError as refused:
        return {"error": str(refused)}


def _outcome(
    message: dict[str, Any], builder: Builder, layers: tuple[str, ...]
) -> ProgramObject | ProgramError:
    if message.get("done") is True:
        return builder.built(layers)
    found = message.get("violation")
    if not isinstance(found, dict):
        return ProgramError(0, 0, "the program was stopped: its process broke off", "limit", layers)
    line, column = _number(found.get("line")), _number(found.get("column"))
    text, kind = str(found.get("message"))[:2000], str(found.get("kind"))[:20]
    return ProgramError(line, column, text.replace("\n", " "), kind, layers)


def _number(value: object) -> int:
    """A line or column that a child names."""
    return value if type(value) is int and 0 <= value <= MAX_SOURCE else 0
