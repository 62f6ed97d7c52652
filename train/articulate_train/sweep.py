"""Train every object with every seed as a separate job, and compare the results.

::

    <out>/config.yaml                  common configuration of all jobs
    <out>/<object>-seed-<K>/           a job: articulate.jobs.job
    <out>/<object>-seed-<K>/run/       its run
    <out>/comparison.json, .html       comparison of all objects
"""

from __future__ import annotations

import dataclasses
import hashlib
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from articulate.config import to_yaml
from articulate.errors import RunError
from articulate.files import write_text
from articulate.jobs.job import Job
from articulate.jobs.launcher import Progress, make_launcher, run_jobs
from articulate.preparation.batch import Item
from articulate_train.asset_patterns import objects_of
from articulate_train.compare import Comparison, compare, read_report, write_comparison
from articulate_train.config import TrainConfig
from articulate_train.run import CONFIG
from articulate_train.seed_runner import processors

DONE, MISSED = 0, 3
"""Exit statuses of ``train`` that leave a report."""


@dataclass(frozen=True)
class Cell:
    """One object with one seed."""

    item: Item
    seed: int
    job: Job


@dataclass(frozen=True)
class Outcome:
    """Result of several runs."""

    progress: Progress
    comparison: Comparison | None
    """None if no run has a report."""
    json_path: Path | None
    html_path: Path | None

    @property
    def complete(self) -> bool:
        """True if every job is done."""
        return self.progress.count("done") == len(self.progress.states)

    def text(self) -> str:
        """Return the table and the jobs that are not done, for the terminal."""
        lines = [self.comparison.text()] if self.comparison else []
        for name, state in self.progress.states.items():
            if state.phase != "done":
                tries = len(state.attempts)
                lines.append(f"{name}: {state.phase} after {tries} attempts: {state.message}")
        if self.html_path:
            lines.append(f"comparison: {self.html_path}")
        return "\n".join(lines)

    def content(self) -> dict[str, Any]:
        """Return the result as a JSON object."""
        return {
            "comparison": self.comparison.content() if self.comparison else None,
            "jobs": {k: dataclasses.asdict(v) for k, v in self.progress.states.items()},
        }


def jobs_of(
    config: TrainConfig, items: Sequence[Item], out: Path, more: tuple[str, ...] = ()
) -> list[Cell]:
    """Return a job, a ``train`` command line, for each object and seed.

    Args:
        config: Common configuration; ``asset`` and ``seeds`` are set for each job.
        items: Objects.
        out: Folder of all jobs.
        more: Further flags of each ``train``.
    """
    cells = []
    names = folder_names([item.name for item in items])
    for item in items:
        for seed in config.seeds:
            folder = out / f"{names[item.name]}-seed-{seed}"
            made = str((folder / "run").absolute())
            train = [sys.executable, "-m", "articulate", "train"]
            start = [
                *train,
                *("--config", str((out / CONFIG).absolute())),
                *("--asset", str(item.file.absolute())),
                *("--seeds", str(seed), "--jobs", "1", "--out", made),
                *more,
            ]
            job = Job(
                folder=folder,
                start_command=tuple(start),
                resume_command=(*train, "--resume", "--out", made),
                accepted_codes=(DONE, MISSED),
            )
            cells.append(Cell(item, seed, job))
    return cells


def folder_names(items: Sequence[str]) -> dict[str, str]:
    """Return a unique folder name for each object; ``a/b`` becomes ``a-b``, with a hash if taken.

    Names do not depend on the order, so that jobs are found again.
    """
    plain = {item: item.replace("/", "-") for item in items}
    count = Counter(plain.values())
    return {
        item: name if item == name or count[name] == 1 else f"{name}-{_digest(item)}"
        for item, name in plain.items()
    }


def _digest(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()[:8]


def train_many(
    config: TrainConfig,
    out: Path,
    launcher: str,
    command: str,
    show_progress: Callable[[str], None],
    more: tuple[str, ...] = (),
) -> Outcome:
    """Train every object with every seed as a separate job, and compare the results.

    A second call with the same folder continues the jobs that are not done, with any launcher;
    failed jobs are tried once more.

    Args:
        config: Common configuration; ``jobs`` of the jobs run in parallel.
        out: Folder of all jobs.
        launcher: local, slurm or ray.
        command: Command that repeats it, for the page.
        show_progress: Called with one line of progress.
        more: Further flags of each ``train``.

    Raises:
        UsageError: No object, no such launcher, or ``out`` holds other jobs.
    """
    items = objects_of(config.asset)
    shared = yaml.safe_load(to_yaml(config))
    for key in ("asset", "seeds", "jobs"):
        del shared[key]
    cells = jobs_of(config, items, out, more)
    # Nothing is written if the launcher is not available on this machine.
    with closing(make_launcher(launcher, config.jobs or processors(), out)) as runner:
        _keep(out / CONFIG, yaml.safe_dump(shared, sort_keys=False))
        progress = run_jobs(
            [cell.job for cell in cells], runner, lambda p: show_progress(describe_progress(p))
        )
    reports = grouped(cells)
    if not reports:
        return Outcome(progress, None, None, None)
    comparison = compare(reports)
    return Outcome(progress, comparison, *write_comparison(comparison, out, command))


def _keep(path: Path, text: str) -> None:
    """Write the common configuration, or check that it is unchanged."""
    if not path.exists():
        write_text(path, text)
    elif path.read_text(encoding="utf-8") != text:
        raise RunError(
            f"{path.parent}: holds runs with other settings ({path.name}); choose another --out"
        )


def describe_progress(progress: Progress) -> str:
    """Describe the state of all jobs in one line."""
    phases = ("done", "running", "waiting", "failed", "lost")
    counts = [f"{n} {phase}" for phase in phases if (n := progress.count(phase))]
    running = [name for name, state in progress.states.items() if state.phase == "running"]
    return f"{', '.join(counts)} of {len(progress.states)}" + (
        f"; now {', '.join(running)}" if running else ""
    )


def grouped(cells: Sequence[Cell]) -> list[dict[str, Any]]:
    """Return one report for each object, over all its seeds with a report."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for cell in cells:
        if (cell.job.run_folder / "report.json").exists():
            content = read_report(cell.job.run_folder)
            groups.setdefault(cell.item.name, []).append(content)
    return [merged(name, reports) for name, reports in groups.items()]


def _pace(reports: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the time of all runs [s], and control steps per second."""
    infos = [report["info"] for report in reports]
    seconds = sum(float(info["seconds"]) for info in infos)
    steps = sum(float(info["seconds"]) * float(info["steps_per_s"]) for info in infos)
    return {"seconds": seconds, "steps_per_s": steps / seconds if seconds else 0.0}


def merged(name: str, reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Merge the reports of runs that differ only in their seed."""
    nominal = [r["nominal_success_rate"] for r in reports if r["nominal_success_rate"] is not None]
    reasons: dict[str, int] = {}
    for report in reports:
        for reason, count in report["reasons"].items():
            reasons[reason] = reasons.get(reason, 0) + count
    return {
        **reports[0],
        "info": {**reports[0]["info"], "name": name, **_pace(reports)},
        "seeds": [seed for report in reports for seed in report["seeds"]],
        "curves": [curve for report in reports for curve in report["curves"]],
        "worst_seed_success_rate": min(r["worst_seed_success_rate"] for r in reports),
        "nominal_success_rate": sum(nominal) / len(nominal) if nominal else None,
        "reasons": reasons,
    }
