"""Scenes of many objects for the generalist policy: prepared once, kept as lines of JSON.

Each line is a joint of an object that a task fits, with its placement and the success of the
scripted expert, or the reason of the rejection. A list is resumable: what it holds is not repeated.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from articulate.assets.asset import Asset
from articulate.cache import cache_folder
from articulate.config import from_mapping
from articulate.errors import ArticulateError, shorten
from articulate.library.procedural.library import ProceduralLibrary
from articulate.preparation.prepare import load_checked_asset
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.object_placement import ObjectPlacement
from articulate.task.task import make_task, matching_joints
from articulate_envs.feasibility import Feasibility, estimate_feasibility
from articulate_envs.joint_selection import GOOD_SUCCESS, choose_scene
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import Scene, build_scene
from articulate_train.config import TrainConfig

TASKS = ("open_drawer", "open_door", "open_lid")
CLOSING_TASKS = ("close_drawer", "close_door", "close_lid")
CATEGORIES = (
    "cabinet", "chest_of_drawers", "table_with_drawers", "box_with_lid", "microwave", "oven",
    "washing_machine", "safe", "fridge", "dishwasher", "toilet", "suitcase", "laptop", "trash_can",
)  # fmt: skip
"""Categories of the procedural library with drawers, doors or lids that the arm can reach."""
TARGETS = (0.8, 0.6, 0.45, 0.3)
"""Targets in order, as a share of the range."""
MAX_JOINTS = 2
"""Joints of an object for each task."""


@dataclass(frozen=True, kw_only=True)
class SceneRecord:
    """One joint of an object, and how it is placed."""

    object: str
    """Id of the object."""
    source: str
    """File of the object."""
    category: str
    task: str
    joint: str
    target_open: float | None = None
    """Target as a share of the range; None is the task's own."""
    placement: dict[str, Any] | None = None
    """Fields of the placement; None if the joint is rejected."""
    expert: float = 0.0
    """Success rate of the scripted expert."""
    reason: str = ""
    """Reason of the rejection, or the most frequent failure of the expert."""


def procedural_ids(seeds: Sequence[int]) -> list[str]:
    """Return the ids of all categories for each of ``seeds``, seed by seed."""
    return [f"{name}-{seed:04d}" for seed in seeds for name in CATEGORIES]


def write_procedural(object_id: str, folder: Path) -> Path:
    """Write an object of the procedural library below ``folder``, unless it is there."""
    found = sorted((folder / object_id).glob("*.urdf"))
    return found[0] if found else ProceduralLibrary(10**6).write(object_id, folder / object_id)


def records_of(
    object_id: str, source: Path, category: str, tasks: Sequence[str] = TASKS
) -> Iterator[SceneRecord]:
    """Yield the scenes of an object for ``tasks``, rejected ones with their reason."""
    common: dict[str, Any] = {"object": object_id, "source": str(source), "category": category}
    try:
        asset = load_checked_asset(source, cache_folder())
    except ArticulateError as error:
        yield SceneRecord(**common, task="", joint="", reason=shorten(str(error), 160))
        return
    for task in tasks:
        for joint in matching_joints(task, asset)[:MAX_JOINTS]:
            yield _record(asset, {**common, "task": task, "joint": joint.name})


def _record(asset: Asset, common: dict[str, Any]) -> SceneRecord:
    """Try the targets in order; the first with a capable expert counts, else the best."""
    best: SceneRecord | None = None
    reason = ""
    estimates: dict[int, Feasibility] = {}

    def rate(scene: Scene) -> float:
        estimates[id(scene)] = found = estimate_feasibility(scene, n_threads=1)
        return found.success

    for target_open in TARGETS:
        config = TrainConfig(
            asset=common["source"],
            task=common["task"],
            joint=common["joint"],
            target_open=target_open,
        )
        try:
            scene = choose_scene(config, asset, rate)
        except ArticulateError as error:
            reason = reason or shorten(str(error), 160)
            continue
        found = estimates[id(scene)]
        record = SceneRecord(
            **common,
            target_open=target_open,
            placement=scene.placement.as_dict(),
            expert=found.success,
            reason=found.dominant_failure or "",
        )
        if best is None or record.expert > best.expert:
            best = record
        if record.expert >= GOOD_SUCCESS:
            break
    return best or SceneRecord(**common, reason=reason)


def scene_of(record: SceneRecord, scales: tuple[float, ...]) -> Scene:
    """Compile the scene of an accepted record for ``scales``."""
    asset = load_checked_asset(Path(record.source), cache_folder())
    return build_scene(
        asset,
        make_task(record.task, asset, record.joint, target_open=record.target_open),
        arm=PANDA,
        control=ControlConfig(),
        physics=PhysicsConfig(),
        placement=from_mapping(ObjectPlacement, record.placement or {}, record.object),
        scales=scales,
    )


def read_records(path: Path) -> list[SceneRecord]:
    """Return the records of a list; none if it does not exist."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [SceneRecord(**json.loads(line)) for line in lines]


def prepare(
    items: Sequence[tuple[str, Path, str]], path: Path, tasks: Sequence[str] = TASKS
) -> None:
    """Append the records of ``items`` (id, file, category) that the list at ``path`` lacks."""
    done = {record.object for record in read_records(path)}
    for object_id, source, category in items:
        if object_id in done:
            continue
        lines = [json.dumps(vars(r)) + "\n" for r in records_of(object_id, source, category, tasks)]
        with path.open("a", encoding="utf-8") as stream:  # one write: an object is complete
            stream.write("".join(lines))
        print(f"{object_id}: {len(lines)} joints", flush=True)
