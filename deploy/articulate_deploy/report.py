"""What a deployment showed: figures for machines, a few lines for people."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.task import done_word
from articulate_deploy.episode import EpisodeResult


@dataclass(frozen=True)
class DeployReport:
    """The episodes of one call of ``deploy``."""

    bundle: str
    robot: str
    task: str
    joint: str
    seed: int
    carried: bool
    """Whether the draws are those that the bundle carries."""
    randomised: bool
    results: tuple[EpisodeResult, ...]
    draws: tuple[EpisodeParams, ...]
    notes: tuple[str, ...]
    """What a reader must know of how this was run."""

    @property
    def successes(self) -> int:
        """Episodes that brought the part to its target and kept the limits."""
        return sum(r.success for r in self.results)

    @property
    def opened(self) -> int:
        """Episodes that brought the part to its target, limits aside."""
        return sum(r.opened for r in self.results)

    @property
    def reasons(self) -> dict[str, int]:
        """How often each end was met, the most frequent first."""
        return dict(Counter(r.reason for r in self.results).most_common())

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "bundle": self.bundle,
            "robot": self.robot,
            "task": self.task,
            "joint": self.joint,
            "seed": self.seed,
            "carried_draws": self.carried,
            "randomised": self.randomised,
            "episodes": len(self.results),
            "opened": self.opened,
            "successes": self.successes,
            "success_rate": self.successes / len(self.results),
            "opened_rate": self.opened / len(self.results),
            "reasons": self.reasons,
            "clipped_ticks": sum(r.clipped for r in self.results),
            "peaks_median": {
                name: _number(np.median([r.peaks[name] for r in self.results]))
                for name in self.results[0].peaks
            },
            "notes": list(self.notes),
            "each": [
                {
                    **asdict(result),
                    "fraction": _number(result.fraction),
                    "peaks": {k: _number(v) for k, v in result.peaks.items()},
                    "draw": dict(zip(COLUMNS, drawn.values[0].tolist(), strict=True)),
                }
                for result, drawn in zip(self.results, self.draws, strict=True)
            ],
        }

    def text(self) -> str:
        """A few lines for people."""
        n, word = len(self.results), done_word(self.task)
        failed = ", ".join(f"{k} {v}" for k, v in self.reasons.items() if k != "success")
        draws = "randomised as in training" if self.randomised else "without randomisation"
        where = "the bundle's draws" if self.carried else f"seed {self.seed}"
        lines = [
            f"{self.task} ({self.joint}) on {self.robot}, {n} episodes {draws}, {where}",
            f"  {word}   {self.opened} of {n}",
            f"  success  {self.successes} of {n} ({word} and within every limit)",
        ]
        if failed:
            lines.append(f"  failed   {failed}")
        clipped = sum(result.clipped for result in self.results)
        if clipped:
            lines.append(f"  clipped  {clipped} ticks whose target had to be made safe")
        return "\n".join([*lines, *(f"  note     {note}" for note in self.notes)])


@dataclass(frozen=True)
class Transfer:
    """The same episodes on several robots; the first is the one that others are compared with."""

    reports: tuple[DeployReport, ...]

    @property
    def ratios(self) -> dict[str, float | None]:
        """Successes of each other robot as a share of the first's; None if that has none."""
        first, *others = self.reports
        return {r.robot: r.successes / first.successes if first.successes else None for r in others}

    @property
    def agree(self) -> dict[str, int]:
        """In how many episodes each other robot ended as the first, in success or not."""
        first, *others = self.reports
        return {
            r.robot: sum(
                a.success == b.success for a, b in zip(first.results, r.results, strict=True)
            )
            for r in others
        }

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "reference": self.reports[0].robot,
            "ratios": self.ratios,
            "agree": self.agree,
            "robots": {report.robot: report.as_dict() for report in self.reports},
        }

    def text(self) -> str:
        """A few lines for people."""
        lines = [report.text() for report in self.reports]
        first = self.reports[0]
        for name, ratio in self.ratios.items():
            shown = "unknown" if ratio is None else f"{ratio:.1%}"
            lines.append(
                f"{name} / {first.robot}: {shown} of the successes; both ended alike in "
                f"{self.agree[name]} of {len(first.results)} episodes"
            )
        return "\n".join(lines)


def _number(value: Any) -> float | None:
    """``value`` as JSON knows it: None where it is not finite."""
    return float(value) if math.isfinite(value) else None
