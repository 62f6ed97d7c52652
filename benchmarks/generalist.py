"""Train the generalist policy: one network for drawers, doors and lids that it has never seen.

    python benchmarks/generalist.py prepare --seeds 0 2 --panels 1 20 --out scenes.jsonl
    python benchmarks/generalist.py train --scenes scenes.jsonl

``prepare`` makes objects of the procedural library and of :mod:`generalist_panels`, places them and
runs the scripted expert on each joint (resumable). ``train`` begins as the expert, whose action the
policy observes and corrects, on all accepted scenes in one batch (DAgger; Ross, Gordon and Bagnell,
2011): in each round all environments run an episode's length of control steps, the expert's actions
at the visited states and another sample of the noise are added to the data, and the network is
fitted to all data so far: in the mean, it removes the noise. It writes ``generalist_open.npz`` and
``.json`` of the package ``articulate_train``, or ``generalist_close`` for scenes of ``prepare
--closing``. Seeds below 1000 are for training, 1000 to 1999 for validation.
"""

# ruff: noqa: E402 - the environment comes before numpy and torch
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from articulate.files import sha256, write_json
from articulate.task.observation import OBSERVATION, expert_action
from articulate.task.randomization_config import RandomizationConfig
from articulate.transforms import Array
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Ended, Episodes
from articulate_envs.rewards import RewardConfig
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.action_scaling import corrected_action, correction_to
from articulate_train.config import ActionScalingConfig
from articulate_train.generalist import weights_file, write_weights
from articulate_train.policy import Network
from articulate_train.run import versions
from generalist_panels import KINDS, write_panel
from generalist_scenes import (
    CLOSING_TASKS,
    TASKS,
    SceneRecord,
    prepare,
    procedural_ids,
    read_records,
    scene_of,
    write_procedural,
)

Singles = NDArray[np.float32]
HIDDEN = (384, 384, 384)
"""Widths of the hidden layers."""
SCALES = (0.9, 1.0, 1.1)
"""Sizes of the objects."""
MIN_EXPERT = 0.8
"""Least success rate of the expert on a training scene."""
STARTS = InitialStatesConfig(share_first=0.5, share_last=0.25, n_precomputed=48)
BATCH_SIZE = 1024
LEARNING_RATES = 1e-3, 1e-4
"""Learning rate at the beginning and at the end, exponential decay between."""
FINAL_RATES = 2e-4, 1e-5
"""The same after the last round."""
MIN_STD = 0.1
"""Floor of the standard deviation of observations, whose units make them about 1: what varies
little in training may vary more on other objects."""
JOINTS, VECTOR, TWIST = (-1, 1, -1, 1, -1, 1, -1), (1, -1, 1), (1, -1, 1, -1, 1, -1)
"""Signs of joint angles, of vectors and of motions in the frame of the tool, mirrored."""
MIRRORED_SIGNS = {
    **dict.fromkeys(("joint_pos", "joint_vel", "joint_tracking_error"), JOINTS),
    **dict.fromkeys(("handle_pos", "handle_pos_fine", "handle_pos_predicted"), VECTOR),
    **dict.fromkeys(("handle_pos_predicted_fine", "measured_force", "path_direction"), VECTOR),
    "tracking_error": TWIST,
    "handle_axes": VECTOR * 2,
    "pending_actions": (*TWIST, -1),
    "last_action": (*TWIST, -1, 1),
    "path_rotation": TWIST[3:],
    "expert_action": (*TWIST, -1, 1),
}
"""Signs of fields of the observation in a scene that is mirrored at the vertical plane through the
base of the arm; others stay the same."""
NORMALIZED_ROUNDS = 5
"""Rounds after which the normalization of observations no longer changes."""


@dataclass
class Data:
    """Observations and corrections to imitate of all rounds."""

    observations: list[Singles]
    actions: list[Singles]

    def tensors(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return all rows (M, size), (M, 8)."""
        both = (self.observations, self.actions)
        first, second = (torch.from_numpy(np.concatenate(rows)) for rows in both)
        return first, second


def mirrored(
    observations: torch.Tensor, actions: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return observations (M, size) and actions (M, 8) of the mirrored scene.

    The arm and the gripper are symmetric, except that joint 7 is 45 degrees off its middle.
    """
    fields = OBSERVATION.fields
    signs = [sign for f in fields for sign in MIRRORED_SIGNS.get(f.name, (1,) * f.size)]
    out = observations * torch.tensor(signs, dtype=observations.dtype)
    out[:, OBSERVATION.slice("joint_pos").stop - 1] += np.pi / 2.0
    return out, actions * torch.tensor((*TWIST, -1, 1), dtype=actions.dtype)


def stacked_scaling(scenes: Sequence[Scene]) -> ActionScalingConfig:
    """Return the action scaling of one scene per environment, arrays where scenes differ."""
    configs = []
    for scene in scenes:
        path_m = scene.asset.handle_travel(scene.task.joint)
        configs.append(ActionScalingConfig().for_path(path_m))
    ranges = np.array([config.goal_range for config in configs], dtype=np.float32)
    return cast(
        ActionScalingConfig,
        SimpleNamespace(
            **asdict(ActionScalingConfig()) | {"goal_range": (ranges[:, :1], ranges[:, 1:])}
        ),
    )


class Trainer:
    """DAgger on many scenes."""

    def __init__(
        self,
        records: Sequence[SceneRecord],
        n_envs: int,
        rounds: int,
        seed: int,
    ) -> None:
        """Compile the scenes and begin the episodes."""
        torch.manual_seed(seed)
        self._rng = np.random.default_rng(seed)
        self.records, self.rounds = records, rounds
        scenes = [scene_of(record, SCALES) for record in records]
        engine = ThreadEngine(scenes, n_envs)
        rows = [scenes[k] for k in engine.scene_of]
        self.tasks = np.array([records[k].task for k in engine.scene_of])
        self.scaling = stacked_scaling(rows)
        self.episodes = Episodes(
            engine,
            randomization=RandomizationConfig(scales=len(SCALES)),
            reward=RewardConfig(),
            initial_states=STARTS,
            seed=seed,
        )
        self.observation = self.episodes.reset(stagger=True)
        self.data = Data([], [])
        ones = torch.ones(OBSERVATION.size)
        self.network = Network(torch.zeros(OBSERVATION.size), ones, HIDDEN)
        for parameter in self.network.head.parameters():
            torch.nn.init.zeros_(parameter)  # begin as the scripted expert
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=LEARNING_RATES[0])

    def act(self, observation: Singles) -> Array:
        """Return the network's corrections (N, 8)."""
        with torch.no_grad():
            out = self.network(torch.as_tensor(observation, dtype=torch.float32))
        return np.asarray(out.numpy(), dtype=np.float64)

    def collect(self, k: int) -> list[Ended]:
        """Run an episode's length of control steps of round ``k`` and add to the data."""
        self.episodes.progress = k / self.rounds
        ended = []
        for _ in range(self.episodes.engine.scene.n_steps):
            seen: Singles = self.observation.astype(np.float32)
            target = expert_action(self.episodes.observe_again())
            self.data.observations.append(seen)
            self.data.actions.append(correction_to(self.scaling, seen, target).astype(np.float32))
            step = self.episodes.step(corrected_action(self.scaling, seen, self.act(seen)))
            self.observation = step.observation
            if step.ended is not None:
                ended.append(step.ended)
        return ended

    def fit(self, k: int, batches: int) -> float:
        """Fit the network to all data after round ``k``; return the last mean loss."""
        network = self.network
        if k <= NORMALIZED_ROUNDS:
            observations, actions = self.data.tensors()
            both = torch.cat([observations, mirrored(observations, actions)[0]])
            network.mean.copy_(both.mean(dim=0))
            network.scale.copy_(torch.rsqrt(both.var(dim=0) + MIN_STD**2))
        first, last = LEARNING_RATES
        begin, end = (first * (last / first) ** (r / self.rounds) for r in (k, k + 1))
        return self.descend(batches, begin, end)

    def descend(self, batches: int, first: float, last: float) -> float:
        """Fit the network to all data with ``batches`` minibatches; return the last mean loss.

        The learning rate decays exponentially from ``first`` to ``last``.
        """
        observations, actions = self.data.tensors()
        network = self.network
        losses = []
        for i in range(batches):
            for group in self.optimizer.param_groups:
                group["lr"] = first * (last / first) ** (i / batches)
            pick = torch.from_numpy(self._rng.integers(len(observations), size=BATCH_SIZE))
            seen, wanted = observations[pick], actions[pick]
            seen[::2], wanted[::2] = mirrored(seen[::2], wanted[::2])
            x = torch.clamp((seen - network.mean) * network.scale, -10.0, 10.0)
            loss: Any = functional.mse_loss(network.head(network.body(x)), wanted)
            self.optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            self.optimizer.step()
            losses.append(float(loss.detach()))
        return float(np.mean(losses[-100:]))

    def success(self, ended: Sequence[Ended]) -> dict[str, str]:
        """Return successes of episodes from home by task, as text."""
        counts: Counter[str] = Counter()
        for one in ended:
            for row, code, home in zip(one.rows, one.code, one.from_home, strict=True):
                if home:
                    counts[f"{self.tasks[row]} n"] += 1
                    counts[f"{self.tasks[row]} ok"] += int(code == 0)
        names = sorted({name.split()[0] for name in counts})
        return {name: f"{counts[f'{name} ok']}/{counts[f'{name} n']}" for name in names}


def train(args: argparse.Namespace) -> int:
    """Train and write the weights after every few rounds."""
    torch.set_num_threads(1)
    records = [r for r in read_records(args.scenes) if r.placement and r.expert >= MIN_EXPERT]
    file = args.out / weights_file(records[0].task).name
    args.envs = max(args.envs, len(records))
    begin = time.monotonic()
    trainer = Trainer(records, args.envs, args.rounds, args.seed)
    print(f"{len(records)} scenes, {time.monotonic() - begin:.0f} s", flush=True)
    for k in range(args.rounds):
        ended = trainer.collect(k)
        collected = time.monotonic() - begin
        loss = trainer.fit(k, args.batches)
        now = time.monotonic() - begin
        print(
            f"round {k} {collected:.0f} s {now:.0f} s loss {loss:.4f} {trainer.success(ended)}",
            flush=True,
        )
        if k + 1 == args.rounds:
            loss = trainer.descend(args.final_batches, *FINAL_RATES)
            print(f"final fit {time.monotonic() - begin:.0f} s loss {loss:.4f}", flush=True)
        if (k + 1) % 2 == 0 or k + 1 == args.rounds:
            write_weights(file, trainer.network)
            steps = (k + 1) * args.envs * trainer.episodes.engine.scene.n_steps
            write_json(
                file.with_suffix(".json"),
                {
                    "command": "python benchmarks/generalist.py train --scenes "
                    f"{args.scenes.name} --rounds {args.rounds} --envs {args.envs} "
                    f"--batches {args.batches} --final-batches {args.final_batches} "
                    f"--seed {args.seed}",
                    "licence": "MIT",
                    "objects": sorted({r.object for r in records}),
                    "scenes": dict(Counter(r.task for r in records)),
                    "rounds": k + 1,
                    "control_steps": steps,
                    "seed": args.seed,
                    "versions": {n: v for n, v in versions().items() if n != "system"},
                    "sha256": sha256(file),
                },
            )
    return 0


def main(argv: Sequence[str]) -> int:
    """Run one of the two stages."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("prepare", help="make, place and check objects")
    one.add_argument("--seeds", type=int, nargs=2, default=(0, 12), help="first seed, and end")
    one.add_argument("--panels", type=int, nargs=2, default=(0, 0), help="the same for panels")
    one.add_argument("--objects", type=Path, default=Path("objects"), help="folder of the objects")
    one.add_argument("--closing", action="store_true", help="tasks that close instead of open")
    one.add_argument("--out", type=Path, required=True, help="list of scenes")
    two = commands.add_parser("train", help="train on the accepted scenes")
    two.add_argument("--scenes", type=Path, required=True, help="list of scenes")
    two.add_argument("--rounds", type=int, default=12, help="rounds of DAgger")
    two.add_argument("--envs", type=int, default=560, help="environments, at least one per scene")
    two.add_argument("--batches", type=int, default=600, help="minibatches per round")
    two.add_argument("--final-batches", type=int, default=12_000, help="after the last round")
    two.add_argument("--seed", type=int, default=0)
    two.add_argument("--out", type=Path, default=WEIGHTS_FOLDER, help="folder of the weights")
    args = parser.parse_args(argv)
    if args.command == "train":
        return train(args)
    ids = procedural_ids(range(*args.seeds))
    items = [(i, write_procedural(i, args.objects), i.rpartition("-")[0]) for i in ids]
    for i in (f"{kind}-{seed:04d}" for seed in range(*args.panels) for kind in KINDS):
        items.append((i, write_panel(i, args.objects), i.rpartition("-")[0]))
    prepare(items, args.out, CLOSING_TASKS if args.closing else TASKS)
    return 0


WEIGHTS_FOLDER = Path(__file__).resolve().parents[1] / "train" / "articulate_train"

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
