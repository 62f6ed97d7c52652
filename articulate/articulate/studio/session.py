"""Session of a correction: history with undo and redo, checks, export."""

from __future__ import annotations

import base64
import hashlib
import tempfile
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from articulate.asset_page.views import AZIMUTH_OFF_FRONT_DEG, ELEVATION_DEG
from articulate.errors import AssetError, UsageError
from articulate.files import copy_writable, write_bytes, write_json, write_text
from articulate.formats.load_meshes import Piece
from articulate.preparation.store import check_out, export
from articulate.reconstruct.program.decompile import decompile
from articulate.reconstruct.result import MADE_FILE, PROGRAM_FOLDER, SCHEMA, SCHEMA_VERSION
from articulate.studio.candidates import candidates, front_direction
from articulate.studio.checker import Checker
from articulate.studio.edits import Accept, Edit, apply_edit, edit_content
from articulate.studio.model import StudioLink, StudioModel
from articulate.studio.source import (
    HISTORY_FILE,
    HISTORY_SCHEMA,
    StudioSource,
    read_history,
)
from articulate.studio.write import URDF_NAME, write_model
from articulate.transforms import Array

MAX_EDITS = 2000
"""Most edits of a session."""
LOW_CONFIDENCE = 0.5
"""Joints with a lower confidence are marked as doubtful."""
EXPORT_WAIT_S = 600.0
"""Longest wait of an export for the check [s]."""


@dataclass(kw_only=True, eq=False)
class Session:
    """Object, its history and its checks; safe for several threads."""

    source: StudioSource
    out: Path
    """Folder of the export."""
    checker: Checker
    exported: bool = False
    """True if the present revision is exported."""
    _models: list[StudioModel] = field(default_factory=list)
    _edits: list[Edit] = field(default_factory=list)
    _position: int = 0
    _revision: int = 0
    _keys: dict[int, tuple[Piece, str]] = field(default_factory=dict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        """Restore the edits of an interrupted session and start the first check."""
        check_out(self.out)
        self._models = [self.source.model]
        for edit in read_history(self.autosave):
            self._models.append(apply_edit(self.model, edit))
            self._edits.append(edit)
            self._position += 1
        self.checker.start(self.model, self._revision)

    @property
    def autosave(self) -> Path:
        """File beside the export that holds the edits until they are exported."""
        return self.out.parent / f"{self.out.name}.edits.json"

    @property
    def model(self) -> StudioModel:
        """The object with the present edits."""
        return self._models[self._position]

    @property
    def edits(self) -> tuple[Edit, ...]:
        """Edits that are in effect."""
        return tuple(self._edits[: self._position])

    def apply(self, edit: Edit) -> None:
        """Apply a correction, forget undone ones, and check the result.

        Raises:
            UsageError: It is not possible; nothing is changed.
        """
        with self._lock:
            if self._position >= MAX_EDITS:
                raise UsageError(f"{MAX_EDITS} edits; export the object and open it again")
            model = apply_edit(self.model, edit)
            del self._edits[self._position :], self._models[self._position + 1 :]
            self._edits.append(edit)
            self._models.append(model)
            self._move(1, check=not isinstance(edit, Accept))

    def undo(self) -> None:
        """Undo the last edit in effect, if there is one."""
        with self._lock:
            if self._position > 0:
                self._move(-1)

    def redo(self) -> None:
        """Apply the edit that was undone last, if there is one."""
        with self._lock:
            if self._position < len(self._edits):
                self._move(1)

    def _move(self, step: int, *, check: bool = True) -> None:
        self._position += step
        self.exported = False
        write_json(self.autosave, self._history())
        if check:
            self._revision += 1
            self.checker.start(self.model, self._revision)

    def _history(self) -> dict[str, Any]:
        return {
            "schema": HISTORY_SCHEMA,
            "schema_version": 1,
            "edits": [edit_content(edit) for edit in self.edits],
        }

    def state(self) -> dict[str, Any]:
        """Return the state for the page: parts, joints, candidates, history and check."""
        with self._lock:
            model, source = self.model, self.source
            accepted = {edit.part for edit in self.edits if isinstance(edit, Accept)}
            corrected = {
                getattr(edit, "part", None) for edit in self.edits if not isinstance(edit, Accept)
            }
            front = front_direction(model)
            return {
                "name": model.name,
                "verdict": source.verdict,
                "reasons": list(source.reasons),
                "assumptions": list(source.assumptions),
                "inputs": [entry.mime for entry in source.inputs],
                "trace": source.trace is not None,
                "revision": self._revision,
                "azimuth_deg": float(np.degrees(np.arctan2(-front[1], -front[0])))
                + AZIMUTH_OFF_FRONT_DEG,
                "elevation_deg": ELEVATION_DEG,
                "bounds": model.bounds_o.tolist(),
                "parts": [
                    {
                        "name": link.name,
                        "pieces": [self._key(piece) for piece in link.visible],
                        "joint": _joint_content(link),
                        "bounds": link.bounds_o.tolist(),
                        "accepted": link.name in accepted,
                        "corrected": link.name in corrected,
                        **_evidence(source.evidence.get(link.name)),
                        "candidates": _candidates(model, link),
                    }
                    for link in model.links
                ],
                "history": [_described(edit) for edit in self.edits],
                "earlier": len(source.earlier),
                "can_undo": self._position > 0,
                "can_redo": self._position < len(self._edits),
                "check": self.check_state(),
                "out": str(self.out),
                "exported": self.exported,
            }

    def check_state(self) -> dict[str, Any] | None:
        """Return the state of the newest check for the page."""
        check = self.checker.state
        return None if check is None else check.content()

    def _key(self, piece: Piece) -> str:
        """Return a key that is the same for the same triangles and colour."""
        known = self._keys.get(id(piece))
        if known is None:
            digest = hashlib.sha256(np.asarray(piece.mesh.vertices).tobytes())
            digest.update(np.asarray(piece.mesh.faces).tobytes())
            digest.update(repr(piece.rgba).encode())
            known = self._keys[id(piece)] = (piece, digest.hexdigest()[:24])
        return known[1]

    def geometry(self) -> dict[str, Any]:
        """Return the triangles of each visible piece by its key, as base64 of little endian."""
        with self._lock:
            pieces = {
                self._key(piece): piece for link in self.model.links for piece in link.visible
            }
        return {key: _piece_content(piece) for key, piece in pieces.items()}

    def export(self) -> Path:
        """Write the checked object with its history, completely or not at all.

        Waits for the check. A rejected object is exported as program, report and history.

        Raises:
            UsageError: The folder cannot be written, or the check does not end.
        """
        with self._lock:
            model, revision, edits = self.model, self._revision, self.edits
        check = self.checker.wait(revision, EXPORT_WAIT_S)
        if check is None or check.folder is None:
            reason = "the check has not ended" if check is None else "; ".join(check.reasons)
            raise UsageError(f"{self.out}: cannot be exported: {reason}")
        with tempfile.TemporaryDirectory(prefix="articulate-studio-") as temporary:
            folder = Path(temporary) / "asset"
            copy_writable(check.folder, folder)
            program = folder / PROGRAM_FOLDER
            urdf = write_model(model, program)
            write_json(program / "source.json", dict(self.source.licence))
            try:
                write_text(program / "program.py", decompile(urdf))
            except AssetError:  # more numbers than a program may have: the URDF remains
                (program / "program.py").unlink(missing_ok=True)
            history = self._history()
            everything = (*self.source.earlier, *edits)
            history["edits"] = [edit_content(edit) for edit in everything]
            history["source"] = self.source.path.name
            write_json(folder / HISTORY_FILE, history)
            write_json(folder / MADE_FILE, self._made(model, check.verdict, check.reasons))
            if self.source.trace is not None:
                write_bytes(folder / "trace.html", self.source.trace)
            export(folder, self.out)
        with self._lock:
            if self._revision == revision:
                self.exported = True
                self.autosave.unlink(missing_ok=True)
        return self.out

    def _made(self, model: StudioModel, verdict: str, reasons: tuple[str, ...]) -> dict[str, Any]:
        usable = verdict in {"passed", "repaired"}
        return {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "verdict": "passed" if usable else verdict,
            "reasons": [] if usable else list(reasons),
            "asset": str(self.out),
            "urdf": str(self.out / URDF_NAME) if usable else None,
            "program": str(self.out / PROGRAM_FOLDER / "program.py"),
            "check_report": str(self.out / "check_report.html"),
            "trace": str(self.out / "trace.html") if self.source.trace is not None else None,
            "recording": None,
            "check_verdict": verdict,
            "rating": None,
            "joints": [
                {
                    "part": link.name,
                    "parent": link.joint.parent,
                    "type": link.joint.kind,
                    "axis": list(link.joint.axis_o),
                    "pivot": list(link.joint.pivot_o),
                    "lower": link.joint.lower,
                    "upper": link.joint.upper,
                    "confidence": 1.0,
                    "evidence": "person",
                }
                for link in model.links
                if link.joint is not None and link.joint.kind != "fixed"
            ],
            "category": self.source.licence.get("category"),
            "confidence": None,
            "assumptions": list(self.source.assumptions),
            "seconds": 0.0,
        }

    def close(self) -> None:
        """End the checks."""
        self.checker.close()


def _joint_content(link: StudioLink) -> dict[str, Any] | None:
    joint = link.joint
    if joint is None:
        return None
    return {
        "name": joint.name,
        "kind": joint.kind,
        "parent": joint.parent,
        "axis": list(joint.axis_o),
        "pivot": list(joint.pivot_o),
        "lower": joint.lower,
        "upper": joint.upper,
        "mimic": None if joint.mimic is None else list(joint.mimic),
    }


def _evidence(entry: Mapping[str, Any] | None) -> dict[str, Any]:
    confidence = None if entry is None else entry["confidence"]
    return {
        "confidence": confidence,
        "evidence": "" if entry is None else entry["evidence"],
        "doubtful": confidence is not None and confidence < LOW_CONFIDENCE,
    }


def _candidates(model: StudioModel, link: StudioLink) -> list[dict[str, Any]]:
    if link.joint is None or not link.visible:
        return []
    return [
        {"label": entry.label, "edit": edit_content(entry.edit)}
        for entry in candidates(model, link.name)
    ]


def _described(edit: Edit) -> str:
    """Return one line that describes an edit."""
    content = edit_content(edit)
    kind = content.pop("type").replace("_", " ")
    part = content.pop("part", "")
    content.pop("faces", None)
    values = ", ".join(f"{key.removesuffix('_o')} {_short(v)}" for key, v in content.items())
    return " ".join(f"{kind} {part}: {values}".rstrip(": ").split())


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    if isinstance(value, list | tuple):
        return f"({', '.join(_short(entry) for entry in value)})"
    return str(value)


def _piece_content(piece: Piece) -> dict[str, Any]:
    vertices = np.asarray(piece.mesh.vertices, dtype="<f4")
    faces = np.asarray(piece.mesh.faces, dtype="<u4")
    return {
        "vertices": base64.b64encode(vertices.tobytes()).decode("ascii"),
        "faces": base64.b64encode(faces.tobytes()).decode("ascii"),
        "components": base64.b64encode(_components(piece).tobytes()).decode("ascii"),
        "rgba": list(piece.rgba),
    }


def _components(piece: Piece) -> Array:
    """Return the number of the connected component of each face (F,), as uint32.

    Faces are connected if they share a corner at the same position.
    """
    corners = np.round(np.asarray(piece.mesh.vertices), 6)
    index = np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1)
    faces = index[np.asarray(piece.mesh.faces)]
    n = int(index.max()) + 1 if len(index) else 0
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_matrix((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(n, n))
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels[faces[:, 0]], dtype="<u4")
