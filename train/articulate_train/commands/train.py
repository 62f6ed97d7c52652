"""``train``: train policies for an object and a task, and evaluate them."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from articulate.cache import cache_folder
from articulate.commands import console
from articulate.commands.flags import parse
from articulate.commands.success import MISSED, check_share, missed
from articulate.errors import ConfigError, RunError
from articulate_train.asset_patterns import is_many
from articulate_train.commands.listing import requests_list, show_list
from articulate_train.config import REPLACED, TrainConfig

if TYPE_CHECKING:
    from articulate_envs.scene import Scene
    from articulate_train.run import Run
    from articulate_train.seed_runner import SeedProgress


@dataclass(frozen=True, kw_only=True)
class TrainFlags(TrainConfig):
    """Train policies that move one joint of an object with a Panda arm, and evaluate them.

    A scripted expert is imitated (DAgger) for the first 10 to 20 % of the steps, PPO trains for the
    rest. Each seed is an ensemble of two policies; its checkpoint is selected on separate episodes.

    Example: train --asset cabinet.urdf --task open_drawer --seeds 0 1 2
    """

    list_tasks: bool = False
    """List the tasks and exit."""
    list_joints: str | None = None
    """List the joints of this object, their matching tasks and feasibility, and exit."""
    from_scratch: bool = False
    """Start from random weights instead of the generalist policy."""
    out: Path | None = None
    """Run folder; by default runs/<asset>-<task>-<time>."""
    resume: bool = False
    """Continue the run in --out from its last checkpoints."""
    force: bool = False
    """Train although the scripted expert succeeds in less than 20 % of the sampled episodes."""
    dry_run: bool = False
    """Write an image of the scene, and print reachability, feasibility, time and disk space,
    without training."""
    launcher: Literal["local", "slurm", "ray"] = "local"
    """Launcher of the jobs if --asset names several objects."""
    no_evaluate: bool = False
    """Stop after training; `evaluate RUN` writes the report later."""
    require_success: float = 0.0
    """Exit with 3 if the success rate of the evaluation is below this fraction."""
    json: bool = False
    """Print only the report, as JSON, on standard output."""

    def __post_init__(self) -> None:
        if self.from_scratch:
            object.__setattr__(self, "initial_policy", "random")
        super().__post_init__()
        self._check_replaced()
        check_share(self.require_success)
        if self.dry_run and self.resume:
            raise ConfigError("--dry-run is for new runs; omit it or --resume")

    def _check_replaced(self) -> None:
        """Reject values that training from the generalist policy would not use."""
        if not self.starts_from_generalist:
            return
        for key in REPLACED:
            section, _, name = key.partition(".")
            own = getattr(self, section)
            if getattr(own, name) != getattr(type(own)(), name):
                raise ConfigError(
                    f"{key} is for training from random weights; add --from-scratch, "
                    "or set the keys of fine_tuning"
                )

    def config(self) -> TrainConfig:
        """Return the configuration that the run folder keeps."""
        return TrainConfig(**{f.name: getattr(self, f.name) for f in fields(TrainConfig)})


FLAGS = TrainFlags


def main(argv: Sequence[str]) -> int:
    """Train, evaluate, write the report; 130 when interrupted."""
    if requests_list(argv):
        return show_list(argv)
    flags = parse(TrainFlags, argv, prog="train", default=_resumed(argv))
    # These import torch and MuJoCo, which --help and bad flags do without.
    from articulate_train.commands.evaluate import show
    from articulate_train.run import resume_run
    from articulate_train.seed_runner import train_seeds

    if flags.engine != "cpu":
        from articulate_envs.engines import describe_engine

        console.show_progress(
            f"engine {describe_engine(flags.engine)}; the first steps compile its kernels, which "
            "takes minutes"
        )
    if not flags.resume and is_many(flags.asset):
        return _many(flags, argv)
    if flags.dry_run:
        return _dry_run(flags)
    run = resume_run(_out(flags), flags.config()) if flags.resume else _new_run(flags)
    console.show_progress(_plan(run))
    again = console.command_line(["train", "--resume", "--out", run.folder])
    console.hint_after_interrupt(f"continue with: {again}")
    if not train_seeds(run, _show_seed, _show_selection):
        raise KeyboardInterrupt
    if flags.no_evaluate:
        folder = str(run.folder)
        console.emit_json({"run": folder}) if flags.json else console.emit(folder)
        return 0
    return show(run, run.config.episodes, flags.require_success, as_json=flags.json)


def _many(flags: TrainFlags, argv: Sequence[str]) -> int:
    """Train every object with every seed as a separate job; 3 if a job or the target failed."""
    from articulate_train.sweep import train_many  # heavy, see main

    for name, is_set in (("--dry-run", flags.dry_run), ("--no-evaluate", flags.no_evaluate)):
        if is_set:
            raise ConfigError(f"{name} is for one object; --asset {flags.asset} names several")
    out = flags.out or Path("runs") / _default_name(flags)
    again = [*argv, *(() if flags.out else ("--out", str(out)))]
    command = console.command_line(["train", *again])
    console.hint_after_interrupt(f"continue with: {command}")
    more = ("--force",) if flags.force else ()
    outcome = train_many(flags.config(), out, flags.launcher, command, console.show_progress, more)
    console.emit_json(outcome.content()) if flags.json else console.emit(outcome.text())
    if not outcome.complete or outcome.comparison is None:
        return MISSED
    worst = min(row.success.value for row in outcome.comparison.rows)
    return missed(worst, flags.require_success)


def _dry_run(flags: TrainFlags) -> int:
    from articulate_train.dry_run import dry_run  # heavy, see main

    out = flags.out or Path("runs") / _default_name(flags)
    found = dry_run(flags.config(), cache_folder(), Path(f"{out}.png"), console.show_waiting)
    console.emit_json(found.as_dict()) if flags.json else console.emit(found.text())
    return 0


def _default_name(flags: TrainFlags) -> str:
    stem = Path(flags.asset.replace("*", "all")).resolve().stem or "asset"
    return f"{stem}-{flags.task}-{time.strftime('%Y%m%d-%H%M%S')}"


def _new_run(flags: TrainFlags) -> Run:
    """Create a run in ``--out``, or in a free folder below ``runs``."""
    from articulate_train.feasibility_check import check_feasibility  # heavy, see main
    from articulate_train.run import create_run

    config, cache = flags.config(), cache_folder()

    def check(scene: Scene) -> None:
        console.show_waiting("running the scripted expert on sampled episodes")
        check_feasibility(
            scene,
            config,
            force=flags.force,
            show_progress=console.show_progress,
            warn=console.print_error,
        )

    if flags.out is not None:
        return create_run(config, flags.out, cache, console.show_waiting, check)
    base = _default_name(flags)
    for k in itertools.count(1):
        folder = Path("runs") / (base if k == 1 else f"{base}-{k}")
        try:
            return create_run(config, folder, cache, console.show_waiting, check)
        except RunError:
            if not folder.exists():
                raise  # otherwise a run of the same second has the folder
    raise AssertionError


def _plan(run: Run) -> str:
    """Describe the run in one line."""
    config = run.config
    seeds = " ".join(map(str, config.seeds))
    return (
        f"{run.folder}: {run.task.name} of {run.asset.name}, joint {run.task.joint}; "
        f"seed{'s' * (len(config.seeds) > 1)} {seeds} of {config.steps / 1e6:.3g}M steps"
    )


def _out(flags: TrainFlags) -> Path:
    assert flags.out is not None  # checked by _resumed
    return flags.out


def _resumed(argv: Sequence[str]) -> TrainFlags | None:
    """Return the configuration of the run to resume, as defaults."""
    if "--resume" not in argv:
        return None
    outs = [after for word, after in pairwise([*argv, ""]) if word == "--out"]
    outs += [word.removeprefix("--out=") for word in argv if word.startswith("--out=")]
    if not outs or not outs[0] or outs[0].startswith("--"):
        raise RunError("--resume needs --out RUN, the folder of the run to continue")
    folder = Path(outs[0])
    from articulate_train.run import open_run  # heavy, see main

    kept = open_run(folder).config
    return TrainFlags(**{f.name: getattr(kept, f.name) for f in fields(TrainConfig)}, out=folder)


def _show_selection(seed: int, text: str) -> None:
    console.show_progress(f"seed {seed}  {text}")


def _show_seed(progress: SeedProgress) -> None:
    steps = min(progress.steps, progress.total)  # the last update may go beyond
    console.show_progress(
        f"seed {progress.seed}  {steps:9,} of {progress.total:,} steps  "
        f"{progress.steps_per_s:6.0f} steps/s  at target {progress.opened:4.0%}  "
        f"success {progress.success:4.0%}"
    )
