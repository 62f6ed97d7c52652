"""Throughput of whole training, ours against a plain robosuite environment.

    python benchmarks/training.py --json

Both sides train PPO from Stable-Baselines3 on the embedded cabinet: same drawer, same place,
same network, rollout, batch and epochs, one torch thread. Ours runs its native threads; robosuite
runs in ``SubprocVecEnv`` (forkserver) with each of ``--workers`` processes in turn, and the best
of them goes on. Then blocks alternate, ours, robosuite, ours, robosuite, so that what else the
machine does hits both. A block is a whole number of updates, so that physics, observations,
rewards, resets, transfer, policy and gradient steps all count. Numba and page caches are warmed
up before the clock starts.
"""

from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # before numpy and torch are imported, here and in the workers
os.environ.setdefault("MUJOCO_GL", "egl")  # robosuite sets it otherwise; nothing is rendered

import argparse
import json
import platform
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

sys.path.insert(0, str(Path(__file__).resolve().parent))

import numpy as np
import torch
from robosuite_cabinet import Fixture, fixture_of, make_env
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

WARM_UP_STEPS = 20
"""Steps of each robosuite environment before the clock starts; numba compiles in the first ones."""
PACKAGES = ("mujoco", "robosuite", "stable_baselines3", "torch", "numpy", "gymnasium")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What both sides have in common."""

    rollout: int
    """Environment steps in an update."""
    batch: int
    """Samples in a gradient step."""
    epochs: int
    """Passes over a rollout."""
    layers: tuple[int, ...]
    """Widths of the hidden layers of policy and of value function."""
    activation: str
    """Name of the activation in ``torch.nn``."""
    gamma: float
    """Discount; also that of the reward's normalisation."""
    horizon: int
    """Control steps in an episode."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """One timed stretch of training."""

    steps: int
    seconds: float

    @property
    def rate(self) -> float:
        """Environment steps in a second."""
        return self.steps / self.seconds


class Side(Protocol):
    """Something that trains."""

    def update(self) -> int:
        """Collect a rollout and learn from it; the number of environment steps."""
        ...

    def close(self) -> None:
        """End its processes or threads."""
        ...


def measure(side: Side, seconds: float) -> Block:
    """Updates until ``seconds`` are over, at least one."""
    steps, start = 0, time.perf_counter()
    while True:
        steps += side.update()
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            return Block(steps=steps, seconds=elapsed)


class RobosuiteSide:
    """Stable-Baselines3's PPO on robosuite environments in worker processes."""

    def __init__(self, fixture: Fixture, settings: Settings, workers: int) -> None:
        self.steps = settings.rollout // workers * workers
        envs = SubprocVecEnv(
            [partial(make_env, fixture, settings.horizon)] * workers, start_method="forkserver"
        )
        self.envs = VecNormalize(envs, gamma=settings.gamma)
        self.envs.seed(0)
        self.envs.reset()
        idle = np.zeros((workers, *envs.action_space.shape))
        for _ in range(WARM_UP_STEPS):
            self.envs.step(idle)
        layers = list(settings.layers)
        self.model = PPO(
            "MlpPolicy",
            self.envs,
            n_steps=self.steps // workers,
            batch_size=settings.batch,
            n_epochs=settings.epochs,
            gamma=settings.gamma,
            policy_kwargs={
                "net_arch": {"pi": layers, "vf": layers},
                "activation_fn": getattr(torch.nn, settings.activation),
            },
            seed=0,
            device="cpu",
        )

    def update(self) -> int:
        """Collect a rollout and learn from it; the number of environment steps."""
        self.model.learn(self.steps, reset_num_timesteps=False)
        return self.steps

    def close(self) -> None:
        """End the worker processes."""
        self.envs.close()


def best_workers(
    fixture: Fixture, settings: Settings, counts: list[int]
) -> tuple[int, dict[int, float]]:
    """The number of workers with which robosuite trains fastest, and the rate of each [steps/s]."""
    rates = {}
    for workers in counts:
        side = RobosuiteSide(fixture, settings, workers)
        rates[workers] = measure(side, seconds=0.0).rate
        side.close()
        _tell(f"robosuite, {workers} workers: {rates[workers]:.0f} steps/s")
    return max(rates, key=lambda workers: rates[workers]), rates


def compare(args: argparse.Namespace) -> dict[str, Any]:
    """The whole measurement; what ``--json`` prints."""
    torch.set_num_threads(1)
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        ours, fixture, settings = our_side(Path(folder), args.threads)
        workers, search = best_workers(fixture, settings, args.workers)
        theirs = RobosuiteSide(fixture, settings, workers)
        blocks: dict[str, list[Block]] = {"ours": [], "robosuite": []}
        ours.update()  # the first one compiles and fills caches
        for _ in range(args.rounds):
            for name, side in (("ours", ours), ("robosuite", theirs)):
                block = measure(side, args.seconds)
                blocks[name].append(block)
                _tell(f"{name}: {block.rate:.0f} steps/s over {block.seconds:.0f} s")
        ours.close()
        theirs.close()
    rate = {
        name: sum(block.steps for block in done) / sum(block.seconds for block in done)
        for name, done in blocks.items()
    }
    pairs = zip(blocks["ours"], blocks["robosuite"], strict=True)
    return {
        "robosuite_ratio": rate["ours"] / rate["robosuite"],
        "ours_steps_per_s": rate["ours"],
        "robosuite_steps_per_s": rate["robosuite"],
        "workers": workers,
        "threads": args.threads,
        "ratios": [a.rate / b.rate for a, b in pairs],
        "blocks": {name: [asdict(block) for block in done] for name, done in blocks.items()},
        "search_steps_per_s": {str(count): value for count, value in search.items()},
        "settings": asdict(settings),
        "cpus": len(os.sched_getaffinity(0)),
        "load_before": load_before,
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--json", action="store_true", help="print the whole result as JSON")
    parser.add_argument("--seconds", type=float, default=25.0, help="shortest length of a block")
    parser.add_argument("--rounds", type=int, default=2, help="blocks of each side")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 3, 4])
    parser.add_argument(
        "--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads of our engine"
    )
    args = parser.parse_args()
    result = compare(args)
    if args.json:
        print(json.dumps(result, indent=1))
    else:
        print(
            f"{result['robosuite_ratio']:.2f} times: ours {result['ours_steps_per_s']:.0f}, "
            f"robosuite {result['robosuite_steps_per_s']:.0f} env-steps/s"
        )


if __name__ == "__main__":
    main()
