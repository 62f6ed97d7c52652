"""Figures of an evaluation report; :mod:`articulate_train.report_html` renders them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from articulate.robot.arm import PANDA, Arm
from articulate.statistics import (
    Bin,
    Share,
    dispersion,
    iqm_over_seeds,
    success_by_range,
    wilson,
)
from articulate.task.episode_monitor import COLUMN, REASONS
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.task import Limits
from articulate.transforms import Array, Ints, Mask
from articulate_envs.rewards import TERMS

SCHEMA = "articulate.report"
SCHEMA_VERSION = 2
DIGITS = 6
"""Significant digits of figures in ``report.json``."""
PEAKS = {
    "force": "N",
    "force_short": "N",
    "force_raw": "N",
    "moment": "Nm",
    "speed_share": "share of the limit",
    "torque_share": "share of the limit",
    "torque_rate": "Nm/s",
}
"""Fields of the episode monitor that are peaks of an episode, with their units."""


@dataclass(frozen=True, kw_only=True)
class SeedEvaluation:
    """Outcomes of the E randomized and the E_n nominal episodes of one seed."""

    seed: int
    """Random seed of the training."""
    codes: Ints
    """Codes of :data:`articulate.task.episode_monitor.REASONS` (E,)."""
    opened: Mask
    """True if the part was at its goal at the end, ignoring limits (E,)."""
    peaks: Array
    """Rows with the columns of :data:`articulate.task.episode_monitor.FIELDS` (E, WIDTH)."""
    params: Array
    """Rows with the columns of :data:`articulate.task.randomization.COLUMNS` (E, len(COLUMNS))."""
    nominal_codes: Ints
    """Codes of episodes without randomization (E_n,); empty if there were none."""
    nominal_opened: Mask
    """True if the part was at its goal at the end of those (E_n,)."""
    checkpoint_sha256: str = ""
    """SHA-256 of the evaluated file; a resumed training replaces the file."""
    policy_steps: int = 0
    """Control steps of experience of the policy; 0 if unknown."""
    active_member: int | None = None
    """Index of the only active ensemble member; None if all are active."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Learning curve of one seed at K points; NaN where unknown."""

    seed: int
    """Random seed of the training."""
    steps: Array
    """Control steps so far (K,)."""
    success: Array
    """Success rate of training episodes from home (K,), in [0, 1]."""
    opened: Array
    """Fraction with the part at its goal at the end, ignoring limits (K,), in [0, 1]."""
    reward_terms: Array
    """Mean sums over an episode of each of :data:`articulate_envs.rewards.TERMS` (K, TERMS)."""


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """One episode at each of its T control steps."""

    name: str
    """Outcome that it is an example of: ``success`` or ``failure``."""
    reason: str
    """Termination reason of :data:`articulate.task.episode_monitor.REASONS`."""
    t: Array
    """Time (T,) [s]."""
    force_n: Array
    """Filtered force on the gripper (T,) [N]."""
    speed_share: Array
    """Largest joint speed as a fraction of its limit (T,)."""
    opened: Array
    """Fraction open (T,)."""
    params: Mapping[str, float] = field(default_factory=dict)
    """Sampled parameters by the names of :data:`articulate.task.randomization.COLUMNS`."""


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """Trained run and the command that repeats it."""

    name: str
    """Name of the run."""
    asset: str
    """Name of the object."""
    task: str
    """Name of the task."""
    joint: str
    """Joint of the object."""
    target_text: str
    """Description of the goal."""
    target: float
    """Fraction of the joint's travel at which the part must rest."""
    steps: int
    """Control steps of each seed."""
    seconds: float
    """Duration of the training [s]."""
    steps_per_s: float
    """Control steps of all seeds per second."""
    command: str
    """The command that repeats it."""
    config: str
    """Its configuration as YAML."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the packages that influence results."""
    licence: str = "unknown"
    """Licence of the object; everything made from it inherits it."""
    source: str = "unknown"
    """Source of the object."""
    commit: str = "unknown"
    """Commit of the code."""
    limits: Limits = field(default_factory=Limits)
    """Limits of a deployable episode."""
    unfinished: str = ""
    """Seeds with incomplete training and their progress; empty if there are none."""
    early_stopping: str = ""
    """Seeds whose training ended at the target success and its evaluation; empty if none did."""


@dataclass(frozen=True, kw_only=True)
class SeedReport:
    """Figures of one seed."""

    seed: int
    success: Share
    opened: Share
    reasons: Mapping[str, int]
    """Number of randomized episodes by termination reason, without zeros."""
    nominal_success: Share | None
    """Success rate without randomization; None if that was not evaluated."""
    nominal_opened: Share | None
    nominal_reasons: Mapping[str, int]
    checkpoint_sha256: str
    """SHA-256 of the evaluated policy file."""
    policy_steps: int
    """Control steps of experience of the policy; 0 if unknown."""
    active_member: int | None
    """Index of the only active ensemble member; None if all are active."""


@dataclass(frozen=True, kw_only=True)
class Peak:
    """Quantiles over randomized episodes of the largest value in an episode."""

    name: str
    unit: str
    median: float
    p95: float
    largest: float
    limit: float | None
    """Limit of the task; None if the quantity is only reported."""
    not_finite: int
    """Episodes left out because the simulation diverged."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """Time of the first violation of a limit, over the episodes that failed by it."""

    reason: str
    episodes: int
    median_s: float
    p10_s: float
    p90_s: float


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Success by one sampled parameter."""

    name: str
    lowest: float
    """Smallest sampled value."""
    highest: float
    """Largest sampled value."""
    dispersion: float
    """Dispersion of success between the ranges; about 1 by chance."""
    bins: tuple[Bin, ...]


@dataclass(frozen=True, kw_only=True)
class Report:
    """Figures of an evaluation."""

    info: RunInfo
    success_rate: float
    """Success rate of randomized episodes, mean over seeds."""
    opened_rate: float
    """Fraction with the part at its goal at the end, ignoring limits, mean over seeds."""
    nominal_success_rate: float | None
    """Success rate without randomization, mean over seeds; None if that was not evaluated."""
    worst_seed_success_rate: float
    success_iqm: Share
    """Interquartile mean over seeds, with a stratified bootstrap interval."""
    opened_iqm: Share
    success_pooled: Share
    """Success rate of all randomized episodes of all seeds, with Wilson's interval."""
    reasons: Mapping[str, int]
    """Number of randomized episodes of all seeds by termination reason."""
    seeds: tuple[SeedReport, ...]
    violations: tuple[Violation, ...]
    """The most frequent first."""
    peaks: tuple[Peak, ...]
    parameters: tuple[Parameter, ...]
    """Varied parameters, the one with the largest dispersion first."""
    curves: tuple[Curve, ...]
    timelines: tuple[Timeline, ...]
    videos: tuple[str, ...]
    """Paths of videos, relative to the report's folder."""

    def content(self) -> dict[str, Any]:
        """Return the report as a JSON object; values that are not finite become None."""
        head = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, "reward_terms": list(TERMS)}
        return head | {f.name: _plain(getattr(self, f.name)) for f in dataclasses.fields(self)}


def make_report(
    info: RunInfo,
    seeds: Sequence[SeedEvaluation],
    curves: Sequence[Curve],
    timelines: Sequence[Timeline],
    videos: Sequence[str],
    rng: np.random.Generator,
    *,
    arm: Arm = PANDA,
) -> Report:
    """Compute the figures of an evaluation.

    Args:
        info: The run.
        seeds: At least one seed with at least one randomized episode.
        curves: Learning curves, if known.
        timelines: One success and one failure, if there were any.
        videos: Paths of videos, relative to the report's folder.
        rng: Random generator of the bootstrap.
        arm: Arm whose limits the peaks are compared with.
    """
    hits = [s.codes == 0 for s in seeds]
    opened = [s.opened for s in seeds]
    each = tuple(_seed_report(s) for s in seeds)
    nominal = [s.nominal_success.value for s in each if s.nominal_success is not None]
    codes = np.concatenate([s.codes for s in seeds])
    peaks = np.concatenate([s.peaks for s in seeds])
    return Report(
        info=info,
        success_rate=float(np.mean([s.success.value for s in each])),
        opened_rate=float(np.mean([s.opened.value for s in each])),
        nominal_success_rate=float(np.mean(nominal)) if nominal else None,
        worst_seed_success_rate=min(s.success.value for s in each),
        success_iqm=iqm_over_seeds(hits, rng),
        opened_iqm=iqm_over_seeds(opened, rng),
        success_pooled=wilson(int(np.sum(codes == 0)), len(codes)),
        reasons=_reasons(codes),
        seeds=each,
        violations=_violations(codes, peaks),
        peaks=_peaks(peaks, info.limits, arm),
        parameters=_parameters(np.concatenate([s.params for s in seeds]), np.concatenate(hits)),
        curves=tuple(curves),
        timelines=tuple(timelines),
        videos=tuple(videos),
    )


def _seed_report(seed: SeedEvaluation) -> SeedReport:
    n, m = len(seed.codes), len(seed.nominal_codes)
    return SeedReport(
        seed=seed.seed,
        success=wilson(int(np.sum(seed.codes == 0)), n),
        opened=wilson(int(np.sum(seed.opened)), n),
        reasons=_reasons(seed.codes),
        nominal_success=wilson(int(np.sum(seed.nominal_codes == 0)), m) if m else None,
        nominal_opened=wilson(int(np.sum(seed.nominal_opened)), m) if m else None,
        nominal_reasons=_reasons(seed.nominal_codes),
        checkpoint_sha256=seed.checkpoint_sha256,
        policy_steps=seed.policy_steps,
        active_member=seed.active_member,
    )


def _reasons(codes: Ints) -> dict[str, int]:
    count = np.bincount(codes, minlength=len(REASONS))
    return {name: int(count[i]) for i, name in enumerate(REASONS) if count[i]}


def _violations(codes: Ints, peaks: Array) -> tuple[Violation, ...]:
    out = []
    for code in np.unique(codes):
        # Other failures are known only at the end of an episode, without a time.
        rows = (codes == code) & (peaks[:, COLUMN["code"]] == code) & (code > 0)
        if not rows.any():
            continue
        t = peaks[rows, COLUMN["violation_time"]]
        p10, median, p90 = (float(q) for q in np.quantile(t, [0.1, 0.5, 0.9]))
        reason = REASONS[int(code)]
        out.append(
            Violation(
                reason=reason, episodes=int(rows.sum()), median_s=median, p10_s=p10, p90_s=p90
            )
        )
    return tuple(sorted(out, key=lambda v: -v.episodes))


def _peaks(peaks: Array, limits: Limits, arm: Arm) -> tuple[Peak, ...]:
    allowed = {
        "force": limits.force_n,
        "moment": limits.moment_nm,
        "speed_share": limits.speed_share,
        "torque_share": limits.torque_share,
        "torque_rate": arm.dtau_max,
    }
    out = []
    for name, unit in PEAKS.items():
        column = peaks[:, COLUMN[name]]
        known = column[np.isfinite(column)]
        median, p95, largest = (
            (float(q) for q in np.quantile(known, [0.5, 0.95, 1.0]))
            if len(known)
            else (math.nan, math.nan, math.nan)
        )
        out.append(
            Peak(
                name=name,
                unit=unit,
                median=median,
                p95=p95,
                largest=largest,
                limit=allowed.get(name),
                not_finite=len(column) - len(known),
            )
        )
    return tuple(out)


def _parameters(rows: Array, hits: Mask) -> tuple[Parameter, ...]:
    params = EpisodeParams(rows)
    values = {name: params[name] for name in COLUMNS}
    values |= {
        "distance_m": np.hypot(params["x_m"], params["y_m"]),
        "start_rad": np.linalg.norm(params["start"], axis=1),
        "bias_m": np.linalg.norm(params["bias"], axis=1),
        "push_n": np.linalg.norm(params["push"], axis=1),
        "force_bias_n": np.linalg.norm(params["force_bias"], axis=1),
    }
    if not params["push"].any():
        del values["push_time"]  # always sampled, here without effect
    out = []
    for name, column in values.items():
        bins = success_by_range(column, hits)
        if bins:
            out.append(
                Parameter(
                    name=name,
                    lowest=bins[0].begin,
                    highest=bins[-1].end,
                    dispersion=dispersion(bins),
                    bins=bins,
                )
            )
    return tuple(sorted(out, key=lambda p: -p.dispersion))


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
