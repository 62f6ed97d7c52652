"""Selection of the joint of a task and of the object placement for it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import AssetError, ReachError
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.object_placement import ObjectPlacement, handle_poses
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task, make_task, matching_joints, no_joint_error
from articulate_envs.grasp_clearance import check_grasp
from articulate_envs.physics import PhysicsConfig
from articulate_envs.placement_search import find_placement
from articulate_envs.scene import build_scene

HOME_HEIGHT_M = 0.78
"""Height of the tool over the robot's base at home [m]; handles are compared to it as if objects
were on the robot's floor."""


class JointSelectionConfig(Protocol):
    """Part of a configuration that determines joint and placement."""

    @property
    def task(self) -> str:
        """Name of the task."""

    @property
    def joint(self) -> str | None:
        """Joint of the asset; None: the reachable one with its handle nearest home height."""

    @property
    def randomization(self) -> RandomizationConfig:
        """Randomization of placement and size."""

    @property
    def control(self) -> ControlConfig:
        """Control stack."""

    @property
    def physics(self) -> PhysicsConfig:
        """Physics settings."""


def choose_joint(config: JointSelectionConfig, asset: Asset) -> tuple[Task, ObjectPlacement]:
    """Return the task and the placement of the configured joint, or of the best reachable one.

    If several joints match and none is configured, the reachable joint is selected whose handle
    over the object's floor is nearest to the height of the gripper at home.

    Raises:
        AssetError: The joint does not exist, or none matches the task.
        ReachError: None is reachable.
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
            task, placement = _reached(config, asset, joint.name)
        except ReachError as error:
            reasons.append(str(error).removeprefix(f"{asset.name}: "))
            continue
        height = float(handle_poses(asset, joint.name, np.zeros(()))[2, 3])
        found.append((abs(height - HOME_HEIGHT_M), task, placement))
    if not found:
        others = f"none of {len(reasons)} joints can be reached: " if len(reasons) > 1 else ""
        raise ReachError(f"{asset.name}: {others}{reasons[0]}")
    _, task, placement = min(found, key=lambda item: (item[0], item[1].joint))
    return task, placement


def _unknown_joint(config: JointSelectionConfig, asset: Asset) -> AssetError:
    names = [joint.name for joint in matching_joints(config.task, asset)]
    if not names:
        return no_joint_error(config.task, asset)
    return AssetError(
        f"{asset.name}: no joint {config.joint!r}; {config.task} matches: {', '.join(names)}"
    )


def _reached(
    config: JointSelectionConfig, asset: Asset, joint: str
) -> tuple[Task, ObjectPlacement]:
    """Return task and placement of one joint; ReachError if it cannot be reached or grasped."""
    task = make_task(config.task, asset, joint)
    placement = find_placement(asset, task, PANDA, config.randomization)
    scene = build_scene(
        asset, task, arm=PANDA, control=config.control, physics=config.physics, placement=placement
    )
    check_grasp(scene)
    return task, placement
