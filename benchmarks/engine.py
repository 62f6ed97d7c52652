"""Speed of the batched engine relative to MuJoCo's physics and to robosuite.

    python benchmarks/engine.py --json

All on the embedded cabinet at 20 Hz, in one run, in blocks that alternate, so that other load on
the machine affects both sides; ratios are medians over ``--rounds`` blocks.

``limit_ratio``
    Environment steps per second of complete episodes (randomized starts, set-point filter, physics,
    monitor, observations, reward, resets) over those of ``mj_step`` only, with MuJoCo's warm start,
    on the same number of threads, from the same states with the same controls: the controls of
    those episodes are recorded and replayed by a compiled loop that only writes controls and steps,
    environment by environment, which is faster: each stays in the cache of its core. All
    those episodes begin and end together; ``limit_ratio_staggered`` has as many that end one
    after another, as in training, over the same ``mj_step``.
``robosuite_ratio_equal``, ``robosuite_ratio_shipped``
    Over a plain robosuite environment with the same cabinet (``robosuite_cabinet.py``) in
    ``SubprocVecEnv`` on the same cores, resets included, with the best of ``--workers``; first
    with our physics step set to its 2 ms, then as shipped.
``training_ratio``
    Complete training (engine and PPO) over the engine only, which runs the training's episodes
    with the actions of its last rollout. A seed begins with imitation, the rest is PPO: both are
    measured (``training_ratio_imitation``, ``training_ratio_ppo``) and weighted by their shares of
    a seed that does not end early.
``steps_per_s_at``, ``lowest_share_of_best``, ``memory_mb_per_env``
    Rate over numbers of environments, measured in turn, and memory per environment.
``reset_ms``, ``reset_one_ms``
    Time of a reset, sampled size included: of all environments at once, and of one.
``required``, ``missed``
    Required values of these figures, and those that are not reached.

Actions are slow random motions from starts along the task, half of them with the gripper closed on
the handle; episodes have their full length, and each environment begins one in a block of 200
control steps. Run it on an idle machine; ``load_before`` records the load.
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
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import SubprocVecEnv

from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_envs.config import InitialStatesConfig
from articulate_envs.engine import Engine
from articulate_envs.episodes import Episodes
from articulate_envs.scene import Scene, build_scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.config import TrainConfig
from engine_replay import Recorded, RecordingEngine
from robosuite_cabinet import Fixture, make_env
from training import PACKAGES, WARM_UP_STEPS, OurSide, prepare

ROBOSUITE_STEP_S = 0.002
"""Physics step of robosuite [s]."""
STARTS = InitialStatesConfig(share_first=1.0, share_last=1.0, truncation_probability=0.0)
"""Episodes begin along the task and run their full length."""
ACTION_STEPS = 10
"""Control steps for which an action is constant."""
ALTERNATIONS = 4
"""Changes between the sides in a round of :func:`limit`: each block takes a second, and other load
on the machine changes within seconds."""


def episodes_on(engine: Engine, config: TrainConfig) -> Episodes:
    """Return episodes as at the beginning of training, all of full length."""
    return Episodes(
        engine,
        randomization=config.randomization,
        reward=config.reward,
        initial_states=STARTS,
        seed=0,
    )


def motions(n: int, steps: int) -> Array:
    """Return slow random actions (T, N, 8); half the grippers stay closed."""
    rng = np.random.default_rng(1)
    held = rng.uniform(-1.0, 1.0, (steps // ACTION_STEPS + 1, n, 8))
    actions = np.repeat(held, ACTION_STEPS, axis=0)[:steps]
    actions[:, ::2, 7] = 1.0
    return np.asarray(actions)


def timed(episodes: Episodes, actions: Array) -> float:
    """Return the time of a control step for each of ``actions`` (T, N, 8) [s]."""
    begin = time.perf_counter()
    for action in actions:
        episodes.step(action)
    return time.perf_counter() - begin


def limit(scene: Scene, config: TrainConfig, args: argparse.Namespace) -> dict[str, Any]:
    """Measure complete episodes against ``mj_step``."""
    count = min(args.steps, scene.n_steps)
    engine = RecordingEngine(scene, args.envs, threads=args.threads)
    episodes = episodes_on(engine, config)
    actions = motions(args.envs, count)
    steps = actions.shape[0] * actions.shape[1]
    ratios, ours, physics, mixed, errors = [], [], [], [], []
    for k in range(args.rounds + 1):
        episodes.reset()
        snapshot, kept = episodes.snapshot(), engine.snapshot()
        recorded = engine.recorded = Recorded()
        for action in actions[:-1]:
            episodes.step(action)
        reached = engine.positions()  # the last control step of an episode begins the next one
        episodes.step(actions[-1])
        engine.recorded = None
        controls, pushes = recorded.controls(scene)
        engine.replay_seconds(kept, controls[:, :-1], pushes[:, :-1])
        errors.append(float(np.abs(engine.positions() - reached).max()))
        floor = seconds = staggered = 0.0
        for _ in range(ALTERNATIONS if k > 0 else 1):  # the first round compiles and fills caches
            floor += engine.replay_seconds(kept, controls, pushes)
            episodes.restore(snapshot)
            seconds += timed(episodes, actions)
            episodes.reset(stagger=True)
            staggered += timed(episodes, actions)
        if k > 0:
            mixed.append(floor / staggered)
            ours.append(ALTERNATIONS * steps / seconds)
            physics.append(ALTERNATIONS * steps / floor)
            ratios.append(floor / seconds)
            _log(f"engine {ours[-1]:.0f}, mj_step {physics[-1]:.0f} env-steps/s")
    engine.close()
    return {
        "limit_ratio": median(ratios),
        "limit_ratios": ratios,
        "limit_ratio_staggered": median(mixed),
        "engine_steps_per_s": median(ours),
        "mj_step_steps_per_s": median(physics),
        "physics_us_per_env_step": 1e6 * args.threads / median(physics),
        "replay_error": max(errors),
    }


def rate_of(scene: Scene, config: TrainConfig, n: int, args: argparse.Namespace) -> Block:
    """Return a block of complete episodes of ``n`` environments."""
    engine = ThreadEngine(scene, n, threads=args.threads)
    episodes = episodes_on(engine, config)
    episodes.reset(stagger=True)
    actions = motions(n, min(args.steps, scene.n_steps))
    timed(episodes, actions[:2])
    return Block(lambda: actions.shape[0] * n / timed(episodes, actions), engine.close)


@dataclass(frozen=True)
class Block:
    """Measurement of a rate [env-steps/s] that can be repeated."""

    measure: Callable[[], float]
    close: Callable[[], None]


def robosuite_block(fixture: Fixture, horizon: int, workers: int) -> Block:
    """Return a block of complete episodes of robosuite's environments under random actions."""
    envs = SubprocVecEnv([partial(make_env, fixture, horizon)] * workers, start_method="forkserver")
    envs.seed(0)
    envs.reset()
    rng = np.random.default_rng(2)
    shape = (workers, *(envs.action_space.shape or ()))
    for _ in range(WARM_UP_STEPS):
        envs.step(np.zeros(shape, dtype=np.float32))

    def measure() -> float:
        actions = rng.uniform(-1.0, 1.0, (horizon, *shape)).astype(np.float32)
        begin = time.perf_counter()
        for action in actions:
            envs.step(action)
        return horizon * workers / (time.perf_counter() - begin)

    return Block(measure, envs.close)


def rivals(
    scene: Scene, config: TrainConfig, fixture: Fixture, args: argparse.Namespace
) -> dict[str, Any]:
    """Measure the engine, at both physics steps, against robosuite."""
    horizon = min(args.steps, scene.n_steps)
    search = {}
    for workers in args.workers:
        block = robosuite_block(fixture, horizon, workers)
        search[workers] = block.measure()
        block.close()
        _log(f"robosuite, {workers} workers: {search[workers]:.0f} env-steps/s")
    best = max(search, key=lambda workers: search[workers])
    equal = scene_with(scene, ROBOSUITE_STEP_S)
    blocks = {
        "robosuite": robosuite_block(fixture, horizon, best),
        "equal": rate_of(equal, config, args.envs, args),
        "shipped": rate_of(scene, config, args.envs, args),
    }
    rates = alternating(blocks, args.rounds)
    out: dict[str, Any] = {"robosuite_workers": best, "robosuite_steps_per_s": rates["robosuite"]}
    for name in ("equal", "shipped"):
        ratios = [a / b for a, b in zip(rates[name], rates["robosuite"], strict=True)]
        out[f"robosuite_ratio_{name}"] = median(ratios)
        out[f"{name}_steps_per_s"] = rates[name]
    return out | {"robosuite_search": {str(k): v for k, v in search.items()}}


def scene_with(scene: Scene, timestep_s: float) -> Scene:
    """Return the scene with another physics step."""
    return build_scene(
        scene.asset,
        scene.task,
        arm=scene.arm,
        control=scene.control,
        physics=replace(scene.physics, timestep_s=timestep_s),
        placement=scene.placement,
        scales=scene.scales,
    )


def alternating(blocks: dict[str, Block], rounds: int) -> dict[str, list[float]]:
    """Return the rates of all blocks, measured in turn, and close them."""
    rates: dict[str, list[float]] = {name: [] for name in blocks}
    for _ in range(rounds):
        for name, block in blocks.items():
            rates[name].append(block.measure())
            _log(f"{name}: {rates[name][-1]:.0f} env-steps/s")
    for block in blocks.values():
        block.close()
    return rates


def training(ours: OurSide, our_steps: int, args: argparse.Namespace) -> dict[str, Any]:
    """Measure complete training against the engine: same episodes, actions of the last rollout.

    A seed has ``our_steps`` control steps. Imitation is measured over its complete phase, because
    it keeps its samples and therefore slows down.
    """
    side = ours.without_imitation()
    learner, config = side.learner, ours.learner.config
    seed_config = replace(config, steps=our_steps).effective()

    def imitation() -> float:
        if seed_config.imitation.until == 0.0:
            return float("nan")
        beginning = ours.with_steps(our_steps)
        begin, steps = time.perf_counter(), 0
        while beginning.imitates:
            steps += beginning.update()
        seconds = time.perf_counter() - begin
        beginning.close()
        return steps / seconds

    def ppo() -> float:
        begin, steps = time.perf_counter(), 0
        for _ in range(args.updates):
            steps += side.update()
        return steps / (time.perf_counter() - begin)

    def engine_only() -> float:
        buffer = learner.model.rollout_buffer  # flattened by the update, environment by environment
        rollout = buffer.actions.reshape(buffer.n_envs, buffer.buffer_size, -1).swapaxes(0, 1)
        actions = np.clip(rollout, -1.0, 1.0).astype(np.float64)
        kept = learner.episodes.snapshot()
        seconds = sum(timed(learner.episodes, actions) for _ in range(args.updates))
        learner.episodes.restore(kept)  # the training goes on where it was
        return float(args.updates * actions.shape[0] * actions.shape[1] / seconds)

    ours.update()  # the first updates compile and fill caches
    side.update()
    blocks = {
        "imitation": Block(imitation, _close_nothing),
        "ppo": Block(ppo, side.close),
        "engine": Block(engine_only, _close_nothing),
    }
    rates = alternating(blocks, args.rounds)
    share = min(seed_config.imitation.until * config.ensemble_size, 1.0)  # all members together
    rates["training"] = [
        1.0 / ((share / a if share else 0.0) + (1.0 - share) / b)
        for a, b in zip(rates["imitation"], rates["ppo"], strict=True)
    ]
    out: dict[str, Any] = {}
    for name, key in (("training", ""), ("imitation", "_imitation"), ("ppo", "_ppo")):
        pairs = zip(rates[name], rates["engine"], strict=True)
        out[f"training_ratio{key}"] = median(a / b for a, b in pairs)
        out[f"training{key}_steps_per_s"] = median(rates[name])
    return out | {"training_imitation_share": share, "training_envs": config.ppo.n_envs}


def _close_nothing() -> None:
    """Do nothing."""


def scaling(scene: Scene, config: TrainConfig, args: argparse.Namespace) -> dict[str, Any]:
    """Measure rate, memory and time of a reset over numbers of environments, in turn."""
    blocks, held = {}, {}
    for n in args.counts:
        before = memory_mb()
        blocks[n] = Scaled(scene, config, n, args)
        blocks[n].rate()  # allocates all memory
        held[n] = (memory_mb() - before) / n
    rates: dict[int, list[float]] = {n: [] for n in blocks}
    resets: dict[int, list[float]] = {n: [] for n in blocks}
    ones: dict[int, list[float]] = {n: [] for n in blocks}
    for _ in range(args.rounds):
        for n, block in blocks.items():
            rates[n].append(block.rate())
            resets[n].append(block.reset_ms())
            ones[n].append(block.reset_one_ms())
    for n, block in blocks.items():
        block.close()
        _log(
            f"{n} environments: {median(rates[n]):.0f} env-steps/s, {held[n]:.2f} MB, "
            f"{median(resets[n]):.3f} ms a reset of all, {median(ones[n]):.3f} ms of one"
        )
    middle = {n: median(values) for n, values in rates.items()}
    most = max(blocks)
    return {
        "steps_per_s_at": {str(n): rate for n, rate in middle.items()},
        "lowest_share_of_best": min(middle.values()) / max(middle.values()),
        "memory_mb_per_env": held[most],
        "memory_mb_per_env_at": {str(n): mb for n, mb in held.items()},
        "reset_ms": median(resets[most]),
        "reset_ms_at": {str(n): median(values) for n, values in resets.items()},
        "reset_one_ms_at": {str(n): median(values) for n, values in ones.items()},
    }


class Scaled:
    """N environments whose rate and resets are measured repeatedly."""

    def __init__(self, scene: Scene, config: TrainConfig, n: int, args: argparse.Namespace) -> None:
        self.n = n
        self.engine = ThreadEngine(scene, n, threads=args.threads)
        self.episodes = episodes_on(self.engine, config)
        self.episodes.reset(stagger=True)
        # Few environments run for more steps, so that every block takes some time.
        steps = max(args.scaling_steps, args.scaling_steps * 256 // n)
        self.actions = motions(n, min(steps, scene.n_steps))

    def rate(self) -> float:
        """Return the rate [env-steps/s] of staggered episodes; some begin at every control step."""
        self.episodes.reset(stagger=True)
        return float(self.actions.shape[0] * self.n / timed(self.episodes, self.actions))

    def reset_ms(self) -> float:
        """Return the time of a reset when all environments are reset at once [ms]."""
        begin = time.perf_counter()
        self.episodes.reset()
        return 1e3 * (time.perf_counter() - begin) / self.n

    def reset_one_ms(self) -> float:
        """Return the time of sampling and beginning an episode in one environment [ms]."""
        begin = time.perf_counter()
        for i in range(self.n):
            self.engine.reset(np.array([i]), self.episodes.sample_start(1))
        return 1e3 * (time.perf_counter() - begin) / self.n

    def close(self) -> None:
        """End the threads."""
        self.engine.close()


def memory_mb() -> float:
    """Return the memory of this process [MB] (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def scene_cost(scene: Scene) -> dict[str, Any]:
    """Return the properties of the scene that determine its cost."""
    model = scene.nominal
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return {
        "nv": int(model.nv),
        "ngeom": int(model.ngeom),
        "substeps": scene.substeps,
        "physics_step_s": scene.physics.timestep_s,
        "steps": scene.n_steps,
    }


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Measure the requested parts and return the result of ``--json``."""
    torch.set_num_threads(1)
    result: dict[str, Any] = {"load_before": os.getloadavg()[0]}
    with tempfile.TemporaryDirectory() as folder:
        ours, fixture, settings = prepare(Path(folder), args.preset, args.threads)
        scene, config = ours.learner.episodes.engine.scene, ours.learner.config
        if "limit" in args.parts:
            result |= limit(scene, config, args)
        if "scaling" in args.parts:
            result |= scaling(scene, config, args)
        if "robosuite" in args.parts:
            result |= rivals(scene, config, fixture, args)
        if "training" in args.parts:
            result |= training(ours, settings.our_steps, args)
        ours.close()
    result["missed"] = missed(result)
    return result | {
        "required": REQUIRED,
        "scene": scene_cost(scene) | {"joint": settings.joint},
        "envs": args.envs,
        "threads": args.threads,
        "rounds": args.rounds,
        "cpus": len(os.sched_getaffinity(0)),
        "load_after": os.getloadavg()[0],
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


REQUIRED = {
    "limit_ratio": (0.83, None),
    "robosuite_ratio_equal": (6.0, None),
    "robosuite_ratio_shipped": (15.0, None),
    "training_ratio": (0.6, None),
    "lowest_share_of_best": (0.8, None),
    "reset_ms": (None, 0.5),
}
"""Smallest and largest accepted value of each figure."""


def missed(result: dict[str, Any]) -> list[str]:
    """Return the names of the measured figures that are outside their required range."""
    out = []
    for name, (least, most) in REQUIRED.items():
        value = result.get(name)
        short = value is not None and least is not None and value < least
        over = value is not None and most is not None and value > most
        if short or over:
            out.append(name)
    return out


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


PARTS = ("limit", "scaling", "robosuite", "training")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the complete result as JSON")
    parser.add_argument(
        "--parts", nargs="+", choices=PARTS, default=PARTS, help="figures to measure"
    )
    parser.add_argument("--rounds", type=int, default=5, help="blocks of each side")
    parser.add_argument("--envs", type=int, default=64, help="environments of the engine")
    parser.add_argument(
        "--steps", type=int, default=200, help="control steps of a block, at most an episode"
    )
    parser.add_argument("--updates", type=int, default=3, help="updates of a block of training")
    parser.add_argument(
        "--counts",
        type=int,
        nargs="+",
        default=[16, 32, 64, 128, 256, 512, 1024],
        help="numbers of environments",
    )
    parser.add_argument(
        "--scaling-steps", type=int, default=40, help="control steps for each of them"
    )
    parser.add_argument(
        "--workers",
        type=int,
        nargs="+",
        default=[1, 2, 3, 4],
        help="numbers of robosuite processes to try",
    )
    parser.add_argument(
        "--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads of the engine"
    )
    parser.add_argument("--preset", help="preset or YAML file of the training")
    args = parser.parse_args()
    result = measure(args)
    if args.json:
        print(json.dumps(result, indent=1))
        return
    for name, (least, most) in REQUIRED.items():
        if name in result:
            bound = f"at least {least:g}" if least is not None else f"at most {most:g}"
            word = "missed" if name in result["missed"] else "reached"
            print(f"{name} {result[name]:.3f} ({bound}: {word})")
    if "memory_mb_per_env" in result:
        print(f"memory_mb_per_env {result['memory_mb_per_env']:.2f}")


if __name__ == "__main__":
    main()
