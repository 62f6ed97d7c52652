"""The same policy on the same draws at finer physics steps: does it live on the step's quirks?

python benchmarks/finer.py runs/cabinet --seed 0 --episodes 300 --timesteps-ms 2.5 1

A row a step, that of the run first: success as it is judged, reasons of the failures, and how
many episodes end otherwise than with the run's own step.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from articulate.task.episode_monitor import REASONS
from articulate_train.evaluate import run_episodes
from articulate_train.policy import load_policy
from articulate_train.run import open_run
from policy_flags import policy_parser


def rows(
    folder: Path,
    seed: int,
    *,
    episodes: int,
    draws: int,
    timesteps_s: list[float],
    ranges: float = 1.0,
    threads: int = 2,
) -> list[dict[str, Any]]:
    """What a policy does at the run's own physics step and at each of ``timesteps_s``.

    Args:
        folder: Run.
        seed: Which of its policies.
        episodes: Drawn episodes from home.
        draws: Seed of what is drawn.
        timesteps_s: Physics steps [s]; a tick must hold a whole number of them.
        ranges: So many times as wide is every range of the randomisation.
        threads: Threads of the engine.

    Raises:
        ConfigError: A step does not fit into a tick.
    """
    run = open_run(folder).widened(ranges)
    policy, own, out = load_policy(run.seed_folder(seed)), None, []
    for step_s in [run.config.physics.timestep_s, *timesteps_s]:
        physics = replace(run.config.physics, timestep_s=step_s)
        physics.substeps(run.config.follow.tick_s)
        scene = replace(run, config=replace(run.config, physics=physics)).scene()
        ended, _ = run_episodes(
            scene,
            policy,
            run.config.draw,
            np.random.SeedSequence(draws),
            episodes=episodes,
            threads=threads,
        )
        own = ended.code if own is None else own
        out.append(
            {
                "timestep_ms": round(1e3 * step_s, 4),
                "success": round(float((ended.code == 0).mean()), 4),
                "reasons": dict(Counter(REASONS[int(k)] for k in ended.code if k)),
                "other_end": int(((ended.code == 0) != (own == 0)).sum()),
            }
        )
    return out


def line(row: dict[str, Any]) -> str:
    """A row as people read it."""
    told = ", ".join(f"{name} {count}" for name, count in row["reasons"].items()) or "none fails"
    return (
        f"{row['timestep_ms']:5g} ms  success {100 * row['success']:5.1f} %  ({told})  "
        f"{row['other_end']} end otherwise"
    )


def main() -> int:
    """Print the rows."""
    parser = policy_parser(__doc__, episodes=300)
    parser.add_argument("--timesteps-ms", type=float, nargs="+", default=[2.5, 1.0])
    flags = parser.parse_args()
    torch.set_num_threads(1)
    found = rows(
        flags.run,
        flags.seed,
        episodes=flags.episodes,
        draws=flags.draws,
        timesteps_s=[1e-3 * step for step in flags.timesteps_ms],
        ranges=flags.ranges,
    )
    if flags.json:
        print(json.dumps({"episodes": flags.episodes, "rows": found}, indent=1))
        return 0
    for row in found:
        print(line(row))
    return 0


if __name__ == "__main__":
    sys.exit(main())
