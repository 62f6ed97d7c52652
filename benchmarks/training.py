"""Throughput of whole training, ours against a plain robosuite environment.

    python benchmarks/training.py --json

Both sides train PPO from Stable-Baselines3 on the embedded cabinet: same drawer, same place,
same network, rollout, batch and epochs, one torch thread, no imitation phase.
Ours runs its native threads; robosuite runs in ``SubprocVecEnv`` (forkserver) with each of
``--workers`` processes in turn, and the best of them goes on. Then blocks alternate, ours,
robosuite, ours, robosuite, so that what else the machine does hits both. A block is a whole number
of updates, so that physics, observations, rewards, resets, transfer, policy and gradient steps all
count. Numba and page caches are warmed up before the clock starts.

Run it on a machine that does nothing else: workers that wait for each other at every step suffer
more from other work than threads do. ``load_before`` says whether it was idle, and
``cpu_ms_per_step`` compares processor time, which other work changes less.
"""

# ruff: noqa: E402 - the environment comes before numpy and torch
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # here and in the workers
os.environ.setdefault("MUJOCO_GL", "egl")  # robosuite sets it otherwise; nothing is rendered

import argparse
import json
import platform
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import SubprocVecEnv, VecNormalize

from articulate.config import find_config, load_config, read_yaml
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig
from articulate_train.ppo import Learner
from articulate_train.run import create_run
from robosuite_cabinet import CONTROL_HZ, Fixture, fixture_of, make_env

WARM_UP_STEPS = 20
"""Steps of each robosuite environment before the clock starts; numba compiles in the first ones."""
ENDLESS_STEPS = 1_000_000_000
"""Steps that our training believes to have ahead, so that it stays at its first curriculum."""
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
    joint: str
    """What is to be opened."""
    our_envs: int
    """Environments of ours; robosuite has one in each worker."""
    our_steps: int
    """Control steps of a seed of ours in a training."""
    our_physics_step_s: float
    """Our physics step [s], the one that is shipped; robosuite's is 0.002."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """One timed stretch of training."""

    steps: int
    """Environment steps."""
    seconds: float
    """Wall time [s]."""
    cpu_seconds: float
    """Processor time of this process and the side's workers [s]."""

    @property
    def rate(self) -> float:
        """Environment steps in a second."""
        return self.steps / self.seconds


class Side(Protocol):
    """Something that trains."""

    def update(self) -> int:
        """Collect a rollout and learn from it; the number of environment steps."""
        ...

    def workers(self) -> list[int]:
        """Ids of its worker processes."""
        ...

    def close(self) -> None:
        """End its processes or threads."""
        ...


def measure(side: Side, seconds: float) -> Block:
    """Run updates for ``seconds``, at least one."""
    processes = [os.getpid(), *side.workers()]
    steps, cpu, start = 0, processor_time(processes), time.perf_counter()
    while True:
        steps += side.update()
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            spent = processor_time(processes) - cpu
            return Block(steps=steps, seconds=elapsed, cpu_seconds=spent)


def processor_time(processes: list[int]) -> float:
    """User and system time that the processes have used so far [s] (Linux)."""
    ticks = 0
    for process in processes:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


class OurSide:
    """A seed's training as ``train`` runs it, one update at a time."""

    def __init__(self, scene: Scene, config: TrainConfig, threads: int) -> None:
        self.learner, self.threads = Learner(scene, config, seed=0, threads=threads), threads
        self.steps = config.ppo.n_envs * config.ppo.n_steps

    def update(self) -> int:
        """Collect a rollout and learn from it; the number of environment steps."""
        self.learner.run(lambda _: False)
        self.learner.envs.finished.clear()
        return self.steps

    def without_imitation(self) -> OurSide:
        """Return another training of the same scene: PPO from the first control step on."""
        of, scene = self.learner.config, self.learner.episodes.engine.scene
        config = replace(
            of,
            imitation=replace(of.imitation, until=0.0),
            fine_tuning=replace(of.fine_tuning, imitation_steps=0),
        )
        return OurSide(scene, config, self.threads)

    def with_steps(self, steps: int) -> OurSide:
        """Return another training of the same scene with so many control steps."""
        of, scene = self.learner.config, self.learner.episodes.engine.scene
        return OurSide(scene, replace(of, steps=steps), self.threads)

    @property
    def imitates(self) -> bool:
        """True if the next update is one of the imitation phase."""
        config = self.learner.config
        return config.imitation.is_active(self.learner.model.num_timesteps / config.steps)

    def workers(self) -> list[int]:
        """None: it runs in threads."""
        return []

    def close(self) -> None:
        """End the threads of the engine."""
        self.learner.close()


def prepare(folder: Path, preset: str | None, threads: int) -> tuple[OurSide, Fixture, Settings]:
    """Ours, ready to train on the embedded cabinet, and what robosuite is to have in common.

    This is the only place that knows the training package.
    """
    urdf = embedded_cabinet(folder / "urdf")
    asked = read_yaml(find_config(preset)) if preset else {}
    asked |= {"asset": str(urdf), "seeds": [0]}
    our_steps = load_config(TrainConfig, asked).steps
    config = load_config(TrainConfig, asked | {"steps": ENDLESS_STEPS})
    run = create_run(config, folder / "run", folder / "cache")
    settings = Settings(
        rollout=config.ppo.n_envs * config.ppo.n_steps,
        batch=config.ppo.batch_size,
        epochs=config.ppo.n_epochs,
        layers=config.ppo.net_arch,
        activation="ELU",
        gamma=config.ppo.gamma,
        horizon=round(run.task.episode_s * CONTROL_HZ),
        our_physics_step_s=config.physics.timestep_s,
        our_envs=config.ppo.n_envs,
        our_steps=our_steps,
        joint=run.task.joint,
    )
    fixture = fixture_of(
        run.asset,
        run.task.joint,
        pos_w=run.placement.pos_w,
        yaw_rad=run.placement.yaw_rad,
        start_q=run.placement.start_q,
    )
    return OurSide(run.scene(), config, threads), fixture, settings


class RobosuiteSide:
    """Stable-Baselines3's PPO on robosuite environments in worker processes."""

    def __init__(self, fixture: Fixture, settings: Settings, workers: int) -> None:
        self.steps = settings.rollout // workers * workers
        envs = SubprocVecEnv(
            [partial(make_env, fixture, settings.horizon)] * workers, start_method="forkserver"
        )
        self.processes = envs.processes
        self.envs = VecNormalize(envs, gamma=settings.gamma)
        self.envs.seed(0)
        self.envs.reset()
        idle = np.zeros((workers, np.prod(envs.action_space.shape or (1,))))
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

    def workers(self) -> list[int]:
        """Ids of the worker processes."""
        return [process.pid for process in self.processes]

    def close(self) -> None:
        """End the worker processes."""
        self.envs.close()


def best_workers(
    fixture: Fixture, settings: Settings, counts: list[int]
) -> tuple[int, dict[int, float]]:
    """Find robosuite's fastest number of workers, and the rate of each number [steps/s]."""
    rates = {}
    for workers in counts:
        side = RobosuiteSide(fixture, settings, workers)
        rates[workers] = measure(side, seconds=0.0).rate
        side.close()
        _tell(f"robosuite, {workers} workers: {rates[workers]:.0f} steps/s")
    return max(rates, key=lambda workers: rates[workers]), rates


def compare(args: argparse.Namespace) -> dict[str, Any]:
    """Run the measurement; return the content of ``--json``."""
    torch.set_num_threads(1)
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        imitating, fixture, settings = prepare(Path(folder), args.preset, args.threads)
        ours = imitating.without_imitation()  # as on the side of robosuite
        imitating.close()
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
    rate, cpu_ms = {}, {}
    for name, done in blocks.items():
        steps = sum(block.steps for block in done)
        rate[name] = steps / sum(block.seconds for block in done)
        cpu_ms[name] = 1e3 * sum(block.cpu_seconds for block in done) / steps
    pairs = zip(blocks["ours"], blocks["robosuite"], strict=True)
    return {
        "robosuite_ratio": rate["ours"] / rate["robosuite"],
        "ours_steps_per_s": rate["ours"],
        "robosuite_steps_per_s": rate["robosuite"],
        "workers": workers,
        "threads": args.threads,
        "ratios": [a.rate / b.rate for a, b in pairs],
        "cpu_ms_per_step": cpu_ms,
        "blocks": {name: [asdict(block) for block in done] for name, done in blocks.items()},
        "search_steps_per_s": {str(count): value for count, value in search.items()},
        "settings": asdict(settings),
        "cpus": len(os.sched_getaffinity(0)),
        "load_before": load_before,
        "load_after": os.getloadavg()[0],
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
    parser.add_argument("--preset", help="preset or YAML file of our training")
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
