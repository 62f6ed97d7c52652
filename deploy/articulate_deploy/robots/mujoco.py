"""Simulated arm in MuJoCo: the scene in which the policy was trained, from the bundle.

The control stack is that of training, with joint impedance by the model's actuators. All episode
parameters apply except the object's size: a bundle has its scene at one size.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from articulate.errors import BundleError
from articulate.robot.contact import contact_wrench
from articulate.simulator import mujoco
from articulate.task.manifest import Manifest
from articulate.task.randomization import COLUMNS, randomize_model
from articulate.transforms import Array, Ints, matrix_to_quat
from articulate_deploy.bundle import Bundle
from articulate_deploy.robots.robot import Sample
from articulate_deploy.robots.simulated import BaseSimulatedRobot

MAX_ITERATIONS = 1000
"""Largest number of solver iterations in a physics step; exported scenes have up to 50."""
SENSOR_SIZES = (10, 10, 1)
"""Sizes of the sensors: net contacts of the gripper with object and floor, count for the robot."""


@dataclass(frozen=True)
class Addresses:
    """Indices of the manifest's names: positions ``q``, speeds ``v``, actuators ``u``, others."""

    arm_q: Ints
    arm_v: Ints
    arm_u: Ints
    finger_q: Ints
    finger_u: Ints
    finger_geoms: Ints
    part_q: int
    part_v: int
    part_body: int
    root_body: int
    moving: Ints
    object_v: Ints
    tool: int
    sensors: tuple[int, int, int]


class MujocoRobot(BaseSimulatedRobot):
    """Arm of a bundle in MuJoCo; see :class:`articulate_deploy.robots.robot.SimulatedRobot`."""

    name = "mujoco"

    def __init__(self, bundle: Bundle) -> None:
        """Keep ``bundle``; the scene is compiled by :meth:`connect`."""
        super().__init__(bundle)
        self._nominal: mujoco.MjModel | None = None

    @property
    def physics_step_s(self) -> float:
        """Length of a physics step [s]."""
        return self._manifest.scene.timestep_s

    def _open(self) -> None:
        text, meshes = self._bundle.scene_assets()
        try:
            self._nominal = mujoco.MjModel.from_xml_string(text, meshes)
            self._at = _addresses(self._nominal, self._manifest)
            _check_options(self._nominal, self._manifest)
            _check_gains(self._nominal, self._at, self._manifest)
        except (ValueError, KeyError, TypeError) as error:  # TypeError: a name that is not text
            self._nominal = None
            reason = " ".join(str(error).split())[:160]
            raise BundleError(
                f"{self._bundle.where}: its scene cannot be used ({reason})"
            ) from None

    def _close(self) -> None:
        self._nominal = None

    def _begin(self, q: Array, gripper_width_m: float, part: float) -> None:
        assert self._nominal is not None
        manifest, at = self._manifest, self._at
        self._model = self._sampled_model(self._nominal)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setConst(self._model, self._data)
        mujoco.mj_resetData(self._model, self._data)
        for joint in manifest.object.joints:
            adr = self._model.joint(manifest.scene.object_prefix + joint.name).qposadr[0]
            self._data.qpos[adr] = joint.closed
        self._data.qpos[at.part_q] = part
        self._data.qpos[at.arm_q] = q
        self._data.qpos[at.finger_q] = np.array([0.5, -0.5]) * gripper_width_m

    def _sampled_model(self, nominal: mujoco.MjModel) -> mujoco.MjModel:
        """Return a copy of the scene with the sampled numbers of the batched engine."""
        model, at = copy.copy(nominal), self._at
        randomize_model(
            model,
            dict(zip(COLUMNS, self._params.values[0].tolist(), strict=True)),
            arm_v=at.arm_v,
            arm_u=at.arm_u,
            finger_geoms=at.finger_geoms,
            object_v=at.object_v,
            moving_bodies=at.moving,
        )
        model.body_pos[at.root_body] = self._T_wo[0, :3, 3]
        model.body_quat[at.root_body] = matrix_to_quat(self._T_wo[0, :3, :3])
        return model

    def _push(self, force_w: Array) -> None:
        self._data.xfrc_applied[self._at.part_body, :3] = force_w

    def _read(self) -> tuple[Array, Array, float]:
        data, at = self._data, self._at
        width = float(data.qpos[at.finger_q[0]] - data.qpos[at.finger_q[1]])
        return data.qpos[at.arm_q], data.qvel[at.arm_v], width

    def _part(self) -> tuple[float, float]:
        return float(self._data.qpos[self._at.part_q]), float(self._data.qvel[self._at.part_v])

    def _step(self, set_point: Array, finger_m: float) -> Sample:
        data, at = self._data, self._at
        data.ctrl[at.arm_u] = set_point
        data.ctrl[at.finger_u] = (finger_m, -finger_m)
        mujoco.mj_step(self._model, data)
        wrench = np.empty(6)
        touch = contact_wrench(data.sensordata, *at.sensors, data.site_xpos[at.tool], wrench)
        return Sample(
            dq=data.qvel[at.arm_v].copy(),
            torque=data.qfrc_actuator[at.arm_v].copy(),
            wrench=wrench,
            touch=touch,
            dt=self.physics_step_s,
        )


def _check_options(model: mujoco.MjModel, manifest: Manifest) -> None:
    """Require the manifest's time step and a bounded time per step; else ValueError."""
    option, physics_step_s = model.opt, manifest.scene.timestep_s
    if abs(option.timestep - physics_step_s) > 1e-9:
        raise ValueError(
            f"its time step is {option.timestep:g} s, the manifest's {physics_step_s:g} s"
        )
    names = ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations")
    for name in (*names, "sdf_iterations"):
        if not 0 <= getattr(option, name) <= MAX_ITERATIONS:
            raise ValueError(f"option {name} is {getattr(option, name)}, above {MAX_ITERATIONS}")
    for name, size in zip(manifest.scene.sensors, SENSOR_SIZES, strict=True):
        if model.sensor(name).dim[0] != size:
            raise ValueError(f"sensor {name} has {model.sensor(name).dim[0]} numbers, not {size}")


def _check_gains(model: mujoco.MjModel, at: Addresses, manifest: Manifest) -> None:
    """Require the gains of the manifest, which other robots get; else ValueError."""
    robot, bias = manifest.robot, model.actuator_biasprm[at.arm_u]
    for name, found, expected in (
        ("stiffness", model.actuator_gainprm[at.arm_u, 0], robot.stiffness),
        ("stiffness", -bias[:, 1], robot.stiffness),
        ("damping", -bias[:, 2], robot.damping),
    ):
        if not np.allclose(found, expected, rtol=1e-6, atol=0.0):
            raise ValueError(f"{name} of its arm is not the manifest's")


def _addresses(model: mujoco.MjModel, manifest: Manifest) -> Addresses:
    """Return the indices; KeyError names what the scene lacks."""
    scene = manifest.scene
    joints = [model.joint(name) for name in scene.arm_joints]
    fingers = [model.joint(name) for name in scene.finger_joints]
    part = model.joint(scene.object_prefix + manifest.task.joint)
    moving = [
        i
        for i in range(model.nbody)
        if model.body(i).name.startswith(scene.object_prefix) and model.body_weldid[i] != 0
    ]

    def ids(values: list[int]) -> Ints:
        return np.array(values, dtype=np.int64)

    gripper, floor, robot = (int(model.sensor(name).adr[0]) for name in scene.sensors)
    return Addresses(
        arm_q=ids([int(j.qposadr[0]) for j in joints]),
        arm_v=ids([int(j.dofadr[0]) for j in joints]),
        arm_u=ids([int(model.actuator(name).id) for name in scene.arm_joints]),
        finger_q=ids([int(j.qposadr[0]) for j in fingers]),
        finger_u=ids([int(model.actuator(name).id) for name in scene.finger_joints]),
        finger_geoms=ids([int(model.geom(name).id) for name in scene.finger_geoms]),
        part_q=int(part.qposadr[0]),
        part_v=int(part.dofadr[0]),
        part_body=int(model.jnt_bodyid[part.id]),
        root_body=int(model.body(scene.object_root).id),
        moving=ids(moving),
        object_v=ids([i for i in range(model.nv) if int(model.dof_bodyid[i]) in moving]),
        tool=int(model.site(scene.tool_site).id),
        sensors=(gripper, floor, robot),
    )
