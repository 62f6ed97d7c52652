"""Videos and images of a scene, rendered without a display."""

from __future__ import annotations

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from types import TracebackType

import numpy as np
from PIL import Image

from articulate.render.canvas import GEOM_GROUPS, Canvas, Pixels
from articulate.render.encode_video import write_video
from articulate.render.view_camera import CORNERS, Viewpoint, camera_axes, fit_viewpoint
from articulate.simulator import mujoco
from articulate.transforms import Array, matrix_to_quat
from articulate_envs.panda import GRIPPER_BODY
from articulate_envs.scene import PREFIX, Scene, scene_spec
from articulate_envs.scene_visuals import add_scene_visuals

FRAMES_PER_S = 20
"""Frame rate of videos [1/s]: one frame a control step at the default rate."""
SIZE = (480, 360)
"""Width and height of a video [px]; H.264 requires even numbers."""
IMAGE_SIZE = (960, 720)
"""Width and height of an image [px]."""
AZIMUTHS_DEG = (52.0, -52.0, 68.0, -68.0, 84.0, -84.0, 100.0, -100.0)
"""Candidate directions of view, from +x (in front of the arm) towards +y [deg]."""
ELEVATIONS_DEG = (-22.0, -34.0)
NEAR_M = 0.6
"""Least part of the object around the gripper that a view contains [m]."""


def set_positions(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> None:
    """Set ``data`` to positions (nq,) [m or rad] and update what rendering needs."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


class SceneRenderer:
    """Renderer of a scene at given positions; close it or use it in a ``with`` block."""

    def __init__(
        self,
        scene: Scene,
        *,
        scale: float = 1.0,
        T_wo: Array | None = None,
        size: tuple[int, int] = SIZE,
        shadows: bool = False,
    ) -> None:
        """Compile the visual model and open a rendering context.

        Args:
            scene: Scene to render.
            scale: Size factor of the object in this episode.
            T_wo: Pose of the object in this episode (4, 4); its nominal placement by default.
            size: Width and height [px].
            shadows: Render shadows; a frame then takes about five times as long.

        Raises:
            MissingError: This machine cannot render.
        """
        self.scene = scene
        self._model = visual_model(scene, scale=scale, T_wo=T_wo, size=size)
        self._root = _root_of(self._model)
        self._data = mujoco.MjData(self._model)
        self._size = size
        self._canvas = Canvas(self._model, size, shadows=shadows)
        self._view: Viewpoint | None = None

    def choose_view(self, qpos: Array) -> Viewpoint:
        """Choose and keep the view that shows the gripper best at positions (T, nq) [m, rad]."""
        samples = qpos[np.linspace(0, len(qpos) - 1, min(len(qpos), 5)).astype(int)]
        visible = np.zeros((len(ELEVATIONS_DEG), len(AZIMUTHS_DEG)))
        points = []
        for q in samples:
            self._set_positions(q)
            points.append(self._points_of_interest())
            visible += self._visible(self._data.site("tool").xpos)
        # Among equals the first counts: directions are in order of preference.
        row, column = np.unravel_index(int(np.argmax(visible)), visible.shape)
        self._view = fit_viewpoint(
            np.concatenate(points),
            azimuth_deg=AZIMUTHS_DEG[column],
            elevation_deg=ELEVATIONS_DEG[row],
            fov_deg=float(self._model.vis.global_.fovy),
            aspect=self._size[0] / self._size[1],
        )
        return self._view

    def view_from(self, qpos: Array, *, azimuth_deg: float, elevation_deg: float) -> Viewpoint:
        """Return the view in a given direction [deg] of gripper and object at positions (nq,)."""
        self._set_positions(qpos)
        return fit_viewpoint(
            self._points_of_interest(),
            azimuth_deg=azimuth_deg,
            elevation_deg=elevation_deg,
            fov_deg=float(self._model.vis.global_.fovy),
            aspect=self._size[0] / self._size[1],
        )

    def frame(self, qpos: Array, view: Viewpoint | None = None) -> Pixels:
        """Return an image of the scene, shape (height, width, 3) [0 to 255].

        Args:
            qpos: Positions of the scene's model (nq,) [m or rad].
            view: Pose of the camera, by default that of :meth:`choose_view`.
        """
        chosen = view or self._view or self.choose_view(qpos[None])
        self._set_positions(qpos)
        return self._canvas.render(self._data, chosen.camera())

    def frames(self, qpos: Array) -> Iterator[Pixels]:
        """Yield an image for each row of positions (T, nq) [m or rad]."""
        if self._view is None:
            self.choose_view(qpos)
        for q in qpos:
            yield self.frame(q)

    def close(self) -> None:
        """Close the rendering context."""
        self._canvas.close()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _set_positions(self, qpos: Array) -> None:
        set_positions(self._model, self._data, qpos)

    def _points_of_interest(self) -> Array:
        """Return corners of the arm, the moving part and the nearby object (P, 3) [m]."""
        model, data = self._model, self._data
        tool = data.site("tool").xpos
        part = int(model.joint(PREFIX + self.scene.task.joint).bodyid[0])
        out = []
        for i in np.flatnonzero(np.isin(model.geom_group, GEOM_GROUPS)):
            body = int(model.geom_bodyid[i])
            if body == 0:
                continue
            middle, half = model.geom_aabb[i, :3], model.geom_aabb[i, 3:]
            corners = middle + half * CORNERS
            corners = corners @ data.geom_xmat[i].reshape(3, 3).T + data.geom_xpos[i]
            if body != part and self._below(body, self._root):
                corners = np.clip(corners, tool - NEAR_M, tool + NEAR_M)
            out.append(corners)
        return np.concatenate(out)

    def _visible(self, tool: Array) -> Array:
        """Return the visible share of points around the tool, by elevation and azimuth."""
        out = np.zeros((len(ELEVATIONS_DEG), len(AZIMUTHS_DEG)))
        gripper = self._model.body(GRIPPER_BODY).id
        bodies = {i for i in range(self._model.nbody) if self._below(i, gripper)}
        points = tool + 0.05 * np.array([[0, 0, 0], [-1, 0, 0], [0, 0, 1.0], [0, 1, 0], [0, -1, 0]])
        group = np.isin(np.arange(mujoco.mjNGROUP), GEOM_GROUPS).astype(np.uint8)
        hit = np.zeros(1, dtype=np.int32)
        for i, elevation in enumerate(ELEVATIONS_DEG):
            for j, azimuth in enumerate(AZIMUTHS_DEG):
                away = -camera_axes(azimuth, elevation)[0]
                for point in points:
                    start = point + 3.0 * away
                    far = mujoco.mj_ray(self._model, self._data, start, -away, group, 1, -1, hit)
                    body = int(self._model.geom_bodyid[hit[0]]) if hit[0] >= 0 else -1
                    out[i, j] += far < 0.0 or far > 2.95 or body in bodies
        return out / len(points)

    def _below(self, body: int, top: int) -> bool:
        while body not in (0, top):
            body = int(self._model.body_parentid[body])
        return body == top


def visual_model(
    scene: Scene,
    *,
    scale: float = 1.0,
    T_wo: Array | None = None,
    size: tuple[int, int] = SIZE,
) -> mujoco.MjModel:
    """Return the model with visual geoms; ``T_wo`` (4, 4) is homogeneous, ``size`` in pixels."""
    T_wo = scene.placement.T_wo() if T_wo is None else np.asarray(T_wo)
    spec = scene_spec(
        scene.asset,
        arm=scene.arm,
        physics=scene.physics,
        placement=scene.placement,
        scale=scale,
        visuals=True,
    )
    add_scene_visuals(spec, scene.asset, scale=scale, T_wo=T_wo, size=size)
    model = spec.compile()
    root = _root_of(model)
    model.body_pos[root] = T_wo[:3, 3]
    model.body_quat[root] = matrix_to_quat(T_wo[:3, :3])
    return model


def _root_of(model: mujoco.MjModel) -> int:
    return next(i for i in range(model.nbody) if model.body(i).name.startswith(PREFIX))


def write_episode_video(
    path: Path,
    scene: Scene,
    qpos: Array,
    *,
    scale: float = 1.0,
    T_wo: Array | None = None,
    step_s: float = 1.0 / FRAMES_PER_S,
    size: tuple[int, int] = SIZE,
) -> Path:
    """Write a video of an episode as MP4 (H.264) and return its path.

    Args:
        path: File to write, completely or not at all.
        scene: Scene to render.
        qpos: Positions of the scene's model (T, nq) [m or rad], one row a control step.
        scale: Size factor of the object in this episode.
        T_wo: Pose of the object in this episode (4, 4); its nominal placement by default.
        step_s: Time between rows [s].
        size: Width and height [px].

    Raises:
        MissingError: This machine cannot render, or the encoder is not installed.
    """
    with SceneRenderer(scene, scale=scale, T_wo=T_wo, size=size) as renderer:
        return write_video(path, renderer.frames(np.asarray(qpos)), size, round(1.0 / step_s))


def render_png(
    scene: Scene,
    qpos: Array,
    *,
    scale: float = 1.0,
    T_wo: Array | None = None,
    size: tuple[int, int] = IMAGE_SIZE,
) -> bytes:
    """Return a PNG of the scene with shadows, at twice the resolution and then averaged.

    Args:
        scene: Scene to render.
        qpos: Positions of the scene's model (nq,) [m or rad].
        scale: Size factor of the object.
        T_wo: Pose of the object (4, 4); its nominal placement by default.
        size: Width and height [px].

    Raises:
        MissingError: This machine cannot render.
    """
    double = (2 * size[0], 2 * size[1])
    with SceneRenderer(scene, scale=scale, T_wo=T_wo, size=double, shadows=True) as renderer:
        image = Image.fromarray(renderer.frame(np.asarray(qpos))).resize(size, Image.Resampling.BOX)
    out = BytesIO()
    image.save(out, "PNG", optimize=True)
    return out.getvalue()
