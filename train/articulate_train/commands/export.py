"""``export-policy``: write a run's policy as a bundle for robots."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from articulate.commands.flags import parse


@dataclass(frozen=True, kw_only=True)
class ExportFlags:
    """Write one seed of a run as a bundle: policy, manifest, golden pairs and scene.

    Example: export-policy runs/cabinet --out cabinet.zip
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""
    out: Path
    """Bundle to write: a path ending in .zip, or a folder that does not exist."""
    seed: int | None = None
    """Seed to export; by default the best."""
    json: bool = False
    """Print the result as JSON."""


def main(argv: Sequence[str]) -> int:
    """Export and print where the bundle lies."""
    flags = parse(ExportFlags, argv, prog="export-policy")
    from articulate_train.export import export_policy  # torch and MuJoCo; --help does without

    done = export_policy(flags.run, flags.out, seed=flags.seed)
    for warning in done.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if flags.json:
        print(json.dumps(done.as_dict(), indent=1))
    else:
        print(f"{done.path}: seed {done.seed} ({done.seed_rule}), {done.size_bytes / 1e3:.0f} kB")
    return 0
