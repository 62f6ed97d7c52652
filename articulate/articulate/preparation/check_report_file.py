"""Read and write ``check_report.json``."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

from articulate.assets.check_report import VERDICTS, Check, CheckReport, Counts, JointCheck
from articulate.errors import AssetError, field_error, quote
from articulate.files import write_json
from articulate.untrusted import load_json_object

CHECK_REPORT_FILE = "check_report.json"
PAGE_FILE = "check_report.html"
SCHEMA = "articulate.check_report"
SCHEMA_VERSION = 2


def content_of(check_report: CheckReport) -> dict[str, Any]:
    """Return the content of ``check_report.json``: verdict and figures, then all measurements."""
    joints = [
        {
            "name": joint.name,
            "type": joint.kind,
            "travel": joint.span,
            "range": None if joint.lower is None else [joint.lower, joint.upper],
            "swept": joint.swept,
            "blocked": joint.blocked,
            "needs": list(joint.needs),
            "opened": joint.opened,
        }
        for joint in check_report.joints
    ]
    counts = check_report.counts
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
        "counts": None if counts is None else dataclasses.asdict(counts),
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
    """Replace numbers that JSON cannot hold by null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def save_check_report(check_report: CheckReport, folder: Path) -> Path:
    """Write ``check_report.json`` into ``folder``, completely or not at all; return its path."""
    path = folder / CHECK_REPORT_FILE
    write_json(path, content_of(check_report))
    return path


def load_check_report(folder: Path) -> CheckReport:
    """Read the check report in ``folder``.

    Raises:
        AssetError: There is none, or it was written by another version.
    """
    path = folder / CHECK_REPORT_FILE
    content = load_json_object(path, error=AssetError)
    if content.get("schema") != SCHEMA or content.get("schema_version") != SCHEMA_VERSION:
        raise AssetError(
            f"{path}: not a check report of schema {SCHEMA} {SCHEMA_VERSION}; "
            "make it with check-asset"
        )
    try:
        return _decoded(content)
    except (KeyError, TypeError, AttributeError) as error:
        reason = quote(str(error)) if isinstance(error, AttributeError) else field_error(error)
        raise AssetError(f"{path}: {reason}; make it with check-asset") from None


def _decoded(content: dict[str, Any]) -> CheckReport:
    counts = content["counts"]
    if content["verdict"] not in VERDICTS:
        raise TypeError(f"verdict {quote(content['verdict'])}")
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
                span=joint["travel"],
                lower=None if joint["range"] is None else joint["range"][0],
                upper=None if joint["range"] is None else joint["range"][1],
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
