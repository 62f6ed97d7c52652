"""Playback of one episode of a bundle on the simulated robot in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from articulate.render.canvas import Canvas, Pixels
from articulate.render.encode_video import write_video
from articulate.render.playback import EpisodePlayback
from articulate.render.view_camera import Viewpoint, fit_viewpoint
from articulate.simulator import mujoco
from articulate.task.episode_monitor import FIELDS
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.episode import Recording, run_episode, start_of
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.plan import make_plan
from articulate_deploy.policy_runner import Policy
from articulate_deploy.robots.mujoco import MujocoRobot

SIZE = (640, 480)
"""Width and height of a video [px]."""
AZIMUTH_DEG, ELEVATION_DEG = 52.0, -22.0
HORIZON_RGB, ZENITH_RGB = (0.93, 0.945, 0.955), (0.70, 0.78, 0.85)
ARM_RGBA = (0.92, 0.92, 0.93, 1.0)
PART_RGBA = ((0.80, 0.79, 0.76, 1.0), (0.72, 0.53, 0.34, 1.0), (0.55, 0.63, 0.66, 1.0))
"""Colours of the object: its root, and its moving links in turn."""
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
FLOOR_RGBA = (0.80, 0.82, 0.83, 1.0)


class _RecordedRobot(MujocoRobot):
    """Robot that records its positions."""

    def __init__(self, bundle: Bundle) -> None:
        super().__init__(bundle)
        self.qpos: list[Array] = []

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        self.qpos.append(self._data.qpos.copy())
        return super().send_action(action)

    @property
    def model(self) -> mujoco.MjModel:
        """Scene under the last episode parameters."""
        return self._model


def watch_bundle(path: Path, *, seed: int | None, episode: int, randomise: bool) -> EpisodePlayback:
    """Run the policy of the bundle at ``path`` for one episode.

    Args:
        path: Bundle.
        seed: Must be None: a bundle has one policy.
        episode: Index of the episode in ``deploy``.
        randomise: Randomize as in training, except the object's size; else only the start of the
            arm.

    Raises:
        BundleError: The bundle is invalid.
    """
    assert seed is None
    bundle = load_bundle(path)
    manifest = bundle.manifest
    plan = make_plan(bundle, episode + 1, seed=None, randomise=randomise)
    params, noise = plan.params(episode), plan.noise(episode)
    robot, recording = _RecordedRobot(bundle), Recording()
    with robot:
        robot.set_episode_params(params, force_noise_n=plan.config.force_noise_n, noise=noise)
        robot.reset_to(start_of(manifest, params), manifest.start.gripper_width_m)
        estimator = TruthEstimator(robot, plan.config, manifest.task, params, noise)
        result = run_episode(
            Policy(bundle),
            robot,
            estimator,
            manifest,
            delay_steps=int(params["delay_steps"][0]),
            recording=recording,
        )
        model = _visual_model(bundle, robot.model)
    arrays, qpos = recording.arrays(), np.stack(robot.qpos)
    step_s = manifest.control.step_s

    def write_clip(file: Path) -> Path:
        return write_video(file, _frames(model, qpos), SIZE, round(1.0 / step_s))

    task = manifest.task
    column = {name: k for k, name in enumerate(FIELDS)}
    return EpisodePlayback(
        title=f"{task.name} of {manifest.object.name} ({task.joint})",
        reason=result.reason,
        model=model,
        qpos=qpos,
        step_s=step_s,
        curves={
            "opened": arrays["part_open"],
            "force_n": arrays["monitor"][:, column["force"]],
            "part_speed": arrays["part_speed"],
        },
        write_video=write_clip,
    )


def _visual_model(bundle: Bundle, sampled: mujoco.MjModel) -> mujoco.MjModel:
    """Return the scene of a bundle with sky, light and colours, its object at the sampled pose."""
    text, meshes = bundle.scene_assets()
    spec = mujoco.MjSpec.from_string(text, assets=meshes)
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=ZENITH_RGB,
        rgb2=HORIZON_RGB,
        width=64,
        height=384,
    )
    spec.visual.headlight.ambient = (0.45, 0.45, 0.45)
    spec.visual.headlight.diffuse = (0.55, 0.55, 0.55)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = SIZE
    model = spec.compile()
    scene = bundle.manifest.scene
    count = 0
    for b in range(1, model.nbody):
        of = model.geom_bodyid == b
        if model.body(b).name.startswith(scene.object_prefix):
            model.geom_rgba[of] = PART_RGBA[0] if count == 0 else PART_RGBA[1 + (count - 1) % 2]
            count += 1
        else:
            model.geom_rgba[of] = ARM_RGBA
    # A bundle has the collision shapes, which are hidden, and no visual shapes.
    model.geom_group[:] = 0
    model.geom_rgba[model.geom_bodyid == 0] = FLOOR_RGBA
    root = model.body(scene.object_root).id
    model.body_pos[root], model.body_quat[root] = sampled.body_pos[root], sampled.body_quat[root]
    return model


def _frames(model: mujoco.MjModel, qpos: Array) -> Iterator[Pixels]:
    """Yield one image for each row of positions (T, nq)."""
    data = mujoco.MjData(model)
    canvas = Canvas(model, SIZE, shadows=False)
    try:
        view = _view(model, data, qpos)
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = view.lookat_w
        camera.distance = view.distance_m
        camera.azimuth, camera.elevation = view.azimuth_deg, view.elevation_deg
        for q in qpos:
            _place(model, data, q)
            yield canvas.render(data, camera)
    finally:
        canvas.close()


def _view(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> Viewpoint:
    """Return a view from the front and above with every moving shape in the image."""
    points = []
    for q in qpos[:: max(1, len(qpos) // 5)]:
        _place(model, data, q)
        for i in np.flatnonzero(model.geom_bodyid != 0):
            corners = model.geom_aabb[i, :3] + model.geom_aabb[i, 3:] * CORNERS
            points.append(corners @ data.geom_xmat[i].reshape(3, 3).T + data.geom_xpos[i])
    return fit_viewpoint(
        np.concatenate(points),
        azimuth_deg=AZIMUTH_DEG,
        elevation_deg=ELEVATION_DEG,
        fov_deg=float(model.vis.global_.fovy),
        aspect=SIZE[0] / SIZE[1],
    )


def _place(model: mujoco.MjModel, data: mujoco.MjData, q: Array) -> None:
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
