"""How near the batched engine comes to what physics alone costs, and how far ahead of robosuite.

    python benchmarks/engine.py --json

All on the embedded cabinet at 20 Hz, in one run, in blocks that alternate, so that what else the
machine does hits both sides; ratios are medians over ``--rounds`` blocks.

``limit_ratio``
    Environment steps a second of whole episodes (randomised starts, follower, physics, judgement,
    observations, reward, resets) over those of ``mj_step`` alone, with MuJoCo's warm start, on the
    same number of threads, from the same states with the same controls: what those episodes did
    is recorded and replayed by a compiled loop that only writes controls and steps, environment by
    environment and not tick by tick, which is faster: each stays in the cache of its core. All
    those episodes begin and end together; ``limit_ratio_staggered`` is of as many that end one
    after another, as they do in training, over the same ``mj_step``.
``robosuite_ratio_equal``, ``robosuite_ratio_shipped``
    Over a plain robosuite environment with the same cabinet (``robosuite_cabinet.py``) in
    ``SubprocVecEnv`` on the same cores, resets included, with the best of ``--workers``; first
    with our physics step set to its 2 ms, then as it is shipped.
``training_ratio``
    Whole training (engine and PPO) over the engine alone, which runs the training's own episodes
    with the actions of its last roll-out. A seed's first ticks learn from a guide, the others by
    PPO: both are measured (``training_ratio_shown``, ``training_ratio_ppo``), and the whole is what
    their shares of the ticks make of them.
``steps_per_s_at``, ``lowest_share_of_best``, ``memory_mb_per_env``
    The rate over numbers of environments, measured in turn, and what each environment holds.
``reset_ms``, ``reset_one_ms``
    What a reset takes, drawn size included: of all environments at once, and of one alone.
``wanted``, ``missed``
    What is asked of these figures, and which of them do not reach it.

Actions are slow random motions from starts along the task, half of them with the hand closed on the
handle; episodes have their full length, and each environment begins one anew in a block of 200
ticks. Run it on a machine that does nothing else; ``load_before`` says whether it was idle.
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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import torch
from numba import carray, njit  # type: ignore[attr-defined]  # numba says no __all__
from stable_baselines3.common.vec_env import SubprocVecEnv

from articulate.robot.control import discretize_filter, filter_step
from articulate.simulator import mujoco
from articulate.transforms import Array, Ints
from articulate_envs.compiled.advance import _call, _doubles
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.scene import Scene, build_scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.config import TrainConfig
from robosuite_cabinet import Fixture, make_env
from training import PACKAGES, WARM_UP_STEPS, OurSide, prepare

ROBOSUITE_STEP_S = 0.002
"""Physics step of robosuite [s]."""
STARTS = InitialStatesConfig(share_first=1.0, share_last=1.0, truncation_probability=0.0)
"""Episodes begin along the task and run their full length."""
HELD_TICKS = 10
"""So long an action lasts."""
ALTERNATIONS = 4
"""So often a round of :func:`limit` goes from one side to the other: each takes a second, and what
else the machine does comes and goes in seconds."""


class Own(NamedTuple):
    """Addresses (N,) of the model, the ``mjData`` and two of its arrays, of each environment.

    The engine steps environments at its desks; ``mj_step`` alone stays with one of them, and what
    that one has, for a whole episode, and finds all of it in the cache.
    """

    model: Ints
    data: Ints
    ctrl: Ints
    xfrc: Ints


@njit(nogil=True, error_model="numpy", boundscheck=False)
def replay(
    first: int,
    last: int,
    mj_step: Any,
    own: Any,
    push_row: int,
    controls: Array,
    pushes: Array,
) -> None:
    """``mj_step`` of environments ``first`` to ``last`` - 1 with controls (N, T, substeps, nu)."""
    nu = controls.shape[3]
    for i in range(first, last):
        ctrl = carray(_doubles(own.ctrl[i]), nu)
        xfrc = carray(_doubles(own.xfrc[i] + 48 * push_row), 6)
        for t in range(controls.shape[1]):
            for k in range(3):
                xfrc[k] = pushes[i, t, k]
            for s in range(controls.shape[2]):
                for k in range(nu):
                    ctrl[k] = controls[i, t, s, k]
                _call(mj_step, own.model[i], own.data[i])


@dataclass
class Recorded:
    """What stood before each tick: all that determines the controls of its substeps."""

    filter: list[Array] = field(default_factory=list)
    target: list[Array] = field(default_factory=list)
    closing: list[Array] = field(default_factory=list)
    finger: list[Array] = field(default_factory=list)
    push: list[Array] = field(default_factory=list)

    def controls(self, scene: Scene) -> tuple[Array, Array]:
        """Controls (N, T, substeps, nu) and pushes (N, T, 3)."""
        at, gripper, dt = scene.at, scene.arm.gripper, scene.physics.timestep_s
        A, B = discretize_filter(scene.control.omega_rad_s, dt)
        step = gripper.finger_speed_m_s * dt
        n, ticks = len(self.finger[0]), len(self.finger)
        out = np.zeros((n, ticks, scene.substeps, scene.nominal.nu))
        for t in range(ticks):
            state, finger = self.filter[t], self.finger[t]
            way = np.where(self.closing[t] > 0.0, -step, step)
            for s in range(scene.substeps):
                state = filter_step(state, self.target[t], A, B)
                finger = np.clip(finger + way, *gripper.finger_m)
                out[:, t, s, at.arm_ctrl : at.arm_ctrl + 7] = state[:, :, 0]
                out[:, t, s, at.finger_ctrl] = finger
                out[:, t, s, at.finger_ctrl + 1] = -finger
        return out, np.stack(self.push, axis=1)


BEFORE = ("filter", "closing", "finger", "push")
"""What the tick changes, or is the same after it; targets are moved at its beginning."""


class RecordingEngine(ThreadEngine):
    """The batched engine, which also notes what each tick begins with."""

    def __init__(self, scene: Scene, n_envs: int, *, threads: int) -> None:
        super().__init__(scene, n_envs, threads=threads)
        self.recorded: Recorded | None = None

    def _advance(self) -> None:
        before = {name: getattr(self._buffers, name).copy() for name in BEFORE}
        super()._advance()
        if self.recorded is not None:
            for name, value in before.items():
                getattr(self.recorded, name).append(value)
            self.recorded.target.append(self._buffers.target.copy())

    def replay_seconds(self, kept: dict[str, Array], controls: Array, pushes: Array) -> float:
        """Time that ``mj_step`` alone takes from the snapshot ``kept`` with those controls [s]."""
        self.restore(kept)
        args = (self._mj_step, self._own(), self._where.push_row, controls, pushes)
        edges = [int(edge) for edge in self._edges]
        with ThreadPoolExecutor(self.threads) as pool:
            begin = time.perf_counter()
            spans = pairwise(edges)
            jobs = [pool.submit(replay, first, last, *args) for first, last in spans]
            for job in jobs:
                job.result()
            return time.perf_counter() - begin

    def _own(self) -> Own:
        return Own(
            model=np.array([model._address for model in self._models]),
            data=np.array([data._address for data in self._data]),
            ctrl=self._pointers.ctrl,
            xfrc=self._pointers.xfrc,
        )

    def positions(self) -> Array:
        """Positions of all models (N, nq)."""
        return np.stack([data.qpos.copy() for data in self._data])


def episodes_on(engine: ThreadEngine, config: TrainConfig) -> Episodes:
    """Episodes as in training at its beginning, all of full length."""
    return Episodes(
        engine,
        randomization=config.randomization,
        reward=config.reward,
        initial_states=STARTS,
        seed=0,
    )


def motions(n: int, ticks: int) -> Array:
    """Slow random actions (T, N, 8); half the hands stay closed."""
    rng = np.random.default_rng(1)
    held = rng.uniform(-1.0, 1.0, (ticks // HELD_TICKS + 1, n, 8))
    actions = np.repeat(held, HELD_TICKS, axis=0)[:ticks]
    actions[:, ::2, 7] = 1.0
    return np.asarray(actions)


def timed(episodes: Episodes, actions: Array) -> float:
    """Time of one tick for each of ``actions`` (T, N, 8) [s]."""
    begin = time.perf_counter()
    for action in actions:
        episodes.step(action)
    return time.perf_counter() - begin


def limit(scene: Scene, config: TrainConfig, args: argparse.Namespace) -> dict[str, Any]:
    """Whole episodes against ``mj_step`` alone."""
    ticks = min(args.ticks, scene.ticks)
    engine = RecordingEngine(scene, args.envs, threads=args.threads)
    episodes = episodes_on(engine, config)
    actions = motions(args.envs, ticks)
    steps = actions.shape[0] * actions.shape[1]
    ratios, ours, alone, mixed, errors = [], [], [], [], []
    for k in range(args.rounds + 1):
        episodes.reset()
        snapshot, kept = episodes.snapshot(), engine.snapshot()
        recorded = engine.recorded = Recorded()
        for action in actions[:-1]:
            episodes.step(action)
        reached = engine.positions()  # the last tick of an episode begins the next one
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
            alone.append(ALTERNATIONS * steps / floor)
            ratios.append(floor / seconds)
            _tell(f"engine {ours[-1]:.0f}, mj_step alone {alone[-1]:.0f} env-steps/s")
    engine.close()
    return {
        "limit_ratio": median(ratios),
        "limit_ratios": ratios,
        "limit_ratio_staggered": median(mixed),
        "engine_steps_per_s": median(ours),
        "mj_step_steps_per_s": median(alone),
        "physics_us_per_env_step": 1e6 * args.threads / median(alone),
        "replay_error": max(errors),
    }


def rate_of(scene: Scene, config: TrainConfig, n: int, args: argparse.Namespace) -> Block:
    """A block of whole episodes of ``n`` environments, to be called again and again."""
    engine = ThreadEngine(scene, n, threads=args.threads)
    episodes = episodes_on(engine, config)
    episodes.reset(stagger=True)
    actions = motions(n, min(args.ticks, scene.ticks))
    timed(episodes, actions[:2])
    return Block(lambda: actions.shape[0] * n / timed(episodes, actions), engine.close)


@dataclass(frozen=True)
class Block:
    """Something that gives a rate [env-steps/s] whenever it is measured."""

    measure: Callable[[], float]
    close: Callable[[], None]


def robosuite_block(fixture: Fixture, horizon: int, workers: int) -> Block:
    """Whole episodes of robosuite's environments under random actions."""
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
    """Ours, at both physics steps, against robosuite."""
    horizon = min(args.ticks, scene.ticks)
    search = {}
    for workers in args.workers:
        block = robosuite_block(fixture, horizon, workers)
        search[workers] = block.measure()
        block.close()
        _tell(f"robosuite, {workers} workers: {search[workers]:.0f} env-steps/s")
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
    """The scene with another physics step."""
    return build_scene(
        scene.asset,
        scene.task,
        arm=scene.arm,
        control=scene.control,
        physics=replace(scene.physics, timestep_s=timestep_s),
        place=scene.place,
        scales=scene.scales,
    )


def alternating(blocks: dict[str, Block], rounds: int) -> dict[str, list[float]]:
    """Rates of all blocks, measured in turn; they are closed."""
    rates: dict[str, list[float]] = {name: [] for name in blocks}
    for _ in range(rounds):
        for name, block in blocks.items():
            rates[name].append(block.measure())
            _tell(f"{name}: {rates[name][-1]:.0f} env-steps/s")
    for block in blocks.values():
        block.close()
    return rates


def training(ours: OurSide, args: argparse.Namespace) -> dict[str, Any]:
    """Whole training against the engine alone: the same episodes, actions of the last roll-out."""
    sides = {"shown": ours, "ppo": ours.unshown()}
    learner = sides["ppo"].learner
    config = ours.learner.config

    def update(side: OurSide) -> float:
        begin, steps = time.perf_counter(), 0
        for _ in range(args.updates):
            steps += side.update()
        return steps / (time.perf_counter() - begin)

    def engine_alone() -> float:
        buffer = learner.model.rollout_buffer  # flattened by the update, environment by environment
        taken = buffer.actions.reshape(buffer.n_envs, buffer.buffer_size, -1).swapaxes(0, 1)
        actions = np.clip(taken, -1.0, 1.0).astype(np.float64)
        kept = learner.episodes.snapshot()
        seconds = sum(timed(learner.episodes, actions) for _ in range(args.updates))
        learner.episodes.restore(kept)  # the training goes on where it was
        return float(args.updates * actions.shape[0] * actions.shape[1] / seconds)

    blocks = {}
    for name, side in sides.items():
        side.update()  # the first one compiles and fills caches
        blocks[name] = Block(partial(update, side), side.close)
    rates = alternating(blocks | {"engine": Block(engine_alone, _nothing)}, args.rounds)
    share = min(
        config.imitation.until * config.ensemble_size, 1.0
    )  # of a seed's ticks, members together
    by_kind = zip(rates["shown"], rates["ppo"], strict=True)
    rates["training"] = [1.0 / (share / shown + (1.0 - share) / ppo) for shown, ppo in by_kind]
    out: dict[str, Any] = {}
    for name, key in (("training", ""), ("shown", "_shown"), ("ppo", "_ppo")):
        pairs = zip(rates[name], rates["engine"], strict=True)
        out[f"training_ratio{key}"] = median(a / b for a, b in pairs)
        out[f"training{key}_steps_per_s"] = median(rates[name])
    return out | {"training_shown_share": share, "training_envs": config.ppo.n_envs}


def _nothing() -> None:
    """Nothing to close."""


def scaling(scene: Scene, config: TrainConfig, args: argparse.Namespace) -> dict[str, Any]:
    """Rate, memory and cost of a reset over numbers of environments, all of them in turn."""
    blocks, held = {}, {}
    for n in args.counts:
        before = memory_mb()
        blocks[n] = Scaled(scene, config, n, args)
        blocks[n].rate()  # touches all that it will
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
        _tell(
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
    """N environments whose rate and resets are measured again and again."""

    def __init__(self, scene: Scene, config: TrainConfig, n: int, args: argparse.Namespace) -> None:
        self.n = n
        self.engine = ThreadEngine(scene, n, threads=args.threads)
        self.episodes = episodes_on(self.engine, config)
        self.episodes.reset(stagger=True)
        # Few environments run for longer, so that no block is over in no time.
        ticks = max(args.scaling_ticks, args.scaling_ticks * 256 // n)
        self.actions = motions(n, min(ticks, scene.ticks))

    def rate(self) -> float:
        """Rate [env-steps/s] of staggered episodes; some of them begin anew at every tick."""
        self.episodes.reset(stagger=True)
        return float(self.actions.shape[0] * self.n / timed(self.episodes, self.actions))

    def reset_ms(self) -> float:
        """Time of a reset when all environments are reset at once [ms]."""
        begin = time.perf_counter()
        self.episodes.reset()
        return 1e3 * (time.perf_counter() - begin) / self.n

    def reset_one_ms(self) -> float:
        """Time of drawing and beginning an episode in one environment alone [ms]."""
        begin = time.perf_counter()
        for i in range(self.n):
            self.engine.reset(np.array([i]), self.episodes.draw_start(1))
        return 1e3 * (time.perf_counter() - begin) / self.n

    def close(self) -> None:
        """End the threads."""
        self.engine.close()


def memory_mb() -> float:
    """Memory that this process holds now [MB] (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def scene_cost(scene: Scene) -> dict[str, Any]:
    """What of the scene decides its cost."""
    model = scene.nominal
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return {
        "nv": int(model.nv),
        "ngeom": int(model.ngeom),
        "substeps": scene.substeps,
        "physics_step_s": scene.physics.timestep_s,
        "ticks": scene.ticks,
    }


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """All parts that are asked for; what ``--json`` prints."""
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
            result |= training(ours, args)
        ours.close()
    result["missed"] = missed(result)
    return result | {
        "wanted": WANTED,
        "scene": scene_cost(scene) | {"joint": settings.joint},
        "envs": args.envs,
        "threads": args.threads,
        "rounds": args.rounds,
        "cpus": len(os.sched_getaffinity(0)),
        "load_after": os.getloadavg()[0],
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


WANTED = {
    "limit_ratio": (0.85, None),
    "robosuite_ratio_equal": (6.0, None),
    "robosuite_ratio_shipped": (15.0, None),
    "training_ratio": (0.6, None),
    "lowest_share_of_best": (0.8, None),
    "reset_ms": (None, 0.5),
}
"""Smallest and largest value that is asked for of each figure."""


def missed(result: dict[str, Any]) -> list[str]:
    """Names of the measured figures that do not reach what is wanted."""
    out = []
    for name, (least, most) in WANTED.items():
        value = result.get(name)
        short = value is not None and least is not None and value < least
        over = value is not None and most is not None and value > most
        if short or over:
            out.append(name)
    return out


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


PARTS = ("limit", "scaling", "robosuite", "training")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--json", action="store_true", help="print the whole result as JSON")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--rounds", type=int, default=5, help="blocks of each side")
    parser.add_argument("--envs", type=int, default=64, help="environments of ours")
    parser.add_argument(
        "--ticks", type=int, default=200, help="ticks of a block, an episode at most"
    )
    parser.add_argument("--updates", type=int, default=3, help="updates of a block of training")
    parser.add_argument("--counts", type=int, nargs="+", default=[16, 32, 64, 128, 256, 512, 1024])
    parser.add_argument("--scaling-ticks", type=int, default=40, help="ticks for each of them")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 3, 4])
    parser.add_argument(
        "--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads of our engine"
    )
    parser.add_argument("--preset", help="preset or YAML file of our training")
    args = parser.parse_args()
    result = measure(args)
    if args.json:
        print(json.dumps(result, indent=1))
        return
    for name, (least, most) in WANTED.items():
        if name in result:
            bound = f"at least {least:g}" if least is not None else f"at most {most:g}"
            word = "missed" if name in result["missed"] else "reached"
            print(f"{name} {result[name]:.3f} ({bound}: {word})")
    if "memory_mb_per_env" in result:
        print(f"memory_mb_per_env {result['memory_mb_per_env']:.2f}")


if __name__ == "__main__":
    main()
