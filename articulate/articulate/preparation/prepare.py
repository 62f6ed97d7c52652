"""From an asset to its proof, and from an input to an asset with its proof."""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from articulate.asset_page.page import write_page
from articulate.assets.asset import Asset, load_asset
from articulate.assets.check_report import Check, CheckReport, JointCheck, Verdict
from articulate.cache import entry_lock
from articulate.checks.cavities import check_cavities
from articulate.checks.coverage import check_coverage
from articulate.checks.descriptions import meanings
from articulate.checks.force import check_opening
from articulate.checks.forward_kinematics import check_forward_kinematics, check_input_kinematics
from articulate.checks.inertia import check_inertia
from articulate.checks.limits import check_limits
from articulate.checks.model import ObjectModel, load_model
from articulate.checks.settle import check_settling
from articulate.checks.source import Origin, origin_of_reading
from articulate.checks.sweep import sweep_joints
from articulate.checks.visual_fidelity import check_visual_fidelity
from articulate.conversion.convert import (
    Reading,
    input_key,
    read_input,
    urdf_in,
    write_asset,
)
from articulate.conversion.counts import counts_of
from articulate.conversion.provenance import ORIGIN_FILE
from articulate.errors import AssetError, UsageError
from articulate.files import copy_writable
from articulate.formats.config import ConvertConfig
from articulate.formats.mesh_file import named_by
from articulate.formats.mesh_paths import AbsentMesh
from articulate.formats.repairs import is_note
from articulate.geometry.time_budget import Budget
from articulate.preparation import store
from articulate.preparation.check_report_file import PAGE_FILE, load_check_report, save_check_report
from articulate.preparation.refine_colliders import Refined, Refiner, failed_shapes
from articulate.preparation.repair import RepairResult, mend
from articulate.simulator import mujoco

TIMED_STEPS = 100
"""Physics steps that are timed together."""
TIMINGS = 7
"""So often; the median counts."""
MEND_S = 90.0
"""Cutting shapes back may take so much time of the processor [s]."""

LEFT_OUT = "left out:"
"""Begins a repair that tells of a mesh or texture that was absent or could not be read."""

Measured = tuple[tuple[Check, ...], tuple[JointCheck, ...]]


def run_checks(asset: Asset, origin: Origin | None = None) -> CheckReport:
    """Measure every clause on ``asset`` and say what comes of it.

    Args:
        asset: Asset in a folder.
        origin: The input, to compare with it.
    """
    start = time.perf_counter()
    try:
        model = load_model(asset)
    except AssetError as error:
        check = Check(name="loads", outcome="failed", message=str(error))
        return _judged(asset, (check,), (), time.perf_counter() - start)
    checks: list[Check] = [
        Check(name="loads", outcome="passed", message=f"MuJoCo {mujoco.__version__} loads it")
    ]
    for name, measure in (
        ("forward_kinematics", check_forward_kinematics),
        ("joint_limits", check_limits),
        ("inertia", check_inertia),
        ("cavities", check_cavities),
        ("collision_coverage", check_coverage),
    ):
        checks += _tried(name, measure, model)
    if origin is not None:
        checks += _tried(
            "input_kinematics",
            lambda m: check_input_kinematics(m, origin.source, origin.frame),
            model,
        )
        checks += _tried("visual_fidelity", lambda m: check_visual_fidelity(m, origin), model)
    joints: tuple[JointCheck, ...] = ()
    if asset.joints:
        more, joints = _moved(asset, model)
        checks += more
    else:
        message = "no joint moves: proven as a rigid object"
        checks.append(Check(name="rigid", outcome="passed", message=message))
    check_report = _judged(asset, tuple(checks), joints, 0.0)
    colliders = sum(len(model.collision_geoms(link.name)) for link in asset.links)
    step_us = _step_us(model)
    return replace(
        check_report, colliders=colliders, step_us=step_us, seconds=time.perf_counter() - start
    )


def check_asset(
    source: Path,
    out: Path,
    config: ConvertConfig | None = None,
    *,
    against: Path | None = None,
) -> CheckReport:
    """Convert ``source``, prove the result, and write both into ``out``, whole or absent.

    What cannot be converted is refused: ``out`` holds the proof alone then. With a ``cache_dir``
    in the configuration, the same input is converted and proven once.

    Args:
        source: URDF or MJCF file, a folder that holds one, or an asset folder.
        out: Folder to write; replaced if it holds an earlier result.
        config: What to do otherwise than by default.
        against: URDF or MJCF that an asset folder was made from, to compare it with.

    Raises:
        UsageError: ``out`` cannot be written, or ``source`` does not exist.
    """
    store.check_out(out)
    config = config or ConvertConfig()
    with tempfile.TemporaryDirectory(prefix="articulate-") as temporary:
        cache = config.cache_dir or Path(temporary)
        options = options_of(config)
        if against is not None:
            options["against"] = str(against.resolve())
        file = source if (source / "asset.json").is_file() else urdf_in(source)
        folder = store.find(file, options, cache)
        if folder is None:
            folder = checked(file, replace(config, cache_dir=cache), options, against)
        store.hand_over(folder, out)
        return load_check_report(out)


def load_checked_asset(source: Path, cache: Path, config: ConvertConfig | None = None) -> Asset:
    """The asset made of ``source``, converted and proven once for each content and configuration.

    Args:
        source: URDF or MJCF file, a folder that holds one, or an asset folder.
        cache: Where assets and proofs are kept.
        config: What to do otherwise than by default.

    Raises:
        AssetError: It cannot be read, or the proof refuses it.
        UsageError: The cache cannot be written.
    """
    config = replace(config or ConvertConfig(), cache_dir=cache)
    file = source if (source / "asset.json").is_file() else urdf_in(source)
    options = options_of(config)
    try:
        folder = store.find(file, options, cache) or checked(file, config, options)
    except OSError as error:
        raise UsageError(
            f"{cache}: cannot be written ({error.strerror}); "
            "set XDG_CACHE_HOME to a folder that can"
        ) from None
    check_report = load_check_report(folder)
    if check_report.is_usable:
        return load_asset(folder)
    if not check_report.checks:
        raise AssetError(check_report.reasons[0])
    more = f" (and {len(check_report.reasons) - 1} more)" if len(check_report.reasons) > 1 else ""
    raise AssetError(
        f"{source}: refused: {check_report.reasons[0]}{more}; check-asset {source} --out DIR shows it"
    )


def options_of(config: ConvertConfig) -> dict[str, Any]:
    """What a verdict depends on besides the input: all that is not as by default."""
    plain = dataclasses.asdict(ConvertConfig())
    given = dataclasses.asdict(config)
    return {k: v for k, v in given.items() if v != plain[k] and k != "cache_dir"}


def checked(
    file: Path, config: ConvertConfig, options: Mapping[str, Any], against: Path | None = None
) -> Path:
    """Folder of the cache with the asset made from ``file`` and its proof, which is noted.

    Args:
        file: URDF or MJCF file, or an asset folder.
        config: With a ``cache_dir``.
        options: The configuration as it enters the record.
        against: URDF or MJCF file that an asset folder is to be compared with.
    """
    assert config.cache_dir is not None
    cache = config.cache_dir
    with entry_lock(cache, store.ticket(file, options)[:32]) as waited:
        found = store.find(file, options, cache) if waited else None
        return found or _checked(file, config, options, against, cache)


def _checked(
    file: Path,
    config: ConvertConfig,
    options: Mapping[str, Any],
    against: Path | None,
    cache: Path,
) -> Path:
    start = time.perf_counter()
    try:
        if file.is_dir():
            made = _copied(file, config, options, against, cache, start)
        else:
            made = _converted(read_input(file, config), config, cache, start)
    except AssetError as error:
        # An absent mesh may come to any of many folders, which nobody looks through again.
        lasting = not isinstance(error, AbsentMesh)
        seconds = time.perf_counter() - start
        return refuse(file, str(error), options, cache, seconds=seconds, lasting=lasting)
    if file.is_dir() or not any(said.startswith(LEFT_OUT) for said in made.check_report.repairs):
        store.keep(file, options, cache, made.inputs, made.folder)
    return made.folder


@dataclass(frozen=True, kw_only=True)
class _Result:
    """What came of an input that could be read."""

    folder: Path
    """Folder of the cache with asset, proof and page."""
    check_report: CheckReport
    inputs: list[Path]
    """Files that were read besides the source itself."""


def _copied(
    file: Path,
    config: ConvertConfig,
    options: Mapping[str, Any],
    against: Path | None,
    cache: Path,
    start: float,
) -> _Result:
    """A copy of the asset folder ``file``, proven."""
    folder = cache / "assets" / f"{file.name[:40]}-{store.ticket(file, options)[:20]}"
    copy_writable(file, folder)
    inputs: list[Path] = []
    origin = None
    if against is not None:
        reading = read_input(urdf_in(against), config)
        inputs = [reading.source.path, *_inputs(reading)]
        origin = origin_of_reading(reading, config)
    asset = load_asset(folder)
    check_report = _written(run_checks(asset, origin), asset, start)
    return _Result(folder=folder, check_report=check_report, inputs=inputs)


def _converted(reading: Reading, config: ConvertConfig, cache: Path, start: float) -> _Result:
    """The asset of ``reading``, made if it is not there yet, and proven.

    Its folder is named by content: files at two places may share it, and then one call at a time
    writes into it.
    """
    key = input_key(reading, config)[:20]
    folder = cache / "assets" / f"{reading.source.name[:40]}-{key}"
    with entry_lock(cache, f"asset-{key}"):
        if (folder / "asset.json").is_file():
            asset = load_asset(folder)
        else:
            asset = _made(reading, config, folder)
        check_report = run_checks(asset, origin_of_reading(reading, config))
        check_report = replace(check_report, counts=counts_of(reading.source, asset))
        check_report = _written(check_report, asset, start)
    return _Result(folder=folder, check_report=check_report, inputs=_inputs(reading))


def _written(check_report: CheckReport, asset: Asset, start: float) -> CheckReport:
    """``check_report`` with its time since ``start``, written beside ``asset`` with its page."""
    check_report = replace(check_report, seconds=time.perf_counter() - start)
    write_page(check_report, asset, asset.folder / PAGE_FILE, meanings=meanings())
    save_check_report(check_report, asset.folder)
    return check_report


def wrong_after(made: Refined, mended: RepairResult) -> frozenset[str]:
    """Links of ``made`` that the repairs left in each other's way, or that cuts have spoiled.

    The inside of a coarse shape that is cut open stands where nothing is seen: a clause on shapes
    fails then that passed before. Shapes that are finer to begin with have less to be cut.
    """
    if not mended.cut or made.model is None:
        return mended.stuck
    failed = mended.cut & {check.subject for check in failed_shapes(mended.model)}
    if failed:
        failed -= {check.subject for check in failed_shapes(made.model)}
    return mended.stuck | failed


def _made(reading: Reading, config: ConvertConfig, folder: Path) -> Asset:
    """The asset of ``reading`` in ``folder``.

    Its collision shapes are as fine as they have to be for what is hollow to be open and what
    is seen to be covered, and cut back where parts do not pass each other.
    """
    refiner = Refiner(reading=reading, config=config, name=folder.name)
    made = refiner.best()
    if made.model is None or not made.asset.joints:
        return write_asset(made.asset, made.bodies, made.mimics, folder)
    mended = mend(made.asset, made.bodies, made.mimics, made.model, Budget(MEND_S))
    wrong = wrong_after(made, mended)
    finer = refiner.finer(wrong) if wrong else None
    if finer is not None and finer.model is not None:
        again = mend(finer.asset, finer.bodies, made.mimics, finer.model, Budget(MEND_S))
        if not wrong_after(finer, again):
            made, mended = finer, again
    sentences = (*made.asset.repairs, *mended.repairs)
    return write_asset(replace(mended.asset, repairs=sentences), mended.bodies, made.mimics, folder)


def refuse(
    file: Path,
    reason: str,
    options: Mapping[str, Any],
    cache: Path,
    *,
    seconds: float = 0.0,
    lasting: bool = True,
) -> Path:
    """Folder of the cache with a refusal of ``file``.

    Args:
        file: What was to be checked.
        reason: Why it is refused.
        options: The configuration as it enters the record.
        cache: Cache folder.
        seconds: Time it took [s].
        lasting: Note it, so that the same file is refused at once the next time.
    """
    name = file.parent.name if file.stem == "mobility" else file.stem
    check_report = CheckReport(asset=name, verdict="rejected", reasons=(reason,), seconds=seconds)
    folder = cache / "rejected" / f"{name[:40]}-{store.ticket(file, options)[:20]}"
    folder.mkdir(parents=True, exist_ok=True)
    write_page(check_report, None, folder / PAGE_FILE, meanings=meanings())
    save_check_report(check_report, folder)
    if lasting:
        store.keep(file, options, cache, (), folder, dated=True)
    return folder


def _inputs(reading: Reading) -> list[Path]:
    """Files that were read besides the source itself, with what stands beside meshes."""
    found = set(reading.files.values())
    found |= {other for path in found for other in named_by(path)}
    folder = reading.source.path.parent
    found |= {folder / name for name in ("meta.json", "semantics.txt", ORIGIN_FILE)}
    return [path for path in found if path.is_file()]


def _moved(asset: Asset, model: ObjectModel) -> Measured:
    """The clauses about motion."""
    try:
        swept = sweep_joints(model)
    except Exception as error:  # noqa: BLE001  evidence or refusal, never a trace
        return (_unmeasured("joint_sweep", error),), ()
    joints = swept.joints
    checks = (*swept.checks, *_tried("settling", lambda m: check_settling(asset, m), model))
    try:
        more, joints = check_opening(asset, model, joints)
    except Exception as error:  # noqa: BLE001
        more = (_unmeasured("opening", error),)
    return (*checks, *more), joints


def _tried(
    name: str, measure: Callable[[ObjectModel], tuple[Check, ...]], model: ObjectModel
) -> tuple[Check, ...]:
    """Clauses of ``measure``, or a failed one that says why there are none."""
    try:
        return measure(model)
    except Exception as error:  # noqa: BLE001  evidence or refusal, never a trace
        return (_unmeasured(name, error),)


def _unmeasured(name: str, error: Exception) -> Check:
    text = " ".join(str(error).split())[:300]
    message = f"could not be measured ({type(error).__name__}: {text}); please report it"
    return Check(name=name, outcome="failed", message=message)


def _judged(
    asset: Asset, checks: tuple[Check, ...], joints: tuple[JointCheck, ...], seconds: float
) -> CheckReport:
    failed = [check for check in checks if check.outcome == "failed"]
    reasons = tuple(
        f"{c.name}{f' of {c.subject}' if c.subject else ''}: {c.message}" for c in failed
    )
    changed = any(not is_note(sentence) for sentence in asset.repairs)
    verdict: Verdict = "rejected" if failed else "repaired" if changed else "passed"
    return CheckReport(
        asset=asset.name,
        verdict=verdict,
        reasons=reasons,
        repairs=asset.repairs,
        checks=checks,
        joints=joints,
        source=asset.source,
        licence=asset.licence,
        seconds=seconds,
    )


def _step_us(model: ObjectModel) -> float:
    """Median time of a physics step of the object alone, closed and at rest [us]."""
    data = model.data()
    mujoco.mj_step(model.model, data, TIMED_STEPS)
    times = []
    for _ in range(TIMINGS):
        start = time.perf_counter()
        mujoco.mj_step(model.model, data, TIMED_STEPS)
        times.append((time.perf_counter() - start) / TIMED_STEPS)
    return 1e6 * float(np.median(times))
