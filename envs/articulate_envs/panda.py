"""The Panda of robosuite as an editable MuJoCo model with joint impedance actuators."""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

from articulate.errors import MissingError
from articulate.robot.arm import Arm
from articulate.robot.kinematics import FLANGE_Z_M, GRIPPER_YAW_RAD
from articulate.simulator import mujoco
from articulate.transforms import Array

GRIPPER_BODY = "right_hand"
"""Body of the gripper, parent of the fingers."""
BASE_BODY = "link0"
"""First body of the arm."""
COARSE_MESHES = tuple(f"link{i}" for i in range(8))
"""Collision meshes of the arm that are reduced; gripper and fingers are not."""
COARSE_POINTS = 48
"""Vertices of a reduced mesh."""
PADS_Z_M = 0.041
"""Middle of the finger pads above the frame of a finger [m]. ``franka_description`` mounts fingers
0.0584 m above the frame of the gripper; robosuite's 0.0524 m make the gripper 6 mm too short."""
PADS_IMPEDANCE = [0.95, 0.99, 0.001, 0.5, 2.0]
"""``solimp`` of contacts with the fingers. The penetration depends on the inertia behind a contact:
with MuJoCo's default of 0.9 to 0.95 the fingers sink 0.9 mm into a lid of 0.1 kg, contact points
jump from step to step, and at 5 ms the lid rattles at 0.1 to 0.2 rad/s between fixed fingers."""
ARM_BIT, OBJECT_BIT = 1, 2
"""Contact bits: the arm collides with the object and the floor, never with itself."""


def robosuite_folder() -> Path:
    """Return the folder of robosuite without importing it.

    Raises:
        MissingError: It is not installed.
    """
    found = importlib.util.find_spec("robosuite")
    if found is None or found.origin is None:
        raise MissingError(
            "robosuite is not installed, which provides the Panda; "
            "run: pip install --no-deps robosuite==1.5.2"
        )
    return Path(found.origin).parent


def panda_spec(arm: Arm, *, visuals: bool) -> mujoco.MjSpec:
    """Return arm and gripper with the actuators ``joint1`` to ``joint7`` and two of the fingers.

    Joint impedance is a position actuator with target velocity 0; gravity is compensated within the
    torque limits of the actuators, as the controller of the arm does.

    Args:
        arm: Gains, limits, armature, gripper.
        visuals: Keep the visual meshes; without them a model is small and quick to copy.
    """
    assets = robosuite_folder() / "models" / "assets"
    spec = mujoco.MjSpec.from_file(str(assets / "robots" / "panda" / "robot.xml"))
    gripper = mujoco.MjSpec.from_file(str(assets / "grippers" / "panda_gripper.xml"))
    for part in (spec, gripper):
        _strip(part, visuals=visuals)
    wrist = spec.body(GRIPPER_BODY)  # robosuite rounds: 0.1065 m and quat 0.924, -0.383
    wrist.pos = [0.0, 0.0, FLANGE_Z_M]
    wrist.quat = [np.cos(GRIPPER_YAW_RAD / 2), 0.0, 0.0, np.sin(GRIPPER_YAW_RAD / 2)]
    frame = wrist.add_frame()
    spec.attach(gripper, prefix="", frame=frame)
    _set_joints(spec, arm)
    _set_fingers(spec, arm)
    tool = spec.body(GRIPPER_BODY).add_site()
    tool.name = "tool"
    tool.pos = [0.0, 0.0, arm.gripper.tcp_z_m]
    return spec


def _strip(spec: mujoco.MjSpec, *, visuals: bool) -> None:
    for element in [*spec.actuators, *spec.sensors, *spec.cameras]:
        spec.delete(element)
    for site in list(spec.sites):
        spec.delete(site)
    used = set()
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            if not visuals:
                spec.delete(geom)
                continue
            geom.group = 2
        else:
            geom.group = 3
            geom.contype, geom.conaffinity = ARM_BIT, OBJECT_BIT
            geom.rgba = [0.5, 0.5, 0.5, 1.0]
            geom.material = ""
        if geom.meshname:
            used.add(geom.meshname)
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
        elif mesh.name in COARSE_MESHES:
            _make_coarse(spec, mesh)
    if not visuals:
        for material in list(spec.materials):
            spec.delete(material)


def _make_coarse(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh) -> None:
    """Replace a collision mesh by few points of its convex hull, by farthest point sampling.

    MuJoCo collides with the hull of a mesh in any case; fewer points make models small.
    """
    folder = Path(spec.modelfiledir) / spec.meshdir
    points = _hull_points(folder / mesh.file, COARSE_POINTS)
    mesh.file = ""
    mesh.uservert = points.ravel()


@lru_cache(maxsize=32)
def _hull_points(path: Path, count: int) -> Array:
    loaded = trimesh.load(path, force="mesh")
    points = np.asarray(loaded.convex_hull.vertices, dtype=np.float64)
    chosen = [int(np.argmin(points[:, 0]))]
    distance = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    return np.asarray(points[chosen])


def _set_joints(spec: mujoco.MjSpec, arm: Arm) -> None:
    for body in spec.bodies:
        body.gravcomp = 1.0 if body.name not in ("world", "base") else 0.0
    for i in range(7):
        joint = spec.joint(f"joint{i + 1}")
        joint.armature = arm.armature[i]
        joint.frictionloss = arm.friction[i]
        joint.damping = np.zeros(3)
        joint.range = [arm.q_min[i], arm.q_max[i]]
        joint.actgravcomp = 1
        joint.actfrclimited = 1
        joint.actfrcrange = [-arm.tau_max[i], arm.tau_max[i]]
        actuator = spec.add_actuator(name=joint.name, target=joint.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.set_to_position(kp=arm.stiffness[i], kv=arm.damping[i])


def _set_fingers(spec: mujoco.MjSpec, arm: Arm) -> None:
    for name in ("leftfinger", "rightfinger"):
        spec.body(name).pos = [0.0, 0.0, arm.gripper.tcp_z_m - PADS_Z_M]
    half = arm.gripper.max_width_m / 2.0
    for i, sign in ((1, 1.0), (2, -1.0)):
        joint = spec.joint(f"finger_joint{i}")
        joint.armature, joint.frictionloss = 0.2, 0.5
        joint.damping = np.array([20.0, 0.0, 0.0])
        joint.range = [0.0, half] if sign > 0 else [-half, 0.0]
        joint.solref_limit, joint.solimp_limit = [0.01, 1.0], [0.99, 0.999, 0.001, 0.5, 2.0]
        actuator = spec.add_actuator(name=joint.name, target=joint.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.set_to_position(kp=arm.gripper.stiffness_n_m, kv=40.0)
        actuator.forcelimited = 1
        actuator.forcerange = [-arm.gripper.force_n, arm.gripper.force_n]
    couple = spec.add_equality(name="fingers", name1="finger_joint2", name2="finger_joint1")
    couple.type = mujoco.mjtEq.mjEQ_JOINT
    couple.objtype = mujoco.mjtObj.mjOBJ_JOINT
    couple.data = np.array([0.0, -1.0, *([0.0] * 9)])
    for geom in spec.geoms:
        if geom.name.startswith("finger") and geom.contype:
            geom.condim = 4
            geom.priority = 1
            geom.friction = [1.0, 0.02, 0.0001]
            geom.solref, geom.solimp = [0.01, 1.0], PADS_IMPEDANCE
