"""Plain robosuite environment with the cabinet of ``training.py``, for comparison.

The environment follows ``Door`` of robosuite 1.5.2: a Panda with robosuite's JOINT_POSITION
controller at its default settings, its observables, its physics (2 ms, elliptic cone) and its loop,
without cameras and renderers. The cabinet has its collision geometry, inertias, limits and
friction. It has no visual meshes, which robosuite would compile at every hard reset.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET  # noqa: TID251  # robosuite's own trees; nothing is read

import gymnasium
import numpy as np
from numpy.typing import NDArray
from robosuite.controllers import load_part_controller_config
from robosuite.controllers.composite.composite_controller_factory import (
    refactor_composite_controller_config,
)
from robosuite.environments.manipulation.manipulation_env import ManipulationEnv
from robosuite.models.arenas import EmptyArena
from robosuite.models.objects import MujocoXMLObject
from robosuite.models.tasks import ManipulationTask
from robosuite.utils.log_utils import ROBOSUITE_DEFAULT_LOGGER
from robosuite.utils.observables import Observable, sensor

from articulate.assets.asset import Asset
from articulate.errors import AssetError
from articulate.robot.arm import PANDA
from articulate.simulator import mujoco

Array = NDArray[np.float64]
Vector = NDArray[np.float32]
CONTROL_HZ = 20
"""Control steps in a second, the default of robosuite."""
NAME = "cabinet"


@dataclass(frozen=True, kw_only=True)
class Fixture:
    """Object before the arm, and the joint to open."""

    model_path: Path
    """MJCF or URDF that MuJoCo reads; its root is fixed."""
    joint: str
    """Joint to open."""
    link: str
    """Body that carries the handle."""
    handle_pos_l: tuple[float, float, float]
    """Middle of the handle in the frame of that body [m]."""
    closed: float
    """Position in which the joint is closed [m or rad]."""
    open: float
    """Position in which it is open [m or rad]."""
    pos_w: tuple[float, float, float] = (0.92, 0.0, 0.2)
    """Position of the object in the frame of the arm's base [m]."""
    yaw_rad: float = 0.0
    """Rotation of the object about the vertical [rad]."""
    start_q: tuple[float, ...] = PANDA.home
    """Start pose of the arm (7,) [rad]; robosuite adds noise."""


def fixture_of(
    asset: Asset,
    joint_name: str,
    *,
    pos_w: tuple[float, float, float],
    yaw_rad: float,
    start_q: tuple[float, ...],
) -> Fixture:
    """Build the fixture in which ``joint_name`` of ``asset`` is opened."""
    joint, handle = asset.joint(joint_name), asset.handle_of(joint_name)
    if handle is None:
        raise AssetError(f"{asset.name}: joint {joint_name} has no handle; choose another --joint")
    return Fixture(
        model_path=asset.mjcf_path,
        joint=joint.name,
        link=handle.link,
        handle_pos_l=handle.pos_l,
        closed=joint.closed,
        open=joint.open,
        pos_w=pos_w,
        yaw_rad=yaw_rad,
        start_q=start_q,
    )


def make_env(fixture: Fixture, horizon: int = 200) -> gymnasium.Env[Vector, Vector]:
    """Create a Gymnasium environment with flat observations around ``OpenCabinet``."""
    ROBOSUITE_DEFAULT_LOGGER.setLevel("ERROR")
    controller = refactor_composite_controller_config(
        load_part_controller_config(default_controller="JOINT_POSITION"), "Panda", ["right"]
    )
    env = OpenCabinet(
        fixture,
        robots="Panda",
        base_types="NullMount",
        controller_configs=controller,
        control_freq=CONTROL_HZ,
        horizon=horizon,
        hard_reset=True,
        use_camera_obs=False,
        has_renderer=False,
        has_offscreen_renderer=False,
    )
    return FlatEnv(env)


class FlatEnv(gymnasium.Env[Vector, Vector]):
    """robosuite's proprioception and object state as one vector, for Stable-Baselines3.

    robosuite's ``GymWrapper`` warns of its float64 bounds and reports the end of the horizon as a
    terminal state.
    """

    keys = ("object-state", "robot0_proprio-state")

    def __init__(self, env: OpenCabinet) -> None:
        self.env = env
        size = self._flat(env.reset()).size
        low, high = (np.asarray(side, dtype=np.float32) for side in env.action_spec)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.action_space = gymnasium.spaces.Box(low, high)

    def reset(
        self, *, seed: int | None = None, options: dict[str, object] | None = None
    ) -> tuple[Vector, dict[str, object]]:
        """Rebuild the model, as robosuite does by default, and start an episode."""
        super().reset(seed=seed)
        if seed is not None:
            self.env.rng = np.random.default_rng(seed)
        return self._flat(self.env.reset()), {}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, object]]:
        """Advance by one control step; episodes end at the horizon only."""
        obs, reward, done, info = self.env.step(action)
        return self._flat(obs), reward, False, done, info

    def close(self) -> None:
        """Free the simulation."""
        self.env.close()

    def _flat(self, obs: dict[str, Array]) -> Vector:
        return np.concatenate([obs[key] for key in self.keys]).astype(np.float32)


class CabinetObject(MujocoXMLObject):  # type: ignore[misc]  # robosuite has no types
    """Fixture as an object of robosuite."""

    def __init__(self, fixture: Fixture) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "object.xml"
            model = mujoco.MjModel.from_xml_path(str(fixture.model_path))
            path.write_text(object_xml(model, fixture), encoding="utf-8")
            super().__init__(str(path), name=NAME, joints=None, duplicate_collision_geoms=False)


class OpenCabinet(ManipulationEnv):  # type: ignore[misc]  # robosuite has no types
    """Open one joint of a cabinet, like ``Door`` of robosuite."""

    def __init__(self, fixture: Fixture, **kwargs: object) -> None:
        self.fixture = fixture
        self.use_object_obs = True
        self.reward_scale = 1.0
        super().__init__(initialization_noise="default", **kwargs)

    def reward(self, action: Array | None = None) -> float:
        """Return 0.25 for reaching the handle plus 0.75 for the open fraction, or 1 when open."""
        if self._check_success():
            return 1.0
        distance = np.linalg.norm(self._handle_pos() - self._gripper_pos())
        return float(0.25 * (1.0 - np.tanh(10.0 * distance)) + 0.75 * self._open_fraction())

    def _open_fraction(self) -> float:
        q = self.sim.data.qpos[self.joint_qpos_addr]
        span = self.fixture.open - self.fixture.closed
        return float(np.clip((q - self.fixture.closed) / span, 0.0, 1.0))

    def _check_success(self) -> bool:
        return self._open_fraction() > 0.8

    def _handle_pos(self) -> Array:
        return np.array(self.sim.data.site_xpos[self.handle_site_id])

    def _gripper_pos(self) -> Array:
        return np.array(self.sim.data.site_xpos[self.robots[0].eef_site_id["right"]])

    def _load_model(self) -> None:
        super()._load_model()
        self.robots[0].robot_model.set_base_xpos([0.0, 0.0, 0.0])
        self.robots[0].init_qpos = np.array(self.fixture.start_q)
        arena = EmptyArena()
        arena.set_origin([0.0, 0.0, min(0.0, self.fixture.pos_w[2])])
        self.cabinet = CabinetObject(self.fixture)
        self.cabinet.set_pos(self.fixture.pos_w)
        self.cabinet.set_euler([0.0, 0.0, self.fixture.yaw_rad])
        self.model = ManipulationTask(
            mujoco_arena=arena,
            mujoco_robots=[robot.robot_model for robot in self.robots],
            mujoco_objects=self.cabinet,
        )
        for exclude in self.cabinet.contact:  # a task copies only bodies and assets of an object
            self.model.contact.append(exclude)

    def _setup_references(self) -> None:
        super()._setup_references()
        self.handle_site_id = self.sim.model.site_name2id(f"{NAME}_handle")
        joint = f"{NAME}_{self.fixture.joint}"
        self.joint_qpos_addr = self.sim.model.get_joint_qpos_addr(joint)
        self.joint_qvel_addr = self.sim.model.get_joint_qvel_addr(joint)

    def _setup_observables(self) -> dict[str, Observable]:
        observables = super()._setup_observables()

        @sensor(modality="object")  # type: ignore[untyped-decorator]
        def handle_pos(_: object) -> Array:
            return self._handle_pos()

        @sensor(modality="object")  # type: ignore[untyped-decorator]
        def handle_to_eef_pos(_: object) -> Array:
            return self._handle_pos() - self._gripper_pos()

        @sensor(modality="object")  # type: ignore[untyped-decorator]
        def joint_pos(_: object) -> Array:
            return np.array([self.sim.data.qpos[self.joint_qpos_addr]])

        @sensor(modality="object")  # type: ignore[untyped-decorator]
        def joint_vel(_: object) -> Array:
            return np.array([self.sim.data.qvel[self.joint_qvel_addr]])

        for s in (handle_pos, handle_to_eef_pos, joint_pos, joint_vel):
            observables[s.__name__] = Observable(
                name=s.__name__, sensor=s, sampling_rate=self.control_freq
            )
        return dict(observables)


def object_xml(model: mujoco.MjModel, fixture: Fixture) -> str:
    """Return the MJCF that ``MujocoXMLObject`` expects, from a compiled fixture.

    Compilation resolves the defaults, which robosuite would drop. Geoms without contacts are
    omitted.
    """
    root = ET.Element("mujoco", model=NAME)
    asset = ET.SubElement(root, "asset")
    outer = ET.SubElement(ET.SubElement(root, "worldbody"), "body")
    bodies = {0: ET.SubElement(outer, "body", name="object")}
    for i in range(model.nbody):
        if i > 0:
            parent = bodies[int(model.body_parentid[i])]
            at = {"pos": _row(model.body_pos[i]), "quat": _row(model.body_quat[i])}
            bodies[i] = ET.SubElement(parent, "body", {"name": model.body(i).name} | at)
            _add_moving_parts(model, i, bodies[i])
        _add_geoms(model, i, bodies[i], asset)
    link = bodies[model.body(fixture.link).id]
    ET.SubElement(link, "site", name="handle", pos=_row(fixture.handle_pos_l), size="0.005")
    for name, pos in (("bottom", "0 0 0"), ("top", "0 0 1"), ("horizontal_radius", "0.5 0 0")):
        ET.SubElement(outer, "site", name=f"{name}_site", pos=pos, size="0.005", rgba="0 0 0 0")
    contact = ET.SubElement(root, "contact")
    for signature in model.exclude_signature:
        names = [_body_name(model, b) for b in (int(signature) >> 16, int(signature) & 0xFFFF)]
        ET.SubElement(contact, "exclude", body1=names[0], body2=names[1])
    return ET.tostring(root, encoding="unicode")


def _body_name(model: mujoco.MjModel, body: int) -> str:
    return str(model.body(body).name) if body else "main"  # robosuite's name for the outer body


def _add_moving_parts(model: mujoco.MjModel, body: int, element: ET.Element) -> None:
    if model.body_mass[body] > 0.0:
        ET.SubElement(
            element,
            "inertial",
            pos=_row(model.body_ipos[body]),
            quat=_row(model.body_iquat[body]),
            mass=_row(model.body_mass[body]),
            diaginertia=_row(model.body_inertia[body]),
        )
    first = int(model.body_jntadr[body])
    for j in range(first, first + int(model.body_jntnum[body])):
        dof = int(model.jnt_dofadr[j])
        slide = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
        limited = bool(model.jnt_limited[j])
        ET.SubElement(
            element,
            "joint",
            name=model.joint(j).name,
            type="slide" if slide else "hinge",
            pos=_row(model.jnt_pos[j]),
            axis=_row(model.jnt_axis[j]),
            limited=str(limited).lower(),
            range=_row(model.jnt_range[j]),
            damping=_row(model.dof_damping[dof]),
            frictionloss=_row(model.dof_frictionloss[dof]),
            armature=_row(model.dof_armature[dof]),
        )


def _add_geoms(model: mujoco.MjModel, body: int, element: ET.Element, asset: ET.Element) -> None:
    first = int(model.body_geomadr[body])
    for g in range(first, first + int(model.body_geomnum[body])):
        if not model.geom_contype[g] and not model.geom_conaffinity[g]:
            continue
        kind = mujoco.mjtGeom(int(model.geom_type[g])).name.removeprefix("mjGEOM_").lower()
        geom = ET.SubElement(
            element,
            "geom",
            name=f"g{g}",
            type=kind,
            group="0",
            pos=_row(model.geom_pos[g]),
            quat=_row(model.geom_quat[g]),
            friction=_row(model.geom_friction[g]),
            condim=str(int(model.geom_condim[g])),
        )
        if kind == "mesh":
            mesh = int(model.geom_dataid[g])
            start = int(model.mesh_vertadr[mesh])
            points = model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])]
            ET.SubElement(asset, "mesh", name=f"m{g}", vertex=_row(points))
            geom.set("mesh", f"m{g}")
        else:
            geom.set("size", _row(model.geom_size[g]))


def _row(values: NDArray[np.floating] | tuple[float, ...] | float) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(values))
