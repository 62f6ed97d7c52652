"""Many runs: every object times every seed as a job, and one comparison of what came of them.

::

    <out>/config.yaml                  what all jobs share
    <out>/<object>-seed-<K>/           a job: articulate.jobs.job
    <out>/<object>-seed-<K>/run/       its run
    <out>/comparison.json, .html       all objects side by side
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
    """What came of many runs."""

    progress: Progress
    comparison: Comparison | None
    """None if no run has a report."""
    json_path: Path | None
    html_path: Path | None

    @property
    def complete(self) -> bool:
        """Whether every job is done."""
        return self.progress.count("done") == len(self.progress.states)

    def text(self) -> str:
        """A few lines for a terminal: the table, then what did not end well."""
        lines = [self.comparison.text()] if self.comparison else []
        for name, state in self.progress.states.items():
            if state.phase != "done":
                tries = len(state.attempts)
                lines.append(f"{name}: {state.phase} after {tries} attempts: {state.words}")
        if self.html_path:
            lines.append(f"comparison: {self.html_path}")
        return "\n".join(lines)

    def content(self) -> dict[str, Any]:
        """The same for JSON."""
        return {
            "comparison": self.comparison.content() if self.comparison else None,
            "jobs": {k: dataclasses.asdict(v) for k, v in self.progress.states.items()},
        }


def cells_of(config: TrainConfig, items: Sequence[Item], out: Path) -> list[Cell]:
    """A job for each object and seed; each is a command line that anyone can type.

    Args:
        config: What all share; its ``asset`` and ``seeds`` are taken apart.
        items: The objects.
        out: Folder of all.
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
            ]
            job = Job(
                folder=folder,
                start=tuple(start),
                go_on=(*train, "--resume", "--out", made),
                accepted=(DONE, MISSED),
            )
            cells.append(Cell(item, seed, job))
    return cells


def folder_names(items: Sequence[str]) -> dict[str, str]:
    """A name of a folder for each object, no two alike: ``a/b`` gives way to ``a-b``.

    It is the same whatever the order, so that jobs are found again.
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
    config: TrainConfig, out: Path, launcher: str, command: str, say: Callable[[str], None]
) -> Outcome:
    """Train every object with every seed as a job of its own, and compare what came of it.

    Called again with the same folder, it goes on with what is not done, whichever launcher left
    it; jobs that failed by themselves are tried once more.

    Args:
        config: What all share; ``jobs`` of them run side by side.
        out: Folder of all.
        launcher: local, slurm or ray.
        command: What repeats it, for the page.
        say: Told how far the jobs are.

    Raises:
        UsageError: No object, no such launcher, or ``out`` holds other jobs.
    """
    items = objects_of(config.asset)
    shared = yaml.safe_load(to_yaml(config))
    for own in ("asset", "seeds", "jobs"):
        del shared[own]
    cells = cells_of(config, items, out)
    # First what may be missing on this machine: where it is, nothing is written.
    with closing(make_launcher(launcher, config.jobs or processors(), out)) as runner:
        _keep(out / CONFIG, yaml.safe_dump(shared, sort_keys=False))
        progress = run_jobs([cell.job for cell in cells], runner, lambda p: say(told(p)))
    reports = grouped(cells)
    if not reports:
        return Outcome(progress, None, None, None)
    comparison = compare(reports)
    return Outcome(progress, comparison, *write_comparison(comparison, out, command))


def _keep(path: Path, text: str) -> None:
    """Write what all jobs share, or see that it is the same as before."""
    if not path.exists():
        write_text(path, text)
    elif path.read_text(encoding="utf-8") != text:
        raise RunError(
            f"{path.parent}: holds runs with other settings ({path.name}); choose another --out"
        )


def told(progress: Progress) -> str:
    """One line on how far many jobs are."""
    phases = ("done", "running", "waiting", "failed", "lost")
    counts = [f"{n} {phase}" for phase in phases if (n := progress.count(phase))]
    running = [name for name, state in progress.states.items() if state.phase == "running"]
    return f"{', '.join(counts)} of {len(progress.states)}" + (
        f"; now {', '.join(running)}" if running else ""
    )


def grouped(cells: Sequence[Cell]) -> list[dict[str, Any]]:
    """For each object one report over all of its seeds that have one."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for cell in cells:
        if (cell.job.made / "report.json").exists():
            content = read_report(cell.job.made)
            groups.setdefault(cell.item.name, []).append(content)
    return [merged(name, reports) for name, reports in groups.items()]


def _pace(reports: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Seconds of all the runs together, and ticks of experience in one of them."""
    infos = [report["info"] for report in reports]
    seconds = sum(float(info["seconds"]) for info in infos)
    ticks = sum(float(info["seconds"]) * float(info["steps_per_s"]) for info in infos)
    return {"seconds": seconds, "steps_per_s": ticks / seconds if seconds else 0.0}


def merged(name: str, reports: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """One report of runs that differ in their seed alone."""
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
