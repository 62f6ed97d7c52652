"""Success of training on single objects from the generalist policy, or from random weights.

    python benchmarks/generalist_fine_tuning.py --scenes generality/scenes.jsonl --out rows.jsonl

Each joint of the list (``benchmarks/generality.py`` or ``benchmarks/generalist.py prepare``) that
``train`` accepts is trained with one seed and one ensemble member until ``--target-success`` of 250
held-out episodes succeed, for ``--steps`` control steps at most. The policies that are near the
best in these evaluations are compared on common episodes, and the best is evaluated on new ones.
The table is resumable: what ``--out`` holds is not repeated.
"""

# ruff: noqa: E402 - the environment comes before numpy
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from articulate.task.episode_monitor import REASONS
from articulate.transforms import Ints
from articulate_train.config import TrainConfig
from articulate_train.evaluate import run_episodes
from articulate_train.feasibility_check import STOP_BELOW
from articulate_train.generalist import generalist_metadata
from articulate_train.policy import policy_of
from articulate_train.ppo import EVALUATION, SELECTION, Learner
from articulate_train.target_evaluation import TargetEvaluation, evaluate_target
from generalist_scenes import SceneRecord, read_records, scene_of

NEAR_BEST = 0.04
"""Difference to the best success rate up to which a policy is compared on common episodes."""
FINALISTS, FINAL_EPISODES = 4, 300
"""Most policies that are compared, and the number of these episodes."""


def fine_tune(record: SceneRecord, args: argparse.Namespace) -> dict[str, Any]:
    """Train on one joint and return its row."""
    config = TrainConfig(
        asset=record.source,
        task=record.task,
        joint=record.joint,
        steps=args.steps,
        target_success=args.target_success,
        ensemble_size=1,
        initial_policy=args.start,
    )
    scene = scene_of(record, config.randomization.scale_values)
    learner = Learner(scene, config, args.seed, threads=1)
    found: list[tuple[TargetEvaluation, dict[str, Any]]] = []

    def evaluate() -> bool:
        """Evaluate the policy and return whether it misses the target."""
        steps, state = learner.model.num_timesteps, learner.policy_state()
        result = evaluate_target(scene, config, args.seed, state, steps, 1)
        print(f"{record.object} {record.task}: {result.text()}", flush=True)
        found.append((result, state))
        return not result.is_reached

    def on_update(_: Learner) -> bool:
        steps, every = learner.model.num_timesteps, config.early_stopping.every
        before = steps - config.ppo.n_envs * config.ppo.n_steps
        if learner.is_done or steps // every > before // every:
            return evaluate()
        return True

    if evaluate():
        learner.run(on_update)
    learner.close()

    def codes(state: dict[str, Any], episodes: int, stream: int) -> Ints:
        """Return the outcome of each episode."""
        random = np.random.SeedSequence([config.evaluation_seed, args.seed, stream])
        ended, _ = run_episodes(
            scene, policy_of(state), config.randomization, random, episodes=episodes, threads=1
        )
        return ended.code

    least = max(_rate(result) for result, _ in found) - NEAR_BEST
    near = sorted((_rate(r), r.steps, k) for k, (r, _) in enumerate(found) if _rate(r) >= least)
    final = [
        (float(np.mean(codes(found[k][1], FINAL_EPISODES, SELECTION) == 0)), steps, k)
        for _, steps, k in near[-FINALISTS:]
    ]
    best, state = found[max(final)[2]]
    outcome = codes(state, args.episodes, EVALUATION)
    failures = outcome[outcome != 0]
    return {
        "object": record.object,
        "task": record.task,
        "joint": record.joint,
        "start": args.start,
        "seed": args.seed,
        "target_success": args.target_success,
        "steps": learner.model.num_timesteps,
        "selected_step": best.steps,
        "evaluations": [[r.steps, r.successes, r.episodes] for r, _ in found],
        "episodes": args.episodes,
        "success": float(np.mean(outcome == 0)),
        "failure": REASONS[int(np.bincount(failures).argmax())] if len(failures) else "",
        "expert": record.expert,
        "policy": generalist_metadata(record.task)["sha256"][:12],
    }


def _rate(result: TargetEvaluation) -> float:
    return result.successes / result.episodes


def main(argv: Sequence[str]) -> int:
    """Train on each joint and append its row."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--scenes", type=Path, required=True, help="list of scenes")
    parser.add_argument("--objects", nargs="+", help="ids of objects; by default all")
    parser.add_argument("--steps", type=int, default=300_000, help="most control steps")
    parser.add_argument("--start", choices=("generalist", "random"), default="generalist")
    parser.add_argument(
        "--min-expert",
        type=float,
        default=STOP_BELOW,
        help="least success rate of the expert; by default that of train",
    )
    parser.add_argument("--target-success", type=float, default=0.98, help="ends the training")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--out", type=Path, required=True, help="rows, one per line")
    args = parser.parse_args(argv)
    torch.set_num_threads(1)
    lines = args.out.read_text(encoding="utf-8").splitlines() if args.out.exists() else []
    keys = ("object", "task", "joint", "start", "seed", "target_success", "policy")
    done = {tuple(json.loads(line).get(key) for key in keys) for line in lines}
    for record in read_records(args.scenes):
        if record.placement is None or record.expert < args.min_expert:
            continue
        if args.objects and record.object not in args.objects:
            continue
        policy = generalist_metadata(record.task)["sha256"][:12]
        options = (args.start, args.seed, args.target_success)
        key = (record.object, record.task, record.joint, *options, policy)
        if key in done:
            continue
        row = fine_tune(record, args)
        with args.out.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
