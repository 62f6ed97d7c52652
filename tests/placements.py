"""Object placements of tests: the search, which takes seconds, runs once for equal inputs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from typing import Any

from filelock import FileLock

from articulate.assets.asset import Asset
from articulate.config import from_mapping
from articulate.errors import ReachError
from articulate.files import write_json
from articulate.robot.arm import Arm
from articulate.task.object_placement import ObjectPlacement
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task
from articulate_envs import placement_search

FOLDER = "ARTICULATE_TEST_RESULTS"
"""Variable with the folder of results, which the workers of a run of pytest share."""


def find_placement(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, **grasps: Any
) -> ObjectPlacement:
    """Return the result of :func:`articulate_envs.placement_search.find_placement`, from memory."""
    stages = placement_search.SEARCH_STAGES, placement_search.MAX_TRIES
    aim = task.joint, task.target, task.begin, task.far, task.closes
    ranges = config.scale, config.position_m, config.yaw_rad
    key = repr(
        (
            dataclasses.replace(asset, folder=Path()),
            aim,
            arm,
            ranges,
            stages,
            *sorted(grasps.items()),
        )
    )
    folder = Path(os.environ[FOLDER])
    folder.mkdir(exist_ok=True)
    file = folder / hashlib.sha256(key.encode()).hexdigest()
    with FileLock(file.with_suffix(".lock")):
        if not file.exists():
            try:
                placement = placement_search.find_placement(asset, task, arm, config, **grasps)
                write_json(file, dataclasses.asdict(placement))
            except ReachError as error:
                write_json(file, {"error": str(error)})
    content = json.loads(file.read_text(encoding="utf-8"))
    if "error" in content:
        raise ReachError(content["error"])
    return from_mapping(ObjectPlacement, content, "placement")
