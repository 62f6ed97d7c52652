"""Scenes over our small assets: a drawer and a door before the arm."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from tests.assets import make_box, make_cabinet, make_cupboard
from tests.placements import find_placement

from articulate.assets.asset import Asset
from articulate.robot.arm import PANDA, Arm
from articulate.robot.config import ControlConfig
from articulate.task.randomization import EpisodeParams
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import make_task
from articulate.transforms import Ints
from articulate_envs import placement_search
from articulate_envs.engine import Start
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import Scene, build_scene

DRAWS = dataclasses.replace(RandomizationConfig(), scales=3)
"""The shipped randomisation with few sizes, so that scenes compile quickly."""


def make_scene(
    asset: Asset,
    joint: str,
    *,
    verb: str = "open",
    arm: Arm = PANDA,
    draws: RandomizationConfig = DRAWS,
    episode_s: float = 1.0,
) -> Scene:
    """The scene in which ``joint`` of ``asset`` is to be moved, at the sizes of ``draws``."""
    task = make_task(f"{verb}_joint", asset, joint, episode_s=episode_s)
    return build_scene(
        asset,
        task,
        arm=arm,
        control=ControlConfig(),
        physics=PhysicsConfig(),
        placement=find_placement(asset, task, arm, draws),
        scales=draws.scale_values,
    )


def drawer_scene(folder: Path) -> Scene:
    """The upper drawer of a cabinet, in episodes of one second."""
    return make_scene(make_cabinet(folder), "drawer_2_slide")


def door_scene(folder: Path) -> Scene:
    """The door of a cupboard, in episodes of one second."""
    return make_scene(make_cupboard(folder, degrees=75.0), "door_hinge")  # found in seconds


def lid_scene(folder: Path, verb: str) -> Scene:
    """The lid of a box, in episodes of one second."""
    return make_scene(make_box(folder), "lid_hinge", verb=verb)


CLOSING_STAGES = {"drawer": 3, "door": 5, "lid": 2}
"""Stage of the search that finds the placement; the others take up to 40 s."""


def closing_scene(folder: Path, part: str) -> Scene:
    """A drawer, a door or a lid that is to be closed, in episodes of one second."""
    stage = CLOSING_STAGES[part]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            placement_search, "SEARCH_STAGES", placement_search.SEARCH_STAGES[stage : stage + 1]
        )
        if part == "lid":
            return lid_scene(folder, "close")
        asset = make_cabinet(folder) if part == "drawer" else make_cupboard(folder, degrees=70.0)
        joint = "drawer_2_slide" if part == "drawer" else "door_hinge"
        return make_scene(asset, joint, verb="close")


def rows_of(start: Start, rows: Ints) -> Start:
    """The rows ``rows`` (M,) of ``start``."""
    return Start(
        params=EpisodeParams(start.params.values[rows]),
        q=start.q[rows],
        opened=start.opened[rows],
        width=start.width[rows],
        closing=start.closing[rows],
        home=start.home[rows],
    )
