"""A stand-in arm in this process: the scene that the policy was trained in, from the bundle.

It repeats the plant of training: the follower at every physics step, the hand's latency and
speed, joint impedance by the model's own actuators. What a :class:`articulate.draw.Draw` says
is applied, but for the object's size: a bundle holds the scene at one size.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import mujoco
import numpy as np

from articulate.contact import contact_wrench
from articulate.draw import PUSH_S, Draw, nominal_draw
from articulate.errors import BundleError, ConfigError, nearest
from articulate.follow import ROUNDING_S, discrete, follow, follow_start
from articulate.manifest import Manifest
from articulate.observe import Estimate
from articulate.placing import handle_in_world, object_pose
from articulate.transforms import Array, Ints, matrix_to_quat
from articulate_deploy.bundle import Bundle
from articulate_deploy.robots.robot import (
    ACTION_FEATURES,
    HAND_KEY,
    JOINT_KEYS,
    OBSERVATION_FEATURES,
    SPEED_KEYS,
    NotConnectedError,
    Sample,
    action_of,
    joints_of,
)
from articulate_deploy.safety import safe_target


@dataclass(frozen=True)
class Addresses:
    """Where the manifest's names stand: positions ``q``, speeds ``v``, actuators ``u``, others."""

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


class MujocoRobot:
    """The arm of a bundle in MuJoCo; see :class:`articulate_deploy.robots.robot.StandIn`."""

    name = "mujoco"

    def __init__(self, bundle: Bundle) -> None:
        """Keep ``bundle``; the scene is compiled by :meth:`connect`."""
        self._bundle = bundle
        self._manifest = bundle.manifest
        self._nominal: mujoco.MjModel | None = None
        self._drawn = nominal_draw(begin=bundle.manifest.task.begin)
        self._stopped = True

    @property
    def observation_features(self) -> dict[str, type]:
        """Keys of observations."""
        return dict(OBSERVATION_FEATURES)

    @property
    def action_features(self) -> dict[str, type]:
        """Keys of actions."""
        return dict(ACTION_FEATURES)

    @property
    def is_connected(self) -> bool:
        """Whether the scene is compiled."""
        return self._nominal is not None

    @property
    def is_calibrated(self) -> bool:
        """Nothing is to be calibrated."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Compile the scene and stand at the bundle's start."""
        text, meshes = self._bundle.scene_assets()
        try:
            self._nominal = mujoco.MjModel.from_xml_string(text, meshes)
            self._at = _addresses(self._nominal, self._manifest)
        except (ValueError, KeyError) as error:
            self._nominal = None
            what = " ".join(str(error).split())[:160]
            raise BundleError(f"{self._bundle.where}: its scene cannot be used ({what})") from None
        start = self._manifest.start
        self.reset_to(np.asarray(start.q), start.hand_width_m)

    def calibrate(self) -> None:
        """Nothing is to be calibrated."""

    def configure(self) -> None:
        """Gains are those of the scene."""

    def disconnect(self) -> None:
        """Forget the scene."""
        self._nominal = None

    def __enter__(self) -> Self:
        """Connect."""
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Disconnect."""
        self.disconnect()

    def set_draw(self, drawn: Draw) -> None:
        """What the next episodes are like.

        Raises:
            ConfigError: It asks for another size of the object.
        """
        scale = float(drawn["scale"][0])
        if scale != self._manifest.scene.scale:
            raise ConfigError(
                f"the bundle's scene has size {self._manifest.scene.scale}, not {scale:.3g}; "
                "draw with one size"
            )
        self._drawn = drawn

    def reset_to(self, q: Array, hand_width_m: float) -> None:
        """Begin anew under the last draw, the arm at rest at ``q``.

        Every part is closed but the task's, which is where it was drawn.
        """
        nominal = self._connected()
        manifest, at = self._manifest, self._at
        self._T_wo = self._object_pose()
        self._model = self._drawn_model(nominal)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setConst(self._model, self._data)
        mujoco.mj_resetData(self._model, self._data)
        for joint in manifest.object.joints:
            adr = self._model.joint(manifest.scene.object_prefix + joint.name).qposadr[0]
            self._data.qpos[adr] = joint.closed
        part = manifest.object.joint(manifest.task.joint)
        opened = float(self._drawn["part_open"][0])
        self._data.qpos[at.part_q] = part.closed + opened * part.span
        self._data.qpos[at.arm_q] = q
        self._data.qpos[at.finger_q] = np.array([0.5, -0.5]) * hand_width_m
        self._A, self._B = discrete(manifest.control.follow.omega_rad_s, manifest.scene.timestep_s)
        self._follower = follow_start(np.asarray(q)[None])
        self._target = np.asarray(q, dtype=np.float64).copy()
        self._finger = hand_width_m / 2.0
        self._wish = self._closing = -1.0
        self._wait_s = 0.0
        self._tick = 0
        self._samples: list[Sample] = []
        self._stopped = False

    def stop(self) -> None:
        """Hold the arm where it is told to be."""
        self._stopped = True

    def get_observation(self) -> dict[str, float]:
        """Joint angles [rad], joint speeds [rad/s], opening of the hand [m]."""
        self._connected()
        data, at = self._data, self._at
        width = float(data.qpos[at.finger_q[0]] - data.qpos[at.finger_q[1]])
        return {
            **dict(zip(JOINT_KEYS, data.qpos[at.arm_q].tolist(), strict=True)),
            **dict(zip(SPEED_KEYS, data.qvel[at.arm_v].tolist(), strict=True)),
            HAND_KEY: width,
        }

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send targets [rad] and an opening [m], and let one tick pass; returns what was sent.

        Raises:
            NotConnectedError: The robot is not connected, or was stopped.
            ConfigError: A key is missing or not known.
        """
        self._connected()
        if self._stopped:
            raise NotConnectedError("the robot was stopped; call reset_to first")
        for key in ACTION_FEATURES.keys() ^ action.keys():
            raise ConfigError(
                f"action: {key} is missing or not known{nearest(key, ACTION_FEATURES)}"
            )
        follow_config, robot = self._manifest.control.follow, self._manifest.robot
        self._target = safe_target(joints_of(action), self._target, follow_config, robot)
        wide = robot.hand.max_width_m
        width = wide if not action[HAND_KEY] < wide / 2.0 else 0.0
        self._tell_hand(1.0 if width == 0.0 else -1.0)
        self._push()
        for _ in range(round(follow_config.tick_s / self._manifest.scene.timestep_s)):
            self._step()
        self._tick += 1
        return action_of(self._target, width)

    def take_samples(self) -> list[Sample]:
        """Samples of every physics step since the last call."""
        samples, self._samples = self._samples, []
        return samples

    def object_state(self) -> Estimate:
        """The true state of the object."""
        self._connected()
        manifest, data = self._manifest, self._data
        joint = manifest.object.joint(manifest.task.joint)
        opened = np.array([(data.qpos[self._at.part_q] - joint.closed) / joint.span])
        T_wh = handle_in_world(
            manifest.object,
            joint.name,
            T_wo=self._T_wo,
            scale=np.ones(1),
            opened=opened,
            flip=manifest.place.flip,
        )
        speed = data.qvel[self._at.part_v] * np.sign(joint.span)
        return Estimate(T_wh=T_wh, opened=opened, speed=np.array([speed]))

    def _connected(self) -> mujoco.MjModel:
        if self._nominal is None:
            raise NotConnectedError("the robot is not connected; call connect first")
        return self._nominal

    def _object_pose(self) -> Array:
        drawn, manifest = self._drawn, self._manifest
        return object_pose(
            manifest.object,
            manifest.task.joint,
            manifest.place,
            scale=np.ones(1),
            shift=np.stack([drawn["x_m"], drawn["y_m"]], axis=1),
            yaw=drawn["yaw_rad"],
        )

    def _drawn_model(self, nominal: mujoco.MjModel) -> mujoco.MjModel:
        """A copy of the scene with the drawn numbers in it, as the batched engine writes them."""
        model, at = copy.copy(nominal), self._at
        d = {name: float(self._drawn[name][0]) for name in _FACTORS}
        model.geom_friction[at.finger_geoms, 0] *= d["friction"]
        model.dof_damping[at.object_v] *= d["joint_damping"]
        model.dof_frictionloss[at.object_v] *= d["joint_friction"]
        model.dof_armature[at.arm_v] *= d["armature"]
        model.body_mass[at.moving] *= d["mass"]
        model.body_inertia[at.moving] *= d["mass"]
        model.actuator_gainprm[at.arm_u, 0] *= d["stiffness"]
        model.actuator_biasprm[at.arm_u, 1] *= d["stiffness"]
        model.actuator_biasprm[at.arm_u, 2] *= d["damping"]
        model.body_pos[at.root_body] = self._T_wo[0, :3, 3]
        model.body_quat[at.root_body] = matrix_to_quat(self._T_wo[0, :3, :3])
        return model

    def _tell_hand(self, wish: float) -> None:
        """A new command acts after the drawn latency."""
        if wish != self._wish:
            self._wait_s = float(self._drawn["hand_latency_s"][0])
        else:
            self._wait_s = max(self._wait_s - self._manifest.control.follow.tick_s, 0.0)
        self._wish = wish
        if self._wait_s <= ROUNDING_S:
            self._closing = wish

    def _push(self) -> None:
        """Apply the drawn push for its time."""
        t = self._tick * self._manifest.control.follow.tick_s
        begin = float(self._drawn["push_time"][0]) * self._manifest.task.episode_s
        on = begin <= t < begin + PUSH_S
        push = self._drawn["push"][0] if on else np.zeros(3)
        self._data.xfrc_applied[self._at.part_body, :3] = push

    def _step(self) -> None:
        data, at, manifest = self._data, self._at, self._manifest
        hand, dt = manifest.robot.hand, manifest.scene.timestep_s
        self._follower = follow(self._follower, self._target[None], self._A, self._B)
        move = -self._closing * hand.finger_speed_m_s * dt
        self._finger = min(max(self._finger + move, 0.0), hand.max_width_m / 2.0)
        data.ctrl[at.arm_u] = self._follower[0, :, 0]
        data.ctrl[at.finger_u] = (self._finger, -self._finger)
        mujoco.mj_step(self._model, data)
        tool_w = data.site_xpos[at.tool]
        wrench, touch = contact_wrench(data.sensordata[None], at.sensors, tool_w[None])
        self._samples.append(
            Sample(
                dq=data.qvel[at.arm_v].copy(),
                torque=data.qfrc_actuator[at.arm_v].copy(),
                wrench=wrench[0],
                touch=bool(touch[0]),
                dt=dt,
            )
        )


_FACTORS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
)  # fmt: skip


def _addresses(model: mujoco.MjModel, manifest: Manifest) -> Addresses:
    """Where things stand; KeyError names what the scene lacks."""
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

    hand, floor, robot = (int(model.sensor(name).adr[0]) for name in scene.sensors)
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
        sensors=(hand, floor, robot),
    )
