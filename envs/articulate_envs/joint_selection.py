"""Selection of the joint of a task and of the object placement for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from articulate.assets.asset import Asset, Handle
from articulate.errors import AssetError, PathError, ReachError
from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.task.floor_pose import parse_floor_pose
from articulate.task.object_placement import ObjectPlacement, handle_poses
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task, closes, make_task, matching_joints, no_joint_error
from articulate_envs.grasp_clearance import check_grasp, shift_beside
from articulate_envs.handle_candidates import handle_candidates
from articulate_envs.physics import PhysicsConfig
from articulate_envs.placement_at import describe_nearest, placement_at
from articulate_envs.placement_search import find_placement
from articulate_envs.scene import Scene, build_scene

SMALLER_TARGETS = (None, 0.6, 0.45, 0.3)
"""Targets in order, as a share of the range; None is the task's own."""
GOOD_SUCCESS = 0.8
"""Success rate of the scripted expert from which no other joint, handle or target is tried."""
SURE_SUCCESS = 0.9
"""Success rate of the scripted expert from which no other grasp of the handle is tried."""
FURTHER_TILTS_RAD = (-0.3, 0.3)
"""Further tilts of the grasp that are tried [rad]."""
FURTHER_DEPTHS_M = (0.004, 0.008)
"""Further depths of the grasp that are tried [m]."""
FAIR_SUCCESS = 0.5
"""Success rate of the scripted expert from which no smaller target is tried."""
MAX_RATED = 6
"""Most joints, handles and targets that are rated."""
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
    def target_open(self) -> float | None:
        """Share of the joint's range at which the part counts as open; None: 0.8, or less."""

    @property
    def placement(self) -> tuple[float | Path, ...] | None:
        """Pose of the object that the user gives; None: a search chooses it."""

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
    """Return task and placement of :func:`choose_scene`."""
    scene = choose_scene(config, asset)
    return scene.task, scene.placement


def choose_scene(
    config: JointSelectionConfig, asset: Asset, rate: Callable[[Scene], float] | None = None
) -> Scene:
    """Return the scene of the configured joint, or of the best reachable one.

    If several joints match and none is configured, the reachable joint is selected whose handle
    over the object's floor is nearest to the height of the gripper at home. Of each joint the
    object's own handle comes first, then other places to hold. Where the target is out of reach,
    it is the largest of :data:`SMALLER_TARGETS` that is reachable.

    Args:
        config: Task, randomization and physics.
        asset: Object.
        rate: Function that returns the success rate of a scene, in [0, 1]. The search of joint,
            handle and target ends with the first that reaches :data:`GOOD_SUCCESS`; below
            :data:`SURE_SUCCESS` other grasps of the best are rated. Without ``rate`` the first
            scene is returned.

    Raises:
        AssetError: The joint does not exist, or none matches the task.
        ReachError: None is reachable.
    """
    search = _Search(config, asset)
    targets = SMALLER_TARGETS if config.target_open is None else (config.target_open,)
    if rate is None:
        for target_open in targets:
            for scene in search.scenes(target_open):
                return scene
        raise search.failure()
    best, n_left = _Best(rate), MAX_RATED
    for target_open in targets:
        before = best.scene
        for scene in search.scenes(target_open):
            best.rate(scene)
            n_left -= 1
            if best.success >= GOOD_SUCCESS or n_left == 0:
                break
        if best.scene is not before:
            _try_other_grasps(config, asset, best)
        if best.success >= FAIR_SUCCESS or n_left == 0:
            break
    if best.scene is None:
        raise search.failure()
    return best.scene


class _Best:
    """Scene with the highest success rate so far."""

    def __init__(self, rate: Callable[[Scene], float]) -> None:
        self._rate = rate
        self.scene: Scene | None = None
        self.success = -1.0

    def rate(self, scene: Scene) -> None:
        """Rate a scene."""
        success = self._rate(scene)
        if success > self.success:
            self.scene, self.success = scene, success


def _try_other_grasps(config: JointSelectionConfig, asset: Asset, best: _Best) -> None:
    """Rate the best scene with the gripper turned or tilted, then with a deeper grasp."""
    for grasps in (_turned, _deeper):
        if best.scene is None or not 0.0 < best.success < SURE_SUCCESS:
            return
        for scene in grasps(config, asset, best.scene):
            best.rate(scene)
            if best.success >= SURE_SUCCESS:
                return


def _turned(config: JointSelectionConfig, asset: Asset, scene: Scene) -> Iterator[Scene]:
    """Yield scenes with the gripper turned by 180 degrees, or tilted further."""
    now = scene.placement
    if config.placement is not None:
        return
    held = asset if now.handle is None else asset.with_handle(now.handle)
    grasps = [
        (not now.flip, now.tilt_rad),
        *((now.flip, now.tilt_rad + t) for t in FURTHER_TILTS_RAD),
    ]
    for flip, tilt_rad in grasps:
        try:
            found = find_placement(
                held, scene.task, PANDA, config.randomization, flips=(flip,), tilts_rad=(tilt_rad,)
            )
            yield from _graspable(config, asset, scene.task, replace(found, handle=now.handle))
        except ReachError:
            continue


def _deeper(config: JointSelectionConfig, asset: Asset, scene: Scene) -> Iterator[Scene]:
    """Yield scenes in which the fingers hold the handle deeper."""
    handle = scene.asset.handle_of(scene.task.joint)
    if handle is None or handle.shut:
        return
    for deeper_m in FURTHER_DEPTHS_M:
        placement = replace(scene.placement, deeper_m=deeper_m)
        yield _build(config, asset, scene.task, placement, config.randomization.scale_values)


class _Search:
    """Reachable scenes of one target after the other."""

    def __init__(self, config: JointSelectionConfig, asset: Asset) -> None:
        """Find the joints; handles are searched when they are needed."""
        self._config, self._asset = config, asset
        self._handles: dict[str, Iterable[Handle]] = {
            joint: handle_candidates(asset, joint, closes=closes(config.task))
            for joint in _joints(config, asset)
        }
        self._reasons: dict[str, str] = {}

    def scenes(self, target_open: float | None) -> Iterator[Scene]:
        """Yield the scenes of all joints and handles for a target.

        The next target tries the handles again that were held but could not be followed so far.
        """
        later: dict[str, Iterable[Handle]] = {}
        for joint, candidates in self._handles.items():
            task = make_task(self._config.task, self._asset, joint, target_open=target_open)
            followable: list[Handle] = []
            later[joint] = followable
            for handle in candidates:
                try:
                    scenes = list(_reached(self._config, self._asset, task, handle))
                except ReachError as error:
                    reason = str(error).removeprefix(f"{self._asset.name}: ")
                    self._reasons.setdefault(joint, reason)
                    if isinstance(error, PathError):
                        followable.append(handle)
                    continue
                followable.append(handle)
                yield from scenes
        self._handles = later

    def failure(self) -> ReachError:
        """Return the error for a search that found nothing."""
        joints = list(self._handles)
        failure = _unreachable(self._asset, joints, self._reasons)
        if self._config.placement is None or self._asset.handle_of(joints[0]) is None:
            return failure
        target_open = self._config.target_open
        task = make_task(self._config.task, self._asset, joints[0], target_open=target_open)
        return ReachError(f"{failure}; {_describe_nearest(self._config, self._asset, task)}")


def _describe_nearest(config: JointSelectionConfig, asset: Asset, task: Task) -> str:
    """Return the motion of the object from its given placement to the nearest reachable one."""
    assert config.placement is not None
    at = parse_floor_pose(config.placement)
    return describe_nearest(asset, task, PANDA, config.randomization, at)


def _unreachable(asset: Asset, joints: list[str], reasons: dict[str, str]) -> ReachError:
    others = f"none of {len(joints)} joints can be reached: " if len(joints) > 1 else ""
    first = joints[0]
    reason = reasons.get(first, f"{first} has no handle; add one to the object")
    return ReachError(f"{asset.name}: {others}{reason}")


def _joints(config: JointSelectionConfig, asset: Asset) -> list[str]:
    """Return the joints to try, the one whose handle is nearest to home height first."""
    if config.joint is not None:
        if config.joint not in {joint.name for joint in asset.joints}:
            raise _unknown_joint(config, asset)
        return [config.joint]
    matching = [joint.name for joint in matching_joints(config.task, asset)]
    if not matching:
        raise no_joint_error(config.task, asset)

    def distance(joint: str) -> tuple[float, str]:
        if asset.handle_of(joint) is None:
            return np.inf, joint
        height = float(handle_poses(asset, joint, np.zeros(()))[2, 3])
        return abs(height - HOME_HEIGHT_M), joint

    return sorted(matching, key=distance)


def _unknown_joint(config: JointSelectionConfig, asset: Asset) -> AssetError:
    names = [joint.name for joint in matching_joints(config.task, asset)]
    if not names:
        return no_joint_error(config.task, asset)
    return AssetError(
        f"{asset.name}: no joint {config.joint!r}; {config.task} matches: {', '.join(names)}"
    )


def _reached(
    config: JointSelectionConfig, asset: Asset, task: Task, handle: Handle
) -> Iterator[Scene]:
    """Yield the scenes of one handle.

    Raises:
        ReachError: It cannot be reached or grasped.
    """
    held = asset.with_handle(handle)
    if config.placement is None:
        placement = find_placement(held, task, PANDA, config.randomization)
    else:
        at = parse_floor_pose(config.placement)
        placement = placement_at(held, task, PANDA, config.randomization, at, with_nearest=False)
    if handle != asset.handle_of(task.joint):
        placement = replace(placement, handle=handle)
    yield from _graspable(config, asset, task, placement)


def _graspable(
    config: JointSelectionConfig, asset: Asset, task: Task, placement: ObjectPlacement
) -> Iterator[Scene]:
    """Yield scenes of one placement: held beside the handle's middle if needed, then at it.

    Raises:
        ReachError: It cannot be grasped.
    """
    build = partial(_build, config, asset, task)
    scene, scales = build(placement), config.randomization.scale_values
    if beside_m := shift_beside(scene):
        beside = replace(placement, beside_m=beside_m)
        check_grasp(build(beside))
        yield build(beside, scales)
    try:
        check_grasp(scene)
    except ReachError:
        if beside_m == 0.0:
            raise
        return
    yield scene if scales == (1.0,) else build(placement, scales)


def _build(
    config: JointSelectionConfig,
    asset: Asset,
    task: Task,
    placement: ObjectPlacement,
    scales: tuple[float, ...] = (1.0,),
) -> Scene:
    """Compile the scene of one placement for ``scales``."""
    return build_scene(
        asset,
        task,
        arm=PANDA,
        control=config.control,
        physics=config.physics,
        placement=placement,
        scales=scales,
    )
