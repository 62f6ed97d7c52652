"""Speed of the batched engine with many scenes in one batch.

    python benchmarks/many_scenes.py --scenes scenes.jsonl --json

``ratio`` is the rate of ``--envs`` environments that have different scenes over the rate of as many
environments that all have one scene, as the harmonic mean over those scenes, on one thread. Scenes
take different times to simulate, so a single one of them is no fair comparison. Both sides run the
same random motions from home in alternating blocks.
"""

# ruff: noqa: E402 - the environment comes before numpy
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import harmonic_mean, median

import numpy as np

from articulate.task.randomization import sample_episode_params
from articulate.task.randomization_config import RandomizationConfig
from articulate_envs.initial_states import concatenate_starts, home_start
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine
from generalist_scenes import read_records, scene_of

REQUIRED = 0.8
"""Required ratio."""


def engine_of(scenes: Sequence[Scene], n_envs: int) -> ThreadEngine:
    """Return an engine whose environments are at home."""
    engine = ThreadEngine(scenes, n_envs)
    rng = np.random.default_rng(0)
    starts = []
    for k, scene in enumerate(scenes):
        n = int((engine.scene_of == k).sum())
        params = sample_episode_params(RandomizationConfig(scale=(1.0, 1.0), scales=1), rng, n)
        starts.append(home_start(scene, params))
    rows = np.arange(n_envs)
    engine.reset(rows, concatenate_starts(starts, rows))
    return engine


def rate(engine: ThreadEngine, steps: int) -> float:
    """Return the control steps of all environments per second over ``steps`` control steps."""
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (steps, engine.n_envs, 8))
    begin = time.perf_counter()
    for action in actions:
        engine.step(action)
    return engine.n_envs * steps / (time.perf_counter() - begin)


def main(argv: Sequence[str]) -> int:
    """Measure and print; 3 if the required ratio is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=Path, required=True, help="list of scenes")
    parser.add_argument("--envs", type=int, default=64, help="number of environments")
    parser.add_argument("--steps", type=int, default=10, help="control steps of a block")
    parser.add_argument("--rounds", type=int, default=3, help="blocks of each side")
    parser.add_argument("--json", action="store_true", help="print the complete result as JSON")
    args = parser.parse_args(argv)
    records = [r for r in read_records(args.scenes) if r.placement][: args.envs]
    scenes = [scene_of(record, (1.0,)) for record in records]
    mixed = engine_of(scenes, args.envs)
    rate(mixed, 2)
    ratios, mixed_rates, equal_rates = [], [], []
    for _ in range(args.rounds):
        equal = []
        many = []
        for k, scene in enumerate(scenes):
            one = engine_of([scene], args.envs)
            equal.append(rate(one, args.steps))
            one.close()
            if k % 4 == 0:
                many.append(rate(mixed, args.steps))
        mixed_rates.append(harmonic_mean(many))
        equal_rates.append(harmonic_mean(equal))
        ratios.append(mixed_rates[-1] / equal_rates[-1])
    out = {
        "scenes": len(scenes),
        "envs": args.envs,
        "steps_per_s_mixed": round(median(mixed_rates)),
        "steps_per_s_equal": round(median(equal_rates)),
        "ratio": round(median(ratios), 3),
        "ratios": [round(ratio, 3) for ratio in ratios],
        "required": REQUIRED,
        "processor": platform.processor() or platform.machine(),
        "load": os.getloadavg()[0],
    }
    print(json.dumps(out) if args.json else "\n".join(f"{k}: {v}" for k, v in out.items()))
    return 0 if median(ratios) >= REQUIRED else 3


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
