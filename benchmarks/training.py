"""Compare the throughput of full training with that of a plain robosuite environment.

    python benchmarks/training.py --json

Both sides train PPO from Stable-Baselines3 on the embedded cabinet: same drawer, same placement,
same network, rollout, batch and epochs, one torch thread, no imitation phase. Ours uses threads.
robosuite runs in ``SubprocVecEnv`` (forkserver), with the fastest number of processes of
``--workers``. Blocks of ours and of robosuite alternate, so that other load affects both. A block
consists of complete updates: physics, observations, rewards, resets, transfer, policy and gradient
steps. Numba and page caches are warmed up before the measurement.

Run it on an idle machine: other load slows worker processes, which synchronize at every step, more
than threads. ``load_before`` is the load at the start. ``cpu_ms_per_step`` compares processor time,
which depends less on other load.
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
"""Steps of each robosuite environment before the measurement; numba compiles in the first."""
ENDLESS_STEPS = 1_000_000_000
"""Configured steps of our training, so many that its schedules stay at their beginning."""
PACKAGES = ("mujoco", "robosuite", "stable_baselines3", "torch", "numpy", "gymnasium")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings that both sides share."""

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
    """Discount, also of the reward normalization."""
    horizon: int
    """Control steps in an episode."""
    joint: str
    """Joint to open."""
    our_envs: int
    """Number of our environments; robosuite has one in each worker."""
    our_steps: int
    """Control steps of a seed in our training."""
    our_physics_step_s: float
    """Our default physics step [s]; robosuite's is 0.002."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """Measured block of training."""

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
    """Training of one side of the comparison."""

    def update(self) -> int:
        """Collect a rollout, update on it, and return the number of environment steps."""
        ...

    def workers(self) -> list[int]:
        """Return the ids of the worker processes."""
        ...

    def close(self) -> None:
        """Stop the processes or threads."""
        ...


def measure(side: Side, seconds: float) -> Block:
    """Measure updates for at least ``seconds`` [s] and at least one update."""
    processes = [os.getpid(), *side.workers()]
    steps, cpu, start = 0, processor_time(processes), time.perf_counter()
    while True:
        steps += side.update()
        elapsed = time.perf_counter() - start
        if elapsed >= seconds:
            spent = processor_time(processes) - cpu
            return Block(steps=steps, seconds=elapsed, cpu_seconds=spent)


def processor_time(processes: list[int]) -> float:
    """Return the user and system time of the processes so far [s] (Linux)."""
    jiffies = 0
    for process in processes:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        jiffies += int(fields[11]) + int(fields[12])
    return jiffies / os.sysconf("SC_CLK_TCK")


class OurSide:
    """Training of one seed as in ``train``, one update at a time."""

    def __init__(self, scene: Scene, config: TrainConfig, threads: int) -> None:
        self.learner, self.threads = Learner(scene, config, seed=0, threads=threads), threads
        self.steps = config.ppo.n_envs * config.ppo.n_steps

    def update(self) -> int:
        """Collect a rollout, update on it, and return the number of environment steps."""
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
        """Return no ids: it uses threads."""
        return []

    def close(self) -> None:
        """Stop the threads of the engine."""
        self.learner.close()


def prepare(folder: Path, preset: str | None, threads: int) -> tuple[OurSide, Fixture, Settings]:
    """Return our training on the embedded cabinet, and fixture and settings for robosuite."""
    urdf = embedded_cabinet(folder / "urdf")
    values = read_yaml(find_config(preset)) if preset else {}
    values |= {"asset": str(urdf), "seeds": [0]}
    our_steps = load_config(TrainConfig, values).steps
    config = load_config(TrainConfig, values | {"steps": ENDLESS_STEPS})
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
        """Collect a rollout, update on it, and return the number of environment steps."""
        self.model.learn(self.steps, reset_num_timesteps=False)
        return self.steps

    def workers(self) -> list[int]:
        """Return the ids of the worker processes."""
        return [process.pid for process in self.processes]

    def close(self) -> None:
        """Stop the worker processes."""
        self.envs.close()


def best_workers(
    fixture: Fixture, settings: Settings, counts: list[int]
) -> tuple[int, dict[int, float]]:
    """Return robosuite's fastest number of workers, and the rate of each number [steps/s]."""
    rates = {}
    for workers in counts:
        side = RobosuiteSide(fixture, settings, workers)
        rates[workers] = measure(side, seconds=0.0).rate
        side.close()
        _log(f"robosuite, {workers} workers: {rates[workers]:.0f} steps/s")
    return max(rates, key=lambda workers: rates[workers]), rates


def compare(args: argparse.Namespace) -> dict[str, Any]:
    """Run the measurement and return the content of ``--json``."""
    torch.set_num_threads(1)
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        imitating, fixture, settings = prepare(Path(folder), args.preset, args.threads)
        ours = imitating.without_imitation()  # like robosuite
        imitating.close()
        workers, search = best_workers(fixture, settings, args.workers)
        theirs = RobosuiteSide(fixture, settings, workers)
        blocks: dict[str, list[Block]] = {"ours": [], "robosuite": []}
        ours.update()  # the first one compiles and fills caches
        for _ in range(args.rounds):
            for name, side in (("ours", ours), ("robosuite", theirs)):
                block = measure(side, args.seconds)
                blocks[name].append(block)
                _log(f"{name}: {block.rate:.0f} steps/s over {block.seconds:.0f} s")
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


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> None:
    """Measure and print the result."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the complete result as JSON")
    parser.add_argument("--seconds", type=float, default=25.0, help="minimum length of a block [s]")
    parser.add_argument("--rounds", type=int, default=2, help="number of blocks of each side")
    parser.add_argument(
        "--workers",
        type=int,
        nargs="+",
        default=[1, 2, 3, 4],
        help="numbers of robosuite processes to try",
    )
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
