"""``proof.json``: a proof as a file, and back."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from articulate.assets.check_report import Check, CheckReport, Counts, JointCheck
from articulate.errors import AssetError
from articulate.files import write_json

PROOF_FILE = "proof.json"
PAGE_FILE = "proof.html"
SCHEMA = "articulate.proof"
SCHEMA_VERSION = 1


def content_of(proof: CheckReport) -> dict[str, Any]:
    """What ``proof.json`` holds: the verdict and its figures first, then all that was measured."""
    joints = [
        {
            "name": joint.name,
            "type": joint.kind,
            "range": joint.span,
            "swept": joint.swept,
            "blocked": joint.blocked,
            "needs": list(joint.needs),
            "opened": joint.opened,
        }
        for joint in proof.joints
    ]
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "asset": proof.asset,
        "verdict": proof.verdict,
        "reasons": list(proof.reasons),
        "repairs": list(proof.repairs),
        "joints": joints,
        "fk_max_error_m": _extreme(proof, ("fk", "fk_input"), max),
        "openness_min": _extreme(proof, ("openness",), min),
        "colliders": proof.colliders,
        "step_us": proof.step_us,
        "seconds": proof.seconds,
        "counts": None if proof.counts is None else dataclasses.asdict(proof.counts),
        "source": proof.source,
        "licence": proof.licence,
        "clauses": [dataclasses.asdict(clause) for clause in proof.clauses],
    }
    finite: dict[str, Any] = _finite(content)
    return finite


def _extreme(proof: CheckReport, names: tuple[str, ...], choose: Any) -> float | None:
    measured = [c.measured for c in proof.clauses if c.name in names and c.measured is not None]
    return choose(measured) if measured else None


def _finite(value: Any) -> Any:
    """``value`` with null for numbers that JSON cannot say."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def save_proof(proof: CheckReport, folder: Path) -> Path:
    """Write ``proof.json`` into ``folder``, whole or not at all, and return its path."""
    path = folder / PROOF_FILE
    write_json(path, content_of(proof))
    return path


def load_proof(folder: Path) -> CheckReport:
    """Read the proof that lies in ``folder``.

    Raises:
        AssetError: There is none, or it is of another schema.
    """
    path = folder / PROOF_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise AssetError(f"{path}: no proof ({error}); make one with check-asset") from None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise AssetError(f"{path}: not a proof of schema {SCHEMA} {SCHEMA_VERSION}")
    try:
        return _decoded(content)
    except (KeyError, TypeError) as error:
        raise AssetError(f"{path}: field missing or not known: {error}") from None


def _decoded(content: dict[str, Any]) -> CheckReport:
    counts = content["counts"]
    return CheckReport(
        asset=content["asset"],
        verdict=content["verdict"],
        reasons=tuple(content["reasons"]),
        repairs=tuple(content["repairs"]),
        clauses=tuple(Check(**clause) for clause in content["clauses"]),
        joints=tuple(
            JointCheck(
                name=joint["name"],
                kind=joint["type"],
                span=joint["range"],
                swept=joint["swept"],
                blocked=joint["blocked"],
                needs=tuple(joint["needs"]),
                opened=joint["opened"],
            )
            for joint in content["joints"]
        ),
        counts=None if counts is None else Counts(**{k: tuple(v) for k, v in counts.items()}),
        source=content["source"],
        licence=content["licence"],
        colliders=content["colliders"],
        step_us=content["step_us"],
        seconds=content["seconds"],
    )
