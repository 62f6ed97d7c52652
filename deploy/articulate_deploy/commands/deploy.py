"""``deploy BUNDLE``: run a bundle on a robot or a stand-in."""

from __future__ import annotations

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
    """Run a policy bundle on a robot and say how many episodes opened the part.

    Several robots run the same episodes, and are compared with the first.

    Example: deploy cabinet.zip --robot mujoco pybullet --episodes 200
    """

    bundle: Annotated[Path, POSITIONAL]
    """Folder or zip file that export-policy made."""
    robot: tuple[str, ...] = ("mujoco",)
    """Names of robots: mujoco and pybullet, stand-ins in this process."""
    episodes: int = 20
    """How many episodes."""
    seed: int | None = None
    """Decides all that is drawn; without it the draws that the bundle carries are taken."""
    randomise: bool = True
    """Draw as in training, the object's size aside."""
    out: Path | None = None
    """Folder for recordings, new or empty; none are kept without it."""
    require_success: float = 0.0
    """Exit with 3 if the success rate is below this share, in [0, 1]."""
    json: bool = False
    """Print the report as JSON and nothing else on standard output."""

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
    """Deploy and print; 3 if the success rate is below what was required."""
    flags = parse(DeployFlags, argv, prog="deploy")
    from articulate_deploy.deploy import deploy, transfer  # ONNX Runtime; --help does without

    def progress(robot: str, index: int, result: EpisodeResult) -> None:
        opened = max(result.fraction, 0.0)  # a part that is pressed shut is not "-0%" open
        console.say(f"{robot} {index + 1}/{flags.episodes}: {result.reason}, {opened:.0%} open")

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
