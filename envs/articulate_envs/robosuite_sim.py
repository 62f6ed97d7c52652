"""Simulation, robot, cameras and viewer of a scene with the interfaces of robosuite."""

from __future__ import annotations

from typing import Any

import numpy as np
from robosuite.utils.binding_utils import MjModel, MjSim

from articulate.errors import EngineError, nearest, quote
from articulate.render.canvas import Pixels
from articulate.task.observation import ACTION
from articulate.transforms import Array
from articulate_envs.scene import Scene, counterbalance, scene_spec
from articulate_envs.single_engine import SingleEngine
from articulate_envs.video import SceneRenderer
from articulate_envs.viewer import SceneViewer, require_display

CAMERAS: dict[str, tuple[float, float] | None] = {
    "agentview": None,
    "sideview": (90.0, -15.0),
    "birdview": (0.0, -80.0),
}
"""Azimuth and elevation of each camera [deg]; None: the view with the least occluded gripper."""


class SceneModel:
    """``env.model`` of robosuite: the model as text."""

    def __init__(self, scene: Scene, engine: SingleEngine) -> None:
        self._scene = scene
        self._engine = engine
        self.mujoco_objects: list[Any] = []
        self.mujoco_robots: list[Any] = []

    def get_xml(self) -> str:
        """Return the model at the size of the episode as MJCF, with the file names of meshes."""
        scene = self._scene
        scale, _ = self._engine.object_pose(0)
        spec = scene_spec(
            scene.asset,
            arm=scene.arm,
            physics=scene.physics,
            placement=scene.placement,
            scale=scale,
            visuals=False,
        )
        counterbalance(spec, scene.asset, scene.task)
        spec.compile()
        return str(spec.to_xml())

    def generate_id_mappings(self, sim: Any) -> None:
        """Do nothing: robosuite's classes of parts are not used."""


class NamedModel(MjModel):  # type: ignore[misc]  # robosuite has no types
    """robosuite's wrapper of the model, with its text."""

    def __init__(self, scene: Scene, engine: SingleEngine) -> None:
        super().__init__(engine.model)
        self._text = SceneModel(scene, engine)

    def get_xml(self) -> str:
        """See :meth:`SceneModel.get_xml`."""
        return self._text.get_xml()


class SceneSim(MjSim):  # type: ignore[misc]  # robosuite has no types
    """robosuite's wrapper of the engine's model and data; images show the visual model."""

    def __init__(self, scene: Scene, engine: SingleEngine) -> None:
        super().__init__(engine.model)
        self.model = NamedModel(scene, engine)
        self.data._model = self.model
        self.data._data = engine.data
        self.scene = scene
        self._engine = engine
        self._rendered_pose: bytes | None = None
        self._renderers: dict[tuple[int, int], SceneRenderer] = {}

    def render(
        self,
        width: int | None = None,
        height: int | None = None,
        *,
        camera_name: str | None = None,
        depth: bool = False,
        mode: str = "offscreen",
        device_id: int = -1,
        segmentation: bool = False,
    ) -> Pixels:
        """Return an image (height, width, 3) [0 to 255], bottom row first as in robosuite.

        Raises:
            EngineError: Depth or segmentation is requested, or the camera is unknown.
            MissingError: This machine cannot render.
        """
        if depth or segmentation or mode != "offscreen":
            raise EngineError("sim.render supports RGB only: omit depth and segmentation")
        name = camera_name or "agentview"
        if name not in CAMERAS:
            raise EngineError(f"no camera {quote(name)}{nearest(name, CAMERAS)}")
        renderer = self._renderer((width or 256, height or 256))
        qpos, direction = self.data.qpos.copy(), CAMERAS[name]
        view = None
        if direction is not None:
            azimuth, elevation = direction
            view = renderer.view_from(qpos, azimuth_deg=azimuth, elevation_deg=elevation)
        return renderer.frame(qpos, view)[::-1]

    def _renderer(self, size: tuple[int, int]) -> SceneRenderer:
        if self._rendered_pose != self.pose_id():
            self.free()
            self._rendered_pose = self.pose_id()
        if size not in self._renderers:
            scale, T_wo = self._engine.object_pose(0)
            self._renderers[size] = SceneRenderer(self.scene, scale=scale, T_wo=T_wo, size=size)
        return self._renderers[size]

    def viewer(self) -> SceneViewer:
        """Open a viewer with the object of the episode."""
        scale, T_wo = self._engine.object_pose(0)
        return SceneViewer(self.scene, scale=scale, T_wo=T_wo)

    def pose_id(self) -> bytes:
        """Return a key of the size and pose of the object."""
        scale, T_wo = self._engine.object_pose(0)
        return np.float64(scale).tobytes() + T_wo.tobytes()

    def free(self) -> None:
        """Close the renderers; model and data belong to the engine."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()


class RobosuiteViewer:
    """MuJoCo's viewer with the interface of robosuite's; it opens with the first image."""

    def __init__(self, sim: SceneSim) -> None:
        """Prepare a viewer of ``sim``.

        Raises:
            MissingError: There is no display.
        """
        require_display()
        self._sim = sim
        self._viewer: SceneViewer | None = None
        self._pose = b""

    def update(self) -> None:
        """Show the current state, in real time."""
        if self._viewer is None or self._pose != self._sim.pose_id():
            self.close()
            self._viewer, self._pose = self._sim.viewer(), self._sim.pose_id()
        self._viewer.show(self._sim.data.qpos, self._sim.scene.control.step_s)

    render = update

    def reset(self) -> None:
        """Do nothing: the next image shows the new episode."""

    def close(self) -> None:
        """Close the viewer."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


class Panda:
    """``robot.robot_model`` of robosuite: names that its wrappers require."""

    name = "Panda"
    naming_prefix = "robot0_"


class RobosuiteRobot:
    """``env.robots[0]`` of robosuite: limits and joint state of the arm."""

    name = "Panda"
    arms = ("right",)

    def __init__(self, sim: SceneSim, scene: Scene) -> None:
        self.robot_model = Panda()
        self.sim = sim
        self.init_qpos = np.array(scene.placement.start_q)
        self.control_freq = scene.control.rate_hz
        self._at = scene.at

    @property
    def action_limits(self) -> tuple[Array, Array]:
        """Lowest and highest action (8,), (8,), dimensionless."""
        return ACTION.low.astype(np.float64), ACTION.high.astype(np.float64)

    @property
    def action_dim(self) -> int:
        """Size of an action."""
        return ACTION.size

    @property
    def _joint_positions(self) -> Array:
        at = self._at.arm_q
        return np.array(self.sim.data.qpos[at : at + 7])

    @property
    def _joint_velocities(self) -> Array:
        at = self._at.arm_q
        return np.array(self.sim.data.qvel[at : at + 7])
