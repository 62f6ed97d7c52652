"""What robosuite's users look into: the simulation, the robot, cameras and viewer of our scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from robosuite.utils.binding_utils import MjModel, MjSim

from articulate.errors import EngineError, nearest
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
"""Cameras: azimuth and elevation of their view [deg], None for the one that sees the hand best."""


class SceneModel:
    """What ``env.model`` is: robosuite's way to the model as text."""

    def __init__(self, scene: Scene, engine: SingleEngine) -> None:
        self._scene = scene
        self._engine = engine
        self.mujoco_objects: list[Any] = []
        self.mujoco_robots: list[Any] = []

    def get_xml(self) -> str:
        """The model at the episode's size as MJCF; meshes stand in it by their files."""
        scene = self._scene
        scale, _ = self._engine.object_pose(0)
        spec = scene_spec(
            scene.asset,
            arm=scene.arm,
            physics=scene.physics,
            place=scene.place,
            scale=scale,
            visuals=False,
        )
        counterbalance(spec, scene.asset, scene.task)
        spec.compile()
        return str(spec.to_xml())

    def generate_id_mappings(self, sim: Any) -> None:
        """Nothing: parts have no classes here."""


class NamedModel(MjModel):  # type: ignore[misc]  # robosuite has no types
    """robosuite's view of the model, which says its text."""

    def __init__(self, scene: Scene, engine: SingleEngine) -> None:
        super().__init__(engine.model)
        self._text = SceneModel(scene, engine)

    def get_xml(self) -> str:
        """See :meth:`SceneModel.get_xml`."""
        return self._text.get_xml()


class SceneSim(MjSim):  # type: ignore[misc]  # robosuite has no types
    """robosuite's view of the engine's model and data, with pictures of the scene as it looks."""

    def __init__(self, scene: Scene, engine: SingleEngine) -> None:
        super().__init__(engine.model)
        self.model = NamedModel(scene, engine)
        self.data._model = self.model
        self.data._data = engine.data
        self.scene = scene
        self._engine = engine
        self._shown: tuple[float, bytes] | None = None
        self._films: dict[tuple[int, int], SceneRenderer] = {}

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
        """A picture (height, width, 3), rows from below as robosuite has it.

        Raises:
            EngineError: Depth or segmentation is asked for, or a camera that is not there.
            MissingError: Nothing can be drawn here.
        """
        if depth or segmentation or mode != "offscreen":
            raise EngineError("sim.render draws colours alone: leave depth and segmentation out")
        name = camera_name or "agentview"
        if name not in CAMERAS:
            raise EngineError(f"no camera {name!r}{nearest(name, CAMERAS)}")
        film = self._film((width or 256, height or 256))
        qpos, way = self.data.qpos.copy(), CAMERAS[name]
        view = None
        if way is not None:
            view = film.view_from(qpos, azimuth_deg=way[0], elevation_deg=way[1])
        return film.frame(qpos, view)[::-1]

    def _film(self, size: tuple[int, int]) -> SceneRenderer:
        scale, T_wo = self._engine.object_pose(0)
        if self._shown != (scale, T_wo.tobytes()):
            self._close_films()
            self._shown = (scale, T_wo.tobytes())
        if size not in self._films:
            self._films[size] = SceneRenderer(self.scene, scale=scale, T_wo=T_wo, size=size)
        return self._films[size]

    def _close_films(self) -> None:
        for film in self._films.values():
            film.close()
        self._films.clear()

    def window(self) -> SceneViewer:
        """A window on the episode's object."""
        scale, T_wo = self._engine.object_pose(0)
        return SceneViewer(self.scene, scale=scale, T_wo=T_wo)

    def pose_id(self) -> bytes:
        """Tells objects of different sizes and poses apart."""
        scale, T_wo = self._engine.object_pose(0)
        return np.float64(scale).tobytes() + T_wo.tobytes()

    def free(self) -> None:
        """Give back pictures; model and data stay the engine's."""
        self._close_films()


class RobosuiteViewer:
    """MuJoCo's viewer as robosuite calls its own: opened at the first picture."""

    def __init__(self, sim: SceneSim) -> None:
        """For ``sim``; MissingError where there is no display."""
        require_display()
        self._sim = sim
        self._window: SceneViewer | None = None
        self._pose = b""

    def update(self) -> None:
        """Show the state of now, at its pace."""
        if self._window is None or self._pose != self._sim.pose_id():
            self.close()
            self._window, self._pose = self._sim.window(), self._sim.pose_id()
        self._window.show(self._sim.data.qpos, self._sim.scene.control.step_s)

    render = update

    def reset(self) -> None:
        """Nothing: the next picture shows the new episode."""

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
            self._window = None


class Panda:
    """What ``robot.robot_model`` is: names that robosuite's wrappers ask for."""

    name = "Panda"
    naming_prefix = "robot0_"


class RobosuiteRobot:
    """What ``env.robots[0]`` is: the arm as robosuite's users ask it."""

    name = "Panda"
    arms = ("right",)

    def __init__(self, sim: SceneSim, scene: Scene) -> None:
        self.robot_model = Panda()
        self.sim = sim
        self.init_qpos = np.array(scene.place.start_q)
        self.control_freq = scene.control.rate_hz
        self._at = scene.at

    @property
    def action_limits(self) -> tuple[Array, Array]:
        """Lowest and highest action (8,), (8,)."""
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
