"""``train``: from an object and a task to policies and their report."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from articulate.commands.flags import parse
from articulate.errors import RunError
from articulate_train.commands.listing import asks_for_a_list, show_list
from articulate_train.config import TrainConfig

if TYPE_CHECKING:
    from articulate_train.campaign import SeedProgress

INTERRUPTED = 130


@dataclass(frozen=True, kw_only=True)
class TrainFlags(TrainConfig):
    """Train policies that move one joint of an object with a Panda arm, and evaluate them.

    Example: train --asset cabinet.urdf --task open_drawer --seeds 0 1 2
    """

    list_tasks: bool = False
    """Print the names of the tasks and what they ask, and stop."""
    list_joints: str | None = None
    """Print the joints of this object and the tasks that can be asked of them, and stop."""
    out: Path | None = None
    """Folder of the run; by default runs/<asset>-<task>-<time>."""
    resume: bool = False
    """Go on with the run in --out from its last checkpoints."""
    no_evaluate: bool = False
    """Stop after training; `evaluate RUN` makes the report later."""
    require_success: float = 0.0
    """Exit with 3 if the success rate of the evaluation is below this share."""
    json: bool = False
    """Print the report as JSON and nothing else on standard output."""

    def config(self) -> TrainConfig:
        """What the run folder keeps."""
        return TrainConfig(**{f.name: getattr(self, f.name) for f in fields(TrainConfig)})


def main(argv: Sequence[str]) -> int:
    """Train, evaluate, write the report; 130 when interrupted."""
    if asks_for_a_list(argv):
        return show_list(argv)
    flags = parse(TrainFlags, argv, prog="train", default=_resumed(argv))
    # From here on torch and MuJoCo are needed; --help and bad flags are answered without them.
    from articulate.prove.store import default_cache
    from articulate_train.campaign import train_seeds
    from articulate_train.commands.evaluate import show
    from articulate_train.run import create_run, resume_run

    out = _out(flags)
    config = flags.config()
    run = resume_run(out, config) if flags.resume else create_run(config, out, default_cache())
    _say(f"{run.folder}: {run.task.name} of {run.asset.name}, joint {run.task.joint}")
    if not train_seeds(run, _tell):
        _say(f"stopped; go on with: train --resume --out {run.folder}")
        return INTERRUPTED
    if flags.no_evaluate:
        print(json.dumps({"run": str(run.folder)}) if flags.json else run.folder)
        return 0
    return show(run, run.config.episodes, flags.require_success, as_json=flags.json)


def _resumed(argv: Sequence[str]) -> TrainFlags | None:
    """Defaults of a run that is resumed: what its folder says."""
    if "--resume" not in argv:
        return None
    outs = [after for word, after in pairwise([*argv, ""]) if word == "--out"]
    outs += [word.removeprefix("--out=") for word in argv if word.startswith("--out=")]
    if not outs or not outs[0] or outs[0].startswith("--"):
        raise RunError("--resume needs --out RUN, the folder of the run to go on with")
    folder = Path(outs[0])
    from articulate_train.run import open_run  # heavy, see main

    kept = open_run(folder).config
    return TrainFlags(**{f.name: getattr(kept, f.name) for f in fields(TrainConfig)}, out=folder)


def _out(flags: TrainFlags) -> Path:
    if flags.out is not None:
        return flags.out
    stem = Path(flags.asset).stem or "asset"
    return Path("runs") / f"{stem}-{flags.task}-{time.strftime('%Y%m%d-%H%M%S')}"


def _tell(progress: SeedProgress) -> None:
    _say(
        f"seed {progress.seed}  {progress.steps / 1e6:5.2f} of {progress.total / 1e6:.2f}M  "
        f"{progress.steps_per_s:6.0f} steps/s  at target {progress.opened:4.0%}  "
        f"success {progress.success:4.0%}"
    )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
