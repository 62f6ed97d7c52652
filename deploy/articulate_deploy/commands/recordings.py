"""``deploy report``, ``deploy replay`` and ``deploy convert``: use a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ReportFlags:
    """Report success, tracking, timing, force and estimates of a recording.

    Example: deploy report recordings/arm --against recordings/mujoco
    """

    recording: Annotated[Path, POSITIONAL]
    """Folder of deploy --out."""
    against: Path | None = None
    """Recording of the same bundle in simulation, for comparison."""
    json: bool = False
    """Print only the report as JSON on standard output."""


@dataclass(frozen=True, kw_only=True)
class ReplayFlags:
    """Send the recorded targets of an episode to the simulated robot and compare.

    Example: deploy replay recordings/arm cabinet.zip --episode 3
    """

    recording: Annotated[Path, POSITIONAL]
    """Folder of deploy --out."""
    bundle: Annotated[Path, POSITIONAL]
    """Bundle that was recorded."""
    episode: int = 0
    """Number of the episode."""
    robot: str = "mujoco"
    """Simulated robot: mujoco or pybullet."""
    json: bool = False
    """Print only the result as JSON on standard output."""

    def __post_init__(self) -> None:
        if self.episode < 0:
            raise ConfigError(f"--episode is {self.episode}; it must be 0 or more")


@dataclass(frozen=True, kw_only=True)
class ConvertFlags:
    """Convert a recording: a LeRobot dataset v3.0 or a file for rerun.

    Example: deploy convert recordings/arm --to lerobot --out datasets/arm
    """

    recording: Annotated[Path, POSITIONAL]
    """Folder of deploy --out."""
    to: Literal["lerobot", "rerun"] = "lerobot"
    """Format."""
    out: Path
    """New folder of the dataset, or a file that ends in .rrd."""
    task: str = ""
    """Description of the task for LeRobot; by default the task's name."""


def report(argv: Sequence[str]) -> int:
    """Run ``deploy report``."""
    flags = parse(ReportFlags, argv, prog="deploy report")
    from articulate_deploy.comparison import DeploymentComparison
    from articulate_deploy.recorded_episodes import read_deployment

    other = None if flags.against is None else read_deployment(flags.against)
    found = DeploymentComparison(read_deployment(flags.recording), other)
    console.emit_json(found.as_dict()) if flags.json else console.emit(found.text())
    return 0


def replay(argv: Sequence[str]) -> int:
    """Run ``deploy replay``."""
    flags = parse(ReplayFlags, argv, prog="deploy replay")
    from articulate_deploy.recorded_episodes import read_deployment
    from articulate_deploy.replay import replay_episode

    found = replay_episode(
        read_deployment(flags.recording), flags.bundle, flags.episode, robot=flags.robot
    )
    console.emit_json(found.as_dict()) if flags.json else console.emit(found.text())
    return 0


def convert(argv: Sequence[str]) -> int:
    """Run ``deploy convert``."""
    flags = parse(ConvertFlags, argv, prog="deploy convert")
    from articulate_deploy.recorded_episodes import read_deployment

    deployment = read_deployment(flags.recording)
    if flags.to == "rerun":
        from articulate_deploy.rerun_episodes import write_rerun

        console.emit(str(write_rerun(deployment, flags.out)))
        return 0
    from articulate_deploy.lerobot_dataset import write_lerobot_dataset

    task = flags.task or str(deployment.report.get("task", "open"))
    console.emit(str(write_lerobot_dataset(deployment, flags.out, task=task)))
    return 0
