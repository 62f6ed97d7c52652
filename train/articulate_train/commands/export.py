"""``export-policy``: write a run's policy as a bundle for robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse


@dataclass(frozen=True, kw_only=True)
class ExportFlags:
    """Write one seed of a run as a bundle: policy, manifest, golden pairs and scene.

    Example: export-policy runs/cabinet --out cabinet.zip
    """

    run: Annotated[Path, POSITIONAL]
    """Folder of the run."""
    out: Path | None = None
    """Bundle to write: a path ending in .zip, or a folder that does not exist; by default
    bundles/<run>-seed_<seed>.zip. Nothing is overwritten."""
    seed: int | None = None
    """Seed to export; by default the best one."""
    json: bool = False
    """Print the result as JSON."""


FLAGS = ExportFlags


def main(argv: Sequence[str]) -> int:
    """Export and print the path of the bundle."""
    flags = parse(ExportFlags, argv, prog="export-policy")
    from articulate_train.export import export_policy  # torch and MuJoCo; --help does without

    done = export_policy(flags.run, flags.out, seed=flags.seed)
    for warning in done.warnings:
        console.print_error(f"warning: {warning}")
    size = f"{done.size_bytes / 1e3:.0f} kB"
    text = f"{done.path}: seed {done.seed} ({done.seed_rule}), {size}"
    console.emit_json(done.as_dict()) if flags.json else console.emit(text)
    return 0
