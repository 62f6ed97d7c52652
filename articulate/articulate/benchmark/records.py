"""Records of objects as plain JSON values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from articulate.benchmark.known_joint import KnownJoint

Record = dict[str, Any]


def crashed_object(
    object_id: str, category: str, known: Sequence[KnownJoint], reason: str
) -> Record:
    """Return the record of an object without predictions: every joint of it is wrong."""
    joints: list[Record] = [
        {
            "joint": k.link,
            "kind": k.kind,
            "status": k.status,
            "released": k.kind in {"revolute", "prismatic"},
            "failures": dict.fromkeys(("paper", "released_code", "strict"), "joint_type"),
            "literal_origin": "joint_type",
            "errors": None,
            "attempts": [],
        }
        for k in known
    ]
    case = {
        "case": "all",
        "seconds": None,
        "calls": 0,
        "rejection": reason,
        "no_answer": True,
        "false_positives": 0,
        "moved_px": None,
        "placement": None,
        "joints": joints,
    }
    return {
        "object": object_id,
        "category": category,
        "error": reason,
        "diagonal": None,
        "cases": [case],
    }


def is_final(record: Record) -> bool:
    """Return whether a record is a result of the actor; others are computed again.

    An error, a time limit or a busy server may have another outcome the next time.
    """
    return not record["error"] and not any(case.get("no_answer") for case in record["cases"])


def plain(value: Any) -> Any:
    """Convert a value for JSON: numbers that are not finite become None, tuples lists."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
