"""Simulated arm in another engine: PyBullet, with its Panda and the object's URDF.

Equal to training: set-point filter, gripper, joint impedance with gravity compensation and torque
limits, layouts, episode monitor. Different: the engine, its contacts, the shapes and inertias of
the arm, and the reader of the object. A policy with the same success here does not depend on one
engine's peculiarities. :attr:`PybulletRobot.notes` lists episode parameters that differ.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pybullet
import pybullet_data

from articulate.errors import BundleError
from articulate.robot.arm import Arm
from articulate.robot.kinematics import joint_poses, tool_pose
from articulate.suppress_output import suppress_output
from articulate.transforms import Array, matrix_to_quat
from articulate_deploy.bundle import Bundle
from articulate_deploy.robots.robot import Sample
from articulate_deploy.robots.simulated import BaseSimulatedRobot

STEP_S = 0.001
"""Longest physics step [s]: that of the arm's controller."""
ITERATIONS = 100
"""Iterations of Bullet's solver in a step."""
GRAVITY_M_S2 = 9.81
ARM_URDF = "franka_panda/panda.urdf"
"""The Panda that comes with PyBullet."""
ARM_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")
GRIPPER_LINKS = ("panda_hand", "panda_leftfinger", "panda_rightfinger")
FINGER_COUPLING_N = 1000.0
"""Largest force that keeps the two fingers at the same opening [N]."""
NOTES = (
    "pybullet has no reflected inertia: the sampled one of the arm is added to its links, so that "
    "the sum at each joint is correct at the start; that of the object's joints is left out",
    "pybullet reads the object's inertias, damping and dry friction from its URDF; its parts "
    "collide with the arm and not with each other",
    "the moment on the gripper is that of the contacts' forces, without their torsional friction",
)


@dataclass(frozen=True)
class _Bodies:
    """Indices of names in the world of one episode."""

    arm: int
    arm_joints: list[int]
    """Seven joints, then the two fingers."""
    gripper_links: frozenset[int]
    object: int
    object_joints: dict[str, int]
    """Moving joints by name; a joint has the number of the link that it moves."""
    floor: int


class PybulletRobot(BaseSimulatedRobot):
    """Arm of a bundle in PyBullet; see :class:`articulate_deploy.robots.robot.SimulatedRobot`."""

    name = "pybullet"

    def __init__(self, bundle: Bundle) -> None:
        """Keep ``bundle``; the engine is started by :meth:`connect`."""
        super().__init__(bundle)
        self._world = -1
        self._files: tempfile.TemporaryDirectory[str] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Episode parameters that this engine handles differently, or not at all."""
        return NOTES

    @property
    def physics_step_s(self) -> float:
        """Physics step [s]: :data:`STEP_S`, or a shorter one that divides training's step."""
        physics_step_s = self._manifest.scene.timestep_s
        return physics_step_s / math.ceil(physics_step_s / STEP_S - 1e-9)

    def _open(self) -> None:
        text, meshes = self._bundle.object_assets()
        self._files = tempfile.TemporaryDirectory(prefix="articulate-pybullet-")
        self._object_urdf = Path(self._files.name) / "object.urdf"
        (self._object_urdf.parent / "meshes").mkdir()
        for name, content in meshes.items():
            (self._object_urdf.parent / name).write_bytes(content)
        self._object_urdf.write_text(text, encoding="utf-8")
        self._world = pybullet.connect(pybullet.DIRECT)

    def _close(self) -> None:
        if self._world >= 0:
            pybullet.disconnect(self._world)
            self._world = -1
        if self._files is not None:
            self._files.cleanup()
            self._files = None

    def _call(self, name: str, *args: Any, **kwargs: Any) -> Any:
        return getattr(pybullet, name)(*args, **kwargs, physicsClientId=self._world)

    def _begin(self, q: Array, gripper_width_m: float, part: float) -> None:
        """Reset the world, so that an episode does not depend on earlier ones."""
        self._call("resetSimulation")
        self._call("setGravity", 0.0, 0.0, -GRAVITY_M_S2)
        self._call(
            "setPhysicsEngineParameter",
            fixedTimeStep=self.physics_step_s,
            numSubSteps=0,
            numSolverIterations=ITERATIONS,
            deterministicOverlappingPairs=1,
        )
        self._bodies = self._load()
        self._set_arm()
        self._set_object()
        self._rest(q, gripper_width_m, part)
        robot, params = self._manifest.robot, self._params
        self._stiffness = np.asarray(robot.stiffness) * float(params["stiffness"][0])
        self._damping = np.asarray(robot.damping) * float(params["damping"][0])
        self._tau_max = np.asarray(robot.tau_max)
        self._push_w = np.zeros(3)
        self._read_arm()

    def _load(self) -> _Bodies:
        manifest = self._manifest
        T_wo = self._T_wo[0]
        w, x, y, z = matrix_to_quat(T_wo[:3, :3])
        arm = self._call(
            "loadURDF",
            str(Path(pybullet_data.getDataPath()) / ARM_URDF),
            useFixedBase=True,
            flags=pybullet.URDF_IGNORE_VISUAL_SHAPES,
        )
        try:
            with suppress_output():  # its messages about a rejected file, beside the error
                item = self._call(
                    "loadURDF",
                    str(self._object_urdf),
                    basePosition=T_wo[:3, 3].tolist(),
                    baseOrientation=[x, y, z, w],
                    useFixedBase=True,
                    flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
                )
        except pybullet.error as error:
            raise BundleError(
                f"{self._bundle.where}: its object cannot be used in PyBullet ({error})"
            ) from None
        shape = self._call("createCollisionShape", pybullet.GEOM_PLANE)
        floor_z = min(0.0, manifest.placement.pos_w[2])
        floor = self._call("createMultiBody", 0.0, shape, basePosition=[0.0, 0.0, floor_z])
        links = {name: number for number, name in self._links(arm)}
        arm_joints = {info[1].decode(): int(info[0]) for info in self._infos(arm)}
        object_joints = {
            info[1].decode(): int(info[0])
            for info in self._infos(item)
            if info[2] != pybullet.JOINT_FIXED
        }
        missing = {joint.name for joint in manifest.object.joints} - object_joints.keys()
        if missing:
            raise BundleError(
                f"{self._bundle.where}: its object has no joint {min(missing)} in "
                f"{manifest.scene.object_file}"
            )
        for number in (-1, *(number for number, _ in self._links(item))):
            self._call("setCollisionFilterPair", floor, item, -1, number, 0)
        return _Bodies(
            arm=arm,
            arm_joints=[arm_joints[name] for name in (*ARM_JOINTS, *FINGER_JOINTS)],
            gripper_links=frozenset(links[name] for name in GRIPPER_LINKS),
            object=item,
            object_joints=object_joints,
            floor=floor,
        )

    def _infos(self, body: int) -> list[Any]:
        count = self._call("getNumJoints", body)
        return [self._call("getJointInfo", body, i) for i in range(count)]

    def _links(self, body: int) -> list[tuple[int, str]]:
        return [(int(info[0]), info[12].decode()) for info in self._infos(body)]

    def _set_arm(self) -> None:
        """Set friction, inertia and limits of the arm; its motors are dry friction only."""
        robot, fingers = self._manifest.robot, self._manifest.scene.fingers
        arm, joints = self._bodies.arm, self._bodies.arm_joints
        for number, _ in [(-1, ""), *self._links(arm)]:
            self._call(
                "changeDynamics", arm, number, linearDamping=0.0, angularDamping=0.0,
                jointDamping=0.0, lateralFriction=1.0, rollingFriction=0.0, spinningFriction=0.0,
            )  # fmt: skip
        # Inverse dynamics keep the inertias of their first call and would reject the ones below: a
        # rotor's inertia about one axis is not a rigid body's. Gravity does not depend on inertia.
        self._gravity(np.zeros(9))
        more = armature_on_links(robot, np.asarray(self._manifest.start.q))
        more = more * float(self._params["armature"][0])
        for i, number in enumerate(joints[:7]):
            inertia = np.array(self._call("getDynamicsInfo", arm, number)[2])
            inertia[2] += more[i]
            self._call(
                "changeDynamics", arm, number, localInertiaDiagonal=inertia.tolist(),
                jointLowerLimit=robot.q_min[i], jointUpperLimit=robot.q_max[i],
            )  # fmt: skip
        for number in joints[7:]:
            self._call(
                "changeDynamics", arm, number, spinningFriction=fingers.spin_friction_m,
                lateralFriction=fingers.sliding_friction * float(self._params["friction"][0]),
            )  # fmt: skip
        gear = self._call(
            "createConstraint", arm, joints[7], arm, joints[8], pybullet.JOINT_GEAR,
            [1.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3,
        )  # fmt: skip
        self._call("changeConstraint", gear, gearRatio=-1.0, erp=0.1, maxForce=FINGER_COUPLING_N)
        for number, force in zip(joints, (*robot.friction, *[fingers.friction_n] * 2), strict=True):
            self._dry_friction(arm, number, force)

    def _set_object(self) -> None:
        """Set the sampled mass, damping and dry friction of the object."""
        item, params = self._bodies.object, self._params
        d = {name: float(params[name][0]) for name in ("joint_damping", "joint_friction", "mass")}
        moving = set(self._bodies.object_joints.values())
        for number in (-1, *(number for number, _ in self._links(item))):
            self._call(
                "changeDynamics", item, number, linearDamping=0.0, angularDamping=0.0,
                lateralFriction=1.0, rollingFriction=0.0, spinningFriction=0.0,
            )  # fmt: skip
        for info in self._infos(item):
            number = int(info[0])
            if number not in moving:
                continue
            mass, _, inertia, *_ = self._call("getDynamicsInfo", item, number)
            self._call(
                "changeDynamics", item, number, mass=mass * d["mass"],
                localInertiaDiagonal=[value * d["mass"] for value in inertia],
                jointDamping=info[6] * d["joint_damping"],
            )  # fmt: skip
            self._dry_friction(item, number, info[7] * d["joint_friction"])
        counterbalanced = set(self._manifest.scene.counterbalanced)
        self._counterbalanced = [
            number for number, name in self._links(item) if name in counterbalanced
        ]

    def _dry_friction(self, body: int, joint: int, force: float) -> None:
        """Add a motor with target speed 0 and at most ``force`` [N or Nm]."""
        self._call(
            "setJointMotorControl2", body, joint, pybullet.VELOCITY_CONTROL,
            targetVelocity=0.0, force=force,
        )  # fmt: skip

    def _rest(self, q: Array, gripper_width_m: float, part: float) -> None:
        bodies, manifest = self._bodies, self._manifest
        for number, value in zip(
            bodies.arm_joints, [*q, *[gripper_width_m / 2.0] * 2], strict=True
        ):
            self._call("resetJointState", bodies.arm, number, float(value), 0.0)
        for joint in manifest.object.joints:
            value = part if joint.name == manifest.task.joint else joint.closed
            self._call("resetJointState", bodies.object, bodies.object_joints[joint.name], value)

    def _push(self, force_w: Array) -> None:
        self._push_w = force_w

    def _read(self) -> tuple[Array, Array, float]:
        return self._q[:7].copy(), self._dq[:7].copy(), float(self._q[7] + self._q[8])

    def _part(self) -> tuple[float, float]:
        number = self._bodies.object_joints[self._manifest.task.joint]
        position, speed, *_ = self._call("getJointState", self._bodies.object, number)
        return float(position), float(speed)

    def _read_arm(self) -> None:
        states = self._call("getJointStates", self._bodies.arm, self._bodies.arm_joints)
        self._q = np.array([state[0] for state in states])
        self._dq = np.array([state[1] for state in states])

    def _step(self, set_point: Array, finger_m: float) -> Sample:
        bodies = self._bodies
        torque = self._torques(set_point, finger_m)
        self._call(
            "setJointMotorControlArray", bodies.arm, bodies.arm_joints, pybullet.TORQUE_CONTROL,
            forces=torque.tolist(),
        )  # fmt: skip
        self._act_on_object()
        self._call("stepSimulation")
        self._read_arm()
        wrench, touch = self._contacts()
        return Sample(
            dq=self._dq[:7].copy(),
            torque=torque[:7],
            wrench=wrench,
            touch=touch,
            dt=self.physics_step_s,
        )

    def _torques(self, set_point: Array, finger_m: float) -> Array:
        """Return joint torques and finger forces (9,) [Nm, N], gravity compensated."""
        fingers, q, dq = self._manifest.scene.fingers, self._q, self._dq
        gravity = self._gravity(q)
        out = np.empty(9)
        torque = self._stiffness * (set_point - q[:7]) - self._damping * dq[:7] + gravity[:7]
        out[:7] = np.clip(torque, -self._tau_max, self._tau_max)
        force = fingers.stiffness_n_m * (finger_m - q[7:]) - fingers.damping_n_s_m * dq[7:]
        out[7:] = np.clip(force, -fingers.force_n, fingers.force_n) + gravity[7:]
        out[7:] -= fingers.passive_damping_n_s_m * dq[7:]
        return out

    def _gravity(self, q: Array) -> Array:
        """Return the torques (9,) [Nm, N] that compensate gravity at ``q`` (9,) [rad, m]."""
        still = [0.0] * 9
        arm = self._bodies.arm
        return np.array(self._call("calculateInverseDynamics", arm, q.tolist(), still, still))

    def _act_on_object(self) -> None:
        """Apply the sampled push, and the compensation of parts that would fall."""
        item = self._bodies.object
        part = self._bodies.object_joints[self._manifest.task.joint]
        forces = [
            (number, np.array([0.0, 0.0, self._mass(number) * GRAVITY_M_S2]))
            for number in self._counterbalanced
        ]
        if self._push_w.any():
            forces.append((part, self._push_w))
        for number, force_w in forces:
            com_w = self._call("getLinkState", item, number)[0]
            self._call(
                "applyExternalForce", item, number, force_w.tolist(), com_w, pybullet.WORLD_FRAME
            )

    def _mass(self, number: int) -> float:
        return float(self._call("getDynamicsInfo", self._bodies.object, number)[0])

    def _contacts(self) -> tuple[Array, bool]:
        """Return the net wrench on the gripper about the tool (6,), and forbidden contact."""
        # Contacts come one by one, as tuples: sums of floats are ten times as fast as arrays here.
        fx = fy = fz = mx = my = mz = 0.0  # about the world's origin
        touch, loaded, bodies = False, False, self._bodies
        for contact in self._call("getContactPoints"):
            if contact[9] <= 0.0:
                continue
            first = contact[1] == bodies.arm
            link, other = (contact[3], contact[2]) if first else (contact[4], contact[1])
            if link not in bodies.gripper_links:
                touch |= other == bodies.object
                continue
            x, y, z = contact_force(contact)
            if not first:
                x, y, z = -x, -y, -z
            px, py, pz = contact[5 if first else 6]
            fx, fy, fz = fx + x, fy + y, fz + z
            mx, my, mz = mx + py * z - pz * y, my + pz * x - px * z, mz + px * y - py * x
            loaded = True
        wrench = np.array([fx, fy, fz, mx, my, mz])
        if loaded:
            tool_w = tool_pose(self._manifest.robot, self._q[:7])[:3, 3]
            wrench[3:] -= np.cross(tool_w, wrench[:3])
        return wrench, touch


def contact_force(contact: Any) -> tuple[float, float, float]:
    """Return the force on the first of the two bodies of a contact point [N].

    ``getContactPoints`` flips the normal for a requested pair, but not the two directions of
    friction: the values are consistent only for a call without bodies.
    """
    nx, ny, nz = contact[7]
    ax, ay, az = contact[11]
    bx, by, bz = contact[13]
    n, a, b = contact[9], contact[10], contact[12]
    return (
        n * nx + a * ax + b * bx,
        n * ny + a * ay + b * by,
        n * nz + a * az + b * bz,
    )


def armature_on_links(arm: Arm, q: Array) -> Array:
    """Return the link inertias about the joint axes (7,) [kg m^2] that model ``arm.armature``.

    A rotor's inertia acts at its joint only; a link's acts at every joint before it, by the squared
    cosine between the axes. The part of the links beyond at ``q`` (7,) [rad] is subtracted.
    """
    axes = joint_poses(arm, q)[:, :3, 2]
    share = (axes @ axes.T) ** 2
    out = np.zeros(7)
    for i in reversed(range(7)):
        out[i] = max(0.0, float(arm.armature[i] - share[i, i + 1 :] @ out[i + 1 :]))
    return out
