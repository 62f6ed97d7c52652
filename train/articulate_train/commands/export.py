"""``export-policy``: write a run's policy as a bundle for robots."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from articulate.cache import cache_folder
from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError

if TYPE_CHECKING:
    from articulate_train.export import Exported


@dataclass(frozen=True, kw_only=True)
class ExportFlags:
    """Write one seed of a run as a bundle: policy, manifest, golden pairs and scene.

    Example: export-policy runs/cabinet --out cabinet.zip
    Example: export-policy --policy generalist --asset cabinet.urdf --task open_drawer
    """

    run: Annotated[tuple[Path, ...], POSITIONAL] = ()
    """Folder of the run."""
    policy: Literal["trained", "generalist"] = "trained"
    """Policy: one of the run, or the generalist policy of the package for --asset and --task."""
    asset: str | None = None
    """Object of --policy generalist."""
    task: str = "open_drawer"
    """Task of --policy generalist."""
    joint: str | None = None
    """Joint of --asset; by default as for train."""
    out: Path | None = None
    """Bundle to write: a path ending in .zip, or a folder that does not exist; by default
    bundles/<run>-seed_<seed>.zip. Nothing is overwritten."""
    seed: int | None = None
    """Seed to export; by default the best one."""
    json: bool = False
    """Print the result as JSON."""

    def __post_init__(self) -> None:
        if self.policy == "generalist":
            if self.run or self.asset is None or self.seed is not None:
                raise ConfigError("--policy generalist needs --asset, no run folder and no --seed")
        elif len(self.run) != 1:
            raise ConfigError("give one run folder, or --policy generalist with --asset and --task")
        elif self.asset is not None or self.joint is not None:
            raise ConfigError("--asset and --joint are for --policy generalist")


FLAGS = ExportFlags


def main(argv: Sequence[str]) -> int:
    """Export and print the path of the bundle."""
    flags = parse(ExportFlags, argv, prog="export-policy")
    from articulate_train.export import export_policy  # torch and MuJoCo; --help does without

    if flags.policy == "generalist":
        done = _export_generalist(flags)
    else:
        done = export_policy(flags.run[0], flags.out, seed=flags.seed)
    for warning in done.warnings:
        console.print_error(f"warning: {warning}")
    size = f"{done.size_bytes / 1e3:.0f} kB"
    text = f"{done.path}: seed {done.seed} ({done.seed_rule}), {size}"
    console.emit_json(done.as_dict()) if flags.json else console.emit(text)
    return 0


def _export_generalist(flags: ExportFlags) -> Exported:
    """Export the generalist policy for --asset, by way of a temporary run folder."""
    from articulate_train.config import TrainConfig
    from articulate_train.export import export_policy
    from articulate_train.generalist import generalist_run  # torch and MuJoCo

    assert flags.asset is not None  # checked by the flags
    config = TrainConfig(asset=flags.asset, task=flags.task, joint=flags.joint, seeds=(0,))
    name = f"{Path(flags.asset).resolve().stem}-{flags.task}"
    out = flags.out or Path("bundles") / f"generalist-{name}.zip"
    with tempfile.TemporaryDirectory(prefix="articulate-generalist-") as temporary:
        folder = Path(temporary) / "generalist"
        generalist_run(config, folder, cache_folder(), show_progress=console.show_waiting)
        return export_policy(folder, out)
