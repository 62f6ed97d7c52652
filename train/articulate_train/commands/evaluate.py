"""``evaluate``: evaluate the policies of runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from articulate.cache import cache_folder
from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.commands.success import check_share, missed
from articulate.errors import ConfigError, RunError

if TYPE_CHECKING:
    from articulate_train.run import Run


@dataclass(frozen=True, kw_only=True)
class EvaluateFlags:
    """Evaluate the policies of a run on new episodes, or compare several runs.

    Example: evaluate runs/cabinet --episodes 200
    Example: evaluate --policy generalist --asset cabinet.urdf --task open_drawer
    """

    run: Annotated[tuple[Path, ...], POSITIONAL] = ()
    """Run folder; several are compared."""
    policy: Literal["trained", "generalist"] = "trained"
    """Policy: those of the run, or the generalist policy of the package for --asset and --task,
    without any training on the object."""
    task: str = "open_drawer"
    """Task of --policy generalist."""
    episodes: int | None = None
    """Episodes for each seed; by default those of the run's configuration."""
    ranges: float = 1.0
    """Factor on all randomization ranges; other than 1, the report is written to the folder
    ranges_<x> of the run."""
    asset: str | None = None
    """Evaluate on this object instead of that of the training; the report is written to the folder
    on_<object>_<joint>_<hash> of the run."""
    joint: str | None = None
    """Joint of --asset; by default as for train."""
    out: Path | None = None
    """Folder for the comparison of several runs, or run folder of --policy generalist; by default
    runs/comparison-<time> or runs/generalist-<asset>-<task>-<time>."""
    keep_reports: bool = False
    """Compare the existing reports of the runs; evaluate only runs without one."""
    require_success: float = 0.0
    """Exit with 3 if the success rate of any run is below this fraction."""
    json: bool = False
    """Print only the report, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if self.episodes is not None and self.episodes < 1:
            raise ConfigError(f"--episodes is {self.episodes}; it must be at least 1")
        if not 0.0 < self.ranges < float("inf"):
            raise ConfigError(f"--ranges is {self.ranges:g}; it must be above 0")
        check_share(self.require_success)
        if self.policy == "generalist":
            self._check_generalist()
            return
        if not self.run:
            raise ConfigError("give a run folder, or --policy generalist with --asset and --task")
        if len(self.run) == 1 and (self.out is not None or self.keep_reports):
            raise ConfigError("--out and --keep-reports are for several runs; one is given")
        for flag, is_set in (("ranges", self.ranges != 1.0), ("asset", self.asset is not None)):
            if len(self.run) > 1 and is_set:
                raise ConfigError(f"--{flag} is for one run; several are given")
        if self.joint is not None and self.asset is None:
            raise ConfigError("--joint needs --asset")

    def _check_generalist(self) -> None:
        if self.run or self.asset is None:
            raise ConfigError("--policy generalist needs --asset, and no run folder")
        if self.keep_reports:
            raise ConfigError("--keep-reports is for several runs")


FLAGS = EvaluateFlags


def main(argv: Sequence[str]) -> int:
    """Evaluate and print; 3 if the success rate is below the required one."""
    flags = parse(EvaluateFlags, argv, prog="evaluate")
    if flags.policy == "generalist":
        return _generalist(flags)
    from articulate_train.run import (
        open_run,
        with_object,
    )  # torch and MuJoCo, which --help does without

    runs = [open_run(folder) for folder in flags.run]
    if len(runs) > 1:
        return _compared(runs, flags)
    run, on = runs[0], None
    if flags.asset is not None:
        on = with_object(run, flags.asset, flags.joint, cache_folder(), console.show_waiting)
    episodes = flags.episodes or run.config.episodes
    return show(
        run, episodes, flags.require_success, as_json=flags.json, ranges=flags.ranges, on=on
    )


def _generalist(flags: EvaluateFlags) -> int:
    """Evaluate the generalist policy on --asset; 3 if its success rate is below the required."""
    from articulate_train.config import TrainConfig
    from articulate_train.generalist import generalist_run  # torch and MuJoCo

    assert flags.asset is not None  # checked by the flags
    config = TrainConfig(asset=flags.asset, task=flags.task, joint=flags.joint, seeds=(0,))
    name = f"{Path(flags.asset).resolve().stem}-{flags.task}-{time.strftime('%Y%m%d-%H%M%S')}"
    folder = flags.out or Path("runs") / f"generalist-{name}"
    run = generalist_run(config, folder, cache_folder(), show_progress=console.show_waiting)
    episodes = flags.episodes or config.episodes
    return show(run, episodes, flags.require_success, as_json=flags.json, ranges=flags.ranges)


def _compared(runs: Sequence[Run], flags: EvaluateFlags) -> int:
    """Evaluate each run and write the comparison; 3 if one is below the required success rate."""
    from articulate_train.compare import compare, read_report, write_comparison  # heavy, see main
    from articulate_train.evaluate_run import evaluate_run_folder

    out = flags.out or Path("runs") / f"comparison-{time.strftime('%Y%m%d-%H%M%S')}"
    if (out / "comparison.json").exists():
        raise RunError(f"{out}: holds a comparison; choose another --out")
    for run in runs:
        if not (flags.keep_reports and (run.folder / "report.json").exists()):
            console.show_progress(f"evaluating {run.folder}")
            evaluate_run_folder(
                run,
                episodes=flags.episodes or run.config.episodes,
                show_progress=console.show_progress,
            )
    comparison = compare([read_report(run.folder) for run in runs])
    more = ["--episodes", flags.episodes] if flags.episodes is not None else []
    more += ["--keep-reports"] if flags.keep_reports else []
    command = console.command_line(["evaluate", *(run.folder for run in runs), *more])
    _, page = write_comparison(comparison, out, command)
    text = f"{comparison.text()}\ncomparison: {page}"
    console.emit_json(comparison.content()) if flags.json else console.emit(text)
    worst = min(row.success.value for row in comparison.rows)
    return missed(worst, flags.require_success)


def show(
    run: Run,
    episodes: int,
    required: float,
    *,
    as_json: bool,
    ranges: float = 1.0,
    on: Run | None = None,
) -> int:
    """Evaluate ``run`` and print the report; 3 if its success rate is below ``required``."""
    from articulate_train.evaluate_run import evaluate_run_folder  # torch and MuJoCo

    done = evaluate_run_folder(
        run, episodes=episodes, ranges=ranges, on=on, show_progress=console.show_progress
    )
    console.emit_json(done.report.content()) if as_json else console.emit(done.text())
    return missed(done.report.success_rate, required)
