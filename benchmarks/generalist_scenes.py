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
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import make_task, matching_joints
from articulate_envs.feasibility import estimate_feasibility
from articulate_envs.grasp_clearance import check_grasp
from articulate_envs.physics import PhysicsConfig
from articulate_envs.placement_search import find_placement
from articulate_envs.scene import Scene, build_scene

TASKS = ("open_drawer", "open_door", "open_lid")
CATEGORIES = (
    "cabinet", "chest_of_drawers", "table_with_drawers", "box_with_lid", "microwave", "oven",
    "washing_machine", "safe",
)  # fmt: skip
"""Categories of the procedural library with drawers, doors or lids that the arm can reach."""
MAX_JOINTS = 2
"""Joints of an object for each task."""
EXPERT_EPISODES = 16
"""Episodes of the scripted expert on each scene."""


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


def records_of(object_id: str, source: Path, category: str) -> Iterator[SceneRecord]:
    """Yield the scenes of an object, rejected ones with their reason."""
    common: dict[str, Any] = {"object": object_id, "source": str(source), "category": category}
    try:
        asset = load_checked_asset(source, cache_folder())
    except ArticulateError as error:
        yield SceneRecord(**common, task="", joint="", reason=shorten(str(error), 160))
        return
    for task in TASKS:
        for joint in matching_joints(task, asset)[:MAX_JOINTS]:
            yield _record(asset, {**common, "task": task, "joint": joint.name})


def _record(asset: Asset, common: dict[str, Any]) -> SceneRecord:
    task = make_task(common["task"], asset, common["joint"])
    randomization = RandomizationConfig()
    try:
        placement = find_placement(asset, task, PANDA, randomization)
        scene = _scene(asset, common, placement, (1.0,))
        check_grasp(scene)
        found = estimate_feasibility(scene, n_episodes=EXPERT_EPISODES, n_threads=1)
    except ArticulateError as error:
        return SceneRecord(**common, reason=shorten(str(error), 160))
    return SceneRecord(
        **common,
        placement=placement.as_dict(),
        expert=found.success,
        reason=found.dominant_failure or "",
    )


def _scene(
    asset: Asset, common: dict[str, Any], placement: ObjectPlacement, scales: tuple[float, ...]
) -> Scene:
    return build_scene(
        asset,
        make_task(common["task"], asset, common["joint"]),
        arm=PANDA,
        control=ControlConfig(),
        physics=PhysicsConfig(),
        placement=placement,
        scales=scales,
    )


def scene_of(record: SceneRecord, scales: tuple[float, ...]) -> Scene:
    """Compile the scene of an accepted record for ``scales``."""
    asset = load_checked_asset(Path(record.source), cache_folder())
    placement = from_mapping(ObjectPlacement, record.placement or {}, record.object)
    return _scene(asset, {"task": record.task, "joint": record.joint}, placement, scales)


def read_records(path: Path) -> list[SceneRecord]:
    """Return the records of a list; none if it does not exist."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [SceneRecord(**json.loads(line)) for line in lines]


def prepare(items: Sequence[tuple[str, Path, str]], path: Path) -> None:
    """Append the records of ``items`` (id, file, category) that the list at ``path`` lacks."""
    done = {record.object for record in read_records(path)}
    for object_id, source, category in items:
        if object_id in done:
            continue
        lines = [json.dumps(vars(r)) + "\n" for r in records_of(object_id, source, category)]
        with path.open("a", encoding="utf-8") as stream:  # one write: an object is complete
            stream.write("".join(lines))
        print(f"{object_id}: {len(lines)} joints", flush=True)
