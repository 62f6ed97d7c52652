"""Run one object of a benchmark in a child process; see :mod:`articulate.jobs.child`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import open_dataset
from articulate.benchmark.imported_predictions import ImportedActor, is_imported
from articulate.benchmark.run import run_object
from articulate.errors import ArticulateError, BudgetError, MissingError, UsageError
from articulate.files import write_json
from articulate.reconstruct.actors.registry import make_actor
from articulate.reconstruct.actors.vlm.options import ModelOptions


def run(request: dict[str, Any]) -> str:
    """Write the record of ``object`` to ``path``.

    Raises:
        UsageError: The settings are not accepted, a package or key is missing, or the budget is
            used.
        ArticulateError: The object cannot be read.
    """
    config = BenchmarkConfig(**request["config"])
    data = None if request["data"] is None else Path(request["data"])
    dataset = open_dataset(request["source"], data)
    imported = is_imported(config.actor)
    actor = ImportedActor(config.actor, request["object"]) if imported else make_actor(config.actor)
    actor = ModelOptions(**request["models"]).apply(actor)
    try:
        record = run_object(dataset.load(request["object"]), actor, config)
    except (MissingError, BudgetError):
        raise
    except UsageError as error:
        raise ArticulateError(str(error)) from None
    write_json(Path(request["path"]), record | request["stamp"])
    return ""
