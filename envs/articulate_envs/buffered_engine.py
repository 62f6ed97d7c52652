"""Common part of all engines on MuJoCo: environments in buffers, and all but the physics steps."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from articulate.errors import AssetError, EngineError
from articulate.robot.control import (
    discretize_filter,
    filter_start,
    finger_params,
    force_limits,
    gripper_params,
    new_action_delay,
    new_gripper_state,
    target_params,
)
from articulate.simulator import mujoco
from articulate.task.episode_monitor import WIDTH, monitor_params
from articulate.task.object_placement import handle_path_of
from articulate.task.randomization import COLUMNS, EpisodeParams, randomize_model
from articulate.task.randomization_config import MAX_DELAY_STEPS
from articulate.transforms import Array, Ints, matrix_to_quat
from articulate_envs.compiled.rows import stack_rows
from articulate_envs.compiled.step import (
    Buffers,
    ModelLayout,
    Poses,
    PreStepParams,
    SubstepParams,
    compiled_pre_step,
    compiled_refresh,
)
from articulate_envs.engine import Start, State
from articulate_envs.native_mujoco import copy_model
from articulate_envs.scene import PREFIX, Scene

KEPT_ACTIONS = MAX_DELAY_STEPS + 1
"""Number of control steps of which actions are kept."""


class BufferedEngine(ABC):
    """N environments, each with a model and a state; see :class:`articulate_envs.engine.Engine`.

    A subclass runs the physics in :meth:`_advance`. Snapshots of one fit another: they hold the
    same arrays.
    """

    def __init__(self, scene: Scene | Sequence[Scene], n_envs: int) -> None:
        """Create N environments of one or several scenes; call :meth:`reset` before stepping.

        Args:
            scene: Scene of all environments, or scenes that are distributed evenly: environment
                ``i`` has scene ``i * S // N``.
            n_envs: Number of environments, at least that of scenes.

        Raises:
            AssetError: The hulls of an object change with its size.
            EngineError: Scenes differ in arm, control, physics, limits or duration.
        """
        self.scenes = (scene,) if isinstance(scene, Scene) else tuple(scene)
        _check_scenes(self.scenes, n_envs)
        self.scene = scene = self.scenes[0]
        self.n_envs = n_envs
        self.scene_of: Ints = np.arange(n_envs, dtype=np.int64) * len(self.scenes) // n_envs
        self._models, self._data = self._allocate()
        self._first_model = np.cumsum([0, *(len(one.models) for one in self.scenes)])
        self._model_of = np.zeros(n_envs, dtype=np.int64)
        self._order = np.arange(n_envs, dtype=np.int64)
        self._quat_wo = np.tile([1.0, 0.0, 0.0, 0.0], (n_envs, 1))
        self._joints = [_object_joints(one) for one in self.scenes]
        self._buffers = _new_buffers(n_envs)
        self._delay = new_action_delay(n_envs, KEPT_ACTIONS)
        self._retract = np.zeros(n_envs, dtype=bool)
        self._values = np.zeros((n_envs, len(COLUMNS)))
        self._step = np.zeros(n_envs, dtype=np.int64)
        self._targets = target_params(scene.arm, scene.control)
        self._layout, self._substep = model_layout(scene), _substep_params(scene)
        step_s = scene.control.step_s
        self._pre_step = PreStepParams(
            gripper=gripper_params(scene.arm.gripper, step_s),
            force=force_limits(scene.control),
            step_s=step_s,
            episode_s=scene.task.episode_s,
        )
        poses = (np.tile(np.eye(4), (n_envs, 1, 1)) for _ in range(4))
        paths = [
            handle_path_of(one.asset, one.task.joint, flip=one.placement.flip)
            for one in self.scenes
        ]
        self._poses = Poses(
            path=stack_rows([paths[k] for k in self.scene_of]),
            T_wo=next(poses),
            scale=np.ones(n_envs),
            joint_scale=np.ones(n_envs),
            opened=np.zeros(n_envs),
            T_wh=next(poses),
            T_wt=next(poses),
            T_wt_target=next(poses),
        )

    def _allocate(self) -> tuple[list[mujoco.MjModel], list[mujoco.MjData]]:
        """Return a model and a state for each environment."""
        models = [copy.copy(self.scenes[k].nominal) for k in self.scene_of]
        return models, [mujoco.MjData(model) for model in models]

    def _load(self, i: int) -> None:  # noqa: B027  nothing to do where these are stepped in place
        """Take over the model and the state of environment ``i``, which have been written."""

    @abstractmethod
    def _advance(self) -> None:
        """Run a control step in all environments, from and into the buffers."""

    def _refresh(self, rows: Ints) -> None:
        """Write all that follows from the buffers of environments ``rows``.

        The functions are those of a control step, so a continued run is bit-identical.
        """
        geometry = self._targets.geometry
        compiled_refresh(rows, self._buffers, self._delay, geometry, self._poses)

    def reset(self, rows: Ints, start: Start) -> None:
        """Begin new episodes in environments ``rows`` (M,) of int."""
        rows = np.asarray(rows, dtype=np.int64)
        self._values[rows] = start.params.values
        self._place(rows, start.params)
        for k, i in enumerate(rows):
            self._write_model(int(i), start.params.values[k])
            self._write_data(int(i), start, k)
            self._load(int(i))
        self._order[:] = np.argsort(self._model_of, kind="stable")
        b = self._buffers
        b.filter[rows] = filter_start(start.q)
        b.target[rows] = start.q
        b.finger[rows] = start.width / 2.0
        b.push[rows] = 0.0
        b.samples[rows] = 0.0
        b.torque[rows] = 0.0
        b.q[rows] = start.q
        b.dq[rows] = 0.0
        b.gripper_width[rows] = start.width
        b.part_pos[rows] = self._part_positions(start.opened, rows)
        b.part_vel[rows] = 0.0
        b.alive[rows] = 1.0
        for array, value in zip(b.gripper, new_gripper_state(len(rows)), strict=True):
            array[rows] = value
        b.gripper.command[rows] = start.closing
        b.gripper.closing[rows] = start.closing
        b.gripper.smooth[rows] = 0.5 * np.maximum(start.closing, 0.0)
        self._delay.requests[:, rows] = 0.0
        self._step[rows] = 0
        self._refresh(rows)

    def _part_positions(self, opened: Array, rows: Ints) -> Array:
        """Positions (M,) of the task's joint in environments ``rows`` at fractions ``opened``."""
        path, joint_scale = self._poses.path, self._poses.joint_scale[rows]
        closed, span = np.asarray(path.closed)[rows], np.asarray(path.span)[rows]
        return np.asarray((closed + opened * span) * joint_scale)

    def _place(self, rows: Ints, params: EpisodeParams) -> None:
        scale, scene_of = params["scale"], self.scene_of[rows]
        for k in np.unique(scene_of):
            which = scene_of == k
            self._poses.T_wo[rows[which]] = self.scenes[k].T_wo(EpisodeParams(params.values[which]))
        self._quat_wo[rows] = matrix_to_quat(self._poses.T_wo[rows, :3, :3])
        self._poses.scale[rows] = scale
        self._poses.joint_scale[rows] = np.where(
            np.asarray(self._poses.path.hinge)[rows], 1.0, scale
        )
        for name in ("delay_steps", "estimate_delay_steps"):  # compiled code does not check them
            if not np.isin(params[name], np.arange(KEPT_ACTIONS)).all():
                raise EngineError(
                    f"episode_params.{name} must be integers from 0 to {MAX_DELAY_STEPS}"
                )
        self._delay.steps[rows] = params["delay_steps"].astype(np.int64)

    def _write_model(self, i: int, row: Array) -> None:
        """Copy the model of the sampled size and write the sampled numbers into it."""
        scene, model = self.scenes[self.scene_of[i]], self._models[i]
        at = scene.at
        value = dict(zip(COLUMNS, row, strict=True))
        k = int(np.argmin(np.abs(np.asarray(scene.scales) - value["scale"])))
        self._model_of[i] = self._first_model[self.scene_of[i]] + k
        copy_model(model, scene.models[k])
        randomize_model(
            model,
            value,
            arm_v=slice(at.arm_q, at.arm_q + 7),
            arm_u=slice(at.arm_ctrl, at.arm_ctrl + 7),
            finger_geoms=list(at.finger_geoms),
            object_v=list(at.object_v),
            moving_bodies=list(at.moving_bodies),
        )
        model.body_pos[at.root_body] = self._poses.T_wo[i, :3, 3]
        model.body_quat[at.root_body] = self._quat_wo[i]
        mujoco.mj_setConst(model, self._data[i])

    def _write_data(self, i: int, start: Start, k: int) -> None:
        scene, data = self.scenes[self.scene_of[i]], self._data[i]
        at = scene.at
        mujoco.mj_resetData(self._models[i], data)
        for address, closed, scales in self._joints[self.scene_of[i]]:
            data.qpos[address] = closed * (self._poses.scale[i] if scales else 1.0)
        data.qpos[at.part_q] = self._part_positions(start.opened[k], np.array(i))
        data.qpos[at.arm_q : at.arm_q + 7] = start.q[k]
        data.qpos[at.finger_q] = start.width[k] / 2.0
        data.qpos[at.finger_q + 1] = -start.width[k] / 2.0

    def step(self, action: Array) -> State:
        """Run one control step with actions (N, 8)."""
        compiled_pre_step(
            action,
            self._delay,
            self._retract,
            self._values,
            self._step,
            self._pre_step,
            self._buffers,
        )
        self._advance()
        self._step += 1
        return self.state()

    def state(self) -> State:
        """Return the present state; the arrays are copies."""
        b, poses = self._buffers, self._poses
        return State(
            q=b.q.copy(),
            dq=b.dq.copy(),
            target=b.target.copy(),
            gripper=b.gripper.copy(),
            gripper_width=b.gripper_width.copy(),
            T_wt=poses.T_wt.copy(),
            T_wt_target=poses.T_wt_target.copy(),
            T_wh=poses.T_wh.copy(),
            opened=poses.opened.copy(),
            speed=b.part_vel * np.sign(poses.path.span),
            samples=b.samples.copy(),
            pending_actions=self._delay.pending.copy(),
        )

    def _kept(self) -> dict[str, Array]:
        """Arrays beside MuJoCo's that a snapshot holds, by name."""
        buffers = {k: v for k, v in self._buffers._asdict().items() if k != "gripper"}
        out = {f"buffer_{k}": v for k, v in buffers.items()}
        out |= {f"gripper_{k}": v for k, v in self._buffers.gripper._asdict().items()}
        return out | {"requests": self._delay.requests, "step": self._step}

    def snapshot(self) -> dict[str, Array]:
        """Return all that bit-identical continuation needs; only arrays."""
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        sizes = [mujoco.mj_stateSize(model, spec) for model in self._models]
        physics = np.zeros((self.n_envs, max(sizes)))
        for i, size in enumerate(sizes):
            mujoco.mj_getState(*self.physics_state(i), physics[i, :size], spec)
        out = {name: array.copy() for name, array in self._kept().items()}
        return out | {"physics": physics, "episode_params": self._values.copy()}

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        rows = np.arange(self.n_envs, dtype=np.int64)
        self._values[:] = snapshot["episode_params"]
        self._place(rows, EpisodeParams(self._values))
        for i in range(self.n_envs):
            self._write_model(i, self._values[i])
            mujoco.mj_resetData(self._models[i], self._data[i])
            state = snapshot["physics"][i, : mujoco.mj_stateSize(self._models[i], spec)]
            mujoco.mj_setState(self._models[i], self._data[i], state, spec)
            self._load(i)
        self._order[:] = np.argsort(self._model_of, kind="stable")
        for name, array in self._kept().items():
            array[:] = snapshot[name]
        self._refresh(rows)

    def physics_state(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return model and data of environment ``i``, for images: read them only, and soon."""
        return self._models[i], self._data[i]

    def object_pose(self, i: int) -> tuple[float, Array]:
        """Return size and pose ``T_wo`` (4, 4) of the object in environment ``i``, for images."""
        return float(self._poses.scale[i]), self._poses.T_wo[i].copy()

    def close(self) -> None:  # noqa: B027  engines without threads hold nothing
        """Release what is held; a second call does nothing."""


def _check_scenes(scenes: tuple[Scene, ...], n_envs: int) -> None:
    """Raise EngineError or AssetError if ``scenes`` cannot share an engine."""
    if not 1 <= len(scenes) <= n_envs:
        raise EngineError(f"{len(scenes)} scenes for {n_envs} environments; give at most as many")
    for scene in scenes:
        if len({model.nbuffer for model in scene.models}) > 1:
            raise AssetError(
                f"{scene.asset.name}: its collision hulls change with its size, so sizes cannot be "
                "exchanged; set randomization.scale to one size"
            )
        for name in ("arm", "control", "physics", "n_steps"):
            if getattr(scene, name) != getattr(scenes[0], name):
                raise EngineError(f"scenes of one engine differ in {name}; use one engine for each")
        for name in ("episode_s", "hold_s", "limits"):
            if getattr(scene.task, name) != getattr(scenes[0].task, name):
                raise EngineError(f"scenes of one engine differ in task.{name}; use one for each")


def _object_joints(scene: Scene) -> list[tuple[int, float, bool]]:
    """Return address in ``qpos``, closed position and True if that is a length, by joint."""
    model = scene.nominal
    return [
        (int(model.joint(PREFIX + joint.name).qposadr[0]), joint.closed, joint.kind == "slide")
        for joint in scene.asset.joints
    ]


def _new_buffers(n: int) -> Buffers:
    return Buffers(
        filter=np.zeros((n, 7, 3)),
        target=np.zeros((n, 7)),
        gripper=new_gripper_state(n),
        finger=np.full(n, 0.04),
        push=np.zeros((n, 3)),
        samples=np.zeros((n, WIDTH)),
        torque=np.zeros((n, 7)),
        q=np.zeros((n, 7)),
        dq=np.zeros((n, 7)),
        gripper_width=np.zeros(n),
        part_pos=np.zeros(n),
        part_vel=np.zeros(n),
        alive=np.zeros(n),
    )


def model_layout(scene: Scene) -> ModelLayout:
    """Return the sizes of MuJoCo's arrays of ``scene`` and the indices into them."""
    at = scene.at
    return ModelLayout(
        nq=scene.nominal.nq,
        nv=scene.nominal.nv,
        arm_q=at.arm_q,
        finger_q=at.finger_q,
        arm_ctrl=at.arm_ctrl,
        finger_ctrl=at.finger_ctrl,
        part_q=at.part_q,
        part_v=at.part_v,
        push_row=at.part_body,
        tool_site=at.tool_site,
        gripper_sensor=at.sensors[0],
        floor_sensor=at.sensors[1],
        robot_sensor=at.sensors[2],
    )


def _substep_params(scene: Scene) -> SubstepParams:
    dt = scene.physics.timestep_s
    A, B = discretize_filter(scene.control.omega_rad_s, dt)
    return SubstepParams(
        substeps=scene.substeps,
        A=A,
        B=B,
        finger=finger_params(scene.arm.gripper, dt),
        monitor=monitor_params(scene.arm, scene.task.limits, dt),
    )
