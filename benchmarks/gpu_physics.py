"""What MuJoCo Warp does with our scenes: does it take them, how near it comes, how fast it is.

    python benchmarks/gpu_physics.py record --out recorded.npz [--asset FILE --task NAME]
    python benchmarks/gpu_physics.py run recorded.npz --json

``record`` needs this project: it runs drawn episodes that reach, close, pull and hold (the script
of ``physics.py``) on the batched engine and keeps each episode's model, start, and what is
written into it before every physics step. ``run`` needs none of it, only ``numpy``, ``mujoco``,
and for the part on Warp ``mujoco-warp`` and ``warp-lang`` (extra ``warp``), so that the file can be
taken to a machine with a GPU. Each world is one of the recorded episodes, with its own masses,
friction, damping, gains and place of the object; all are of one size, as Warp's meshes are shared.

``taken``
    Whether ``mujoco_warp.put_model`` takes the model; its own words if not. One flag of ours is
    cleared before: it knows no ``mjDSBL_AUTORESET``, and does not reset by itself.
``nearness``
    Largest distance of the driven part's joint and of the arm's from MuJoCo's, over the episodes:
    median and 90 %, within a tick, a second, and the whole episode (mm or mrad; mrad).
    ``rounded`` is MuJoCo itself with starts and models rounded to single precision, which no
    engine that computes in it can be asked to beat; ``same_end`` the share of episodes whose
    joint ends within 2 % of its way.
``same_state``
    MuJoCo's episodes are stopped every half second and Warp is put at the same states: contacts of
    both where MuJoCo has any, and the largest difference of an acceleration (m/s^2, rad/s^2)
    where neither has contacts, where both have as many, and where they have not.
``warp_steps_per_s``
    Environment steps (ticks of 50 ms) a second over whole episodes, by number of worlds: a tick is
    one captured graph, controls are on the device already. ``exchanged`` takes the controls of
    each tick from the host, and positions, velocities and sensors back to it, as a policy would.
``mj_step_steps_per_s``
    ``mj_step`` alone of the same episodes on ``--threads`` threads of the same machine
    (``mujoco.rollout``, with its warm start).
``most``
    The most contacts of a tick, in the mean over worlds, and constraint rows of any world, of what
    was allocated.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import platform
import sys
import tempfile
import time
from dataclasses import fields, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

os.environ.setdefault("MUJOCO_GL", "disable")

import mujoco  # noqa: TID251 - `run` goes without this project
from mujoco import rollout  # noqa: TID251

PACKAGES = ("mujoco", "mujoco-warp", "warp-lang", "numpy")
CONTACTS, ROWS = 60, 260
"""Contacts and constraint rows that are allocated for each world."""
BEGUN = ("qpos", "qvel")
"""What an episode begins with."""
SEEN_TICKS = 10
"""So often states are compared."""
PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_XFRC_APPLIED)
Array = np.ndarray[Any, Any]


def record(args: argparse.Namespace) -> None:
    """Write the recorded episodes of one object."""
    from articulate.cache import cache_folder, using
    from articulate.task.randomization import at_size
    from articulate_envs.native_mujoco import DRAWN
    from engine import Recorded, RecordingEngine
    from physics import Candidate, recorded, stages

    with tempfile.TemporaryDirectory() as name, using(cache_folder()):
        stage, _ = stages(args, Path(name))[0]
        config = replace(stage.config, draw=at_size(stage.config.draw, 1.0))
        stage = replace(stage, config=config)
        start, actions = recorded(stage, None, args)
        scene = stage.scene(Candidate(name="shipped"))
    engine = RecordingEngine(scene, args.episodes, threads=1)
    engine.reset(np.arange(args.episodes, dtype=np.int64), start)
    models, data = engine._models, engine._data
    kept = {name: np.stack([getattr(m, name) for m in models]) for name in DRAWN}
    kept = {f"drawn_{name}": value for name, value in kept.items() if value.size}
    kept |= {name: np.stack([getattr(d, name) for d in data]) for name in ("qpos", "qvel")}
    engine.recorded = Recorded()
    for action in actions:
        engine.step(action)
    controls, pushes = engine.recorded.controls(scene)
    joint = scene.asset.joint(scene.task.joint)
    np.savez_compressed(
        args.out,
        model=_saved(scene.nominal),
        name=np.array(f"{scene.task.name} {stage.asset.name}"),
        controls=controls.astype(np.float32),
        pushes=pushes.astype(np.float32),
        part=np.array([scene.at.part_q, scene.at.part_body]),
        arm=np.array(scene.at.arm_q),
        way=np.array(abs(joint.span)),
        unit=np.array("mm" if joint.kind == "slide" else "mrad"),
        **kept,  # type: ignore[arg-type]  # taken for its only named argument
    )
    engine.close()


def _saved(model: mujoco.MjModel) -> Array:
    """A model as MuJoCo saves it."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "model.mjb"
        mujoco.mj_saveModel(model, str(path))
        return np.frombuffer(path.read_bytes(), dtype=np.uint8)


class Episodes:
    """Recorded episodes of one object."""

    def __init__(self, path: Path) -> None:
        with np.load(path) as kept:
            self.arrays: dict[str, Array] = {name: kept[name] for name in kept.files}
        with tempfile.TemporaryDirectory() as name:
            saved = Path(name) / "model.mjb"
            saved.write_bytes(self.arrays.pop("model").tobytes())
            self.model = mujoco.MjModel.from_binary_path(str(saved))
        self.name, self.unit = str(self.arrays["name"]), str(self.arrays["unit"])
        self.part_q, self.part_body = (int(k) for k in self.arrays["part"])
        arm = int(self.arrays["arm"])
        self.shown = [self.part_q, *range(arm, arm + 7)]
        self.way = 1e3 * float(self.arrays["way"])
        self.controls, self.pushes = self.arrays["controls"], self.arrays["pushes"]
        self.n, self.ticks, self.substeps = self.controls.shape[:3]

    @property
    def drawn(self) -> dict[str, Array]:
        """Fields of the models in which the episodes differ."""
        names = [name for name in self.arrays if name.startswith("drawn_")]
        return {name.removeprefix("drawn_"): self.arrays[name] for name in names}

    def models(self, kind: type) -> list[mujoco.MjModel]:
        """The model of each episode, what is drawn rounded to ``kind``."""
        out = [copy.copy(self.model) for _ in range(self.n)]
        for name, values in self.drawn.items():
            for model, value in zip(out, values, strict=True):
                getattr(model, name)[...] = value.astype(kind)
        return out


class OnMuJoCo:
    """``mj_step`` of ``n`` episodes, the recorded ones again and again, and nothing else."""

    def __init__(self, episodes: Episodes, n: int, threads: int, *, rounded: bool = False) -> None:
        self.of, rows = episodes, np.arange(n) % episodes.n
        kind = np.float32 if rounded else np.float64
        few = episodes.models(kind)
        self.models = [few[k] for k in rows]
        self.data = [mujoco.MjData(episodes.model) for _ in range(threads)]
        nq, nv, nu = episodes.model.nq, episodes.model.nv, episodes.model.nu
        self.begin = np.zeros((n, mujoco.mj_stateSize(episodes.model, PHYSICS)))
        self.begin[:, 1 : 1 + nq] = episodes.arrays["qpos"].astype(kind)[rows]
        self.begin[:, 1 + nq : 1 + nq + nv] = episodes.arrays["qvel"].astype(kind)[rows]
        steps = episodes.ticks * episodes.substeps
        self.control = np.zeros((n, steps, nu + 6 * episodes.model.nbody))
        self.control[:, :, :nu] = episodes.controls.reshape(-1, steps, nu)[rows]
        at = nu + 6 * episodes.part_body
        pushes = np.repeat(episodes.pushes, episodes.substeps, axis=1)
        self.control[:, :, at : at + 3] = pushes[rows]

    def run(self) -> tuple[Array, float]:
        """Part's and arm's joints after each tick (n, T, 8), and the time of all of it [s]."""
        clock = time.perf_counter()
        states, _ = rollout.rollout(
            self.models,
            self.data,
            self.begin,
            self.control,
            control_spec=CONTROLS,
            persistent_pool=True,
        )
        seconds = time.perf_counter() - clock
        ends = states[:, self.of.substeps - 1 :: self.of.substeps]
        return np.asarray(ends[:, :, [1 + k for k in self.of.shown]]), seconds


class OnWarp:
    """The same episodes as worlds of MuJoCo Warp, repeated until there are ``n_worlds``."""

    def __init__(self, episodes: Episodes, n_worlds: int) -> None:
        import mujoco_warp as mjw
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        self.of, self.n, self.mjw, self.wp = episodes, n_worlds, mjw, wp
        model, rows = copy.copy(episodes.model), np.arange(n_worlds) % episodes.n
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        self.model = mjw.put_model(model)
        for name, values in episodes.drawn.items():
            self._each(name, values[rows])
        data = mujoco.MjData(model)
        self.data = mjw.put_data(model, data, nworld=n_worlds, nconmax=CONTACTS, njmax=ROWS)
        self.begin = {name: episodes.arrays[name][rows].astype(np.float32) for name in BEGUN}
        controls = episodes.controls.transpose(1, 2, 0, 3)[:, :, rows]
        self.controls = [[np.ascontiguousarray(c) for c in tick] for tick in controls]
        self.on_device = [[wp.array(c, dtype=float) for c in tick] for tick in self.controls]
        self.pushes = np.zeros((episodes.ticks, n_worlds, 6), dtype=np.float32)
        self.pushes[:, :, :3] = episodes.pushes[rows].swapaxes(0, 1)
        self.forces = wp.array(self.pushes, dtype=wp.spatial_vector)
        self.slots = [wp.zeros_like(self.data.ctrl) for _ in range(episodes.substeps)]
        self.pushed = self.data.xfrc_applied[:, episodes.part_body]
        self.graph: Any = None

    def _each(self, name: str, values: Array) -> None:
        """Give each world its own numbers of the model's field ``name``, if Warp has it.

        It has not what MuJoCo computes from other fields and Warp computes anew or never reads:
        ``dof_M0``, ``dof_length``, ``actuator_length0``.
        """
        if name not in {f.name for f in fields(self.model)}:
            return
        field = getattr(self.model, name)
        flat = np.ascontiguousarray(values.astype(np.float32))
        setattr(self.model, name, self.wp.array(flat, dtype=field.dtype))

    def reset(self) -> None:
        """Put all worlds at their beginning."""
        self.mjw.reset_data(self.model, self.data)
        for name, values in self.begin.items():
            getattr(self.data, name).assign(values)
        self.data.time.zero_()

    def _substeps(self) -> None:
        for slot in self.slots:
            self.wp.copy(self.data.ctrl, slot)
            self.mjw.step(self.model, self.data)

    def capture(self) -> float:
        """Compile kernels and capture a tick; the time it took [s]."""
        clock = time.perf_counter()
        self.reset()
        self.load(0)
        self._substeps()
        if self.wp.get_device().is_cuda:
            with self.wp.ScopedCapture() as captured:
                self._substeps()
            self.graph = captured.graph
        self.wp.synchronize()
        return time.perf_counter() - clock

    def load(self, tick: int, *, host: bool = False) -> None:
        """Take a tick's controls and pushes, which are on the device, or from the host."""
        kept = self.controls if host else self.on_device
        for slot, values in zip(self.slots, kept[tick], strict=True):
            slot.assign(values)
        self.pushed.assign(self.forces[tick])

    def tick(self) -> None:
        """A tick of all worlds."""
        if self.graph is not None:
            self.wp.capture_launch(self.graph)
        else:
            self._substeps()

    def run(self, ticks: int) -> tuple[Array, Array]:
        """As :meth:`OnMuJoCo.run`, and most contacts of all worlds and rows of one (2,)."""
        self.reset()
        joint, most = np.zeros((self.n, ticks, 8)), np.zeros(2)
        for t in range(ticks):
            self.load(t)
            self.tick()
            joint[:, t] = self.data.qpos.numpy()[:, self.of.shown]
            most = np.maximum(most, [self.data.nacon.numpy()[0], self.data.nefc.numpy().max()])
        return joint, most

    def rate(self, ticks: int, *, exchanged: bool) -> float:
        """Environment steps a second of the first ``ticks`` ticks."""
        self.reset()
        self.wp.synchronize()
        clock = time.perf_counter()
        for t in range(ticks):
            self.load(t, host=exchanged)
            self.tick()
            if exchanged:
                for name in ("qpos", "qvel", "sensordata"):
                    getattr(self.data, name).numpy()
        self.wp.synchronize()
        return self.n * ticks / (time.perf_counter() - clock)


def same_state(warp: OnWarp) -> dict[str, Any]:
    """Contacts and accelerations of both at the states that MuJoCo's episodes pass through."""
    e, models = warp.of, warp.of.models(np.float64)
    data = [mujoco.MjData(e.model) for _ in models]
    for k, d in enumerate(data):
        d.qpos[:], d.qvel[:] = e.arrays["qpos"][k], e.arrays["qvel"][k]
    kinds: dict[str, list[float]] = {"none": [], "as_many": [], "fewer_or_more": []}
    counts: list[tuple[int, int]] = []
    for t in range(e.ticks):
        if t % SEEN_TICKS == 0:
            _write(e, data, t, 0)
            for m, d in zip(models, data, strict=True):
                mujoco.mj_forward(m, d)
            for d, n, apart in zip(data, *_at_states(warp, data), strict=True):
                kind = "none" if d.ncon == n == 0 else "as_many" if d.ncon == n else "fewer_or_more"
                kinds[kind].append(float(apart))
                counts += [(d.ncon, int(n))] if d.ncon > 0 else []
        for s in range(e.substeps):
            _write(e, data, t, s)
            for m, d in zip(models, data, strict=True):
                mujoco.mj_step(m, d)
    out: dict[str, Any] = {"states": sum(map(len, kinds.values())), "in_contact": len(counts)}
    if counts:
        out["contacts"], out["contacts_warp"] = np.mean(counts, axis=0).tolist()
    for kind, values in kinds.items():
        out[kind] = {"states": len(values)}
        if values:
            out[kind] |= {"median": median(values), "p90": float(np.quantile(values, 0.9))}
    return out


def _write(episodes: Episodes, data: list[mujoco.MjData], tick: int, substep: int) -> None:
    """What is written into each episode's data before a physics step."""
    for d, ctrl, push in zip(data, episodes.controls, episodes.pushes, strict=True):
        d.ctrl[:] = ctrl[tick, substep]
        d.xfrc_applied[episodes.part_body, :3] = push[tick]


def _at_states(warp: OnWarp, data: list[mujoco.MjData]) -> tuple[Array, Array]:
    """Warp's contacts (N,), and how far its accelerations are from those of ``data`` (N,)."""
    warp.mjw.reset_data(warp.model, warp.data)
    for name in ("qpos", "qvel", "ctrl", "xfrc_applied"):
        values = np.stack([getattr(d, name) for d in data]).astype(np.float32)
        getattr(warp.data, name).assign(values)
    warp.mjw.forward(warp.model, warp.data)
    world = warp.data.contact.worldid.numpy()[: int(warp.data.nacon.numpy()[0])]
    apart = warp.data.qacc.numpy() - np.stack([d.qacc for d in data])
    return np.bincount(world, minlength=len(data)), np.abs(apart).max(axis=1)


def nearness(mine: Array, exact: Array, way: float) -> dict[str, Any]:
    """How far joints (N, T, 8), the part's first, are from MuJoCo's [mm or mrad; mrad]."""
    apart = 1e3 * np.abs(mine - exact)
    out: dict[str, Any] = {"not_finite": int((~np.isfinite(apart)).any(axis=(1, 2)).sum())}
    apart = np.where(np.isfinite(apart), apart, way)
    for name, ticks in (("tick", 1), ("second", 20), ("episode", apart.shape[1])):
        for what, joints in (("part", slice(0, 1)), ("arm", slice(1, 8))):
            largest = apart[:, :ticks, joints].max(axis=(1, 2))
            out[f"{what}_{name}_median"] = float(np.median(largest))
            out[f"{what}_{name}_p90"] = float(np.quantile(largest, 0.9))
    return out | {"same_end": float((apart[:, -1, 0] < 0.02 * way).mean())}


def measured(path: Path, args: argparse.Namespace) -> dict[str, Any]:
    """All figures of one recording."""
    episodes = Episodes(path)
    ticks = min(args.ticks, episodes.ticks)
    model = episodes.model
    out: dict[str, Any] = {
        "scene": episodes.name,
        "episodes": episodes.n,
        "ticks": ticks,
        "substeps": episodes.substeps,
        "model": {name: int(getattr(model, name)) for name in ("nq", "nv", "nu", "ngeom", "nmesh")},
        "unit": episodes.unit,
    }
    exact, _ = OnMuJoCo(episodes, episodes.n, args.threads).run()
    rounded, _ = OnMuJoCo(episodes, episodes.n, args.threads, rounded=True).run()
    many = OnMuJoCo(episodes, args.alone, args.threads)
    seconds = [many.run()[1] for _ in range(args.rounds)]
    del many
    out["mj_step_steps_per_s"] = args.alone * episodes.ticks / median(seconds)
    out["nearness"] = {"rounded": nearness(rounded[:, :ticks], exact[:, :ticks], episodes.way)}
    tell(f"{episodes.name}: mj_step {out['mj_step_steps_per_s']:.0f} env-steps/s")
    if packages()["mujoco-warp"] == "not installed":
        out["taken"] = "not tried: mujoco-warp is not installed"
        return out
    try:
        few = OnWarp(episodes, episodes.n)
    except NotImplementedError as error:  # what Warp says of models that it does not take
        out["taken"] = str(error)
        tell(f"{episodes.name}: {error}")
        return out
    on_warp(out, few, exact[:, :ticks], args)
    return out


def on_warp(out: dict[str, Any], few: OnWarp, exact: Array, args: argparse.Namespace) -> None:
    """Add what Warp does with the episodes to ``out``; ``few`` holds each of them once."""
    import warp as wp

    episodes, ticks = few.of, exact.shape[1]
    out["device"] = wp.get_device().name
    out["taken"] = "yes"
    out["compile_s"] = few.capture()
    joint, most = few.run(ticks)
    out["nearness"]["warp"] = nearness(joint, exact, episodes.way)
    out["same_state"] = same_state(few)
    out["most"] = {
        "contacts": float(most[0]) / episodes.n,
        "of": CONTACTS,
        "rows": int(most[1]),
        "of_rows": ROWS,
    }
    tell(f"{episodes.name}: compiled in {out['compile_s']:.0f} s, {out['same_state']}")
    rates: dict[str, dict[str, float]] = {
        "warp_steps_per_s": {},
        "exchanged": {},
        "mb_per_world": {},
    }
    out |= rates
    for n in args.worlds:
        free = wp.get_device().free_memory if wp.get_device().is_cuda else 0
        many = OnWarp(episodes, n)
        many.capture()
        if wp.get_device().is_cuda:
            held = (free - wp.get_device().free_memory) / 1e6 / n
            rates["mb_per_world"][str(n)] = held
        runs = [many.rate(ticks, exchanged=False) for _ in range(args.rounds)]
        rates["warp_steps_per_s"][str(n)] = median(runs)
        rates["exchanged"][str(n)] = many.rate(ticks, exchanged=True)
        tell(f"{episodes.name}: {n} worlds {median(runs):.0f} env-steps/s")
        del many


def tell(line: str) -> None:
    """A line of progress."""
    print(line, file=sys.stderr, flush=True)


def packages() -> dict[str, str]:
    """Versions of what decides the figures."""
    out = {}
    for name in PACKAGES:
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            out[name] = "not installed"
    return out


def run(args: argparse.Namespace) -> None:
    """Measure each recording and print, or write after each of them."""
    result: dict[str, Any] = {
        "command": " ".join(["python", "benchmarks/gpu_physics.py", *sys.argv[1:]]),
        "threads": args.threads,
        "cpus": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "versions": packages(),
        "scenes": [],
    }
    for path in args.recordings:
        result["scenes"].append(measured(path, args))
        if args.out is not None:
            args.out.write_text(json.dumps(result, indent=1) + "\n")
    if args.json:
        print(json.dumps(result, indent=1))


def main() -> int:
    """Record, or run what was recorded."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    verbs = parser.add_subparsers(required=True)
    one = verbs.add_parser("record", help="record one object's episodes")
    one.add_argument(
        "--asset", type=Path, nargs="*", default=[], help="the embedded cabinet if none"
    )
    one.add_argument("--task", default="open_drawer")
    one.add_argument("--episodes", type=int, default=64)
    one.add_argument("--ticks", type=int, help="length of an episode; the task's by default")
    one.add_argument("--seed", type=int, default=0, help="of what is drawn")
    one.add_argument("--out", type=Path, required=True)
    one.set_defaults(act=record, run=[])
    two = verbs.add_parser("run", help="measure recordings")
    two.add_argument("recordings", type=Path, nargs="+")
    two.add_argument("--ticks", type=int, default=200, help="at most so many of each episode")
    two.add_argument("--worlds", type=int, nargs="*", default=[64, 1024, 4096, 16384])
    two.add_argument("--alone", type=int, default=256, help="episodes of mj_step alone")
    two.add_argument("--rounds", type=int, default=3)
    two.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    two.add_argument("--out", type=Path, help="write the JSON there as well")
    two.add_argument("--json", action="store_true", help="print the result as JSON")
    two.set_defaults(act=run)
    args = parser.parse_args()
    args.act(args)
    return 0


if __name__ == "__main__":
    sys.exit(main())
