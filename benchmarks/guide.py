"""How far the guide comes on objects: what the plant allows, before anything is learnt.

python benchmarks/guide.py open_door=data/assets/partnet/7119/mobility.urdf --episodes 64
python benchmarks/guide.py close_drawer=cabinet.urdf --follow lead_rad=0.25 --json

The guide sees everything as it is, so that what it cannot do in the time of an episode is bounded
by arm, follower and object, not by training. A row an object: success as it is judged, reasons of
the failures, ticks until the part was at its target, and the largest force [N].
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate.robot.config import ControlConfig
from articulate.task.episode_monitor import REASONS
from articulate.task.task import beyond_target
from articulate.transforms import Array
from articulate_envs.episodes import Tick
from articulate_envs.make_scene import EnvConfig, make_episodes, make_scene
from articulate_envs.scene import Scene
from articulate_envs.scripted_expert import guide_of
from articulate_envs.threaded_engine import ThreadEngine


def tried(
    config: EnvConfig, scene: Scene, *, episodes: int, seed: int, threads: int
) -> dict[str, Any]:
    """What the guide does in ``episodes`` drawn episodes from home."""
    engine = ThreadEngine(scene, episodes, threads=threads)
    runs = make_episodes(engine, config, renew=False)
    runs.reseed(seed)
    runs.reset()
    drawn, guide = runs.drawn, guide_of(scene)
    force, opened, tick = np.zeros(episodes), [], None
    for _ in range(scene.ticks):
        tick = runs.step(guide.act(engine.state(), drawn))
        state = engine.state()
        force = np.fmax(force, np.linalg.norm(state.samples[:, :3], axis=1))
        opened.append(state.opened.copy())
    engine.close()
    return _row(scene, tick, force, np.array(opened))


def _row(scene: Scene, tick: Tick | None, force: Array, opened: Array) -> dict[str, Any]:
    assert tick is not None
    assert tick.ended is not None
    code = tick.ended.code
    at = beyond_target(scene.task, opened)
    reached = np.argmax(at, axis=0)[at.any(axis=0)]
    reasons, counts = np.unique(code[code != 0], return_counts=True)
    return {
        "success": round(float((code == 0).mean()), 4),
        "failed": {REASONS[int(r)]: int(n) for r, n in zip(reasons, counts, strict=True)},
        "reached_tick_median": float(np.median(reached)) if len(reached) else None,
        "reached_tick_p90": float(np.percentile(reached, 90)) if len(reached) else None,
        "force_median_n": round(float(np.median(force)), 1),
        "force_p90_n": round(float(np.percentile(force, 90)), 1),
    }


def main() -> int:
    """Print a row for each object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("objects", nargs="+", metavar="TASK=FILE")
    parser.add_argument("--episodes", type=int, default=64)
    parser.add_argument("--seed", type=int, default=5, help="of what is drawn")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--ranges", type=float, default=1.0, help="times every drawn range")
    parser.add_argument("--follow", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    changed = {k: float(v) for k, v in (item.split("=") for item in flags.follow)}
    rows = []
    for item in flags.objects:
        task, _, file = item.partition("=")
        config = EnvConfig(asset=file, task=task, follow=replace(ControlConfig(), **changed))
        config = replace(config, draw=config.draw.widened(flags.ranges))
        try:
            row = tried(
                config,
                make_scene(config),
                episodes=flags.episodes,
                seed=flags.seed,
                threads=flags.threads,
            )
        except UsageError as error:
            row = {"reason": str(error)}
        rows.append(
            {"task": task, "object": file, "follow": changed, "ranges": flags.ranges, **row}
        )
        if not flags.json:
            print(json.dumps(rows[-1]), flush=True)
    if flags.json:
        print(json.dumps({"episodes": flags.episodes, "seed": flags.seed, "rows": rows}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
