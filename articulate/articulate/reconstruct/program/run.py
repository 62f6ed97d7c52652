"""Run programs: from source to an object as plain data, or an error."""

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

MAX_MESSAGE = 1_000
"""Longest message of a child [characters]."""
CHILD = Path(__file__).with_name("child.py")
PartsInput = Parts | Path | Mapping[str, Path | trimesh.Trimesh]
"""Parts, a folder of meshes, a URDF, or meshes by name."""


def run_program(
    source: str, parts: PartsInput, limits: SandboxLimits | None = None
) -> ProgramObject | ProgramError:
    """Run a program in a restricted process and return the object that it describes.

    Args:
        source: Text of the program; it may be untrusted.
        parts: Parts that it may use.
        limits: Limits of the run; the defaults suit programs of people and models.

    Raises:
        AssetError: The parts cannot be read.
    """
    limits = limits or SandboxLimits()
    loaded = parts if isinstance(parts, Parts) else parts_of(parts)
    if len(source) > MAX_SOURCE:
        what = f"the program has {len(source)} characters; {MAX_SOURCE} are accepted"
        return ProgramError(0, 0, what)
    layers: tuple[str, ...] = ()
    last = (0, 0)
    with Sandbox(CHILD, limits) as child:
        builder = Builder(loaded, child.check_time)
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
    parts: PartsInput,
    out: Path,
    limits: SandboxLimits | None = None,
    *,
    name: str = "object",
) -> Path | ProgramError:
    """Run a program and write the object that it describes into the folder ``out``.

    Args:
        source: Text of the program; it may be untrusted.
        parts: Parts that it may use.
        out: Folder for ``<name>.urdf``, ``meshes/``, ``built.json`` and ``program.py``.
        limits: Limits of the run.
        name: Name of the object.

    Returns:
        Path of the URDF, or the error of the program.

    Raises:
        AssetError: The parts cannot be read.
        UsageError: The folder cannot be written.
    """
    loaded = parts if isinstance(parts, Parts) else parts_of(parts)
    found = run_program(source, loaded, limits)
    if isinstance(found, ProgramError):
        return found
    return write_object(found, loaded, out, source=source, name=name)


def _layers(message: dict[str, Any]) -> tuple[str, ...]:
    layers = message.get("layers")
    return tuple(str(layer) for layer in layers) if isinstance(layers, list) else ()


def _answer(builder: Builder, message: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"value": builder.answer(message.get("call"), message.get("arguments"))}
    except InvalidValueError as error:
        return {"error": str(error)}


def _outcome(
    message: dict[str, Any], builder: Builder, layers: tuple[str, ...]
) -> ProgramObject | ProgramError:
    if message.get("done") is True:
        return builder.built(layers)
    found = message.get("violation")
    if not isinstance(found, dict):
        return ProgramError(
            0, 0, "the program was stopped: its process sent no result", "limit", layers
        )
    line, column = _number(found.get("line")), _number(found.get("column"))
    text, kind = str(found.get("message"))[:MAX_MESSAGE], str(found.get("kind"))[:20]
    return ProgramError(line, column, text.replace("\n", " "), kind, layers)


def _number(value: object) -> int:
    """Return a line or column of the child, 0 if it is invalid."""
    return value if type(value) is int and 0 <= value <= MAX_SOURCE else 0
