"""From the records of all objects to ``results.json``."""

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
from articulate.benchmark.statistics import clustered_mean, wilson
from articulate.reconstruct.actors.protocol import FAILURES

SCHEMA = "articulate.benchmark"
SCHEMA_VERSION = 1
SEEN_PX = 5.0
"""A joint whose part moves by less in the picture is reported in a row of its own."""
VISIBLE_PX = 200.0
"""The same for placing a part that shows fewer pixels."""
FAMILIAR = frozenset({"StorageFurniture", "Laptop", "Box", "Table", "Refrigerator"})
"""The publication's five categories within the training of its rivals."""
WORST_AXIS_RAD = float(np.pi / 2)
DEFAULT_DIAGONAL = 2.0
LINKS = "links"
"""Failure of a joint whose object was not put together rightly; it comes before all others."""


@dataclass(frozen=True, kw_only=True)
class Item:
    """One true joint and what became of it."""

    object_id: str
    category: str
    kind: str
    row: str
    """``seen``, ``hardly_seen`` or ``compound``."""
    released: bool
    failures: dict[str, str]
    literal_origin: str
    errors: Record | None
    endpoints: Record | None
    diagonal: float
    spurious: int
    """Joints invented on fixed parts, counted with the first joint of each question; for groups."""
    critic: str | None
    attempts: tuple[Record, ...]


def items_of(records: Sequence[Record]) -> list[Item]:
    """All true joints of the records."""
    return [
        _item(record, case, joint, first=k == 0)
        for record in records
        for case in record["cases"]
        for k, joint in enumerate(case["joints"])
    ]


def _item(record: Record, case: Record, joint: Record, *, first: bool) -> Item:
    failures = dict(joint["failures"])
    placement = case.get("placement")
    for protocol, right in (placement or {"success": {}})["success"].items():
        if not right:
            failures[protocol] = LINKS
    moved = case.get("moved_px")
    row = "hardly_seen" if moved is not None and moved < SEEN_PX else "seen"
    return Item(
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
        spurious=case["spurious"] if first else 0,
        critic=case.get("critic") if len(case["joints"]) == 1 else None,
        attempts=tuple(joint["attempts"]),
    )


def summary(records: Sequence[Record], config: BenchmarkConfig, dataset: str) -> Record:
    """The content of ``results.json``.

    Args:
        records: One for each object, in any order.
        config: What was run.
        dataset: Name of the data set.
    """
    records = sorted(records, key=lambda r: str(r["object"]))
    items = items_of(records)
    head = [item for item in items if item.row == "seen"]
    # Of all questions: one about an object that has no joints has no item to count them with.
    spurious = sum(case["spurious"] for record in records for case in record["cases"])
    rng = np.random.default_rng(config.seed)
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "dataset": dataset,
        "config": dataclasses.asdict(config),
        "objects": len(records),
        "joints": len(items),
        "lost": [
            {"object": r["object"], "category": r["category"], "why": r["error"]}
            for r in records
            if r["error"]
        ],
        "refused": sum(bool(c["refusal"]) for r in records for c in r["cases"]),
        "protocols": rows_of(head, spurious),
        "rows": {
            name: rows_of([item for item in items if item.row == name], count)
            for name, count in (("seen", spurious), ("hardly_seen", 0), ("compound", 0))
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
        "spurious": spurious,
        "placement": placement(records),
        "cost": cost(records),
    }


def rows_of(items: Sequence[Item], spurious: int) -> dict[str, Record]:
    """What each protocol says of some joints, and of as many invented beside them."""
    out: dict[str, Record] = {p: _row(items, p, spurious) for p in PROTOCOLS}
    good = sum(item.literal_origin == "success" for item in items)
    out["paper_literal_origin"] = {"joint_success": wilson(good, len(items)).share, "n": len(items)}
    return out


def _group(items: Sequence[Item]) -> dict[str, Record]:
    """Rows of some of the joints, and of what was invented in questions that begin with them."""
    return rows_of(items, sum(item.spurious for item in items))


def _row(items: Sequence[Item], protocol: Protocol, spurious: int) -> Record:
    counted = [item for item in items if protocol != "released_code" or item.released]
    extra = spurious if protocol == "strict" else 0
    found = Counter(item.failures[protocol] for item in counted)
    n = len(counted) + extra
    success = wilson(found["success"], n)
    near = wilson(found["success"] + found["joint_limit"], n)
    failed = [LINKS, *FAILURES[1:]]
    return {
        "joint_success": success.share,
        "joint_success_interval": [success.low, success.high],
        "type_axis_origin": near.share,
        "type_axis_origin_interval": [near.low, near.high],
        "n": n,
        "spurious": spurious,
        "failures": {name: found[name] for name in failed if found[name] or name != LINKS},
    }


def error_means(items: Sequence[Item], rng: np.random.Generator) -> Record:
    """Mean errors of the published kinds; what was not said counts as the worst case.

    The worst axis is a right angle off, the worst origin a diagonal of the object.
    """
    turning = [item for item in items if item.kind != "prismatic"]
    named = [item for item in items if item.errors and item.errors["kind_equal"]]
    measures: dict[str, tuple[Sequence[Item], Callable[[Item], float]]] = {
        "type": (items, lambda i: float(not (i.errors and i.errors["kind_equal"]))),
        "axis_rad": (items, lambda i: _of(i, "axis_rad", WORST_AXIS_RAD)),
        "origin": (turning, lambda i: _of(i, "origin_paper", i.diagonal)),
        "origin_near_part": (turning, lambda i: _of(i, "origin_foot", i.diagonal)),
        "axis_rad_where_type_is_right": (named, lambda i: _of(i, "axis_rad", WORST_AXIS_RAD)),
        "origin_where_type_is_right": (
            [item for item in named if item.kind != "prismatic"],
            lambda i: _of(i, "origin_paper", i.diagonal),
        ),
    }
    return {
        name: dataclasses.asdict(
            clustered_mean([value(i) for i in of], [i.object_id for i in of], rng)
        )
        for name, (of, value) in measures.items()
    }


def _of(item: Item, name: str, worst: float) -> float:
    """An error of the item, at most ``worst``, which also stands for what is missing."""
    value = None if item.errors is None else item.errors[name]
    if name.startswith("origin") and item.errors and not item.errors["kind_equal"]:
        return worst  # a slide's origin says nothing of where a part turns
    return worst if value is None else min(float(value), worst)


def endpoint_means(items: Sequence[Item], rng: np.random.Generator) -> Record:
    """Mean distances of ArticulateArena; a joint that was not said is a fixed one."""
    out = {}
    for name in ("split", "kinetic", "compact"):
        has = [i for i in items if i.endpoints and i.endpoints[name] is not None]
        values = [float(i.endpoints[name]) for i in has if i.endpoints]
        out[name] = dataclasses.asdict(clustered_mean(values, [i.object_id for i in has], rng))
    return out


def _groups(items: Sequence[Item]) -> Record:
    tests: dict[str, Callable[[Item], bool]] = {
        "in_distribution": lambda i: i.category in FAMILIAR,
        "out_of_distribution": lambda i: i.category not in FAMILIAR,
        "prismatic": lambda i: i.kind == "prismatic",
        "revolute": lambda i: i.kind == "revolute",
        "continuous": lambda i: i.kind == "continuous",
    }
    return {name: _group([i for i in items if test(i)]) for name, test in tests.items()}


def iterations(items: Sequence[Item]) -> list[Record]:
    """Success after each turn of the loop, an object that had stopped keeping what it had."""
    tried = [item for item in items if item.attempts]
    most = max((len(item.attempts) for item in tried), default=0)
    out = []
    for k in range(most):
        row: Record = {"iteration": k + 1}
        for protocol in ("paper", "strict"):
            at = [i.attempts[min(k, len(i.attempts) - 1)]["failures"][protocol] for i in tried]
            row[protocol] = dataclasses.asdict(wilson(at.count("success"), len(at)))
        row["still_running"] = sum(len(item.attempts) > k for item in tried)
        out.append(row)
    return out


def confusion(items: Sequence[Item], protocol: str) -> Record:
    """How often the critic said what (columns) where the truth says what (rows)."""
    judged = [item for item in items if item.critic is not None]
    counts = Counter((item.failures[protocol], item.critic) for item in judged)
    matrix = [[counts[truth, said] for said in FAILURES] for truth in FAILURES]
    return {"order": list(FAILURES), "truth_by_critic": matrix, "n": len(judged)}


def placement(records: Sequence[Record]) -> Record | None:
    """Success of link placement; None where it was not asked."""
    asked = [c["placement"] for r in records for c in r["cases"] if c.get("placement")]
    if not asked:
        return None
    parts = [part for p in asked for part in p["parts"]]
    shown = [part for part in parts if (part["visible_px"] or 0.0) >= VISIBLE_PX]
    hidden = [part for part in parts if part["visible_px"] is not None and part not in shown]
    lost = sum(bool(r["error"]) for r in records)
    rows = {
        "links_visible": shown,
        "links_hardly_visible": hidden,
        "links_all": parts,
    }
    return {
        "objects": {
            protocol: dataclasses.asdict(
                wilson(sum(p["success"][protocol] for p in asked), len(asked) + lost)
            )
            for protocol in PROTOCOLS
        },
        **{
            name: dataclasses.asdict(wilson(sum(part["right"] for part in of), len(of)))
            for name, of in rows.items()
        },
    }


def cost(records: Sequence[Record]) -> Record:
    """Seconds and calls of a question and of an object."""
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
        "seconds_per_question": spread(seconds),
        "seconds_per_object": spread(objects),
        "calls_per_object": spread(calls),
        "calls": int(sum(calls)),
    }
