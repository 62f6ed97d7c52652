"""Run an actor on the cases of one object and score its predictions, as plain JSON values."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping, Sequence

import numpy as np

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.endpoint_error import endpoint_metrics
from articulate.benchmark.evidence import Case, cases_of
from articulate.benchmark.placement import (
    PlacementErrors,
    placement_errors,
    placement_success,
    released_placement,
)
from articulate.benchmark.protocols import (
    JointScore,
    Protocol,
    best_by_critic,
    best_by_truth,
    counts_in_released,
    score,
)
from articulate.benchmark.records import Record, plain
from articulate.benchmark.truth import TrueJoint, TrueObject, renamed
from articulate.errors import BudgetError, MissingError, UsageError
from articulate.formats.part_names import plain_label
from articulate.jobs.processor_limit import ProcessorLimitReached, processor_limit
from articulate.reconstruct.actors.protocol import Actor, Failure, PredictedJoint, Prediction
from articulate.transforms import Array, matrix_to_quat


def run_object(subject: TrueObject, actor: Actor, config: BenchmarkConfig) -> Record:
    """Run and score all cases of an object."""
    cases = [
        run_case(subject, case, actor, config.query_limit_s) for case in cases_of(subject, config)
    ]
    return {
        "object": subject.object_id,
        "category": subject.category,
        "error": "",
        "diagonal": float(np.linalg.norm(np.ptp(subject.box_of(p.name for p in subject.parts), 0))),
        "cases": cases,
    }


def run_case(subject: TrueObject, case: Case, actor: Actor, limit_s: float = math.inf) -> Record:
    """Run and score one case, in ``limit_s`` of processor time [s]."""
    start = time.perf_counter()
    no_answer = False
    try:
        with processor_limit(limit_s):
            prediction = actor.predict(case.evidence)
        rejection = prediction.rejection
    except ProcessorLimitReached:
        rejection = f"more than {limit_s:g} s of processor time"
        prediction = Prediction(joints=())
    except (MissingError, BudgetError):  # also for all other objects
        raise
    except (UsageError, OSError) as error:  # a busy server or a file; it may succeed next time
        prediction, rejection, no_answer = Prediction(joints=()), str(error), True
    except Exception as error:  # noqa: BLE001  a bug of an actor fails this case, not the run
        prediction, rejection = Prediction(joints=()), f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - start
    placement = _placement(subject, case, prediction)
    shift = np.zeros(3) if placement is None else placement.shift
    names = case.names if placement is None else _matched_names(subject, case.names, placement)
    final = _in_true_names(prediction.joints, names, shift)
    attempts = [
        _in_true_names(attempt.joints, names, shift) for attempt in prediction.attempts
    ] or [final]
    ratings = [None if a.verdict is None else a.verdict.rating for a in prediction.attempts]
    joints = [
        _joint_record(subject, joint, final, attempts, ratings or [prediction.rating])
        for joint in case.joints
    ]
    return {
        "case": case.name,
        "seconds": seconds,
        "calls": prediction.calls,
        "rejection": rejection,
        "no_answer": no_answer,
        "false_positives": len(_on_fixed_parts(subject, final)),
        "moved_px": case.moved_px,
        "rating": plain(prediction.rating),
        "critic": None if prediction.verdict is None else prediction.verdict.failure,
        "placement": None if placement is None else _placement_record(subject, case, placement),
        "joints": joints,
        "fixed": [[joint.part, joint.parent] for joint in final if joint.kind == "fixed"],
    }


def _joint_record(
    subject: TrueObject,
    truth: TrueJoint,
    joints: Sequence[PredictedJoint],
    attempts: Sequence[Sequence[PredictedJoint]],
    ratings: Sequence[float | None],
) -> Record:
    box = subject.box_of(truth.rigid)
    found = predicted_for(truth, joints)
    final = score(truth.joint, found, box)
    scores = [score(truth.joint, predicted_for(truth, attempt), box) for attempt in attempts]
    by_truth = scores[best_by_truth(scores)]
    failures: dict[Protocol, Failure] = {**final.failures}
    failures["released_code"] = by_truth.failures["released_code"]
    return {
        "joint": truth.joint.part,
        "kind": truth.joint.kind,
        "status": truth.status,
        "released": counts_in_released(truth.joint),
        "failures": failures,
        "literal_origin": final.literal_origin,
        "errors": None if final.errors is None else plain(dataclasses.asdict(final.errors)),
        "endpoints": plain(dataclasses.asdict(endpoint_metrics(truth.joint, found, box))),
        "truth": plain(dataclasses.asdict(truth.joint)),
        "predicted": None if found is None else plain(dataclasses.asdict(found)),
        "attempts": _iterations(scores, ratings),
    }


def _iterations(scores: Sequence[JointScore], ratings: Sequence[float | None]) -> list[Record]:
    """Record the best attempt so far after each iteration, by the actor's critic."""
    out = []
    for k in range(len(scores)):
        best = best_by_critic(ratings[: k + 1])
        failures = scores[best].failures
        out.append({"rating": plain(ratings[k]), "best": best, "failures": dict(failures)})
    return out


def predicted_for(truth: TrueJoint, joints: Sequence[PredictedJoint]) -> PredictedJoint | None:
    """Return the predicted joint of the part, or of a part fixed to it; None without one."""
    of_part = {joint.part: joint for joint in reversed(joints) if joint.kind != "fixed"}
    return next((of_part[name] for name in truth.rigid if name in of_part), None)


def _on_fixed_parts(subject: TrueObject, joints: Sequence[PredictedJoint]) -> list[PredictedJoint]:
    """Return joints that are predicted for parts that do not move."""
    move = {name for joint in subject.joints for name in joint.moves} | subject.carried
    return [joint for joint in joints if joint.kind != "fixed" and joint.part not in move]


def _in_true_names(
    joints: Sequence[PredictedJoint], names: Mapping[str, str], shift: Array
) -> list[PredictedJoint]:
    out = []
    for joint in joints:
        x, y, z = (float(v) for v in np.asarray(joint.pivot_o, dtype=np.float64) - shift)
        out.append(renamed(dataclasses.replace(joint, pivot_o=(x, y, z)), names))
    return out


def _matched_names(
    subject: TrueObject, names: Mapping[str, str], placement: PlacementErrors
) -> dict[str, str]:
    """Return the true name of each part by its neutral name, after matching of placed parts.

    A joint of an interchangeable part counts for the part at whose position it was placed.
    """
    parts = subject.parts
    matched = {parts[k].name: true.name for k, true in zip(placement.match, parts, strict=True)}
    return {neutral: matched[true] for neutral, true in names.items()}


def _placement(subject: TrueObject, case: Case, prediction: Prediction) -> PlacementErrors | None:
    if case.evidence.placed:
        return None
    pixels = case.visible_px
    return placement_errors(
        subject.parts,
        {p.name: plain_label(subject.labels[p.name]) for p in subject.parts},
        {case.names[k]: T for k, T in prediction.placements.items() if k in case.names},
        anchored=case.evidence.camera is not None,
        visible_px=None
        if pixels is None
        else np.array([float(pixels[p.name]) for p in subject.parts]),
    )


def _placement_record(subject: TrueObject, case: Case, errors: PlacementErrors) -> Record:
    names = [subject.labels[p.name] for p in subject.parts]
    keys = [f"{name}_{i}" for i, name in enumerate(names)]
    upright = matrix_to_quat(np.eye(3))
    truth = {k: (p.centre, upright) for k, p in zip(keys, subject.parts, strict=True)}
    placed = {
        k: (centre, quat)
        for k, centre, quat in zip(keys, errors.predicted, errors.quat, strict=True)
        if np.isfinite(centre).all()
    }
    success: dict[Protocol, bool] = {**placement_success(errors)}
    success["released_code"] = released_placement(truth, placed)
    return {
        "success": success,
        "parts": [
            {
                "part": part.name,
                "position": plain(float(position)),
                "angle_rad": float(angle),
                "visible_px": plain(float(px)),
                "right": bool(right),
            }
            for part, position, angle, px, right in zip(
                subject.parts,
                errors.position,
                errors.angle_rad,
                errors.visible_px,
                errors.right,
                strict=True,
            )
        ],
    }
