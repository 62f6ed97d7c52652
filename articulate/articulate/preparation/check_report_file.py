"""``check_report.json``: a proof as a file, and back."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from articulate.assets.check_report import Check, CheckReport, Counts, JointCheck
from articulate.errors import AssetError
from articulate.files import write_json

CHECK_REPORT_FILE = "check_report.json"
PAGE_FILE = "check_report.html"
SCHEMA = "articulate.check_report"
SCHEMA_VERSION = 2


def content_of(check_report: CheckReport) -> dict[str, Any]:
    """What ``check_report.json`` holds: the verdict and its figures first, then all that was measured."""
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
        for joint in check_report.joints
    ]
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "asset": check_report.asset,
        "verdict": check_report.verdict,
        "reasons": list(check_report.reasons),
        "repairs": list(check_report.repairs),
        "joints": joints,
        "kinematics_max_error_m": _extreme(
            check_report, ("forward_kinematics", "input_kinematics"), max
        ),
        "cavities_min": _extreme(check_report, ("cavities",), min),
        "colliders": check_report.colliders,
        "step_us": check_report.step_us,
        "seconds": check_report.seconds,
        "counts": None if check_report.counts is None else dataclasses.asdict(check_report.counts),
        "source": check_report.source,
        "licence": check_report.licence,
        "checks": [dataclasses.asdict(check) for check in check_report.checks],
    }
    finite: dict[str, Any] = _finite(content)
    return finite


def _extreme(check_report: CheckReport, names: tuple[str, ...], choose: Any) -> float | None:
    measured = [
        c.measured for c in check_report.checks if c.name in names and c.measured is not None
    ]
    return choose(measured) if measured else None


def _finite(value: Any) -> Any:
    """``value`` with null for numbers that JSON cannot say."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def save_check_report(check_report: CheckReport, folder: Path) -> Path:
    """Write ``check_report.json`` into ``folder``, whole or not at all, and return its path."""
    path = folder / CHECK_REPORT_FILE
    write_json(path, content_of(check_report))
    return path


def load_check_report(folder: Path) -> CheckReport:
    """Read the proof that lies in ``folder``.

    Raises:
        AssetError: There is none, or it is of another schema.
    """
    path = folder / CHECK_REPORT_FILE
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
        checks=tuple(Check(**check) for check in content["checks"]),
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
