"""Report: what an evaluation found, in figures; :mod:`articulate_train.report_html` draws them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from articulate.robot.arm import PANDA, Arm
from articulate.task.episode_monitor import COLUMN, REASONS
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.task import Limits
from articulate.transforms import Array, Ints, Mask
from articulate_envs.rewards import TERMS
from articulate_train.statistics import (
    Bin,
    Share,
    iqm_over_seeds,
    success_against,
    unevenness,
    wilson,
)

SCHEMA = "articulate.report"
SCHEMA_VERSION = 1
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
"""Fields of a judgement that are peaks of an episode, with their units."""


@dataclass(frozen=True, kw_only=True)
class SeedEvaluation:
    """How the E drawn and the E_n nominal episodes of one seed ended."""

    seed: int
    """Seed of the training."""
    codes: Ints
    """Codes of :data:`articulate.task.episode_monitor.REASONS` (E,)."""
    opened: Mask
    """Whether the part was held open at the end, limits aside (E,)."""
    peaks: Array
    """Rows with the columns of :data:`articulate.task.episode_monitor.FIELDS` (E, WIDTH)."""
    draws: Array
    """Rows with the columns of :data:`articulate.task.randomization.COLUMNS` (E, len(COLUMNS))."""
    nominal_codes: Ints
    """Codes of episodes in which nothing is randomised (E_n,); empty if there were none."""
    nominal_opened: Mask
    """Whether those held the part open (E_n,)."""
    checkpoint_sha256: str = ""
    """Sum of the file that was evaluated; a training that goes on replaces it."""
    policy_steps: int = 0
    """Ticks of experience that the policy was made after; 0 where it is not known."""
    alone: int | None = None
    """Number of the seed's member that acts alone; None where all do."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """What training showed of one seed at K moments; NaN where nothing is known."""

    seed: int
    """Seed of the training."""
    steps: Array
    """Ticks of experience so far (K,)."""
    success: Array
    """Share of successes among training episodes from home (K,)."""
    opened: Array
    """Share whose part was held at the target, limits aside (K,)."""
    reward_terms: Array
    """Mean sums over an episode of each of :data:`articulate_envs.rewards.TERMS` (K, TERMS)."""


@dataclass(frozen=True, kw_only=True)
class Timeline:
    """One episode, tick by tick."""

    name: str
    """What it is an example of: ``success`` or ``failure``."""
    reason: str
    """How it ended, of :data:`articulate.task.episode_monitor.REASONS`."""
    t: Array
    """Time (T,) [s]."""
    force_n: Array
    """Filtered force on the hand (T,) [N]."""
    speed_share: Array
    """Largest joint speed as a share of its limit (T,)."""
    opened: Array
    """Fraction open (T,)."""
    drawn: Mapping[str, float] = field(default_factory=dict)
    """What was drawn for it, by the names of :data:`articulate.task.randomization.COLUMNS`."""


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """What was trained, and how to repeat it."""

    name: str
    """Name of the run."""
    asset: str
    """Name of the object."""
    task: str
    """Name of the task."""
    joint: str
    """Joint of the object."""
    target_text: str
    """What counts as done, in words."""
    target: float
    """Fraction of the joint's way at which the part must rest."""
    steps: int
    """Ticks of experience of each seed."""
    seconds: float
    """How long the training took [s]."""
    steps_per_s: float
    """Ticks of experience of all seeds in a second of it."""
    command: str
    """The command that repeats it."""
    config: str
    """Its configuration as YAML."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of what decides the results."""
    licence: str = "unknown"
    """Licence of the object; what is made from it inherits it."""
    source: str = "unknown"
    """Where the object came from."""
    commit: str = "unknown"
    """Commit of the code."""
    limits: Limits = field(default_factory=Limits)
    """What a deployable episode may ask of the arm."""
    unfinished: str = ""
    """Seeds whose training is not over, and how far they are; empty if there are none."""


@dataclass(frozen=True, kw_only=True)
class SeedReport:
    """One seed's figures."""

    seed: int
    success: Share
    opened: Share
    reasons: Mapping[str, int]
    """How many of the drawn episodes ended in each way; ways that did not occur are left out."""
    nominal_success: Share | None
    """The same without randomisation; None if that was not evaluated."""
    nominal_opened: Share | None
    nominal_reasons: Mapping[str, int]
    checkpoint_sha256: str
    """Sum of the file with the policy that the figures are of."""
    policy_steps: int
    """Ticks of experience that this policy was made after; 0 where it is not known."""
    alone: int | None
    """Number of the seed's member that acts alone; None where all do."""


@dataclass(frozen=True, kw_only=True)
class Peak:
    """Quantiles over all drawn episodes of a quantity's largest value in an episode."""

    name: str
    unit: str
    median: float
    p95: float
    largest: float
    limit: float | None
    """What is allowed; None where the quantity is reported only."""
    not_finite: int
    """Episodes left out because the simulation diverged."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """When a limit was broken for the first time, over the episodes that failed by it."""

    reason: str
    episodes: int
    median_s: float
    p10_s: float
    p90_s: float


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Success against one drawn parameter."""

    name: str
    lowest: float
    """Smallest value drawn."""
    highest: float
    """Largest value drawn."""
    unevenness: float
    """How much success differs between the ranges; about 1 where only chance speaks."""
    bins: tuple[Bin, ...]


@dataclass(frozen=True, kw_only=True)
class Report:
    """What an evaluation found."""

    info: RunInfo
    success_rate: float
    """Mean over seeds of the share of drawn episodes that succeeded."""
    opened_rate: float
    """Mean over seeds of the share that held the part open, limits aside."""
    nominal_success_rate: float | None
    """Mean over seeds without randomisation; None if that was not evaluated."""
    worst_seed_success_rate: float
    success_iqm: Share
    """Interquartile mean over seeds, with a stratified bootstrap interval."""
    opened_iqm: Share
    success_pooled: Share
    """All drawn episodes of all seeds taken together, with Wilson's interval."""
    reasons: Mapping[str, int]
    """How many drawn episodes of all seeds ended in each way."""
    seeds: tuple[SeedReport, ...]
    violations: tuple[Violation, ...]
    """The most frequent first."""
    peaks: tuple[Peak, ...]
    parameters: tuple[Parameter, ...]
    """The one that divides success most unevenly first; what was not varied is left out."""
    curves: tuple[Curve, ...]
    timelines: tuple[Timeline, ...]
    videos: tuple[str, ...]
    """Paths of clips, relative to the report's folder."""

    def content(self) -> dict[str, Any]:
        """The report for JSON: plain values; what is not finite is None."""
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
    """The figures of an evaluation.

    Args:
        info: What was trained.
        seeds: At least one, each of at least one drawn episode.
        curves: Learning curves, if known.
        timelines: One success and one failure, where there were any.
        videos: Paths of clips, relative to the report's folder.
        rng: Decides the resamples of the bootstrap.
        arm: Whose limits the peaks are compared with.
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
        parameters=_parameters(np.concatenate([s.draws for s in seeds]), np.concatenate(hits)),
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
        alone=seed.alone,
    )


def _reasons(codes: Ints) -> dict[str, int]:
    count = np.bincount(codes, minlength=len(REASONS))
    return {name: int(count[i]) for i, name in enumerate(REASONS) if count[i]}


def _violations(codes: Ints, peaks: Array) -> tuple[Violation, ...]:
    out = []
    for code in np.unique(codes):
        # Other ways of failing show at the end only: they have no moment of their own.
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


def _parameters(draws: Array, hits: Mask) -> tuple[Parameter, ...]:
    drawn = EpisodeParams(draws)
    values = {name: drawn[name] for name in COLUMNS}
    values |= {
        "distance_m": np.hypot(drawn["x_m"], drawn["y_m"]),
        "start_rad": np.linalg.norm(drawn["start"], axis=1),
        "bias_m": np.linalg.norm(drawn["bias"], axis=1),
        "push_n": np.linalg.norm(drawn["push"], axis=1),
        "force_bias_n": np.linalg.norm(drawn["force_bias"], axis=1),
    }
    if not drawn["push"].any():
        del values["push_time"]  # drawn in any case, but of nothing
    out = []
    for name, column in values.items():
        bins = success_against(column, hits)
        if bins:
            out.append(
                Parameter(
                    name=name,
                    lowest=bins[0].begin,
                    highest=bins[-1].end,
                    unevenness=unevenness(bins),
                    bins=bins,
                )
            )
    return tuple(sorted(out, key=lambda p: -p.unevenness))


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
