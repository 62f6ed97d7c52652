"""One episode of a bundle on the stand-in in this process, to be watched."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from articulate.render.canvas import Canvas, Pixels
from articulate.render.encode_video import write_video
from articulate.render.playback import EpisodePlayback
from articulate.render.scene_style import add_sky, part_rgba
from articulate.render.view_camera import Viewpoint, fit_viewpoint, geom_corners
from articulate.simulator import mujoco
from articulate.task.episode_monitor import FIELDS
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.deploy import make_plan
from articulate_deploy.episode import Recording, run_episode, start_of
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.policy_runner import Policy
from articulate_deploy.robots.mujoco import MujocoRobot

SIZE = (640, 480)
"""Width and height of a clip [px]."""
AZIMUTH_DEG, ELEVATION_DEG = 52.0, -22.0
ARM_RGBA = (0.92, 0.92, 0.93, 1.0)
FLOOR_RGBA = (0.80, 0.82, 0.83, 1.0)


class _Seen(MujocoRobot):
    """Keeps what it went through."""

    def __init__(self, bundle: Bundle) -> None:
        super().__init__(bundle)
        self.qpos: list[Array] = []

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        self.qpos.append(self._data.qpos.copy())
        return super().send_action(action)

    @property
    def model(self) -> mujoco.MjModel:
        """The scene under the last draw."""
        return self._model


def watch_bundle(path: Path, *, seed: int | None, episode: int, randomise: bool) -> EpisodePlayback:
    """Let the policy of the bundle at ``path`` act for one episode.

    Args:
        path: The bundle.
        seed: Must be None: a bundle holds one policy.
        episode: The episode that ``deploy`` counts so.
        randomise: Draw as in training, the object's size aside; else the start of the arm alone.

    Raises:
        BundleError: The bundle is not sound.
    """
    assert seed is None
    bundle = load_bundle(path)
    manifest = bundle.manifest
    plan = make_plan(bundle, episode + 1, seed=None, randomise=randomise)
    drawn, noise = plan.params(episode), plan.noise(episode)
    robot, recording = _Seen(bundle), Recording()
    with robot:
        robot.set_episode_params(drawn, force_noise_n=plan.config.force_noise_n, noise=noise)
        robot.reset_to(start_of(manifest, drawn), manifest.start.gripper_width_m)
        estimator = TruthEstimator(robot, plan.config, manifest.task, drawn, noise)
        result = run_episode(
            Policy(bundle),
            robot,
            estimator,
            manifest,
            delay_steps=int(drawn["delay_steps"][0]),
            recording=recording,
        )
        model = _as_seen(bundle, robot.model)
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
            "force_n": arrays["judgement"][:, column["force"]],
            "part_speed": arrays["part_speed"],
        },
        write_video=write_clip,
    )


def _as_seen(bundle: Bundle, drawn: mujoco.MjModel) -> mujoco.MjModel:
    """The scene of a bundle with a sky, light and colours, its object where it was drawn."""
    text, meshes = bundle.scene_assets()
    spec = mujoco.MjSpec.from_string(text, assets=meshes)
    add_sky(spec, 64)
    spec.visual.headlight.ambient = (0.45, 0.45, 0.45)
    spec.visual.headlight.diffuse = (0.55, 0.55, 0.55)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = SIZE
    model = spec.compile()
    scene = bundle.manifest.scene
    own = 0
    for b in range(1, model.nbody):
        of = model.geom_bodyid == b
        if model.body(b).name.startswith(scene.object_prefix):
            model.geom_rgba[of] = part_rgba(own)
            own += 1
        else:
            model.geom_rgba[of] = ARM_RGBA
    # A bundle holds the shapes that touch, which are hidden, and not those that are seen.
    model.geom_group[:] = 0
    model.geom_rgba[model.geom_bodyid == 0] = FLOOR_RGBA
    root = model.body(scene.object_root).id
    model.body_pos[root], model.body_quat[root] = drawn.body_pos[root], drawn.body_quat[root]
    return model


def _frames(model: mujoco.MjModel, qpos: Array) -> Iterator[Pixels]:
    """One picture for each row of positions (T, nq)."""
    data = mujoco.MjData(model)
    canvas = Canvas(model, SIZE, shadows=False)
    try:
        camera = _view(model, data, qpos).camera()
        for q in qpos:
            _place(model, data, q)
            yield canvas.render(data, camera)
    finally:
        canvas.close()


def _view(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> Viewpoint:
    """From the front and above, so that every moving shape is in the picture."""
    points = []
    for q in qpos[:: max(1, len(qpos) // 5)]:
        _place(model, data, q)
        points.append(geom_corners(model, data, np.flatnonzero(model.geom_bodyid != 0)))
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
