"""Rows of the publication's ablations: the benchmark run of each.

Rows with a model are run from recorded answers only; see ``docs/results/benchmark.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from articulate.benchmark.config import Task
from articulate.reconstruct.actors.modality import Modality
from articulate.reconstruct.actors.vlm.gemini import DEFAULT_MODEL

Ablation = Literal["modality", "examples", "iterations", "base_model", "critic"]
"""Quantity that is varied."""
N_EXAMPLES = (0, 1, 2, 5, 10, 20)
"""Numbers of in-context examples; the publication uses at most 20."""


@dataclass(frozen=True, kw_only=True)
class AblationRow:
    """One row of a table: a benchmark run."""

    label: str
    actor: str
    modality: Modality
    task: Task = "joints"
    model: str = ""
    """Model whose recorded answers are used; empty for actors without a model."""
    examples: int | None = None
    """Number of in-context examples; None: the actor's default."""

    @property
    def folder(self) -> str:
        """Name of the folder of the run; equal runs share it."""
        words = [self.task, self.modality, self.actor, self.model]
        words += [] if self.examples is None else [f"examples-{self.examples}"]
        return "-".join(word for word in words if word)


def _model_row(
    label: str, modality: Modality, actor: str = "vlm", **changes: object
) -> AblationRow:
    settings: dict[str, object] = {"model": DEFAULT_MODEL, **changes}
    return AblationRow(label=label, actor=actor, modality=modality, **settings)  # type: ignore[arg-type]


_VIDEO = AblationRow(label="geometric-video", actor="geometric-video", modality="video")
ROWS: Mapping[Ablation, Sequence[AblationRow]] = {
    "modality": (
        AblationRow(
            label="placement, image", actor="geometric-image", modality="image", task="placement"
        ),
        _model_row("placement, text, model", "text", task="placement"),
        _model_row("placement, image, model", "image", task="placement"),
        AblationRow(label="joints, text", actor="geometric-text", modality="text"),
        AblationRow(label="joints, image", actor="geometric-image", modality="image"),
        AblationRow(label="joints, video", actor="geometric-video", modality="video"),
        _model_row("joints, text, model", "text"),
        _model_row("joints, image, model", "image"),
        _model_row("joints, video, model", "video"),
    ),
    "examples": (
        AblationRow(label="no model", actor="geometric-video", modality="video"),
        *(_model_row(f"{n} examples", "video", examples=n) for n in N_EXAMPLES),
    ),
    "iterations": (_VIDEO, _model_row("hybrid", "video", "hybrid"), _model_row("vlm", "video")),
    "base_model": (
        AblationRow(label="no model", actor="geometric-video", modality="video"),
        _model_row(DEFAULT_MODEL, "video"),
    ),
    "critic": (_VIDEO, _model_row("hybrid", "video", "hybrid"), _model_row("vlm", "video")),
}
"""Rows of each ablation, in the order of the table; see :func:`rows_of` for further models."""


def rows_of(name: Ablation, recorded: Sequence[str]) -> list[AblationRow]:
    """Return the rows of an ablation; that of base models has a row for each recorded model.

    Args:
        name: Ablation.
        recorded: Names of the recordings, such as ``joints-video-vlm-MODEL``.
    """
    rows = list(ROWS[name])
    if name == "base_model":
        folder = rows[-1].folder.removesuffix(DEFAULT_MODEL)
        models = [text.removeprefix(folder) for text in recorded if text.startswith(folder)]
        known = {row.model for row in rows}
        rows += [
            _model_row(model, "video", model=model)
            for model in sorted(models)
            if model and model not in known and "-examples-" not in model
        ]
    return rows
