"""``deploy BUNDLE``: run a policy bundle on robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.commands.success import check_share, missed
from articulate.errors import ConfigError

if TYPE_CHECKING:
    from articulate_deploy.episode import EpisodeResult


@dataclass(frozen=True, kw_only=True)
class DeployFlags:
    """Run a policy bundle on a robot and report how many episodes succeed.

    Several robots run the same episodes and are compared with the first.

    Example: deploy cabinet.zip --robot mujoco pybullet --episodes 200
    """

    bundle: Annotated[Path, POSITIONAL]
    """Folder or zip file from export-policy."""
    robot: tuple[str, ...] = ("mujoco",)
    """Names of robots: mujoco and pybullet, both simulated in this process."""
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


FLAGS = DeployFlags


def main(argv: Sequence[str]) -> int:
    """Run the command; return 3 if the success rate is below the required one."""
    flags = parse(DeployFlags, argv, prog="deploy")
    from articulate_deploy.deploy import deploy, transfer  # late: ONNX Runtime

    def progress(robot: str, index: int, result: EpisodeResult) -> None:
        opened = ""
        if math.isfinite(result.fraction):  # it is not where the simulation diverged
            opened = f", {max(result.fraction, 0.0):.0%} open"  # not "-0%" of a closed part
        console.show_progress(f"{robot} {index + 1}/{flags.episodes}: {result.reason}{opened}")

    if len(flags.robot) > 1:
        both = transfer(
            flags.bundle,
            flags.robot,
            episodes=flags.episodes,
            seed=flags.seed,
            randomise=flags.randomise,
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
        out=flags.out,
        on_episode=partial(progress, flags.robot[0]),
    )
    console.emit_json(report.as_dict()) if flags.json else console.emit(report.text())
    return missed(report.successes / len(report.results), flags.require_success)
