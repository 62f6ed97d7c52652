"""Summary of the records of all objects: the content of ``results.json``."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.protocols import PROTOCOLS, Protocol
from articulate.benchmark.records import Record
from articulate.reconstruct.actors.protocol import FAILURES, GOOD_ENOUGH
from articulate.statistics import clustered_mean, wilson

SCHEMA = "articulate.benchmark"
SCHEMA_VERSION = 2
MIN_MOTION_PX = 5.0
"""A joint whose part moves less in the image is reported in a separate row."""
VISIBLE_PX = 200.0
"""A placed part with fewer visible pixels is reported in a separate row."""
IN_DISTRIBUTION = frozenset({"StorageFurniture", "Laptop", "Box", "Table", "Refrigerator"})
"""The five categories in the training data of the publication's baselines."""
AMBIGUOUS = frozenset({"Chair", "Faucet", "FoldingChair", "Knife", "Window"})
"""Categories in which part names allow several joints: levers on top or at the side, windows that
slide or tip, seats that turn, rise or fold, blades that slide or fold."""
WORST_AXIS_RAD = float(np.pi / 2)
DEFAULT_DIAGONAL = 2.0
LINKS = "links"
"""Failure of a joint whose parts were not placed correctly; it precedes all others."""


@dataclass(frozen=True, kw_only=True)
class ScoredJoint:
    """One true joint with its scores."""

    object_id: str
    category: str
    kind: str
    row: str
    """``visible``, ``low_visibility`` or ``compound``."""
    released: bool
    failures: dict[str, str]
    literal_origin: str
    errors: Record | None
    endpoints: Record | None
    diagonal: float
    false_positives: int
    """Joints predicted for fixed parts, counted with the first joint of each case; for groups."""
    critic: str | None
    attempts: tuple[Record, ...]


def scored_joints(records: Sequence[Record]) -> list[ScoredJoint]:
    """Return all true joints of the records."""
    return [
        _scored_joint(record, case, joint, first=k == 0)
        for record in records
        for case in record["cases"]
        for k, joint in enumerate(case["joints"])
    ]


def _scored_joint(record: Record, case: Record, joint: Record, *, first: bool) -> ScoredJoint:
    failures = dict(joint["failures"])
    placement = case.get("placement")
    for protocol, right in (placement or {"success": {}})["success"].items():
        if not right:
            failures[protocol] = LINKS
    moved = case.get("moved_px")
    row = "low_visibility" if moved is not None and moved < MIN_MOTION_PX else "visible"
    return ScoredJoint(
        object_id=record["object"],
        category=record["category"],
        kind=joint["kind"],
        row="compound" if joint["status"] == "compound" else row,
        released=joint["released"],
        failures=failures,
        literal_origin=joint["literal_origin"],
        errors=joint["errors"],
        endpoints=joint.get("endpoints"),
        diagonal=record["diagonal"] or DEFAULT_DIAGONAL,
        false_positives=case["false_positives"] if first else 0,
        critic=case.get("critic") if len(case["joints"]) == 1 else None,
        attempts=tuple(joint["attempts"]),
    )


def summary(records: Sequence[Record], config: BenchmarkConfig, dataset: str) -> Record:
    """Return the content of ``results.json``.

    Args:
        records: One for each object, in any order.
        config: Settings of the run.
        dataset: Name of the data set.
    """
    records = sorted(records, key=lambda r: str(r["object"]))
    items = scored_joints(records)
    head = [item for item in items if item.row == "visible"]
    # Counted over all cases, as the case of an object without joints has no scored joint.
    false_positives = sum(case["false_positives"] for record in records for case in record["cases"])
    rng = np.random.default_rng(config.seed)
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "dataset": dataset,
        "config": dataclasses.asdict(config),
        "objects": len(records),
        "joints": len(items),
        "crashed": [
            {"object": r["object"], "category": r["category"], "reason": r["error"]}
            for r in records
            if r["error"]
        ],
        "rejected": sum(bool(c["rejection"]) for r in records for c in r["cases"]),
        "protocols": rows_of(head, false_positives),
        "rows": {
            name: rows_of([item for item in items if item.row == name], count)
            for name, count in {
                "visible": false_positives,
                "low_visibility": 0,
                "compound": 0,
            }.items()
        },
        "errors": error_means(head, rng),
        "endpoints": endpoint_means(head, rng),
        "groups": _groups(head),
        "categories": {
            category: _group([item for item in head if item.category == category])
            for category in sorted({item.category for item in head})
        },
        "iterations": iterations(head),
        "critic": {p: confusion(head, p) for p in ("paper", "strict")},
        "false_positives": false_positives,
        "placement": placement(records),
        "cost": cost(records),
    }


def share_row(successes: int, n: int) -> Record:
    """Return a proportion with Wilson's 95 % interval as a JSON object; None of no trials."""
    if n == 0:
        return {"successes": 0, "n": 0, "share": None, "low": None, "high": None}
    share = wilson(successes, n)
    return {
        "successes": successes,
        "n": n,
        "share": share.value,
        "low": share.low,
        "high": share.high,
    }


def rows_of(items: Sequence[ScoredJoint], false_positives: int) -> dict[str, Record]:
    """Return the row of each protocol for some joints, with a number of false positives."""
    out: dict[str, Record] = {p: _row(items, p, false_positives) for p in PROTOCOLS}
    good = sum(item.literal_origin == "success" for item in items)
    out["paper_literal_origin"] = {
        "joint_success": share_row(good, len(items))["share"],
        "n": len(items),
    }
    return out


def _group(items: Sequence[ScoredJoint]) -> dict[str, Record]:
    """Return the rows of some joints, with the false positives that are counted with them."""
    return rows_of(items, sum(item.false_positives for item in items))


def _row(items: Sequence[ScoredJoint], protocol: Protocol, false_positives: int) -> Record:
    counted = [item for item in items if protocol != "released_code" or item.released]
    extra = false_positives if protocol == "strict" else 0
    found = Counter(item.failures[protocol] for item in counted)
    n = len(counted) + extra
    success = share_row(found["success"], n)
    near = share_row(found["success"] + found["joint_limit"], n)
    failed = [LINKS, *FAILURES[1:]]
    return {
        "joint_success": success["share"],
        "joint_success_interval": [success["low"], success["high"]],
        "type_axis_origin": near["share"],
        "type_axis_origin_interval": [near["low"], near["high"]],
        "n": n,
        "false_positives": false_positives,
        "failures": {name: found[name] for name in failed if found[name] or name != LINKS},
    }


def error_means(items: Sequence[ScoredJoint], rng: np.random.Generator) -> Record:
    """Compute mean errors of the published kinds; missing joints count as the worst case.

    The worst axis error is a right angle, the worst origin error the object's diagonal.
    """
    turning = [item for item in items if item.kind != "prismatic"]
    named = [item for item in items if item.errors and item.errors["kind_equal"]]
    measures: dict[str, tuple[Sequence[ScoredJoint], Callable[[ScoredJoint], float]]] = {
        "type": (items, lambda i: float(not (i.errors and i.errors["kind_equal"]))),
        "axis_rad": (items, lambda i: _limited(i, "axis_rad", WORST_AXIS_RAD)),
        "origin": (turning, lambda i: _limited(i, "origin_paper", i.diagonal)),
        "origin_near_part": (turning, lambda i: _limited(i, "origin_foot", i.diagonal)),
        "axis_rad_where_type_is_right": (named, lambda i: _limited(i, "axis_rad", WORST_AXIS_RAD)),
        "origin_where_type_is_right": (
            [item for item in named if item.kind != "prismatic"],
            lambda i: _limited(i, "origin_paper", i.diagonal),
        ),
    }
    return {
        name: dataclasses.asdict(
            clustered_mean([value(i) for i in of], [i.object_id for i in of], rng)
        )
        for name, (of, value) in measures.items()
    }


def _limited(item: ScoredJoint, name: str, worst: float) -> float:
    """Return an error of a joint, at most ``worst``, which also replaces missing errors."""
    value = None if item.errors is None else item.errors[name]
    if name.startswith("origin") and item.errors and not item.errors["kind_equal"]:
        return worst  # the origin of a slide does not locate an axis
    return worst if value is None else min(float(value), worst)


def endpoint_means(items: Sequence[ScoredJoint], rng: np.random.Generator) -> Record:
    """Compute mean distances of ArticulateArena; missing joints count as fixed."""
    out = {}
    for name in ("split", "kinetic", "compact"):
        has = [i for i in items if i.endpoints and i.endpoints[name] is not None]
        values = [float(i.endpoints[name]) for i in has if i.endpoints]
        out[name] = dataclasses.asdict(clustered_mean(values, [i.object_id for i in has], rng))
    return out


def _groups(items: Sequence[ScoredJoint]) -> Record:
    tests: dict[str, Callable[[ScoredJoint], bool]] = {
        "in_distribution": lambda i: i.category in IN_DISTRIBUTION,
        "out_of_distribution": lambda i: i.category not in IN_DISTRIBUTION,
        "ambiguous": lambda i: i.category in AMBIGUOUS,
        "prismatic": lambda i: i.kind == "prismatic",
        "revolute": lambda i: i.kind == "revolute",
        "continuous": lambda i: i.kind == "continuous",
    }
    return {name: _group([i for i in items if test(i)]) for name, test in tests.items()}


def iterations(items: Sequence[ScoredJoint]) -> list[Record]:
    """Compute success after each iteration; objects that had stopped keep their result."""
    attempted = [item for item in items if item.attempts]
    most = max((len(item.attempts) for item in attempted), default=0)
    out = []
    for k in range(most):
        row: Record = {"iteration": k + 1}
        for protocol in ("paper", "strict"):
            at = [i.attempts[min(k, len(i.attempts) - 1)]["failures"][protocol] for i in attempted]
            row[protocol] = share_row(at.count("success"), len(at))
        row["critic"] = share_row(sum(_accepted(item, k) for item in attempted), len(attempted))
        row["still_running"] = sum(len(item.attempts) > k for item in attempted)
        out.append(row)
    return out


def _accepted(item: ScoredJoint, k: int) -> bool:
    """Return whether the critic accepts the best attempt after iteration ``k``, from 0."""
    best = item.attempts[min(k, len(item.attempts) - 1)]["best"]
    rating = item.attempts[best]["rating"]
    return rating is not None and rating > GOOD_ENOUGH


def confusion(items: Sequence[ScoredJoint], protocol: str) -> Record:
    """Count failures by truth (rows) and by the critic (columns)."""
    assessed = [item for item in items if item.critic is not None]
    counts = Counter((item.failures[protocol], item.critic) for item in assessed)
    matrix = [[counts[truth, critic] for critic in FAILURES] for truth in FAILURES]
    return {"order": list(FAILURES), "truth_by_critic": matrix, "n": len(assessed)}


def placement(records: Sequence[Record]) -> Record | None:
    """Compute the success of link placement; None for other tasks."""
    placements = [c["placement"] for r in records for c in r["cases"] if c.get("placement")]
    if not placements:
        return None
    parts = [part for p in placements for part in p["parts"]]
    visible = [part for part in parts if (part["visible_px"] or 0.0) >= VISIBLE_PX]
    low = [part for part in parts if part["visible_px"] is not None and part not in visible]
    n_objects = len(placements) + sum(bool(r["error"]) for r in records)
    rows = {
        "links_visible": visible,
        "links_low_visibility": low,
        "links_all": parts,
    }
    return {
        "objects": {
            protocol: share_row(sum(p["success"][protocol] for p in placements), n_objects)
            for protocol in PROTOCOLS
        },
        **{
            name: share_row(sum(part["right"] for part in of), len(of)) for name, of in rows.items()
        },
    }


def cost(records: Sequence[Record]) -> Record:
    """Summarize seconds and calls of cases and objects."""
    cases = [c for r in records for c in r["cases"] if c["seconds"] is not None]
    seconds = np.array([c["seconds"] for c in cases])
    objects = [sum(c["seconds"] or 0.0 for c in r["cases"]) for r in records if not r["error"]]
    calls = [sum(c["calls"] for c in r["cases"]) for r in records]

    def spread(values: Sequence[float] | np.ndarray[Any, Any]) -> Record:
        if not len(values):
            return {"median": None, "p90": None, "max": None}
        return {
            "median": float(np.median(values)),
            "p90": float(np.percentile(values, 90)),
            "max": float(np.max(values)),
        }

    return {
        "seconds_per_case": spread(seconds),
        "seconds_per_object": spread(objects),
        "calls_per_object": spread(calls),
        "calls": int(sum(calls)),
    }
