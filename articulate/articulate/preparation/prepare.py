"""Prepare an object: convert it, repair it, run the checks, and keep the result in the cache."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from articulate.asset_page.page import write_page
from articulate.assets.asset import Asset, load_asset, save_asset
from articulate.assets.asset_files import check_asset_files
from articulate.assets.check_report import CheckReport
from articulate.cache import entry_lock
from articulate.checks.descriptions import meanings
from articulate.checks.run_checks import run_checks
from articulate.checks.source import origin_of_reading
from articulate.conversion.convert import (
    Reading,
    counts_of,
    input_key,
    read_input,
    write_asset,
)
from articulate.conversion.provenance import ORIGIN_FILES
from articulate.errors import AssetError, UsageError
from articulate.files import copy_writable
from articulate.formats.config import ConvertConfig
from articulate.formats.find_source import find_source
from articulate.formats.mesh_paths import MissingMesh
from articulate.formats.textures import named_files
from articulate.geometry.time_budget import Budget
from articulate.preparation import store
from articulate.preparation.check_report_file import (
    CHECK_REPORT_FILE,
    PAGE_FILE,
    load_check_report,
    save_check_report,
)
from articulate.preparation.refine_colliders import Refined, Refiner, failed_shapes
from articulate.preparation.repair import RepairResult, repair_joints

REPAIR_S = 90.0
"""Processor time for trimming collision shapes [s]."""
LEFT_OUT = "left out:"
"""First words of a repair that reports a mesh or texture that was absent or unreadable."""


def check_asset(
    source: Path,
    out: Path,
    config: ConvertConfig | None = None,
    *,
    against: Path | None = None,
) -> CheckReport:
    """Convert ``source``, check the result, and write both into ``out``, complete or absent.

    If conversion is not possible, ``out`` holds the check report only. With a ``cache_dir`` in
    the configuration, the same input is converted and checked once.

    Args:
        source: URDF or MJCF file, a folder that holds one, or an asset folder.
        out: Folder to write; an earlier result in it is replaced.
        config: Options that differ from the defaults.
        against: Input that an asset folder was made from, to compare it with.

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
        file = _source_of(source)
        folder = store.load(file, options, cache)
        if folder is None:
            folder = prepare_in_cache(file, replace(config, cache_dir=cache), options, against)
        store.export(folder, out)
        return load_check_report(out)


def load_checked_asset(source: Path, cache: Path, config: ConvertConfig | None = None) -> Asset:
    """Return the asset made of ``source``, prepared once for each content and configuration.

    Args:
        source: URDF or MJCF file, a folder that holds one, or an asset folder.
        cache: Cache folder.
        config: Options that differ from the defaults.

    Raises:
        AssetError: It cannot be read, or the checks reject it or leave it undecided.
        UsageError: The cache cannot be written.
    """
    config = replace(config or ConvertConfig(), cache_dir=cache)
    file = _source_of(source)
    options = options_of(config)
    try:
        folder = store.load(file, options, cache) or prepare_in_cache(file, config, options)
    except OSError as error:
        raise UsageError(
            f"{cache}: cannot be written ({error.strerror}); "
            "set XDG_CACHE_HOME to a folder that can"
        ) from None
    report = load_check_report(folder)
    if report.is_usable:
        return load_asset(folder)
    if not report.checks:
        raise AssetError(report.reasons[0])
    more = f" (and {len(report.reasons) - 1} more)" if len(report.reasons) > 1 else ""
    raise AssetError(
        f"{source}: {report.verdict}: {report.reasons[0]}{more}; "
        f"run check-asset {source} --out DIR for the report"
    )


def _source_of(source: Path) -> Path:
    """Return an asset folder itself, else the object file that ``source`` is or holds."""
    return source if os.path.lexists(source / "asset.json") else find_source(source)


def options_of(config: ConvertConfig) -> dict[str, Any]:
    """Return the options that differ from the defaults and that a verdict depends on."""
    defaults = dataclasses.asdict(ConvertConfig())
    options = dataclasses.asdict(config)
    return {k: v for k, v in options.items() if v != defaults[k] and k != "cache_dir"}


def prepare_in_cache(
    file: Path, config: ConvertConfig, options: Mapping[str, Any], against: Path | None = None
) -> Path:
    """Prepare ``file`` and return the folder of the cache with asset and check report.

    Args:
        file: URDF or MJCF file, or an asset folder.
        config: Configuration with a ``cache_dir``.
        options: Configuration for the record of the cache.
        against: URDF or MJCF file to compare an asset folder with.
    """
    assert config.cache_dir is not None
    cache = config.cache_dir
    with entry_lock(cache, store.record_key(file, options)[:32]) as waited:
        found = store.load(file, options, cache) if waited else None
        return found or _prepare(file, config, options, against, cache)


def _prepare(
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
        # An absent mesh may appear in any of many folders, which are not searched again.
        lasting = not isinstance(error, MissingMesh)
        seconds = time.perf_counter() - start
        return reject(file, str(error), options, cache, seconds=seconds, lasting=lasting)
    complete = not any(text.startswith(LEFT_OUT) for text in made.report.repairs)
    if made.report.verdict != "undecided" and (file.is_dir() or complete):
        store.save(file, options, cache, made.inputs, made.folder)
    return made.folder


@dataclass(frozen=True, kw_only=True)
class _Result:
    """Result of preparing an input that could be read."""

    folder: Path
    """Folder of the cache with asset, report and page."""
    report: CheckReport
    inputs: list[Path]
    """Files that were read in addition to the source itself."""


def _copied(
    file: Path,
    config: ConvertConfig,
    options: Mapping[str, Any],
    against: Path | None,
    cache: Path,
    start: float,
) -> _Result:
    """Check a copy of the asset folder ``file``."""
    check_asset_files(file)
    load_asset(file)  # messages name the file that was given, not the copy
    folder = cache / "assets" / f"{file.name[:40]}-{store.record_key(file, options)[:20]}"
    copy_writable(file, folder)
    inputs: list[Path] = []
    origin = None
    if against is not None:
        reading = read_input(find_source(against), config)
        inputs = [reading.source.path, *_inputs(reading)]
        origin = origin_of_reading(reading, config)
    asset = load_asset(folder)
    if config.accept:
        asset = replace(asset, accepted=config.accept)
        save_asset(asset)
    report = _written(run_checks(asset, origin), asset, start)
    return _Result(folder=folder, report=report, inputs=inputs)


def _converted(reading: Reading, config: ConvertConfig, cache: Path, start: float) -> _Result:
    """Make the asset of ``reading``, unless the cache has it, and check it.

    Its folder is named by content. Files at two paths may share it, so a lock protects it.
    """
    key = input_key(reading, config)[:20]
    folder = cache / "assets" / f"{reading.source.name[:40]}-{key}"
    with entry_lock(cache, f"asset-{key}"):
        unfinished: frozenset[str] = frozenset()
        if (folder / "asset.json").is_file() and not _is_undecided(folder):
            asset = load_asset(folder)
        else:
            asset, unfinished = _made(reading, config, folder)
        report = run_checks(asset, origin_of_reading(reading, config), unfinished)
        report = replace(report, counts=counts_of(reading.source, asset))
        report = _written(report, asset, start)
    return _Result(folder=folder, report=report, inputs=_inputs(reading))


def _written(report: CheckReport, asset: Asset, start: float) -> CheckReport:
    """Write ``report``, with its time since ``start``, and its page beside ``asset``."""
    report = replace(report, seconds=time.perf_counter() - start)
    write_page(report, asset, asset.folder / PAGE_FILE, meanings=meanings())
    save_check_report(report, asset.folder)
    return report


def links_to_refine(made: Refined, repaired: RepairResult) -> frozenset[str]:
    """Return the links that still interfere after repairs, or whose shapes the cuts spoiled.

    A coarse shape that is cut open exposes its inside where nothing is visible; a check on shapes
    then fails that passed before. Finer shapes have less to be cut.
    """
    if not repaired.cut or made.model is None:
        return repaired.stuck
    failed = repaired.cut & {check.subject for check in failed_shapes(repaired.model)}
    if failed:
        failed -= {check.subject for check in failed_shapes(made.model)}
    return repaired.stuck | failed


def _is_undecided(folder: Path) -> bool:
    """Return whether the report in ``folder`` is undecided: more time may decide it."""
    path = folder / CHECK_REPORT_FILE
    return path.is_file() and load_check_report(folder).verdict == "undecided"


def _made(reading: Reading, config: ConvertConfig, folder: Path) -> tuple[Asset, frozenset[str]]:
    """Make the asset of ``reading`` in ``folder``; return it and its links without finer shapes.

    Its collision shapes are as fine as necessary to leave cavities open and to cover visible
    surfaces, and are trimmed where parts do not pass each other.
    """
    refiner = Refiner(reading=reading, config=config, name=folder.name)
    made = refiner.best()
    if made.model is None or not made.asset.joints:
        asset = replace(made.asset, accepted=config.accept)
        return write_asset(asset, made.bodies, made.mimics, folder), made.unfinished
    repaired = repair_joints(made.asset, made.bodies, made.mimics, made.model, Budget(REPAIR_S))
    wrong = links_to_refine(made, repaired)
    finer = refiner.finer(wrong) if wrong else None
    if finer is not None and finer.model is not None:
        again = repair_joints(finer.asset, finer.bodies, made.mimics, finer.model, Budget(REPAIR_S))
        if not links_to_refine(finer, again):
            made, repaired = finer, again
    asset = replace(
        repaired.asset,
        repairs=(*made.asset.repairs, *repaired.repairs),
        accepted=config.accept,
    )
    return write_asset(asset, repaired.bodies, made.mimics, folder), made.unfinished


def reject(
    file: Path,
    reason: str,
    options: Mapping[str, Any],
    cache: Path,
    *,
    seconds: float = 0.0,
    lasting: bool = True,
    undecided: bool = False,
) -> Path:
    """Write a check report without an asset and return its folder in the cache.

    Args:
        file: Input that could not be prepared.
        reason: One sentence.
        options: Configuration for the record of the cache.
        cache: Cache folder.
        seconds: Time that it took [s].
        lasting: Whether the same file is rejected at once the next time.
        undecided: True if the reason is not in the object: a limit of time or memory. Such a
            result is not kept for the next time.
    """
    name = file.parent.name if file.stem == "mobility" else file.stem
    report = CheckReport(
        asset=name,
        verdict="undecided" if undecided else "rejected",
        reasons=(reason,),
        seconds=seconds,
    )
    folder = cache / "rejected" / f"{name[:40]}-{store.record_key(file, options)[:20]}"
    folder.mkdir(parents=True, exist_ok=True)
    write_page(report, None, folder / PAGE_FILE, meanings=meanings())
    save_check_report(report, folder)
    if lasting and not undecided:
        store.save(file, options, cache, (), folder, dated=True)
    return folder


def _inputs(reading: Reading) -> list[Path]:
    """Return the files that were read, and files with metadata beside the source."""
    found = set(reading.files.values())
    found |= {other for path in found for other in named_files(path)}
    folder = reading.source.path.parent
    found |= {folder / name for name in ("meta.json", "semantics.txt", *ORIGIN_FILES)}
    return [path for path in found if path.is_file()]
