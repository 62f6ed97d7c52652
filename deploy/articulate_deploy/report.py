"""What a deployment showed: figures for machines, a few lines for people."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from articulate.draw import COLUMNS, Draw
from articulate.task import done_word
from articulate_deploy.episode import EpisodeResult


@dataclass(frozen=True)
class DeployReport:
    """The episodes of one call of ``deploy``."""

    bundle: str
    robot: str
    task: str
    joint: str
    seed: int
    randomised: bool
    results: tuple[EpisodeResult, ...]
    draws: tuple[Draw, ...]
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
        lines = [
            f"{self.task} ({self.joint}) on {self.robot}, {n} episodes {draws}, seed {self.seed}",
            f"  {word}   {self.opened} of {n}",
            f"  success  {self.successes} of {n} ({word} and within every limit)",
        ]
        if failed:
            lines.append(f"  failed   {failed}")
        return "\n".join([*lines, *(f"  note     {note}" for note in self.notes)])


def _number(value: Any) -> float | None:
    """``value`` as JSON knows it: None where it is not finite."""
    return float(value) if math.isfinite(value) else None
