"""Speed of the engine on MuJoCo Warp relative to the engine on all processors.

    python benchmarks/gpu_engine.py --envs 1024 2048 4096 8192 --training warp cpu --json

All on the embedded cabinet at 20 Hz. Blocks of both engines alternate; ratios are medians over
``--rounds`` blocks. Episodes begin along the task and end one after another, half of them with the
gripper closed on the handle, under slow random motions.

``engine_ratio``
    Control steps per second of ``Engine.step`` only: set-point filter, physics, monitor.
``episodes_ratio``
    The same of complete episodes: also observations, rewards and resets, which the processors
    calculate in both.
``minutes``
    With ``--training``: minutes of fine-tuning with that engine (extra ``train``) to a success rate
    of 98 % on held-out episodes, control steps until then, and the success rate of the policy in
    the evaluation, which uses the engine on the processors. On Warp, ``--training-envs``
    environments with 16 control steps between updates are trained.
``device``, ``compile_s``
    Warp's device, and the time of the first control step, which compiles kernels that are not in
    Warp's cache.
"""

# ruff: noqa: E402 - the environment comes before numpy
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
os.environ.setdefault("MUJOCO_GL", "egl")

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any, get_args

import torch

from articulate.library.procedural.cabinet import embedded_cabinet
from articulate.transforms import Array
from articulate_envs.config import EngineName, WarpConfig
from articulate_envs.engines import describe_engine, make_engine
from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig
from articulate_train.run import create_run
from engine import episodes_on, motions, timed

ENGINES: tuple[EngineName, ...] = get_args(EngineName)
PACKAGES = ("mujoco", "mujoco-warp", "warp-lang", "torch", "numpy")
TRAINING_STEPS = 16
"""Control steps of each environment between updates in a training on Warp."""


class Side:
    """Environments on one of the engines."""

    def __init__(
        self, name: EngineName, scene: Scene, config: TrainConfig, n: int, threads: int, steps: int
    ) -> None:
        self.engine = make_engine(name, scene, n, threads=threads, warp=WarpConfig())
        self.episodes = episodes_on(self.engine, config)
        self.actions = motions(n, steps)
        self.episodes.reset(stagger=True)
        begin = time.perf_counter()
        self.episodes.step(self.actions[0])
        self.first_s = time.perf_counter() - begin
        self.episodes.step(self.actions[0])  # on a GPU from now on one graph

    def _rate(self, measure: Callable[[Array], float]) -> float:
        self.episodes.reset(stagger=True)
        return float(self.actions.shape[0] * self.actions.shape[1] / measure(self.actions))

    def episodes_rate(self) -> float:
        """Return the rate of complete episodes [control steps/s]."""
        return self._rate(lambda actions: timed(self.episodes, actions))

    def engine_rate(self) -> float:
        """Return the rate of the engine only [control steps/s]."""

        def measure(actions: Array) -> float:
            begin = time.perf_counter()
            for action in actions:
                self.engine.step(action)
            return time.perf_counter() - begin

        return self._rate(measure)


def compare(scene: Scene, config: TrainConfig, n: int, args: argparse.Namespace) -> dict[str, Any]:
    """Return the rates of both engines with N environments, and their ratios."""
    sides = {
        name: Side(name, scene, config, n, args.threads, min(args.steps, scene.n_steps))
        for name in ENGINES
    }
    rates: dict[str, dict[str, list[float]]] = {
        kind: {name: [] for name in ENGINES} for kind in ("engine", "episodes")
    }
    for _ in range(args.rounds):
        for name, side in sides.items():
            rates["engine"][name].append(side.engine_rate())
            rates["episodes"][name].append(side.episodes_rate())
    for side in sides.values():
        side.engine.close()
    out: dict[str, Any] = {"envs": n, "compile_s": sides["warp"].first_s}
    for kind, values in rates.items():
        pairs = zip(values["warp"], values["cpu"], strict=True)
        out[f"{kind}_ratio"] = median(warp / cpu for warp, cpu in pairs)
        for name in ENGINES:
            out[f"{kind}_steps_per_s_{name}"] = median(values[name])
    print(json.dumps(out), file=sys.stderr, flush=True)
    return out


def train(asset: Path, name: str, folder: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Train on one engine to the target success and return time, control steps and success."""
    run = folder / f"run-{name}"
    arguments = ["--engine", name, "--out", str(run), "--json"]
    arguments += ["--config", "quickstart", "--seeds", "0", "--target-success", "0.98"]
    if name == "warp":
        n = args.training_envs
        sizes = {"n_envs": n, "n_steps": TRAINING_STEPS, "batch_size": n * TRAINING_STEPS // 16}
        for key, value in sizes.items():
            arguments += ["--set", f"ppo.{key}={value}"]
    command = [sys.executable, "-m", "articulate", "train", "--asset", str(asset), *arguments]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    return {
        "command": " ".join(["train", *arguments]),
        "minutes": summary["seconds"] / 60.0,
        "steps": summary["seeds"][0]["steps"],
        "success": json.loads(printed)["success_pooled"],
    }


def measure(args: argparse.Namespace) -> dict[str, Any]:
    """Measure the requested parts and return the result of ``--json``."""
    torch.set_num_threads(1)
    result: dict[str, Any] = {"load_before": os.getloadavg()[0]}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        asset = embedded_cabinet(folder / "urdf")
        config = TrainConfig(asset=str(asset), seeds=(0,))
        scene = create_run(config, folder / "run", folder / "cache").scene()
        result["sizes"] = [compare(scene, config, n, args) for n in args.envs]
        result["training"] = {name: train(asset, name, folder, args) for name in args.training}
    return result | {
        "device": describe_engine("warp"),
        "threads": args.threads,
        "cpus": len(os.sched_getaffinity(0)),
        "rounds": args.rounds,
        "steps": args.steps,
        "load_after": os.getloadavg()[0],
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


def main(argv: Sequence[str]) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--envs",
        type=int,
        nargs="*",
        default=[1024, 2048, 4096, 8192],
        help="numbers of environments",
    )
    parser.add_argument("--rounds", type=int, default=3, help="blocks of each engine")
    parser.add_argument("--steps", type=int, default=40, help="control steps of a block")
    parser.add_argument(
        "--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads of both engines"
    )
    parser.add_argument(
        "--training",
        nargs="*",
        choices=ENGINES,
        default=[],
        help="engines with which a policy is trained",
    )
    parser.add_argument("--training-envs", type=int, default=1024, help="environments on Warp")
    parser.add_argument("--json", action="store_true", help="print the complete result as JSON")
    args = parser.parse_args(argv)
    result = measure(args)
    if args.json:
        print(json.dumps(result, indent=1))
        return 0
    print(result["device"])
    for row in result["sizes"]:
        print(
            f"{row['envs']} environments: engine {row['engine_ratio']:.2f}, "
            f"episodes {row['episodes_ratio']:.2f} of the engine on {args.threads} threads"
        )
    for name, row in result["training"].items():
        print(f"training on {name}: {row['minutes']:.1f} min, success {row['success']}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
