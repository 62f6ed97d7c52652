"""``deploy BUNDLE``: run a policy bundle on robots."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.commands.success import check_share, missed
from articulate.errors import ConfigError
from articulate_deploy.robots import ARMS

if TYPE_CHECKING:
    from articulate_deploy.episode import EpisodeResult


@dataclass(frozen=True, kw_only=True)
class DeployFlags:
    """Run a policy bundle on a robot and report how many episodes succeed.

    Several simulated robots run the same episodes and are compared with the first. Motions of a
    real arm are confirmed first. At a loopback address, a simulated arm with its network interface
    is started. Other forms: deploy inspect BUNDLE, deploy report FOLDER, deploy replay, deploy
    convert, deploy sign, deploy verify.

    Example: deploy cabinet.zip --robot panda --address 172.16.0.2 --speed-scale 0.2
    """

    bundle: Annotated[Path, POSITIONAL]
    """Folder or zip file from export-policy."""
    robot: tuple[str, ...] = ("mujoco",)
    """Names of robots: mujoco and pybullet, both simulated in this process; or one of panda, fr3
    and bridge."""
    address: str = ""
    """Address of a real arm's controller."""
    client: str = ""
    """Client of a real arm: panda-python or franka-rs for panda, pylibfranka or franka-rs for fr3;
    by default the first."""
    estimator: Path | None = None
    """Estimator file of a real arm: camera, markers, or the arm's kinematics. A simulated arm needs
    none."""
    placement: tuple[float | Path, ...] | None = None
    """Pose of the object before a real arm: x y [m], yaw [degrees] and optionally the height z of
    its floor [m]; or a file from `articulate locate`. By default that of the estimator file or of
    training."""
    speed_scale: float = 1.0
    """Speed of the policy's clock, in [0.05, 1]: 0.5 doubles the time of each control step."""
    tool_speed: float = 0.25
    """Largest speed of the tool on a real arm [m/s]."""
    workspace: tuple[float, ...] = (0.1, 0.9, -0.6, 0.6, -0.02, 1.0)
    """Box of the tool on a real arm: x, y and z, smallest and largest, base frame [m]."""
    yes: bool = False
    """Move a real arm without asking."""
    recover: bool = False
    """Clear a reflex of a real arm first; find its cause before."""
    homing: bool = False
    """Home the gripper of a real arm first."""
    episodes: int = 20
    """Number of episodes."""
    seed: int | None = None
    """Seed of the episode parameters; by default those in the bundle are used."""
    randomise: bool = True
    """Sample as in training, except for the object's size."""
    out: Path | None = None
    """Folder for recordings, new or empty; by default none are written."""
    require_success: float = 0.0
    """Exit with 3 if the success rate is below this share, in [0, 1]."""
    json: bool = False
    """Print only the report as JSON on standard output."""

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"--episodes is {self.episodes}; it must be at least 1")
        if not self.robot:
            raise ConfigError("--robot: a value is missing; give the name of a robot")
        if self.seed is not None and self.seed < 0:
            raise ConfigError(f"--seed is {self.seed}; it must be 0 or more")
        check_share(self.require_success)
        if len(self.workspace) != 6 or any(
            not low < high
            for low, high in zip(self.workspace[::2], self.workspace[1::2], strict=False)
        ):
            raise ConfigError(
                "--workspace needs six numbers: x, y and z, each smallest and largest [m]"
            )
        if not 0.0 < self.tool_speed <= 1.7:
            raise ConfigError(f"--tool-speed is {self.tool_speed}; it must be in (0, 1.7] m/s")
        arm = next((name for name in self.robot if name in ARMS), None)
        for name in ("address", "estimator", "placement"):
            if arm is None and getattr(self, name):
                raise ConfigError(f"--{name}: only for a real arm; name one: {', '.join(ARMS)}")
        if arm is not None and len(self.robot) > 1:
            raise ConfigError(f"--robot {arm}: name one robot only with a real arm")


FLAGS = DeployFlags
OTHERS = {
    "inspect": "articulate_deploy.commands.inspect:inspect",
    "sign": "articulate_deploy.commands.inspect:sign",
    "verify": "articulate_deploy.commands.inspect:verify",
    "report": "articulate_deploy.commands.recordings:report",
    "replay": "articulate_deploy.commands.recordings:replay",
    "convert": "articulate_deploy.commands.recordings:convert",
}
"""Other commands by their first word, ``module:function``."""


def main(argv: Sequence[str]) -> int:
    """Run the command; return 3 if the success rate is below the required one."""
    if argv and argv[0] in OTHERS:
        module, name = OTHERS[argv[0]].split(":")
        other: Callable[[Sequence[str]], int] = getattr(importlib.import_module(module), name)
        return other(argv[1:])
    flags = parse(DeployFlags, argv, prog="deploy")
    from articulate_deploy.deploy import deploy, transfer  # late: ONNX Runtime

    def progress(robot: str, index: int, result: EpisodeResult) -> None:
        opened = ""
        if math.isfinite(result.fraction):  # it is not where the simulation diverged
            opened = f", {max(result.fraction, 0.0):.0%} open"  # not "-0%" of a closed part
        console.show_progress(f"{robot} {index + 1}/{flags.episodes}: {result.reason}{opened}")

    if flags.robot[0] in ARMS:
        return _run_on_arm(flags, progress)
    if len(flags.robot) > 1:
        both = transfer(
            flags.bundle,
            flags.robot,
            episodes=flags.episodes,
            seed=flags.seed,
            randomise=flags.randomise,
            speed_scale=flags.speed_scale,
            out=flags.out,
            on_episode=progress,
        )
        console.emit_json(both.as_dict()) if flags.json else console.emit(both.text())
        lowest = min(report.successes for report in both.reports)
        return missed(lowest / flags.episodes, flags.require_success)
    report = deploy(
        flags.bundle,
        robot=flags.robot[0],
        episodes=flags.episodes,
        seed=flags.seed,
        randomise=flags.randomise,
        speed_scale=flags.speed_scale,
        out=flags.out,
        on_episode=partial(progress, flags.robot[0]),
    )
    console.emit_json(report.as_dict()) if flags.json else console.emit(report.text())
    return missed(report.successes / len(report.results), flags.require_success)


def _run_on_arm(flags: DeployFlags, progress: Callable[[str, int, EpisodeResult], None]) -> int:
    """Run on a real arm; return 3 if the success rate is below the required one."""
    from articulate.task.floor_pose import parse_floor_pose  # late: NumPy
    from articulate_deploy.arm_deployment import ArmRequest, deploy_on_arm
    from articulate_deploy.plan import EpisodeRequest
    from articulate_deploy.safety import ToolLimits

    x0, x1, y0, y1, z0, z1 = flags.workspace
    request = ArmRequest(
        robot=flags.robot[0],
        address=flags.address,
        client=flags.client,
        estimator=flags.estimator,
        placement=None if flags.placement is None else parse_floor_pose(flags.placement),
        speed_scale=flags.speed_scale,
        tool_limits=ToolLimits(speed_m_s=flags.tool_speed, low_w=(x0, y0, z0), high_w=(x1, y1, z1)),
        yes=flags.yes,
        recover=flags.recover,
        homing=flags.homing,
    )
    report = deploy_on_arm(
        flags.bundle,
        request,
        EpisodeRequest(flags.episodes, flags.seed, flags.randomise, flags.speed_scale),
        out=flags.out,
        on_episode=partial(progress, flags.robot[0]),
        show=console.show_progress,
    )
    console.emit_json(report.as_dict()) if flags.json else console.emit(report.text())
    return missed(report.successes / len(report.results), flags.require_success)
