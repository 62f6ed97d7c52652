"""What all engines on MuJoCo share: environments in buffers, and all of a tick but its substeps."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from articulate.errors import AssetError, EngineError
from articulate.robot.control import GripperState, filter_start, hand_start
from articulate.simulator import mujoco
from articulate.task.episode_monitor import WIDTH
from articulate.task.object_placement import handle_path_of
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import MAX_DELAY_STEPS
from articulate.transforms import Array, Ints, matrix_to_quat
from articulate_envs.compiled.begin import Hands, begin, times_of, write_due
from articulate_envs.compiled.motion import chain_of, see
from articulate_envs.compiled.observe import Shown, part_of, write_parts
from articulate_envs.engine import Start, State
from articulate_envs.native_mujoco import SharedModelArrays, copy_model
from articulate_envs.scene import Scene

KEPT_ACTIONS = MAX_DELAY_STEPS + 1
"""How many ticks of actions are kept."""
DIVERGED = 1e10
"""Speed from which a state counts as diverged [rad/s or m/s]; MuJoCo's own ``mjMAXVAL``."""


class Buffers(NamedTuple):
    """Arrays that a tick reads and writes, first axis N.

    ``filter`` (N, 7, 3), ``target`` (N, 7), ``closing`` and ``finger`` (N,), ``push`` (N, 3),
    ``samples`` (N, WIDTH), ``torque`` (N, 7), ``q`` and ``dq`` (N, 7), ``rest`` (N, 4): finger
    width, part position, part speed, and one until the environment diverges.
    """

    filter: Array
    target: Array
    closing: Array
    finger: Array
    push: Array
    samples: Array
    torque: Array
    q: Array
    dq: Array
    rest: Array


class BufferedEngine(ABC):
    """N environments, each with a model and a state of its own; see :class:`Engine`.

    A subclass says in :meth:`_advance` how a tick is run: targets moved by
    :func:`articulate_envs.compiled.motion.aim`, the substeps, and the tool's poses written as
    :meth:`_see` does. Snapshots of one fit another: they hold the same arrays.
    """

    def __init__(self, scene: Scene, n_envs: int) -> None:
        """Make N environments of ``scene``; call :meth:`reset` for all before stepping."""
        if len({model.nbuffer for model in scene.models}) > 1:
            raise AssetError(
                f"{scene.asset.name}: its collision hulls change with its size, so that sizes "
                "cannot be exchanged; set draw.scale to one size"
            )
        self.scene = scene
        self.n_envs = n_envs
        self._models = [copy.copy(scene.nominal) for _ in range(n_envs)]
        self._data = [mujoco.MjData(m) for m in self._models]
        self._sizes = np.zeros(n_envs, dtype=np.int64)
        self._order = np.arange(n_envs, dtype=np.int64)
        self._lenders = [SharedModelArrays(model) for model in scene.models] if n_envs > 1 else []
        self._buffers = _buffers(n_envs)
        start = hand_start(n_envs)
        self._hand = Hands(*(getattr(start, name) for name in Hands._fields))
        self._times = times_of(scene.arm.gripper, scene.control, scene.task.episode_s)
        self._actions = np.zeros((KEPT_ACTIONS, n_envs, 7))
        self._motion = np.zeros((n_envs, 7))
        self._yields = np.zeros(n_envs, dtype=bool)
        self._chain = chain_of(scene.arm, scene.control)
        self._tool, self._led = (np.tile(np.eye(4), (n_envs, 1, 1)) for _ in range(2))
        self._draw = np.zeros((n_envs, len(COLUMNS)))
        self._T_wo = np.tile(np.eye(4), (n_envs, 1, 1))
        self._tick = np.zeros(n_envs, dtype=np.int64)
        self._all = np.arange(n_envs, dtype=np.int64)
        joint = scene.asset.joint(scene.task.joint)
        self._closed, self._span = joint.closed, joint.span
        self._delay = np.zeros(n_envs, dtype=np.int64)
        self._due = np.zeros((n_envs, 7))
        self._shown = Shown(
            part=part_of(handle_path_of(scene.asset, scene.task.joint, flip=scene.place.flip)),
            T_wo=self._T_wo,
            scale=np.ones(n_envs),
            size=np.ones(n_envs),
            opened=np.zeros(n_envs),
            handle=np.tile(np.eye(4), (n_envs, 1, 1)),
        )

    @abstractmethod
    def _advance(self) -> None:
        """Run a tick in all environments, on what is in the buffers."""

    def _see(self, rows: Ints) -> None:
        """Write what follows from the buffers of environments ``rows``.

        That is the tool's poses at the joints and at the targets, the handle's, how far the part is
        open, and the motions that are due.
        """
        # By the functions that a tick uses: what is resumed goes on to the bit.
        b = self._buffers
        see(rows, b.q, b.target, self._chain, self._tool, self._led)
        write_parts(rows, b.rest, self._shown)
        write_due(rows, self._actions, self._delay, self._due)

    def reset(self, rows: Ints, start: Start) -> None:
        """Begin new episodes in environments ``rows`` (M,) of int."""
        rows = np.asarray(rows, dtype=np.int64)
        self._draw[rows] = start.params.values
        self._place(rows, start.params)
        for k, i in enumerate(rows):
            self._write_model(int(i), start.params.values[k])
            self._write_data(int(i), start, k)
        self._order[:] = np.argsort(self._sizes, kind="stable")
        b = self._buffers
        b.filter[rows] = filter_start(start.q)
        b.target[rows] = start.q
        b.closing[rows] = start.closing
        b.finger[rows] = start.width / 2.0
        b.push[rows] = 0.0
        b.samples[rows] = 0.0
        b.torque[rows] = 0.0
        b.q[rows] = start.q
        b.dq[rows] = 0.0
        b.rest[rows, 0] = start.width
        b.rest[rows, 1] = (self._closed + start.opened * self._span) * self._shown.size[rows]
        b.rest[rows, 2] = 0.0
        b.rest[rows, 3] = 1.0
        fresh = hand_start(len(rows))
        for name in Hands._fields:
            value = start.closing if name in ("wish", "closing") else getattr(fresh, name)
            getattr(self._hand, name)[rows] = value
        self._hand.smooth[rows] = 0.5 * np.maximum(start.closing, 0.0)
        self._actions[:, rows] = 0.0
        self._tick[rows] = 0
        self._see(rows)

    def _place(self, rows: Ints, drawn: EpisodeParams) -> None:
        scene = self.scene
        self._T_wo[rows] = scene.T_wo(drawn)
        self._shown.scale[rows] = drawn["scale"]
        if scene.task.kind == "slide":
            self._shown.size[rows] = drawn["scale"]
        for name in ("delay_steps", "estimate_delay_steps"):  # compiled code takes them on trust
            if not np.isin(drawn[name], np.arange(KEPT_ACTIONS)).all():
                raise EngineError(f"a draw's {name} must be whole numbers, 0 to {MAX_DELAY_STEPS}")
        self._delay[rows] = drawn["delay_steps"].astype(np.int64)

    def _write_model(self, i: int, row: Array) -> None:
        """Copy the model of the drawn size and write the drawn numbers into it."""
        scene, at, model = self.scene, self.scene.at, self._models[i]
        value = dict(zip(COLUMNS, row, strict=True))
        k = int(np.argmin(np.abs(np.asarray(scene.scales) - value["scale"])))
        self._sizes[i] = k
        copy_model(model, scene.models[k])
        if self._lenders:
            self._lenders[k].lend(model)
        arm_v = slice(at.arm_q, at.arm_q + 7)
        arm_u = slice(at.arm_ctrl, at.arm_ctrl + 7)
        object_v, moving = list(at.object_v), list(at.moving_bodies)
        model.geom_friction[list(at.finger_geoms), 0] *= value["friction"]
        model.dof_damping[object_v] *= value["joint_damping"]
        model.dof_frictionloss[object_v] *= value["joint_friction"]
        model.dof_armature[arm_v] *= value["armature"]
        model.body_mass[moving] *= value["mass"]
        model.body_inertia[moving] *= value["mass"]
        model.actuator_gainprm[arm_u, 0] *= value["stiffness"]
        model.actuator_biasprm[arm_u, 1] *= value["stiffness"]
        model.actuator_biasprm[arm_u, 2] *= value["damping"]
        model.body_pos[at.root_body] = self._T_wo[i, :3, 3]
        model.body_quat[at.root_body] = matrix_to_quat(self._T_wo[i, :3, :3])
        mujoco.mj_setConst(model, self._data[i])

    def _write_data(self, i: int, start: Start, k: int) -> None:
        scene, at, data = self.scene, self.scene.at, self._data[i]
        mujoco.mj_resetData(self._models[i], data)
        for joint in scene.asset.joints:
            own = scene.scales and joint.kind == "slide"
            size = self._shown.scale[i] if own else 1.0
            adr = self._models[i].joint(f"object/{joint.name}").qposadr[0]
            data.qpos[adr] = joint.closed * size
        data.qpos[at.part_q] = (self._closed + start.opened[k] * self._span) * self._shown.size[i]
        data.qpos[at.arm_q : at.arm_q + 7] = start.q[k]
        data.qpos[at.finger_q] = start.width[k] / 2.0
        data.qpos[at.finger_q + 1] = -start.width[k] / 2.0

    def step(self, action: Array) -> State:
        """Run one tick with actions (N, 8)."""
        begin(
            action,
            self._actions,
            self._delay,
            self._motion,
            self._yields,
            self._due,
            self._hand,
            self._draw,
            self._tick,
            self._times,
            self._buffers,
        )
        self._advance()
        self._tick += 1
        return self.state()

    def state(self) -> State:
        """What is true now; the arrays are copies."""
        b = self._buffers
        return State(
            q=b.q.copy(),
            dq=b.dq.copy(),
            target=b.target.copy(),
            gripper=GripperState(*(array.copy() for array in self._hand)),
            gripper_width=b.rest[:, 0].copy(),
            T_wt=self._tool.copy(),
            T_wt_target=self._led.copy(),
            T_wh=self._shown.handle.copy(),
            opened=self._shown.opened.copy(),
            speed=b.rest[:, 2] * np.sign(self._span),
            samples=b.samples.copy(),
            pending_actions=self._due.copy(),
        )

    def snapshot(self) -> dict[str, Array]:
        """All that resuming bit-identically needs; only arrays."""
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        size = mujoco.mj_stateSize(self._models[0], spec)
        physics = np.zeros((self.n_envs, size))
        for i in range(self.n_envs):
            mujoco.mj_getState(self._models[i], self._data[i], physics[i], spec)
        out = {f"buffer_{n}": getattr(self._buffers, n).copy() for n in Buffers._fields}
        out |= {f"hand_{n}": getattr(self._hand, n).copy() for n in Hands._fields}
        return out | {
            "physics": physics,
            "actions": self._actions.copy(),
            "draw": self._draw.copy(),
            "tick": self._tick.copy(),
        }

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        self._draw[:] = snapshot["draw"]
        self._place(self._all, EpisodeParams(self._draw))
        for i in range(self.n_envs):
            self._write_model(i, self._draw[i])
            mujoco.mj_resetData(self._models[i], self._data[i])
            mujoco.mj_setState(self._models[i], self._data[i], snapshot["physics"][i], spec)
        self._order[:] = np.argsort(self._sizes, kind="stable")
        for name in Buffers._fields:
            getattr(self._buffers, name)[:] = snapshot[f"buffer_{name}"]
        for name in Hands._fields:
            getattr(self._hand, name)[:] = snapshot[f"hand_{name}"]
        self._actions[:] = snapshot["actions"]
        self._tick[:] = snapshot["tick"]
        self._see(self._all)

    def physics_state(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Model and data of environment ``i``, for pictures: not to be changed or to outlive it."""
        return self._models[i], self._data[i]

    def object_pose(self, i: int) -> tuple[float, Array]:
        """Size and pose ``T_wo`` (4, 4) of the object in environment ``i``, for pictures."""
        return float(self._draw[i, COLUMNS.index("scale")]), self._T_wo[i].copy()

    def close(self) -> None:  # noqa: B027  engines without threads hold nothing
        """Give back what is held; closing twice is no harm."""


def _buffers(n: int) -> Buffers:
    return Buffers(
        filter=np.zeros((n, 7, 3)),
        target=np.zeros((n, 7)),
        closing=-np.ones(n),
        finger=np.full(n, 0.04),
        push=np.zeros((n, 3)),
        samples=np.zeros((n, WIDTH)),
        torque=np.zeros((n, 7)),
        q=np.zeros((n, 7)),
        dq=np.zeros((n, 7)),
        rest=np.zeros((n, 4)),
    )
