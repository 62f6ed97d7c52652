"""Report of a deployment as JSON and as text."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from articulate.task.manifest import Manifest, encode_manifest
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.task import done_word
from articulate_deploy.bundle import Bundle
from articulate_deploy.episode import EpisodeResult
from articulate_deploy.plan import EpisodeRequest, Plan

SCALE_NOTE = "the object's size is not randomised: a bundle has its scene at one size"


class NamedRobot(Protocol):
    """Robot as the report describes it."""

    name: str

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on how it runs episodes."""


@dataclass(frozen=True)
class DeployReport:
    """The episodes of one call of ``deploy``."""

    bundle: str
    robot: str
    task: str
    joint: str
    seed: int
    from_bundle: bool
    """True for the episode parameters of the bundle."""
    randomised: bool
    results: tuple[EpisodeResult, ...]
    episode_params: tuple[EpisodeParams, ...]
    notes: tuple[str, ...]
    """Remarks on how the episodes were run."""
    bundle_sha256: str = ""
    """SHA-256 of the bundle's manifest, which lists those of its files."""
    sender: dict[str, float | str] = field(default_factory=dict)
    """Timing of the sender of a real arm; empty for robots in this process."""

    @property
    def successes(self) -> int:
        """Number of episodes that reached the target within the limits."""
        return sum(r.success for r in self.results)

    @property
    def opened(self) -> int:
        """Number of episodes that reached the target, limits aside."""
        return sum(r.opened for r in self.results)

    @property
    def reasons(self) -> dict[str, int]:
        """Number of episodes by reason code, the most frequent first."""
        return dict(Counter(r.reason for r in self.results).most_common())

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        return {
            "bundle": self.bundle,
            "robot": self.robot,
            "task": self.task,
            "joint": self.joint,
            "seed": self.seed,
            "params_from_bundle": self.from_bundle,
            "randomised": self.randomised,
            "episodes": len(self.results),
            "opened": self.opened,
            "successes": self.successes,
            "success_rate": self.successes / len(self.results),
            "opened_rate": self.opened / len(self.results),
            "reasons": self.reasons,
            "clipped_steps": sum(r.clipped for r in self.results),
            "peaks_median": {
                name: _number(np.median([r.peaks[name] for r in self.results]))
                for name in self.results[0].peaks
            },
            "notes": list(self.notes),
            "bundle_sha256": self.bundle_sha256,
            "sender": self.sender,
            "each": [
                {
                    **asdict(result),
                    "fraction": _number(result.fraction),
                    "peaks": {k: _number(v) for k, v in result.peaks.items()},
                    "episode_params": dict(zip(COLUMNS, params.values[0].tolist(), strict=True)),
                }
                for result, params in zip(self.results, self.episode_params, strict=True)
            ],
        }

    def text(self) -> str:
        """Return the report as a few lines of text."""
        n, word = len(self.results), done_word(self.task)
        failed = ", ".join(f"{k} {v}" for k, v in self.reasons.items() if k != "success")
        sampling = "randomised as in training" if self.randomised else "without randomisation"
        where = "parameters of the bundle" if self.from_bundle else f"seed {self.seed}"
        lines = [
            f"{self.task} ({self.joint}) on {self.robot}, {n} episodes {sampling}, {where}",
            f"  {word}   {self.opened} of {n}",
            f"  success  {self.successes} of {n} ({word} and within every limit)",
        ]
        if failed:
            lines.append(f"  failed   {failed}")
        clipped = sum(result.clipped for result in self.results)
        if clipped:
            lines.append(f"  clipped  {clipped} control steps with a target that was made safe")
        return "\n".join([*lines, *(f"  note     {note}" for note in self.notes)])


def make_report(
    path: Path,
    bundle: Bundle,
    robot: NamedRobot,
    plan: Plan,
    request: EpisodeRequest,
    results: tuple[EpisodeResult, ...],
) -> DeployReport:
    """Return the report of the episodes of ``plan`` on one robot."""
    manifest = bundle.manifest
    return DeployReport(
        bundle=str(path),
        robot=robot.name,
        task=manifest.task.name,
        joint=manifest.task.joint,
        seed=plan.seed,
        from_bundle=plan.from_bundle,
        randomised=request.randomise,
        results=results,
        episode_params=tuple(plan.params(k) for k in range(len(results))),
        notes=(*_scale_notes(manifest, request.randomise), *robot.notes),
        bundle_sha256=bundle_sha256(manifest),
    )


def bundle_sha256(manifest: Manifest) -> str:
    """Return the SHA-256 of a manifest."""
    return hashlib.sha256(encode_manifest(manifest).encode()).hexdigest()


def _scale_notes(manifest: Manifest, randomise: bool) -> tuple[str, ...]:
    return (SCALE_NOTE,) if randomise and manifest.randomization.scale_values != (1.0,) else ()


@dataclass(frozen=True)
class Transfer:
    """The same episodes on several robots; the others are compared with the first."""

    reports: tuple[DeployReport, ...]

    @property
    def ratios(self) -> dict[str, float | None]:
        """Successes of each other robot relative to the first; None if that has none."""
        first, *others = self.reports
        return {r.robot: r.successes / first.successes if first.successes else None for r in others}

    @property
    def agree(self) -> dict[str, int]:
        """Number of episodes in which each other robot succeeds or fails like the first."""
        first, *others = self.reports
        return {
            r.robot: sum(
                a.success == b.success for a, b in zip(first.results, r.results, strict=True)
            )
            for r in others
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        return {
            "reference": self.reports[0].robot,
            "ratios": self.ratios,
            "agree": self.agree,
            "robots": {report.robot: report.as_dict() for report in self.reports},
        }

    def text(self) -> str:
        """Return the report as a few lines of text."""
        lines = [report.text() for report in self.reports]
        first = self.reports[0]
        for name, ratio in self.ratios.items():
            percentage = "unknown" if ratio is None else f"{ratio:.1%}"
            lines.append(
                f"{name} / {first.robot}: {percentage} of the successes; both ended alike in "
                f"{self.agree[name]} of {len(first.results)} episodes"
            )
        return "\n".join(lines)


def _number(value: Any) -> float | None:
    """Return ``value`` for JSON: None where it is not finite."""
    return float(value) if math.isfinite(value) else None
