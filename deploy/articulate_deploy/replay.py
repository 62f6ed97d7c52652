"""Replay of a recorded episode: its targets on the simulated robot of the same bundle."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import ConfigError, UsageError
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate_deploy.bundle import load_bundle
from articulate_deploy.policy_control import PolicyController
from articulate_deploy.recorded_episodes import RecordedDeployment
from articulate_deploy.report import bundle_sha256
from articulate_deploy.robots import robot_named
from articulate_deploy.robots.robot import action_dict, read_keys


@dataclass(frozen=True)
class Replay:
    """Difference between a recording and its replay."""

    episode: int
    robot: str
    steps: int
    joint_rms_rad: float
    """Root mean square of the difference of joint angles [rad]."""
    joint_max_rad: float
    """Largest difference of a joint angle [rad]."""
    opened_recorded: float
    """Fraction open at the end of the recording."""
    opened_replayed: float
    """Fraction open at the end of the replay."""

    def as_dict(self) -> dict[str, Any]:
        """Return the result as a JSON object."""
        return asdict(self)

    def text(self) -> str:
        """Return the result as text."""
        return (
            f"episode {self.episode} on {self.robot}, {self.steps} control steps\n"
            f"  joints   {self.joint_rms_rad:.4f} rad rms, {self.joint_max_rad:.4f} rad at most\n"
            f"  opened   {self.opened_recorded:.0%} recorded, {self.opened_replayed:.0%} replayed"
        )


def replay_episode(
    deployment: RecordedDeployment, bundle: Path, index: int, *, robot: str = "mujoco"
) -> Replay:
    """Send the recorded targets of episode ``index`` to a simulated robot.

    Args:
        deployment: Recording.
        bundle: The bundle that was recorded.
        index: Number of the episode.
        robot: Name of the simulated robot.

    Raises:
        ConfigError: The bundle is another one.
        UsageError: The episode did not end, so that its parameters are not known.
    """
    loaded, episode = load_bundle(bundle), deployment.episode(index)
    manifest, arrays = loaded.manifest, episode.arrays
    recorded = deployment.report.get("bundle_sha256", "")
    if recorded and recorded != bundle_sha256(manifest):
        raise ConfigError(f"{bundle}: not the bundle of {deployment.folder}")
    params = episode.result.get("episode_params")
    if (
        not isinstance(params, dict)
        or set(params) != set(COLUMNS)
        or not all(isinstance(value, (int, float)) for value in params.values())
        or "part_open" not in arrays
    ):
        raise UsageError(
            f"{deployment.folder}: episode {index} did not end, or is of another version"
        )
    values = np.array([[params[name] for name in COLUMNS]], dtype=np.float64)
    simulated = robot_named(robot, loaded)
    controller = PolicyController(manifest, arrays["joint_pos"][0])
    joints = []
    with simulated:
        simulated.set_episode_params(EpisodeParams(values))
        simulated.reset_to(arrays["joint_pos"][0], manifest.start.gripper_width_m)
        for k, target in enumerate(arrays["target"]):
            joints.append(read_keys(simulated.get_observation()))
            _, opening = controller.step(
                arrays["action"][k],
                q=arrays["joint_pos"][k],
                width_m=float(arrays["gripper_width_m"][k]),
                force=np.zeros(3),
            )
            simulated.send_action(action_dict(target, opening))
        opened = float(simulated.object_state().opened[0])
    error = np.array(joints) - arrays["joint_pos"]
    return Replay(
        episode=index,
        robot=robot,
        steps=len(error),
        joint_rms_rad=float(np.sqrt(np.mean(error**2))),
        joint_max_rad=float(np.abs(error).max()),
        opened_recorded=float(arrays["part_open"][-1]),
        opened_replayed=opened,
    )
