"""Scene: asset, task, arm and physics as one MuJoCo model, with addresses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import AssetError, shorten
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.contact import FLOOR_SENSOR, GRIPPER_SENSOR, ROBOT_SENSOR
from articulate.robot.control import check_control
from articulate.simulator import mujoco
from articulate.task.object_placement import ObjectPlacement, grasped, object_pose
from articulate.task.randomization import EpisodeParams
from articulate.task.task import Task
from articulate.transforms import Array, matrix_to_quat
from articulate_envs.panda import ARM_BIT, BASE_BODY, GRIPPER_BODY, OBJECT_BIT, panda_spec
from articulate_envs.physics import PhysicsConfig

PREFIX = "object/"
"""Prefix of all names of the object in a scene."""


@dataclass(frozen=True)
class Addresses:
    """Indices into the model's arrays, the same for every size of the object."""

    arm_q: int
    """First of the arm's seven positions and velocities."""
    finger_q: int
    """First of the two fingers."""
    arm_ctrl: int
    """First of the arm's seven actuators."""
    finger_ctrl: int
    """First of the two finger actuators."""
    part_q: int
    """Position of the task's joint."""
    part_v: int
    """Velocity of the task's joint."""
    object_v: tuple[int, ...]
    """Degrees of freedom of the object."""
    root_body: int
    """The object's root body."""
    part_body: int
    """Body that the task's joint moves."""
    moving_bodies: tuple[int, ...]
    """Bodies of the object below a joint."""
    finger_geoms: tuple[int, ...]
    """Geoms whose friction applies to contacts of the fingers."""
    tool_site: int
    """Site of the tool frame."""
    sensors: tuple[int, int, int]
    """First value of the gripper, floor and robot sensors."""


@dataclass(frozen=True)
class Scene:
    """Compiled scene; model ``k`` has the object at size ``scales[k]``.

    The asset's handle is the one to grasp, chosen and tilted as in the placement.
    """

    asset: Asset
    task: Task
    arm: Arm
    control: ControlConfig
    physics: PhysicsConfig
    placement: ObjectPlacement
    scales: tuple[float, ...]
    models: tuple[mujoco.MjModel, ...]
    at: Addresses

    @property
    def nominal(self) -> mujoco.MjModel:
        """Model whose size is nearest to 1."""
        return self.models[int(np.argmin(np.abs(np.asarray(self.scales) - 1.0)))]

    @property
    def substeps(self) -> int:
        """Physics steps in a control step."""
        return self.physics.substeps(self.control.step_s)

    @property
    def n_steps(self) -> int:
        """Control steps in an episode."""
        return round(self.task.episode_s * self.control.rate_hz)

    def T_wo(self, params: EpisodeParams) -> Array:
        """Return poses (N, 4, 4) of the object in the world; see :func:`object_pose`."""
        return object_pose(
            self.asset,
            self.task.joint,
            self.placement,
            scale=params["scale"],
            shift=np.stack([params["x_m"], params["y_m"]], axis=1),
            yaw=params["yaw_rad"],
        )


def build_scene(
    asset: Asset,
    task: Task,
    *,
    arm: Arm,
    control: ControlConfig,
    physics: PhysicsConfig,
    placement: ObjectPlacement,
    scales: tuple[float, ...] = (1.0,),
) -> Scene:
    """Compile the scene for each of ``scales``.

    Raises:
        ConfigError: The controller could take the arm beyond its limits.
        MissingError: robosuite, which provides the Panda, is not installed.
    """
    check_control(control, arm)
    models = []
    for scale in scales:
        spec = scene_spec(
            asset, arm=arm, physics=physics, placement=placement, scale=scale, visuals=False
        )
        counterbalance(spec, asset, task)
        try:
            models.append(spec.compile())
        except ValueError as error:
            raise AssetError(
                f"{asset.mjcf_path}: MuJoCo does not accept it ({shorten(error)})"
            ) from None
    return Scene(
        asset=grasped(asset, task.joint, placement),
        task=task,
        arm=arm,
        control=control,
        physics=physics,
        placement=placement,
        scales=scales,
        models=tuple(models),
        at=_addresses(models[0], task),
    )


def scene_spec(
    asset: Asset,
    *,
    arm: Arm,
    physics: PhysicsConfig,
    placement: ObjectPlacement,
    scale: float,
    visuals: bool,
) -> mujoco.MjSpec:
    """Return arm, floor and object as an editable model, with ``visuals`` for rendering."""
    spec = panda_spec(arm, visuals=visuals)
    spec.modelname = asset.name
    apply_physics(spec, physics)
    try:
        child = mujoco.MjSpec.from_file(str(asset.mjcf_path))
    except ValueError as error:
        raise AssetError(
            f"{asset.mjcf_path}: MuJoCo does not accept it ({shorten(error)})"
        ) from None
    _prepare_object(child, scale=scale, visuals=visuals)
    frame = spec.worldbody.add_frame()
    T_wo = placement.T_wo()
    root = child.worldbody.first_body()
    root_name = PREFIX + root.name
    root.pos = T_wo[:3, 3]
    root.quat = matrix_to_quat(T_wo[:3, :3])
    spec.attach(child, prefix=PREFIX, frame=frame)
    _add_arena(spec, asset, placement, visuals=visuals)
    _add_sensors(spec, root_name)
    return spec


def counterbalance(spec: mujoco.MjSpec, asset: Asset, task: Task) -> None:
    """Compensate the weight of a part that begins open and would fall.

    Springs and struts of lids do so. A level drawer and an upright door need no compensation.
    """
    joint = asset.joint(task.joint)
    up = abs(joint.axis_o[2])
    falls = up > LEVEL if joint.kind == "slide" else up < np.sqrt(1.0 - LEVEL**2)
    if task.begin[1] <= 0.0 or not falls:
        return
    below = [spec.body(PREFIX + joint.link)]
    while below:
        body = below.pop()
        body.gravcomp = 1.0
        below += list(body.bodies)


LEVEL = 1e-3
"""Sine of an angle that counts as 0."""


def apply_physics(spec: mujoco.MjSpec, config: PhysicsConfig) -> None:
    """Write the physics settings into ``spec``."""
    spec.option.timestep = config.timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    spec.option.cone = (
        mujoco.mjtCone.mjCONE_ELLIPTIC
        if config.cone == "elliptic"
        else mujoco.mjtCone.mjCONE_PYRAMIDAL
    )
    spec.option.impratio = config.impratio
    spec.option.iterations = config.iterations
    spec.option.tolerance = config.tolerance
    # MuJoCo would reset a diverged state; the engines stop and report it.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.memory = 4 << 20


def _prepare_object(spec: mujoco.MjSpec, *, scale: float, visuals: bool) -> None:
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            if not visuals:
                spec.delete(geom)
                continue
        else:
            geom.contype, geom.conaffinity = OBJECT_BIT, ARM_BIT | OBJECT_BIT
        geom.pos = scale * np.asarray(geom.pos)
        geom.size = scale * np.asarray(geom.size)
    used = {g.meshname for g in spec.geoms if g.meshname}
    for mesh in list(spec.meshes):
        if mesh.name not in used:
            spec.delete(mesh)
        else:
            mesh.scale = scale * np.asarray(mesh.scale)
    for site in spec.sites:
        site.pos = scale * np.asarray(site.pos)
    for body in spec.bodies:
        body.pos = scale * np.asarray(body.pos)
        body.ipos = scale * np.asarray(body.ipos)
        body.mass = scale**3 * body.mass
        body.inertia = scale**5 * np.asarray(body.inertia)
        body.fullinertia = scale**5 * np.asarray(body.fullinertia)
    for joint in spec.joints:
        joint.pos = scale * np.asarray(joint.pos)
        if int(joint.type) == int(mujoco.mjtJoint.mjJNT_SLIDE):
            joint.range = scale * np.asarray(joint.range)


def _add_arena(
    spec: mujoco.MjSpec, asset: Asset, placement: ObjectPlacement, *, visuals: bool
) -> None:
    floor_z = min(0.0, placement.pos_w[2])
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE)
    floor.size = [3.0, 3.0, 0.1]
    floor.pos = [0.0, 0.0, floor_z]
    floor.rgba = [0.86, 0.87, 0.88, 1.0]
    floor.contype, floor.conaffinity, floor.group = 0, ARM_BIT, 2
    if not visuals:
        return
    for name, top, x, half in (
        ("robot_stand", 0.0, 0.0, (0.12, 0.12)),
        ("object_stand", placement.pos_w[2], placement.pos_w[0], _footprint(asset, placement)),
    ):
        if top - floor_z > 0.01:
            height = (top - floor_z) / 2.0
            box = spec.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX)
            box.size = [half[0], half[1], height - 0.001]
            box.pos = [x, 0.0 if name == "robot_stand" else placement.pos_w[1], floor_z + height]
            box.contype, box.conaffinity, box.group = 0, 0, 2
            box.rgba = [0.55, 0.57, 0.6, 1.0]
    light = spec.worldbody.add_light()
    light.pos, light.dir = [0.0, -1.0, 3.0], [0.2, 0.4, -1.0]
    light.diffuse = [0.6, 0.6, 0.6]
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL


def _footprint(asset: Asset, placement: ObjectPlacement) -> tuple[float, float]:
    low, high = (np.asarray(b) for b in asset.bounds_o)
    half = (high - low)[:2] / 2.0
    c, s = abs(np.cos(placement.yaw_rad)), abs(np.sin(placement.yaw_rad))
    return float(c * half[0] + s * half[1]), float(s * half[0] + c * half[1])


def _add_sensors(spec: mujoco.MjSpec, root_name: str) -> None:
    xbody, body = mujoco.mjtObj.mjOBJ_XBODY, mujoco.mjtObj.mjOBJ_BODY
    data = mujoco.mjtConDataField
    net = [int(data.mjCONDATA_FOUND), int(data.mjCONDATA_FORCE)]
    net += [int(data.mjCONDATA_TORQUE), int(data.mjCONDATA_POS)]
    for name, first, second, kind, fields, reduce in (
        (GRIPPER_SENSOR, GRIPPER_BODY, root_name, xbody, net, 3),
        (FLOOR_SENSOR, GRIPPER_BODY, "world", body, net, 3),
        (ROBOT_SENSOR, BASE_BODY, root_name, xbody, net[:1], 0),
    ):
        sensor = spec.add_sensor(name=name)
        sensor.type = mujoco.mjtSensor.mjSENS_CONTACT
        sensor.objtype, sensor.objname = xbody, first
        sensor.reftype, sensor.refname = kind, second
        sensor.intprm = [sum(1 << f for f in fields), reduce, 1]


def _addresses(model: mujoco.MjModel, task: Task) -> Addresses:
    part = model.joint(PREFIX + task.joint)
    arm = model.joint("joint1")
    finger = model.joint("finger_joint1")
    moving = [
        i
        for i in range(model.nbody)
        if model.body(i).name.startswith(PREFIX) and model.body_weldid[i] != 0
    ]
    object_v = [i for i in range(model.nv) if int(model.dof_bodyid[i]) in moving]
    root = next(i for i in range(model.nbody) if model.body(i).name.startswith(PREFIX))
    fingers = [
        i
        for i in range(model.ngeom)
        if model.geom(i).name.startswith("finger") and model.geom_contype[i]
    ]
    return Addresses(
        arm_q=int(arm.qposadr[0]),
        finger_q=int(finger.qposadr[0]),
        arm_ctrl=int(model.actuator("joint1").id),
        finger_ctrl=int(model.actuator("finger_joint1").id),
        part_q=int(part.qposadr[0]),
        part_v=int(part.dofadr[0]),
        object_v=tuple(object_v),
        root_body=root,
        part_body=int(part.bodyid[0]),
        moving_bodies=tuple(moving),
        finger_geoms=tuple(fingers),
        tool_site=int(model.site("tool").id),
        sensors=(
            int(model.sensor(GRIPPER_SENSOR).adr[0]),
            int(model.sensor(FLOOR_SENSOR).adr[0]),
            int(model.sensor(ROBOT_SENSOR).adr[0]),
        ),
    )
