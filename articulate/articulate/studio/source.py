"""Find the object, the input and the evidence at a path."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from articulate.errors import AssetError, UsageError, quote, shorten
from articulate.files import is_asset
from articulate.formats.find_source import find_source
from articulate.preparation.batch import path_exists
from articulate.preparation.check_report_file import CHECK_REPORT_FILE
from articulate.reconstruct.result import (
    MADE_FILE,
    PROGRAM_FOLDER,
    SCHEMA,
    TRACE_FILE,
    URDF_FILE,
)
from articulate.studio.edits import Edit, parse_edit
from articulate.studio.model import StudioModel, read_model
from articulate.untrusted import load_json_object, read_bounded

HISTORY_FILE = "edits.json"
HISTORY_SCHEMA = "articulate.edits"
MAX_INPUT = 200_000_000
"""Largest video or image that is displayed [bytes]."""
MAX_TRACE = 100_000_000
"""Largest trace page that is read [bytes]."""
MAX_IMAGES = 4
"""Most images of the input from a trace page."""
TYPES = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".webp": "image/webp",
    ".mp4": "video/mp4",
    ".webm": "video/webm",
    ".mov": "video/mp4",
}
_IMAGE = re.compile(
    r'<img alt="[^"]{0,2000}" src="data:image/(png|webp);base64,([A-Za-z0-9+/=]+)">'
)


@dataclass(frozen=True, kw_only=True)
class InputFile:
    """Video or image of the query."""

    mime: str
    content: bytes


@dataclass(frozen=True, kw_only=True, eq=False)
class StudioSource:
    """Object to correct, with its evidence."""

    path: Path
    """Path that the user named."""
    model: StudioModel
    verdict: str = ""
    """Verdict of ``made.json`` or the check report; empty for a plain file."""
    reasons: tuple[str, ...] = ()
    """Reasons for a verdict other than ``passed``."""
    assumptions: tuple[str, ...] = ()
    evidence: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Confidence and evidence of each joint, by part."""
    inputs: tuple[InputFile, ...] = ()
    trace: bytes | None = None
    """Trace page of the reconstruction."""
    earlier: tuple[Edit, ...] = ()
    """Edits of earlier exports, which the object already contains."""
    licence: Mapping[str, str] = field(default_factory=dict)
    """Source, licence and category, which the export inherits."""


def read_studio_source(path: Path, input_file: Path | None = None) -> StudioSource:
    """Read an asset folder, a folder of ``articulate make``, or an object file.

    Args:
        path: Path that the user names.
        input_file: Video or image to show; by default the images of the trace page.

    Raises:
        UsageError: It does not exist, holds no object, or is damaged; one line.
    """
    if not path_exists(path):
        raise UsageError(f"{path}: does not exist; give an asset folder or a URDF")
    made = _made(path)
    model = read_model(_object_file(path))
    trace = _trace(path)
    inputs = _trace_images(trace)
    if input_file is not None:
        inputs = (read_input(input_file),)
    report = _optional_json(path / CHECK_REPORT_FILE) if path.is_dir() else {}
    described = made or report
    return StudioSource(
        path=path,
        model=model,
        verdict=_text(described.get("verdict")),
        reasons=_texts(described.get("reasons")),
        assumptions=_texts(made.get("assumptions")),
        evidence=_evidence(made),
        inputs=inputs,
        trace=trace,
        earlier=read_history(path / HISTORY_FILE) if path.is_dir() else (),
        licence=_licence(path, report),
    )


def read_input(path: Path) -> InputFile:
    """Read a video or image to show.

    Raises:
        UsageError: It cannot be read, or its type is not displayed by browsers.
    """
    mime = TYPES.get(path.suffix.lower())
    if mime is None:
        raise UsageError(f"{path}: accepted are {', '.join(TYPES)}")
    return InputFile(mime=mime, content=read_bounded(path, MAX_INPUT))


def read_history(path: Path) -> tuple[Edit, ...]:
    """Read the edits of a history file; none if it is absent.

    Raises:
        UsageError: It is damaged.
    """
    if not path.exists():
        return ()
    content = load_json_object(path)
    edits = content.get("edits")
    if content.get("schema") != HISTORY_SCHEMA or not isinstance(edits, list):
        raise UsageError(f"{path}: not a history of edits; remove it")
    for entry in edits:
        if not isinstance(entry, dict):
            raise UsageError(f"{path}: edit {quote(entry)}; an object was expected")
    return tuple(parse_edit(entry) for entry in edits)


def _object_file(path: Path) -> Path:
    """Return the object file of a folder: the asset's URDF, else that of the program."""
    if not path.is_dir():
        return path
    if (path / URDF_FILE).is_file():
        return path / URDF_FILE
    if (path / PROGRAM_FOLDER).is_dir() and not is_asset(path):
        return find_source(path / PROGRAM_FOLDER)
    if is_asset(path):
        raise AssetError(f"{path}: {URDF_FILE} is missing; make the asset again")
    if (path / MADE_FILE).exists() or (path / CHECK_REPORT_FILE).exists():
        raise AssetError(f"{path}: holds a report without an object; give its URDF")
    return find_source(path)


def _made(path: Path) -> dict[str, Any]:
    file = path / MADE_FILE
    if not path.is_dir() or not file.exists():
        return {}
    content = load_json_object(file)
    joints = content.get("joints")
    entries = joints if isinstance(joints, list) else [None]
    fine = content.get("schema") == SCHEMA
    if not fine or not all(isinstance(joint, dict) for joint in entries):
        raise UsageError(f"{file}: not written by articulate make; remove it to open the object")
    return content


def _evidence(made: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    found = {}
    for joint in made.get("joints") or ():
        confidence = joint.get("confidence")
        number = isinstance(confidence, int | float) and not isinstance(confidence, bool)
        found[_text(joint.get("part"))] = {
            "confidence": float(confidence) if number else None,
            "evidence": _text(joint.get("evidence")),
        }
    return found


def _licence(path: Path, report: Mapping[str, Any]) -> dict[str, str]:
    """Return the source, licence and category of an asset or of a ``source.json``."""
    folder = path if path.is_dir() else path.parent
    origin = {
        **_optional_json(folder / PROGRAM_FOLDER / "source.json"),
        **_optional_json(folder / "source.json"),
        **_optional_json(folder / "asset.json"),
    }
    keys = ("source", "licence", "category")
    return {key: _text(origin.get(key) or report.get(key)) or "unknown" for key in keys}


def _optional_json(path: Path) -> dict[str, Any]:
    return load_json_object(path) if path.is_file() else {}


def _trace(path: Path) -> bytes | None:
    file = path / TRACE_FILE
    return read_bounded(file, MAX_TRACE) if path.is_dir() and file.is_file() else None


def _trace_images(trace: bytes | None) -> tuple[InputFile, ...]:
    """Return the images of the section ``Input`` of a trace page."""
    if trace is None:
        return ()
    text = trace.decode("utf-8", errors="replace")
    section = text.partition("<h2>Input</h2>")[2].partition("<h2>")[0]
    found = []
    for match in list(_IMAGE.finditer(section))[:MAX_IMAGES]:
        try:
            content = base64.b64decode(match.group(2), validate=True)
        except binascii.Error:
            continue
        found.append(InputFile(mime=f"image/{match.group(1)}", content=content))
    return tuple(found)


def _text(value: Any) -> str:
    return shorten(value, 500) if isinstance(value, str) else ""


def _texts(value: Any) -> tuple[str, ...]:
    entries = value if isinstance(value, list) else []
    return tuple(_text(entry) for entry in entries if isinstance(entry, str))
