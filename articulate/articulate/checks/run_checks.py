"""Run all checks on an asset and derive the verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from articulate.assets.asset import Asset
from articulate.assets.check_report import Check, CheckReport, JointCheck, Verdict
from articulate.checks.accepted_overlap import AUTHORED_OVERLAP, accept_overlaps
from articulate.checks.cavities import check_cavities
from articulate.checks.coverage import check_coverage
from articulate.checks.finger_clearance import check_finger_clearance
from articulate.checks.force import check_opening
from articulate.checks.forward_kinematics import check_forward_kinematics, check_input_kinematics
from articulate.checks.inertia import check_inertia
from articulate.checks.limits import check_limits
from articulate.checks.model import ObjectModel, load_model
from articulate.checks.settle import check_settling
from articulate.checks.source import Origin
from articulate.checks.sweep import sweep_joints
from articulate.checks.trimming import check_trimming
from articulate.checks.visual_fidelity import check_visual_fidelity
from articulate.errors import AssetError, shorten
from articulate.formats.repairs import is_note
from articulate.simulator import mujoco

TIMED_STEPS = 100
"""Physics steps that are timed together."""
TIMINGS = 7
"""Number of such timings, of which the median counts."""
SHAPES = frozenset({"cavities", "collision_coverage"})
"""Checks of the fineness of collision shapes."""
MAX_ERROR = 300
"""Characters of an unexpected error that a message quotes."""


def run_checks(
    asset: Asset, origin: Origin | None = None, unfinished: Collection[str] = ()
) -> CheckReport:
    """Run every check on ``asset``, which is only read.

    Args:
        asset: Asset in a folder.
        origin: Input of the conversion, to compare the asset with.
        unfinished: Links whose collision shapes were not made finer because of the time: failed
            checks of their shapes are undecided.
    """
    start = time.perf_counter()
    try:
        model = load_model(asset)
    except AssetError as error:
        check = Check(name="loads", outcome="failed", message=str(error))
        return _report(asset, (check,), (), time.perf_counter() - start)
    checks: list[Check] = [
        Check(name="loads", outcome="passed", message=f"MuJoCo {mujoco.__version__} loads it")
    ]
    for name, measure in (
        ("forward_kinematics", check_forward_kinematics),
        ("joint_limits", check_limits),
        ("inertia", check_inertia),
        ("cavities", check_cavities),
        ("finger_clearance", check_finger_clearance),
        ("collision_coverage", check_coverage),
        ("trimming", check_trimming),
    ):
        checks += _attempt(name, measure, model)
    if origin is not None:
        source, frame = origin.source, origin.frame
        checks += _attempt(
            "input_kinematics", lambda m: check_input_kinematics(m, source, frame), model
        )
        checks += _attempt("visual_fidelity", lambda m: check_visual_fidelity(m, origin), model)
    checks = [_left_undecided(check, unfinished) for check in checks]
    joints: tuple[JointCheck, ...] = ()
    if asset.joints:
        more, joints = _check_motion(asset, model)
        checks += more
    else:
        message = "no joint moves: checked as a rigid object"
        checks.append(Check(name="rigid", outcome="passed", message=message))
    report = _report(asset, tuple(checks), joints, 0.0)
    colliders = sum(len(model.collision_geoms(link.name)) for link in asset.links)
    step_us = _step_us(model)
    seconds = time.perf_counter() - start
    return replace(report, colliders=colliders, step_us=step_us, seconds=seconds)


def _check_motion(
    asset: Asset, model: ObjectModel
) -> tuple[tuple[Check, ...], tuple[JointCheck, ...]]:
    """Run the checks of moving joints."""
    try:
        swept = sweep_joints(model)
    except Exception as error:  # noqa: BLE001  a report, never a traceback
        return (_undecided("joint_sweep", error),), ()
    joints = swept.joints
    checks = (*swept.checks, *_attempt("settling", lambda m: check_settling(asset, m), model))
    try:
        more, joints = check_opening(asset, model, joints)
    except Exception as error:  # noqa: BLE001
        more = (_undecided("opening", error),)
    checks = (*checks, *more)
    if AUTHORED_OVERLAP in asset.accepted:
        checks = accept_overlaps(checks)
    return checks, joints


def _attempt(
    name: str, measure: Callable[[ObjectModel], tuple[Check, ...]], model: ObjectModel
) -> tuple[Check, ...]:
    """Return the checks of ``measure``, or an undecided one with the error."""
    try:
        return measure(model)
    except Exception as error:  # noqa: BLE001  a report, never a traceback
        return (_undecided(name, error),)


def _left_undecided(check: Check, unfinished: Collection[str]) -> Check:
    """Return an undecided check instead of a failed one of shapes that could become finer."""
    if check.outcome != "failed" or check.name not in SHAPES or check.subject not in unfinished:
        return check
    message = (
        f"{check.message}; the processor time was too short for finer shapes: try an idle computer"
    )
    return replace(check, outcome="undecided", message=message)


def _undecided(name: str, error: Exception) -> Check:
    text = shorten(" ".join(str(error).split()), MAX_ERROR)
    message = f"could not be measured ({type(error).__name__}: {text}); please report it"
    return Check(name=name, outcome="undecided", message=message)


def _report(
    asset: Asset, checks: tuple[Check, ...], joints: tuple[JointCheck, ...], seconds: float
) -> CheckReport:
    failed = [check for check in checks if check.outcome == "failed"]
    undecided = [check for check in checks if check.outcome == "undecided"]
    warned = any(check.outcome == "warning" for check in checks)
    changed = warned or any(not is_note(text) for text in asset.repairs)
    verdict: Verdict = "repaired" if changed else "passed"
    if failed or undecided:
        verdict = "rejected" if failed else "undecided"
    return CheckReport(
        asset=asset.name,
        verdict=verdict,
        reasons=tuple(
            f"{c.name}{f' of {c.subject}' if c.subject else ''}: {c.message}"
            for c in (*failed, *undecided)
        ),
        repairs=asset.repairs,
        checks=checks,
        joints=joints,
        source=asset.source,
        licence=asset.licence,
        seconds=seconds,
    )


def _step_us(model: ObjectModel) -> float:
    """Measure the median time of a physics step of the object, closed and at rest [us]."""
    data = model.data()
    mujoco.mj_step(model.model, data, TIMED_STEPS)
    times = []
    for _ in range(TIMINGS):
        start = time.perf_counter()
        mujoco.mj_step(model.model, data, TIMED_STEPS)
        times.append((time.perf_counter() - start) / TIMED_STEPS)
    return 1e6 * float(np.median(times))
