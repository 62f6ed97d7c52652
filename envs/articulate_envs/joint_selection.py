"""Which joint a task is asked of, and where the object stands for it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import AssetError, ReachError
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task, make_task, matching_joints, no_joint_error
from articulate_envs.grasp_clearance import check_grasp
from articulate_envs.physics import PhysicsConfig
from articulate_envs.placement_search import ObjectPlacement, find_placement, handle_poses
from articulate_envs.scene import build_scene

HOME_HEIGHT_M = 0.78
"""Height of the tool over the robot's base at home [m]; handles are compared as if objects stood
on the robot's floor."""


class Wish(Protocol):
    """What of a configuration decides about joint and place."""

    @property
    def task(self) -> str:
        """What is asked."""

    @property
    def joint(self) -> str | None:
        """Joint of the asset; None: the reachable one with its handle nearest home height."""

    @property
    def randomization(self) -> RandomizationConfig:
        """Randomisation."""

    @property
    def control(self) -> ControlConfig:
        """Plant."""

    @property
    def physics(self) -> PhysicsConfig:
        """Physics."""


def choose_joint(config: Wish, asset: Asset) -> tuple[Task, ObjectPlacement]:
    """The task and place of the joint asked for, or of the best that can be reached.

    Where several joints match and none is named, the reachable one is taken whose handle is, over
    the object's floor, nearest the height of the hand's home.

    Raises:
        AssetError: No such joint, or none that matches the task.
        ReachError: None can be reached.
    """
    if config.joint is not None:
        if config.joint not in {joint.name for joint in asset.joints}:
            raise _unknown_joint(config, asset)
        return _reached(config, asset, config.joint)
    matching = matching_joints(config.task, asset)
    if not matching:
        raise no_joint_error(config.task, asset)
    found: list[tuple[float, Task, ObjectPlacement]] = []
    reasons: list[str] = []
    for joint in matching:
        if asset.handle_of(joint.name) is None:
            reasons.append(f"{joint.name} has no handle; add one to the object")
            continue
        try:
            task, place = _reached(config, asset, joint.name)
        except ReachError as error:
            reasons.append(str(error).removeprefix(f"{asset.name}: "))
            continue
        height = float(handle_poses(asset, joint.name, np.zeros(()))[2, 3])
        found.append((abs(height - HOME_HEIGHT_M), task, place))
    if not found:
        others = f"none of {len(reasons)} joints can be reached: " if len(reasons) > 1 else ""
        raise ReachError(f"{asset.name}: {others}{reasons[0]}")
    _, task, place = min(found, key=lambda item: (item[0], item[1].joint))
    return task, place


def _unknown_joint(config: Wish, asset: Asset) -> AssetError:
    names = [joint.name for joint in matching_joints(config.task, asset)]
    if not names:
        return no_joint_error(config.task, asset)
    return AssetError(
        f"{asset.name}: no joint {config.joint!r}; {config.task} matches: {', '.join(names)}"
    )


def _reached(config: Wish, asset: Asset, joint: str) -> tuple[Task, ObjectPlacement]:
    """Task and place of one joint; ReachError if it cannot be reached or held."""
    task = make_task(config.task, asset, joint)
    place = find_placement(asset, task, PANDA, config.randomization)
    scene = build_scene(
        asset, task, arm=PANDA, control=config.control, physics=config.physics, place=place
    )
    check_grasp(scene)
    return task, place
