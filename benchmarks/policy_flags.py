"""Flags of the commands that run a policy of a run folder again and look closer at what it does."""

from __future__ import annotations

import argparse
from pathlib import Path


def policy_parser(description: str | None, *, episodes: int) -> argparse.ArgumentParser:
    """Parser of ``run``, ``--seed``, ``--episodes``, ``--draws``, ``--ranges`` and ``--json``.

    Args:
        description: What the command does.
        episodes: So many episodes unless told.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--seed", type=int, default=0, help="policy of the run")
    parser.add_argument("--episodes", type=int, default=episodes)
    parser.add_argument("--draws", type=int, default=77, help="seed of what is drawn")
    parser.add_argument("--ranges", type=float, default=1.0, help="as wide as --ranges of evaluate")
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    return parser
