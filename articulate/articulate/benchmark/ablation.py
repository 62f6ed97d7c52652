"""Run the rows of an ablation and collect its table.

Each row is a benchmark run in a separate folder, so a stopped ablation continues where it was,
and ablations with equal rows share them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.benchmark.ablation_rows import Ablation, AblationRow, rows_of
from articulate.benchmark.batch import BenchmarkBatch
from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import Dataset
from articulate.benchmark.records import Record
from articulate.benchmark.summary import ScoredJoint, scored_joints, summary
from articulate.errors import UsageError
from articulate.reconstruct.actors.vlm.answer_store import RECORDING_FILE
from articulate.reconstruct.actors.vlm.options import ModelOptions

SCHEMA = "articulate.benchmark.ablation"
SCHEMA_VERSION = 1
KEPT = (
    "objects",
    "joints",
    "crashed",
    "protocols",
    "errors",
    "categories",
    "iterations",
    "critic",
    "placement",
    "cost",
)
"""Values of ``results.json`` that a row of the table repeats."""
NO_RECORDING = "no recording"
INCOMPLETE = "recording lacks answers"
REPLAY_ONLY = ("calls=0",)
"""Budget of rows with a model: only recorded answers are used."""
DISTRIBUTIONS = {
    "axis_rad": ("prismatic", "revolute", "continuous"),
    "origin_foot": ("revolute", "continuous"),
    "motion": ("prismatic", "revolute"),
}
"""Errors whose distributions are stored, and the joint types that have them."""
QUANTILES = 51
Progress = Callable[[Iterator[Record], int, str], Iterator[Record]]
"""Passes records on and shows their progress: records, their number, label of the row."""


@dataclass(frozen=True, kw_only=True)
class AblationRun:
    """Settings that all rows of an ablation share."""

    dataset: Dataset
    source: str
    """Argument DATASET of the command."""
    data: Path | None
    base: BenchmarkConfig
    """Settings of all rows; actor, modality and task are those of the row."""
    ids: Sequence[str]
    out: Path
    jobs: int
    limit_s: float
    fresh: bool = False
    recordings: Path | None = None
    """Folder with a recording for each row with a model, named as the folder of the row."""

    def table(self, name: Ablation, progress: Progress) -> Record:
        """Run the rows of ``name`` that can be run and return its table.

        Raises:
            UsageError: The settings are not accepted.
        """
        return {
            "ablation": name,
            "rows": [self._row(row, progress) for row in rows_of(name, self._recorded())],
        }

    def _recorded(self) -> list[str]:
        """Return the names of the recordings."""
        if self.recordings is None or not self.recordings.is_dir():
            return []
        return [path.name for path in self.recordings.iterdir() if path.is_dir()]

    def _row(self, row: AblationRow, progress: Progress) -> Record:
        """Return one row; without numbers if it needs a recording that does not exist."""
        out: Record = {**dataclasses.asdict(row), "status": "measured", "results": None}
        models = self._models(row)
        if models is None:
            return {**out, "status": NO_RECORDING}
        config = dataclasses.replace(
            self.base, actor=row.actor, modality=row.modality, task=row.task
        )
        batch = BenchmarkBatch(
            dataset=self.dataset,
            source=self.source,
            data=self.data,
            config=config,
            out=self.out / row.folder,
            limit_s=self.limit_s,
            fresh=self.fresh,
            models=models,
        )
        found = progress(batch.run(self.ids, self.jobs), len(self.ids), row.label)
        try:
            records = list(found)
        except UsageError:
            if not row.model:
                raise
            return {**out, "status": INCOMPLETE}  # a new answer needs a key
        results = summary(records, config, self.dataset.name)
        kept = {name: results[name] for name in KEPT}
        return {**out, "results": kept | {"distributions": distributions(scored_joints(records))}}

    def _models(self, row: AblationRow) -> ModelOptions | None:
        """Return the settings that replay the recording of a row; None without one."""
        if not row.model:
            return ModelOptions()
        folder = None if self.recordings is None else self.recordings / row.folder
        if folder is None or not (folder / RECORDING_FILE).is_file():
            return None
        return ModelOptions(examples=row.examples, budget=REPLAY_ONLY).recorded(folder)


def distributions(items: Sequence[ScoredJoint]) -> Record:
    """Return quantiles of each error over the predicted joints, in equal steps from 0 to 1."""
    out: Record = {}
    for name, kinds in DISTRIBUTIONS.items():
        chosen = [i for i in items if i.row == "visible" and i.kind in kinds and i.errors]
        values = [i.errors[name] for i in chosen if i.errors]
        finite = np.array([float(v) for v in values if v is not None and np.isfinite(v)])
        steps = np.linspace(0.0, 1.0, QUANTILES)
        out[name] = {
            "n": len(finite),
            "quantiles": np.quantile(finite, steps).round(6).tolist() if len(finite) else [],
        }
    return out
