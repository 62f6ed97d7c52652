"""Run folders: configuration, object, checkpoints and reports of a training.

::

    run/
      config.yaml    complete configuration, written before training
      asset/         converted object
      scene.json     task, object placement and arm
      versions.json  package versions at the beginning
      seed_K.log     output of the seed's process
      seed_K/        checkpoint.pt, policy.pt, progress.jsonl, tensorboard/, done.json or
                     diverged.npz
      sessions.json  training time of each call of train [s]
      summary.json   results of each seed, time of all calls, versions
      report.json, report.html, videos/
      .lock          held by the call of train that works on the run
"""

from __future__ import annotations

import dataclasses
import errno
import os
import platform
import shlex
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
from articulate.assets.asset_files import check_asset_files
from articulate.cache import cache_in_use
from articulate.config import from_mapping, read_yaml, to_yaml
from articulate.conversion import ConvertConfig
from articulate.conversion.metric_size import check_category
from articulate.errors import ConfigError, RunError, field_error, quote, shorten
from articulate.files import (
    copy_writable,
    read_json_object,
    reject_links,
    require_space,
    write_json,
    write_text,
)
from articulate.preparation.prepare import load_checked_asset
from articulate.robot.arm import PANDA, Arm
from articulate.task.floor_pose import parse_floor_pose
from articulate.task.object_placement import ObjectPlacement
from articulate.task.observation import ACTION
from articulate.task.task import Task
from articulate.untrusted import load_json_object
from articulate_envs.scene import Scene, build_scene
from articulate_train.config import TrainConfig
from articulate_train.feasibility_check import best_scene
from articulate_train.run_lock import lock_run

PACKAGES = (
    "mujoco", "numpy", "torch", "stable_baselines3", "gymnasium", "numba", "robosuite",
)  # fmt: skip
"""Packages whose versions are recorded."""


@dataclass(frozen=True)
class Run:
    """Run folder and its content."""

    folder: Path
    config: TrainConfig
    asset: Asset
    task: Task
    placement: ObjectPlacement
    arm: Arm

    def seed_folder(self, seed: int) -> Path:
        """Return the folder of one seed."""
        return self.folder / f"seed_{seed}"

    def widened(self, ranges: float) -> Run:
        """Return the run with all randomization ranges ``ranges`` times as wide.

        Raises:
            ConfigError: ``ranges`` is not above 0, or a range would hold invalid values.
        """
        wide = dataclasses.replace(
            self.config, randomization=self.config.randomization.widened(ranges)
        )
        return dataclasses.replace(self, config=wide)

    def scene(self, scales: tuple[float, ...] | None = None) -> Scene:
        """Compile the scene for ``scales``, by default the sizes of the randomization."""
        return build_scene(
            self.asset,
            self.task,
            arm=self.arm,
            control=self.config.control,
            physics=self.config.physics,
            placement=self.placement,
            scales=self.config.randomization.scale_values if scales is None else scales,
        )


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that influence results."""
    out = {"python": platform.python_version(), "system": platform.platform()}
    for name in PACKAGES:
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            out[name] = "not installed"
    return out


def prepare_asset(config: TrainConfig, cache: Path) -> Asset:
    """Convert and check the object of ``config``, or read it from the cache."""
    check_category(config.category)
    options = ConvertConfig(
        size_m=config.size, category=config.category, closed=config.closed, up=config.up
    )
    return load_checked_asset(Path(config.asset), cache, options)


def create_run(
    config: TrainConfig,
    folder: Path,
    cache: Path,
    show_progress: Callable[[str], None] = lambda _: None,
    check: Callable[[Scene], None] = lambda _: None,
) -> Run:
    """Create the folder of a new run atomically.

    Args:
        config: Configuration.
        folder: Folder to create.
        cache: Cache folder.
        show_progress: Called with one line before each stage.
        check: Called with the compiled scene; nothing is written if it raises.

    Raises:
        RunError: The folder exists.
        UsageError: The object cannot be read or reached.
    """
    _check_free(folder)
    config = with_placement(config)
    with cache_in_use(cache):
        asset, task, placement = _place_object(config, cache, show_progress)
        require_space(folder, run_bytes(config, asset), "a run")
        check(Run(folder, config, asset, task, placement, PANDA).scene())
        _write_run(folder, config, asset, task, placement)
    return open_run(folder)


def with_placement(config: TrainConfig) -> TrainConfig:
    """Return ``config`` with the numbers of its placement file, so that it needs no other file.

    Raises:
        ConfigError: The placement cannot be read or is not accepted.
    """
    if config.placement is None:
        return config
    at = parse_floor_pose(config.placement)
    return dataclasses.replace(config, placement=at.as_tuple())


def _place_object(
    config: TrainConfig, cache: Path, show_progress: Callable[[str], None]
) -> tuple[Asset, Task, ObjectPlacement]:
    """Return the checked asset of ``config``, its task and its placement."""
    show_progress(f"{config.asset}: converting and checking, or reading from the cache")
    asset = prepare_asset(config, cache)
    show_progress(f"{asset.name}: searching a reachable object placement")
    scene = best_scene(config, asset, show_progress)
    return asset, scene.task, scene.placement


def with_object(
    run: Run,
    asset: str,
    joint: str | None,
    cache: Path,
    show_progress: Callable[[str], None] = lambda _: None,
) -> Run:
    """Return ``run`` with another object, to evaluate its policies there.

    Args:
        run: The run; its policies, configuration and folder are kept.
        asset: Object, as for ``train --asset``; its size, category and closed positions are
            inferred.
        joint: Joint of the object; None selects it as ``train`` does.
        cache: Cache folder.
        show_progress: Called with one line before each stage.

    Raises:
        UsageError: The object cannot be read or reached, or has no such joint.
    """
    config = dataclasses.replace(
        run.config, asset=asset, joint=joint, size=None, category=None, closed="auto", up="z"
    )
    with cache_in_use(cache):
        other, task, placement = _place_object(config, cache, show_progress)
    return dataclasses.replace(run, config=config, asset=other, task=task, placement=placement)


def _write_run(
    folder: Path, config: TrainConfig, asset: Asset, task: Task, placement: ObjectPlacement
) -> None:
    temporary = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        # A unique name: another run may be created beside this one at the same time.
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        temporary.chmod(0o755)
        copy_writable(asset.folder, temporary / "asset")
        write_text(temporary / CONFIG, to_yaml(config) + CONFIG_END)
        write_scene(temporary, task, placement, PANDA)
        write_json(temporary / "versions.json", versions())
        temporary.replace(folder)
    except OSError as error:
        if error.errno in {errno.ENOTEMPTY, errno.EEXIST}:  # another call was faster
            raise RunError(f"{folder}: {EXISTS}") from None
        why = error.strerror or "copying failed"
        raise RunError(f"{folder}: cannot be written ({why}); choose another --out") from None
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def run_bytes(config: TrainConfig, asset: Asset) -> int:
    """Return an upper bound of the disk space of a run [bytes]."""
    object_bytes = sum(p.stat().st_size for p in asset.folder.rglob("*") if p.is_file())
    seed_bytes = config.ensemble_size * _member_bytes(config) + config.steps // 10
    return object_bytes + len(config.seeds) * seed_bytes + REPORT_BYTES


def _member_bytes(config: TrainConfig) -> int:
    """Return the size of a member's checkpoints, one of them written twice, and candidates."""
    sizes = (MAX_INPUTS, *config.ppo.net_arch, ACTION.size)
    weights = 8 * sum((a + 1) * b for a, b in pairwise(sizes))  # actor and critic of 4 bytes
    checkpoint = 3 * weights + config.ppo.n_envs * ENV_BYTES  # with the two moments of Adam
    if config.starts_from_generalist:
        samples = min(config.fine_tuning.imitation_steps, config.steps)
        checkpoint += 4 * samples * (MAX_INPUTS + ACTION.size)
    return config.checkpoint_selection.n_checkpoints * weights + 2 * checkpoint


MAX_INPUTS = 130
"""Upper bound of the inputs of the value function."""
ENV_BYTES = 10_000
"""Upper bound of the state of an environment in a checkpoint [bytes]."""
REPORT_BYTES = 20_000_000
"""Size of a report with its videos [bytes]."""


EXISTS = "exists; continue with --resume, or choose another --out"


def _check_free(folder: Path) -> None:
    """Raise RunError if a new run cannot be created at ``folder``."""
    if (folder / CONFIG).exists():
        raise RunError(f"{folder}: {EXISTS}")
    is_empty = folder.is_dir() and next(folder.iterdir(), None) is None  # it is replaced
    if folder.exists() and not is_empty:
        raise RunError(f"{folder}: exists and is not a run; choose another --out")
    above = next(p for p in folder.absolute().parents if p.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        reason = "is not writable" if above.is_dir() else "is a file"
        raise RunError(f"{folder}: cannot be created: {above} {reason}; choose another --out")


def resume_run(folder: Path, config: TrainConfig) -> Run:
    """Return the run in ``folder`` to continue, with the changes of ``config`` in :data:`OPEN`.

    Raises:
        RunError: It is not a run, is being trained, or ``config`` differs in other keys.
    """
    run, config = open_run(folder), with_placement(config)
    new, kept = _by_key("", config), _by_key("", run.config)
    for name, value in new.items():
        if value != kept[name] and name not in OPEN:
            raise RunError(
                f"{folder}: {name} is {quote(value)}, but the run was begun with "
                f"{quote(kept[name])}; only --steps, --jobs and --episodes can change with --resume"
            )
    if new == kept:
        return run
    ppo = config.ppo
    # The last round of updates is complete.
    most = config.steps + ppo.n_envs * ppo.n_steps * config.ensemble_size
    trained = max((done_steps(path) for path in folder.glob(f"seed_*/{DONE}")), default=0)
    if trained >= most:
        raise RunError(
            f"{folder}: --steps is {config.steps}, but {trained} are trained already; give more, "
            "or omit it"
        )
    with lock_run(folder):  # seeds of another call read it too
        write_text(folder / CONFIG, to_yaml(config) + CONFIG_END)
    return dataclasses.replace(run, config=config)


def done_steps(path: Path) -> int:
    """Return the control steps of a seed that is done; 0 if it is not or ``path`` is damaged."""
    steps = read_json_object(path).get("steps")
    return steps if isinstance(steps, int) else 0


def is_seed_done(config: TrainConfig, folder: Path) -> bool:
    """Return whether the seed in ``folder`` has all control steps or met the target success."""
    steps = done_steps(folder / DONE)
    return steps >= config.steps or (
        steps > 0 and bool(read_json_object(folder / DONE).get("target_evaluation"))
    )


OPEN = ("steps", "jobs", "episodes")
"""Keys that may change when a run is resumed."""
CONFIG, SCENE, SUMMARY, DONE = "config.yaml", "scene.json", "summary.json", "done.json"
CONFIG_END = "...\n"
"""Last line of ``config.yaml``: without it the file may lack keys at its end."""
SCHEMA, SCHEMA_VERSION = "articulate.run", 2
"""Schema of ``scene.json``, for the complete run folder."""


def _read_config(path: Path) -> TrainConfig:
    """Read the complete configuration of a run."""
    content = read_yaml(path)
    if not path.read_text(encoding="utf-8").rstrip().endswith(CONFIG_END.rstrip()):
        raise RunError(f"{path}: the end is missing; train again")
    return from_mapping(TrainConfig, content, str(path))


def _by_key(prefix: str, config: Any) -> dict[str, Any]:
    """Return the values of nested configurations by dotted key."""
    out: dict[str, Any] = {}
    for f in dataclasses.fields(config):
        value = getattr(config, f.name)
        nested = dataclasses.is_dataclass(value)
        out |= _by_key(f"{prefix}{f.name}.", value) if nested else {prefix + f.name: value}
    return out


def open_run(folder: Path) -> Run:
    """Read a run folder.

    Raises:
        UsageError: It is not a run, holds links, is damaged or was made by another version.
    """
    path = folder / SCENE
    if not path.exists():
        reason = f"no {SCENE} in it" if folder.exists() else "it does not exist"
        if (folder / CONFIG).is_file():
            raise RunError(
                f"{folder}: holds several runs; to continue, repeat the command that began them, "
                "without --resume"
            )
        raise RunError(f"{folder}: not a run folder: {reason}; give a folder that train made")
    reject_links(folder)
    check_asset_files(folder / "asset")
    content = load_json_object(path, error=RunError)
    version = content.get("schema_version", 1)
    if content.get("schema", SCHEMA) != SCHEMA or version != SCHEMA_VERSION:
        raise RunError(
            f"{path}: schema version {quote(version)}, not {SCHEMA_VERSION}; this version cannot "
            f"read it: train again with train --asset ASSET{_task_flags(content)} --out NEW_RUN"
        )
    try:
        task = from_mapping(Task, content["task"], str(path))
        placement = from_mapping(ObjectPlacement, content["placement"], str(path))
        arm = from_mapping(Arm, content["arm"], str(path))
    except KeyError as error:
        raise RunError(f"{path}: {field_error(error)}; train again") from None
    except ConfigError as error:
        raise RunError(f"{error}; train again") from None
    return Run(
        folder=folder,
        config=_read_config(folder / CONFIG),
        asset=load_asset(folder / "asset"),
        task=task,
        placement=placement,
        arm=arm,
    )


def _task_flags(content: dict[str, Any]) -> str:
    """Return the flags of ``train`` for the task of a run of another version, if readable."""
    task = content.get("task")
    names = (task.get("name"), task.get("joint")) if isinstance(task, dict) else (None, None)
    pairs = zip(("--task", "--joint"), names, strict=True)
    return "".join(f" {flag} {shlex.quote(shorten(n))}" for flag, n in pairs if isinstance(n, str))


def write_scene(folder: Path, task: Task, placement: ObjectPlacement, arm: Arm) -> None:
    """Write ``scene.json``: task, object placement, limits and gains of the arm."""
    scene = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "task": dataclasses.asdict(task),
        "placement": placement.as_dict(),
        "arm": dataclasses.asdict(arm),
    }
    write_json(folder / SCENE, scene)


def load_scene(folder: Path) -> Scene:
    """Compile the scene of the run in ``folder``."""
    return open_run(folder).scene()


def write_summary(run: Run, results: list[dict[str, Any]], seconds: float) -> Path:
    """Write ``summary.json``: results of each seed after ``seconds`` of training."""
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
