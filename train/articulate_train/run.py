"""Run folders: what was asked, with which object, and what came of it.

::

    run/
      config.yaml    the whole configuration, before work starts
      asset/         the object as it was converted
      scene.json     task, place and arm
      versions.json  versions at the beginning
      seed_K.log     what its process said
      seed_K/        checkpoint.pt, policy.pt, progress.jsonl, tensorboard/, done.json or
                     diverged.npz
      sessions.json  seconds of each call of train that worked on it
      summary.json   what each seed reached, seconds of all calls, versions
      report.json, report.html, videos/
      .lock          held by the call of train that works on it
"""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import Any

from articulate.assets.asset import Asset, load_asset
from articulate.cache import cache_in_use
from articulate.config import from_mapping, read_yaml, to_yaml
from articulate.conversion import ConvertConfig
from articulate.conversion.metric_size import check_category
from articulate.errors import RunError, field_error
from articulate.files import copy_writable, require_space, write_json, write_text
from articulate.preparation.prepare import load_checked_asset
from articulate.robot.arm import PANDA, Arm, Gripper
from articulate.task.observation import ACTION
from articulate.task.task import Limits, Task
from articulate_envs.joint_selection import choose_joint
from articulate_envs.placement_search import ObjectPlacement
from articulate_envs.scene import Scene, build_scene
from articulate_train.config import TrainConfig
from articulate_train.run_lock import lock_run

PACKAGES = (
    "mujoco", "numpy", "torch", "stable_baselines3", "gymnasium", "numba", "robosuite",
)  # fmt: skip
"""Packages whose versions are recorded."""


@dataclass(frozen=True)
class Run:
    """A run folder and what it holds."""

    folder: Path
    config: TrainConfig
    asset: Asset
    task: Task
    place: ObjectPlacement
    arm: Arm

    def seed_folder(self, seed: int) -> Path:
        """Folder of one seed."""
        return self.folder / f"seed_{seed}"

    def widened(self, ranges: float) -> Run:
        """The run with every range of its randomisation ``ranges`` times as wide.

        Raises:
            ConfigError: ``ranges`` is not above 0, or a range would hold what cannot be.
        """
        wide = dataclasses.replace(
            self.config, randomization=self.config.randomization.widened(ranges)
        )
        return dataclasses.replace(self, config=wide)

    def scene(self, scales: tuple[float, ...] | None = None) -> Scene:
        """The run's scene, compiled for ``scales`` (the drawn sizes by default)."""
        return build_scene(
            self.asset,
            self.task,
            arm=self.arm,
            control=self.config.control,
            physics=self.config.physics,
            place=self.place,
            scales=self.config.randomization.scale_values if scales is None else scales,
        )


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide results."""
    out = {"python": platform.python_version(), "system": platform.platform()}
    for name in PACKAGES:
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            out[name] = "not installed"
    return out


def prepare_asset(config: TrainConfig, cache: Path) -> Asset:
    """The object of ``config``, converted or taken from the cache."""
    check_category(config.category)
    wish = ConvertConfig(size_m=config.size, category=config.category, closed=config.closed)
    return load_checked_asset(Path(config.asset), cache, wish)


def create_run(
    config: TrainConfig, folder: Path, cache: Path, show_progress: Callable[[str], None] = lambda _: None
) -> Run:
    """Make the folder of a new run, whole or not at all.

    Args:
        config: What is asked for.
        folder: Where to.
        cache: Cache folder.
        say: Told what is done next.

    Raises:
        RunError: The folder exists.
        UsageError: The object cannot be read or reached.
    """
    _check_free(folder)
    with cache_in_use(cache):
        asset, task, place = _placed(config, cache, show_progress)
        require_space(folder, run_bytes(config, asset), "a run")
        _write_run(folder, config, asset, task, place)
    return open_run(folder)


def _placed(
    config: TrainConfig, cache: Path, show_progress: Callable[[str], None]
) -> tuple[Asset, Task, ObjectPlacement]:
    """The object of ``config``, what is asked of it, and where it stands."""
    show_progress(f"{config.asset}: converting and proving it, or taking it from the cache")
    asset = prepare_asset(config, cache)
    show_progress(f"{asset.name}: looking for a place from which the arm reaches what it is to move")
    return (asset, *choose_joint(config, asset))


def with_object(
    run: Run,
    asset: str,
    joint: str | None,
    cache: Path,
    show_progress: Callable[[str], None] = lambda _: None,
) -> Run:
    """``run`` with another object before the same arm, to judge there what was trained here.

    Args:
        run: Whose policies, configuration and folder are taken.
        asset: Object, as ``train --asset`` takes it; its size, category and closed ends are found
            from it alone.
        joint: Joint of it; None: the one that ``train`` would take.
        cache: Cache folder.
        say: Told what is done next.

    Raises:
        UsageError: The object cannot be read or reached, or has no such joint.
    """
    config = dataclasses.replace(
        run.config, asset=asset, joint=joint, size=None, category=None, closed="auto"
    )
    with cache_in_use(cache):
        other, task, place = _placed(config, cache, show_progress)
    return dataclasses.replace(run, config=config, asset=other, task=task, place=place)


def _write_run(
    folder: Path, config: TrainConfig, asset: Asset, task: Task, place: ObjectPlacement
) -> None:
    temporary = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        # A name of its own: another run may be made beside this one at the same moment.
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        temporary.chmod(0o755)
        copy_writable(asset.folder, temporary / "asset")
        write_text(temporary / CONFIG, to_yaml(config))
        write_scene(temporary, task, place, PANDA)
        write_json(temporary / "versions.json", versions())
        temporary.replace(folder)
    except OSError as error:
        if error.errno in {errno.ENOTEMPTY, errno.EEXIST}:  # another call was faster
            raise RunError(f"{folder}: {IN_THE_WAY}") from None
        why = error.strerror or "copying failed"
        raise RunError(f"{folder}: cannot be written ({why}); choose another --out") from None
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def run_bytes(config: TrainConfig, asset: Asset) -> int:
    """What a run takes on disk at most, generously [bytes]."""
    object_bytes = sum(p.stat().st_size for p in asset.folder.rglob("*") if p.is_file())
    seed_bytes = config.ensemble_size * _member_bytes(config) + config.steps // 10
    return object_bytes + len(config.seeds) * seed_bytes + REPORT_BYTES


def _member_bytes(config: TrainConfig) -> int:
    """A member's part of a checkpoint, twice while it is written, and states of its policy."""
    sizes = (MOST_SEEN, *config.ppo.net_arch, ACTION.size)
    weights = 8 * sum((a + 1) * b for a, b in pairwise(sizes))  # actor and critic, of 4 bytes each
    checkpoint = 3 * weights + config.ppo.n_envs * ENV_BYTES  # beside them Adam's two moments
    return config.checkpoint_selection.n_checkpoints * weights + 2 * checkpoint


MOST_SEEN = 130
"""Numbers that a critic sees, or more."""
ENV_BYTES = 10_000
"""State of an environment in a checkpoint, or more."""
REPORT_BYTES = 20_000_000
"""The report with its clips."""


IN_THE_WAY = "exists; go on with --resume, or choose another --out"


def _check_free(folder: Path) -> None:
    """RunError, before any work, where a new run cannot be made at ``folder``."""
    if (folder / CONFIG).exists():
        raise RunError(f"{folder}: {IN_THE_WAY}")
    is_empty = folder.is_dir() and next(folder.iterdir(), None) is None  # such a one is replaced
    if folder.exists() and not is_empty:
        raise RunError(f"{folder}: exists and is no run; choose another --out")
    above = next(p for p in folder.absolute().parents if p.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        what = "may not be written to" if above.is_dir() else "is a file"
        raise RunError(f"{folder}: cannot be made: {above} {what}; choose another --out")


def resume_run(folder: Path, config: TrainConfig) -> Run:
    """The run in ``folder`` to go on with, under ``config`` where it differs in :data:`OPEN`.

    Raises:
        RunError: It is none, is being trained, or ``config`` differs from what it was begun with.
    """
    run = open_run(folder)
    asked, kept = _plain("", config), _plain("", run.config)
    for name, value in asked.items():
        if value != kept[name] and name not in OPEN:
            flags = ", ".join(f"--{n}" for n in OPEN)
            raise RunError(
                f"{folder}: --{name} is {value!r}, but the run was begun with {kept[name]!r}; "
                f"--resume may change {flags} alone: leave it out, or begin a new run"
            )
    if asked == kept:
        return run
    ppo = config.ppo
    beyond = (
        config.steps + ppo.n_envs * ppo.n_steps * config.ensemble_size
    )  # a last round is not cut
    trained = max((done_steps(path) for path in folder.glob(f"seed_*/{DONE}")), default=0)
    if trained >= beyond:
        raise RunError(
            f"{folder}: --steps is {config.steps}, but {trained} are trained already; give more, "
            "or leave it out"
        )
    with lock_run(folder):  # seeds that wait their turn in another call read it too
        write_text(folder / CONFIG, to_yaml(config))
    return dataclasses.replace(run, config=config)


def done_steps(path: Path) -> int:
    """Ticks after which a seed was done; 0 where it is not, or its file is damaged."""
    try:
        return int(json.loads(path.read_text(encoding="utf-8"))["steps"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0


OPEN = ("steps", "jobs", "episodes")
"""What may be asked anew of a run that goes on."""
CONFIG, SUMMARY, DONE = "config.yaml", "summary.json", "done.json"


def _plain(prefix: str, config: Any) -> dict[str, Any]:
    """Fields of nested configurations by their flags."""
    out: dict[str, Any] = {}
    for f in dataclasses.fields(config):
        value = getattr(config, f.name)
        inner = dataclasses.is_dataclass(value)
        out |= _plain(f"{prefix}{f.name}.", value) if inner else {prefix + f.name: value}
    return out


def open_run(folder: Path) -> Run:
    """Read a run folder.

    Raises:
        RunError: It is none.
    """
    path = folder / "scene.json"
    if not path.is_file():
        what = "no scene.json in it" if folder.exists() else "it does not exist"
        if (folder / CONFIG).is_file():
            raise RunError(
                f"{folder}: holds many runs; to go on, repeat the command that began them, without "
                "--resume"
            )
        raise RunError(f"{folder}: not a run folder: {what}; give a folder that train made")
    try:
        scene = json.loads(path.read_text(encoding="utf-8"))
        task, place, arm = _task(scene["task"]), _place(scene["place"]), _arm(scene["arm"])
    except (KeyError, TypeError) as error:
        raise RunError(f"{path}: {field_error(error)}; train again") from None
    except (OSError, ValueError, AttributeError) as error:
        raise RunError(f"{path}: cannot be read ({error}); train again") from None
    return Run(
        folder=folder,
        config=_kept_config(folder / CONFIG),
        asset=load_asset(folder / "asset"),
        task=task,
        place=place,
        arm=arm,
    )


def _kept_config(path: Path) -> TrainConfig:
    """What a run was begun with; one of before there were members has one."""
    return from_mapping(TrainConfig, {"members": 1} | read_yaml(path), str(path))


def write_scene(folder: Path, task: Task, place: ObjectPlacement, arm: Arm) -> None:
    """Write ``scene.json``: what is asked, where the object stands, limits and gains of the arm."""
    scene = {
        "task": dataclasses.asdict(task),
        "place": place.as_dict(),
        "arm": dataclasses.asdict(arm),
    }
    write_json(folder / "scene.json", scene)


def load_scene(folder: Path) -> Scene:
    """The scene of the run in ``folder``."""
    return open_run(folder).scene()


def write_summary(run: Run, results: list[dict[str, Any]], seconds: float) -> Path:
    """Write ``summary.json``: what each seed reached in ``seconds`` of training."""
    path = run.folder / SUMMARY
    content = {
        "asset": run.asset.name,
        "task": run.task.name,
        "joint": run.task.joint,
        "target_fraction": run.task.target,
        "steps": run.config.steps,
        "seconds": seconds,
        "seeds": results,
        "versions": versions(),
        "command": " ".join(sys.argv),
    }
    write_json(path, content)
    return path


def _task(content: dict[str, Any]) -> Task:
    plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in content.items()}
    return Task(**{**plain, "limits": Limits(**content["limits"])})


def _arm(content: dict[str, Any]) -> Arm:
    plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in content.items()}
    return Arm(**{**plain, "hand": Gripper(**content["hand"])})


def _place(content: dict[str, Any]) -> ObjectPlacement:
    plain: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in content.items()}
    return ObjectPlacement(**plain)
