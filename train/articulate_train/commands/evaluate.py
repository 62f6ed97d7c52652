"""``evaluate``: repeat the evaluation of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.commands.success import check_share, missed
from articulate.errors import ConfigError

if TYPE_CHECKING:
    from articulate_train.run import Run


@dataclass(frozen=True, kw_only=True)
class EvaluateFlags:
    """Evaluate the last checkpoints of a run on fresh episodes and write its report.

    Example: evaluate runs/cabinet --episodes 200
    """

    run: Annotated[Path, POSITIONAL]
    """Folder of the run."""
    episodes: int | None = None
    """Episodes for each seed; by default what the run's configuration says."""
    require_success: float = 0.0
    """Exit with 3 if the success rate is below this share."""
    json: bool = False
    """Print the report as JSON and nothing else on standard output."""

    def __post_init__(self) -> None:
        if self.episodes is not None and self.episodes < 1:
            raise ConfigError(f"--episodes is {self.episodes}; it must be at least 1")
        check_share(self.require_success)


FLAGS = EvaluateFlags


def main(argv: Sequence[str]) -> int:
    """Evaluate and print; 3 if the success rate is below what was required."""
    flags = parse(EvaluateFlags, argv, prog="evaluate")
    from articulate_train.run import open_run  # torch and MuJoCo; --help does without them

    run = open_run(flags.run)
    episodes = flags.episodes or run.config.episodes
    return show(run, episodes, flags.require_success, as_json=flags.json)


def show(run: Run, episodes: int, required: float, *, as_json: bool) -> int:
    """Evaluate ``run``, print the report, and say whether it reached ``required``."""
    from articulate_train.judge_run import judge_run  # torch and MuJoCo

    done = judge_run(run, episodes=episodes)
    console.emit_json(done.report.content()) if as_json else console.emit(done.text())
    return missed(done.report.success_rate, required)
