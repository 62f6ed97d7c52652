"""``deploy BUNDLE``: run a bundle on a robot or a stand-in."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from articulate.commands.flags import parse
from articulate_deploy.deploy import deploy
from articulate_deploy.episode import EpisodeResult


@dataclass(frozen=True)
class DeployFlags:
    """Run a policy bundle on a robot and say how many episodes opened the part."""

    bundle: tyro.conf.Positional[Path]
    """Folder or zip file that export-policy made."""
    robot: str = "mujoco"
    """Name of the robot: mujoco, a stand-in in this process."""
    episodes: int = 20
    """How many episodes."""
    seed: int = 0
    """Decides all that is drawn."""
    randomise: bool = True
    """Draw as in training, the object's size aside."""
    json: bool = False
    """Print the result as JSON."""
    out: Path | None = None
    """Folder for recordings; none are kept without it."""


def main(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    flags = parse(DeployFlags, argv, prog="deploy")

    def progress(index: int, result: EpisodeResult) -> None:
        line = f"episode {index + 1}/{flags.episodes}: {result.reason}, {result.fraction:.0%} open"
        print(line, file=sys.stderr)

    report = deploy(
        flags.bundle,
        robot=flags.robot,
        episodes=flags.episodes,
        seed=flags.seed,
        randomise=flags.randomise,
        out=flags.out,
        on_episode=progress,
    )
    print(json.dumps(report.as_dict(), indent=1) if flags.json else report.text())
    return 0
