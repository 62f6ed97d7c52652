"""Study of the physics settings: how exact and how dear each of them is.

Drawn episodes from home are run once on the reference, 0.5 ms with a tight solver: a script that
reaches, closes, pulls and holds by inverse kinematics on an estimate that is wrong as drawn ones
are, or with ``--run`` the policies of a trained run. Their actions are recorded and replayed, as
they are, under every candidate. A row says how far the candidate comes from the reference over
the same episodes, and what a tick costs: processor time of follower, physics and judgement on one
thread, the candidates in turn, the median over ``--rounds``.

    python benchmarks/physics.py --json

``opened_mm``, ``tool_mm``
    Largest distance over an episode of the handle and of the tool from where they are in the
    reference: median and 90 % over the episodes.
``force_n``
    Difference of the episode's peak of filtered force, and (``force_bias_n``) to which side.
``same_verdict``
    Share of episodes that are judged as in the reference.
``cost``
    Of a tick, as a share of what it costs as shipped.

Some rows say how to read the others: ``0.25 ms`` is how far the reference is from its limit,
``start moved`` is the reference with every joint begun 1e-4 rad further, and so what no setting
can be asked to be nearer than; ``impratio``, ``noslip`` and ``pyramidal`` are other models of
friction, so that more steps would not bring them nearer. A step must divide the tick of 50 ms:
4 ms does not. With ``--asset`` the object's collision shapes are a candidate as well:
``--budgets`` are the largest numbers of shapes of a link.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from articulate.assets.asset import Asset
from articulate.cache import cache_folder, using
from articulate.conversion import ConvertConfig
from articulate.errors import UsageError
from articulate.files import write_json
from articulate.preparation.prepare import checked_asset
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import solve_ik, tool_pose
from articulate.simulator import mujoco
from articulate.task.episode_monitor import REASONS, judge_tick, judgement_start, verdict
from articulate.task.object_placement import ObjectPlacement, handle_in_world
from articulate.task.randomization import EpisodeParams, draw
from articulate.task.task import Task
from articulate.transforms import Array, Ints, axis_angle_to_matrix, pose
from articulate_envs.config import RewardConfig
from articulate_envs.engine import Start
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import home_start
from articulate_envs.joint_selection import choose_joint
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import Scene, build_scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.config import TrainConfig
from articulate_train.policy import load_policy
from articulate_train.run import open_run, prepare_asset
from gains import motion_to

PACKAGES = ("mujoco", "numpy", "numba")
SHIPPED = "shipped"
TIGHT = PhysicsConfig(timestep_s=0.0005, iterations=200, tolerance=1e-12)
"""Physics of the reference."""
STANDOFF_M = 0.1
REACH_TICKS, ENTER_TICKS, CLOSE_TICKS = 60, 20, 30
"""Ticks of the script to the place before the handle, to the handle, and until it pulls."""
PULL_M_S = 0.12
MISFIT_RAD = 0.01
"""Standard deviation of a constant error of each joint's target in the script."""
MOVED_RAD = 1e-4


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """Settings that are tried."""

    name: str
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    option: dict[str, int | float] = field(default_factory=dict)
    """Further fields of MuJoCo's options, over what ``physics`` writes."""
    disabled: int = 0
    """Further bits of MuJoCo's ``disableflags``."""
    moved_rad: float = 0.0
    """So far from the recorded start every joint begins [rad]."""
    max_geoms: int | None = None
    """Largest number of collision shapes of a link; None: as shipped."""
    timed: bool = True
    """Whether its cost is measured in every round."""


EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
CG = int(mujoco.mjtSolver.mjSOL_CG)
PGS = int(mujoco.mjtSolver.mjSOL_PGS)
REFERENCE = Candidate(name="0.5 ms, tight (reference)", physics=TIGHT, timed=False)


def candidates(budgets: list[int]) -> list[Candidate]:
    """All that is tried, the reference and the shipped settings first."""
    shipped = PhysicsConfig()
    bits = mujoco.mjtDisableBit

    def step(ms: float, **more: Any) -> Candidate:
        word = "".join(f", {key}" for key in more.pop("words", ()))
        physics = replace(shipped, timestep_s=ms / 1e3)
        return Candidate(name=f"{ms:g} ms{word}", physics=physics, **more)

    def setting(name: str, **values: Any) -> Candidate:
        return Candidate(name=name, physics=replace(shipped, **values))

    tight = replace(TIGHT, timestep_s=0.00025)
    return [
        REFERENCE,
        Candidate(name=SHIPPED),
        Candidate(name="0.25 ms, tight", physics=tight, timed=False),
        replace(REFERENCE, name="0.5 ms, tight, start moved", moved_rad=MOVED_RAD),
        *(step(ms) for ms in (10.0, 6.25, 2.5, 2.0, 1.0)),
        *(step(ms, words=("Euler",), option={"integrator": EULER}) for ms in (10.0, 5.0, 2.0, 1.0)),
        step(5.0, words=("implicit",), option={"integrator": IMPLICIT}),
        *(
            step(5.0, words=("CG", f"{n} iterations"), option={"solver": CG, "iterations": n})
            for n in (30, 100)
        ),
        step(5.0, words=("PGS", "100 iterations"), option={"solver": PGS, "iterations": 100}),
        *(setting(f"{n} iterations", iterations=n) for n in (2, 4, 8, 100)),
        *(setting(f"tolerance {t:g}", tolerance=t) for t in (1e-4, 1e-6, 1e-10)),
        setting("pyramidal", cone="pyramidal"),
        setting("pyramidal, impratio 1", cone="pyramidal", impratio=1.0),
        *(setting(f"impratio {r:g}", impratio=r) for r in (1.0, 10.0, 1000.0)),
        Candidate(name="noslip 3", option={"noslip_iterations": 3}),
        Candidate(name="one contact a pair", disabled=int(bits.mjDSBL_MULTICCD)),
        Candidate(name="libccd", disabled=int(bits.mjDSBL_NATIVECCD)),
        Candidate(name="no warm start", disabled=int(bits.mjDSBL_WARMSTART)),
        *(Candidate(name=f"at most {n} shapes a link", max_geoms=n) for n in budgets),
    ]


@dataclass(frozen=True)
class Stage:
    """What all candidates have in common."""

    config: TrainConfig
    source: Path
    asset: Asset
    task: Task
    place: ObjectPlacement
    cache: Path

    def scene(self, candidate: Candidate) -> Scene:
        """The scene under the candidate's settings; UsageError if its object is refused."""
        asset = self.asset
        if candidate.max_geoms is not None:
            wish = ConvertConfig(
                size_m=self.config.size,
                category=self.config.category,
                closed=self.config.closed,
                max_geoms=candidate.max_geoms,
            )
            asset = checked_asset(self.source, self.cache, wish)
        scene = build_scene(
            asset,
            self.task,
            arm=PANDA,
            follow=self.config.follow,
            physics=candidate.physics,
            place=self.place,
            scales=self.config.draw.scale_values,
        )
        for model in scene.models:
            for name, value in candidate.option.items():
                setattr(model.opt, name, value)
            model.opt.disableflags |= candidate.disabled
        return scene


class TimedEngine(ThreadEngine):
    """The batched engine on the calling thread, which adds up its processor time."""

    spent_s = 0.0

    def _advance(self) -> None:
        begin = time.thread_time()
        super()._advance()
        self.spent_s += time.thread_time() - begin


@dataclass(frozen=True)
class Outcome:
    """What N episodes came to."""

    handle_w: Array
    """Where the handle is at each tick (T, N, 3) [m]."""
    tool_w: Array
    """Where the tool is at each tick (T, N, 3) [m]."""
    peak_n: Array
    """Largest filtered force (N,) [N]."""
    code: Ints
    """Verdicts (N,)."""
    held: Array
    """Fraction open at the end (N,)."""
    tick_us: float
    """Processor time of a tick of one environment [us]."""


def replay(
    engine: TimedEngine, start: Start, act: Callable[[int], Array], ticks: int
) -> tuple[Outcome, Array]:
    """Run episodes from ``start``; what came of them, and the actions (T, N, 8) that were taken."""
    n, scene = engine.n_envs, engine.scene
    engine.reset(np.arange(n, dtype=np.int64), start)
    engine.spent_s = 0.0
    judgement = judgement_start(n)
    handle_w, tool_w = np.zeros((ticks, n, 3)), np.zeros((ticks, n, 3))
    taken = np.zeros((ticks, n, 8))
    for t in range(ticks):
        taken[t] = np.clip(act(t), -1.0, 1.0)
        state = engine.step(taken[t])
        judgement = judge_tick(
            judgement,
            state.samples,
            scene.task,
            opened=state.opened,
            speed=state.speed,
            tick_s=scene.follow.tick_s,
        )
        handle_w[t] = state.T_wh[:, :3, 3]
        tool_w[t] = tool_pose(scene.arm, state.q)[:, :3, 3]
    outcome = Outcome(
        handle_w=handle_w,
        tool_w=tool_w,
        peak_n=judgement.peak("force"),
        code=verdict(judgement, scene.task),
        held=engine.state().opened,
        tick_us=1e6 * engine.spent_s / (ticks * n),
    )
    return outcome, taken


def script(scene: Scene, start: Start, rng: np.random.Generator) -> tuple[Array, Array]:
    """Joint goals (T, N, 7) and hand commands (T, N) of an episode: reach, close, pull, hold."""
    task, ticks, drawn, q = scene.task, scene.ticks, start.draw, start.q
    goals, hand = np.zeros((ticks, *q.shape)), -np.ones((ticks, len(q)))
    before = _goal(scene, drawn, start.opened) @ pose(np.array([0.0, 0.0, -STANDOFF_M]))
    first = solve_ik(scene.arm, before, q, iterations=80).q
    share = np.linspace(0.0, 1.0, REACH_TICKS + 1)[1:, None, None]
    goals[:REACH_TICKS] = (q + share * (first - q))[:ticks]
    at, q = REACH_TICKS, first
    for t in range(at, ticks):
        near = min((t - at + 1) / ENTER_TICKS, 1.0)
        pulled = (t - at - ENTER_TICKS - CLOSE_TICKS + 1) / _pull_ticks(scene, start)
        beyond = 1.02 * task.target if not task.closes else 0.5 * task.target
        opened = start.opened + (beyond - start.opened) * np.clip(pulled, 0.0, 1.0)
        back = pose(np.array([0.0, 0.0, -STANDOFF_M * (1.0 - near)]))
        goal = _goal(scene, drawn, opened) @ back
        q = solve_ik(scene.arm, goal, q, iterations=4, rest_gain=0.0).q
        goals[t] = q
    hand[at + ENTER_TICKS :] = 1.0
    grow = np.minimum(np.arange(ticks) / REACH_TICKS, 1.0)[:, None, None]
    return goals + grow * MISFIT_RAD * rng.normal(size=start.q.shape), hand


def _goal(scene: Scene, drawn: EpisodeParams, opened: Array) -> Array:
    """Where the hand holds the handle (N, 4, 4), as a wrong estimate has it."""
    T_wo = scene.T_wo(drawn)
    goal = handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=T_wo,
        scale=drawn["scale"],
        opened=opened,
        flip=scene.place.flip,
    )
    turn = axis_angle_to_matrix(np.array([[0.0, 0.0, 1.0]]), drawn["bias_yaw_rad"])
    goal[:, :3, :3] = turn @ goal[:, :3, :3]
    goal[:, :3, 3] += drawn["bias"]
    return np.asarray(goal)


def _pull_ticks(scene: Scene, start: Start) -> float:
    """Ticks that the way of the handle takes at the script's speed, as many as there are."""
    spots = [
        _goal(scene, start.draw, start.opened + (scene.task.target - start.opened) * k / 8)
        for k in range(9)
    ]
    way = sum(np.linalg.norm(b[:, :3, 3] - a[:, :3, 3], axis=1).mean() for a, b in pairwise(spots))
    left = scene.ticks - REACH_TICKS - ENTER_TICKS - CLOSE_TICKS - 20
    return float(max(min(way / PULL_M_S * scene.follow.rate_hz, left), 1.0))


def recorded(stage: Stage, run: Path | None, args: argparse.Namespace) -> tuple[Start, Array]:
    """Starts and actions (T, N, 8) of episodes on the reference."""
    scene = stage.scene(REFERENCE)
    rng = np.random.default_rng(args.seed)
    start = home_start(scene, draw(stage.config.draw, rng, args.episodes, begin=scene.task.begin))
    engine = TimedEngine(scene, args.episodes)
    if run is not None:
        return start, _policy_actions(stage, engine, start, run, args)
    goals, hand = script(scene, start, rng)

    def act(t: int) -> Array:
        motion = motion_to(scene, engine.state().target, goals[t])
        return np.column_stack([motion, hand[t]])

    return start, replay(engine, start, act, args.ticks or scene.ticks)[1]


def _policy_actions(
    stage: Stage, engine: TimedEngine, start: Start, run: Path, args: argparse.Namespace
) -> Array:
    """Mean actions (T, N, 8) of a trained policy."""
    policy = load_policy(open_run(run).seed_folder(args.policy))
    draws = stage.config.draw
    env = Episodes(
        engine, draws=draws, reward=RewardConfig(), starts=None, seed=args.seed, renew=False
    )
    seen, taken = env.reset(start=start), []
    for _ in range(args.ticks or engine.scene.ticks):
        taken.append(np.clip(policy.act(seen), -1.0, 1.0))
        seen = env.step(taken[-1]).observation
    return np.stack(taken)


def difference(mine: Outcome, reference: Outcome, limit_n: float) -> dict[str, Any]:
    """How far a candidate's episodes are from the reference's."""
    opened = 1e3 * np.linalg.norm(mine.handle_w - reference.handle_w, axis=2).max(axis=0)
    tool = 1e3 * np.linalg.norm(mine.tool_w - reference.tool_w, axis=2).max(axis=0)
    force = np.abs(mine.peak_n - reference.peak_n)
    out: dict[str, Any] = {}
    for name, values in (("opened_mm", opened), ("tool_mm", tool), ("force_n", force)):
        out[f"{name}_median"] = round(float(np.median(values)), 4)
        out[f"{name}_p90"] = round(float(np.quantile(values, 0.9)), 4)
    over = mine.peak_n > limit_n
    return out | {
        "force_bias_n": round(float(np.median(mine.peak_n - reference.peak_n)), 3),
        "over_limit": round(float(over.mean()), 4),
        "same_verdict": round(float((mine.code == reference.code).mean()), 4),
        "success": round(float((mine.code == 0).mean()), 4),
    }


def study(stage: Stage, run: Path | None, args: argparse.Namespace) -> dict[str, Any]:
    """Rows of all candidates on one object."""
    start, actions = recorded(stage, run, args)
    tell(f"{stage.asset.name}: {args.episodes} episodes recorded")
    budgets = [] if stage.asset.name == "cabinet" and not args.asset else args.budgets
    engines: dict[str, TimedEngine] = {}
    refused, chosen = [], {}
    for c in candidates(budgets):
        if args.only and c.timed and not any(word in c.name for word in (*args.only, SHIPPED)):
            continue
        try:
            engines[c.name] = TimedEngine(stage.scene(c), args.episodes)
            chosen[c.name] = c
        except UsageError as error:
            refused.append({"setting": c.name, "reason": str(error)})
    outcomes: dict[str, Outcome] = {}
    spent: dict[str, list[float]] = {name: [] for name in engines}
    for k in range(args.rounds):
        for name, engine in engines.items():
            if k > 0 and not chosen[name].timed:
                continue
            begun = replace(start, q=start.q + chosen[name].moved_rad)
            outcome, _ = replay(engine, begun, actions.__getitem__, len(actions))
            outcomes.setdefault(name, outcome)
            spent[name].append(outcome.tick_us)
        tell(f"{stage.asset.name}: round {k + 1} of {args.rounds}")
    reference = outcomes[REFERENCE.name]
    shipped_us = median(spent[SHIPPED])
    rows = [
        {
            "setting": name,
            "tick_us": round(median(spent[name]), 1),
            "cost": round(median(spent[name]) / shipped_us, 3),
            **difference(outcome, reference, stage.task.limits.force_n),
            "shapes": int(engines[name].scene.nominal.ngeom),
            "physics": asdict(chosen[name].physics) | chosen[name].option,
        }
        for name, outcome in outcomes.items()
    ]
    return {
        "object": stage.asset.name,
        "task": stage.task.name,
        "joint": stage.task.joint,
        "actions": "script" if run is None else "policy",
        "episodes": args.episodes,
        "ticks": len(actions),
        "reference_verdicts": _counted(reference.code),
        "reference_peak_n": [
            round(float(np.quantile(reference.peak_n, q)), 2) for q in (0.1, 0.5, 0.9)
        ],
        "rows": rows,
        "refused": refused,
    }


def _counted(code: Ints) -> dict[str, int]:
    return dict(Counter(REASONS[int(c)] for c in code).most_common())


def stages(args: argparse.Namespace, folder: Path) -> list[tuple[Stage, Path | None]]:
    """Objects, and the run that an object comes from."""
    cache = cache_folder()
    out: list[tuple[Stage, Path | None]] = []
    for path in args.run:
        run = open_run(path)
        out.append(
            (Stage(run.config, run.asset.folder, run.asset, run.task, run.place, cache), path)
        )
    sources = list(args.asset)
    if not sources and not args.run:
        from articulate.library.procedural.cabinet import embedded_cabinet

        sources = [embedded_cabinet(folder / "cabinet")]
    for source in sources:
        config = TrainConfig(asset=str(source), task=args.task)
        asset = prepare_asset(config, cache)
        task, place = choose_joint(config, asset)
        out.append((Stage(config, source, asset, task, place, cache), None))
    return out


COLUMNS = (
    "tick_us", "cost", "opened_mm_median", "opened_mm_p90", "tool_mm_median", "tool_mm_p90",
    "force_n_median", "force_n_p90", "force_bias_n", "same_verdict", "success",
)  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """One object's rows as Markdown."""
    lines = ["| setting | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    for row in result["rows"]:
        lines.append(f"| {row['setting']} | " + " | ".join(f"{row[c]:g}" for c in COLUMNS) + " |")
    return "\n".join(lines)


def tell(line: str) -> None:
    """A line of progress."""
    print(line, file=sys.stderr, flush=True)


def main() -> int:
    """Print the tables, or all of it as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--asset", type=Path, nargs="*", default=[], help="objects of the script")
    parser.add_argument("--task", default="open_drawer", help="task of --asset")
    parser.add_argument("--run", type=Path, nargs="*", default=[], help="runs whose policies act")
    parser.add_argument("--policy", type=int, default=0, help="seed of those runs")
    parser.add_argument("--episodes", type=int, default=96)
    parser.add_argument("--ticks", type=int, help="length of an episode; the task's by default")
    parser.add_argument("--rounds", type=int, default=5, help="timings of each setting")
    parser.add_argument("--seed", type=int, default=0, help="of what is drawn")
    parser.add_argument("--budgets", type=int, nargs="*", default=[8, 16, 96])
    parser.add_argument("--only", nargs="*", default=[], help="settings with these words only")
    parser.add_argument("--out", type=Path, help="write the JSON there as well")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    args = parser.parse_args()
    load_before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name, using(cache_folder()):
        objects = [study(stage, run, args) for stage, run in stages(args, Path(name))]
    result = {
        "command": " ".join(["python", "benchmarks/physics.py", *sys.argv[1:]]),
        "shipped": asdict(PhysicsConfig()) | {"solver": "Newton", "integrator": "implicitfast"},
        "objects": objects,
        "cpus": len(os.sched_getaffinity(0)),
        "load_before": load_before,
        "load_after": os.getloadavg()[0],
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }
    if args.out is not None:
        write_json(args.out, result)
    print(json.dumps(result, indent=1) if args.json else "\n\n".join(map(table, objects)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
