"""Environment for robosuite: ``robosuite.make("ArticulatedObject", robots="Panda", …)``.

Importing this module registers it. It runs the same model and control stack (set-point filter,
joint impedance, gripper) as every other engine, so that policies find the dynamics of their
training; other controllers are rejected. Making, resetting, stepping, rendering and inspecting it
work as in robosuite.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from inspect import signature
from typing import Any

import numpy as np
from robosuite import macros
from robosuite.environments.base import MujocoEnv
from robosuite.utils.mjcf_utils import IMAGE_CONVENTION_MAPPING
from robosuite.utils.observables import Observable, sensor

from articulate.config import to_plain
from articulate.errors import ConfigError, EngineError, nearest, quote
from articulate.render.canvas import Pixels
from articulate.task.layout import Field
from articulate.task.observation import ACTION, OBSERVATION
from articulate.transforms import Array
from articulate_envs.engine import Start
from articulate_envs.gym_env import MAX_PIXELS
from articulate_envs.interface import apply_options, checked_action, episode_info, params_dict
from articulate_envs.make_scene import EnvConfig, make_episodes, make_scene, read_config
from articulate_envs.robosuite_sim import (
    CAMERAS,
    RobosuiteRobot,
    RobosuiteViewer,
    SceneModel,
    SceneSim,
)
from articulate_envs.scene import Scene
from articulate_envs.single_engine import SingleEngine

ROBOT = "robot0_"
"""robosuite's prefix of what belongs to its first robot."""
FIXED: dict[str, tuple[Any, ...]] = {
    "env_configuration": ("default",),
    "base_types": ("default", "NullMount"),
    "gripper_types": ("default", "PandaGripper"),
    "renderer": ("mjviewer",),
    "camera_depths": (False,),
    "camera_segmentations": (None,),
    "reward_shaping": (True,),
    "use_object_obs": (True,),
}
"""Arguments of robosuite of which only some values are supported."""
UNUSED = (
    "lite_physics", "hard_reset", "render_collision_mesh", "render_visual_mesh",
    "render_gpu_device_id", "renderer_config",
)  # fmt: skip
"""Arguments of robosuite that have no effect here."""
PER_CAMERA = frozenset({"camera_depths", "camera_segmentations"})
"""Arguments of :data:`FIXED` for which robosuite also takes a list, one value a camera."""


class ArticulatedObject(MujocoEnv):  # type: ignore[misc]  # robosuite has no types
    """A Panda in front of an articulated object, as an environment of robosuite.

    Observations have each field of :data:`articulate.task.observation.OBSERVATION` by its name, the
    vectors ``object-state`` and ``robot0_proprio-state`` that robosuite's wrappers require, and
    ``policy-state``, the complete vector that policies observe.
    """

    def __init__(
        self,
        robots: str | list[str] | tuple[str, ...] = "Panda",
        *,
        controller_configs: Any = None,
        initialization_noise: Any = "default",
        use_camera_obs: bool = False,
        camera_names: str | list[str] = "agentview",
        camera_heights: int | Sequence[int] = 256,
        camera_widths: int | Sequence[int] = 256,
        has_renderer: bool = False,
        has_offscreen_renderer: bool = False,
        render_camera: str = "agentview",
        control_freq: float | None = None,
        horizon: int | None = None,
        ignore_done: bool = False,
        reward_scale: float = 1.0,
        seed: int | None = None,
        scene: Scene | None = None,
        **env_fields: Any,
    ) -> None:
        """Make the environment.

        Args:
            robots: ``Panda``.
            controller_configs: None: the control stack is part of the task.
            initialization_noise: ``default`` for ``randomization.start_rad``, None for no noise, or
                robosuite's dictionary of uniform noise.
            use_camera_obs: Add images to observations.
            camera_names: Cameras of the images, of
                :data:`articulate_envs.robosuite_sim.CAMERAS`.
            camera_heights: Height of the images [px], or one height for each camera.
            camera_widths: Width of the images [px], or one width for each camera.
            has_renderer: Show MuJoCo's viewer; it requires a display.
            has_offscreen_renderer: Accepted without effect; images are rendered on request.
            render_camera: Initial view of the viewer.
            control_freq: Control steps in a second [Hz]; by default ``control.rate_hz``.
            horizon: Control steps in an episode; by default the task's length.
            ignore_done: Continue episodes after their end; their remaining time is then 0.
            reward_scale: Factor on rewards.
            seed: Seed of all randomness; ``env.rng`` may be set instead.
            scene: Existing scene, in place of ``asset``, ``task`` and ``joint``.
            **env_fields: Fields of :class:`articulate_envs.make_scene.EnvConfig`, ``asset`` at
                least, and other arguments of robosuite (:data:`FIXED`, :data:`UNUSED`).

        Raises:
            UsageError: An argument is not accepted, the object is rejected or out of reach, or
                the viewer is requested without a display.
        """
        if horizon is not None and horizon < 1:
            raise ConfigError(f"horizon is {horizon}; it must be at least 1 control step")
        _check_robots(robots)
        _check_controller(controller_configs)
        names = [camera_names] if isinstance(camera_names, str) else list(camera_names)
        _check_cameras([*names, render_camera])
        self.config = _read(_without_fixed(env_fields), initialization_noise, control_freq, scene)
        self._scene = scene or make_scene(self.config)
        self.reward_scale = reward_scale
        self.use_object_obs, self.use_camera_obs = True, use_camera_obs
        self.camera_names, self.num_cameras = names, len(names)
        self.camera_heights = _per_camera("camera_heights", camera_heights, len(names))
        self.camera_widths = _per_camera("camera_widths", camera_widths, len(names))
        self.sim: Any = None  # a SceneSim until it is closed
        self.viewer: RobosuiteViewer | None = None
        self.robots: list[RobosuiteRobot] = []
        self._observation = np.zeros(OBSERVATION.size)
        self._reward = 0.0
        self._start: Start | None = None
        super().__init__(
            has_renderer=has_renderer,
            has_offscreen_renderer=False,  # robosuite's own context would render the bare model
            render_camera=render_camera,
            control_freq=self._scene.control.rate_hz,
            horizon=horizon or self._scene.n_steps,
            ignore_done=ignore_done,
            seed=seed,
        )
        self.has_offscreen_renderer = has_offscreen_renderer

    def _load_model(self) -> None:
        self.engine = SingleEngine(self._scene)
        self.episodes = make_episodes(self.engine, self.config, renew=False)
        self.model = SceneModel(self._scene, self.engine)

    def _initialize_sim(self, xml_string: str | None = None) -> None:
        self.sim = SceneSim(self._scene, self.engine)
        self.robots = [RobosuiteRobot(self.sim, self._scene)]
        self.initialize_time(self.control_freq)

    def initialize_time(self, control_freq: float) -> None:
        """Set robosuite's times to those of the scene, of which ``control_freq`` [Hz] is one."""
        self.cur_time = 0.0
        self.control_freq = control_freq
        self.model_timestep = self._scene.physics.timestep_s
        self.control_timestep = self._scene.control.step_s

    def initialize_renderer(self) -> None:
        """Prepare the viewer if it was requested; it opens with the first image."""
        self.viewer = RobosuiteViewer(self.sim) if self.has_renderer else None

    def reset(self) -> OrderedDict[str, Any]:
        """Begin an episode, sampled from ``env.rng``, and return its first observations.

        Raises:
            EngineError: A value of :meth:`set_ep_meta` is not accepted.
        """
        if self.sim is None:
            self._initialize_sim()
        self._reset_internal()
        observations: OrderedDict[str, Any] = self._get_observations(force_update=True)
        return observations

    def _reset_internal(self) -> None:
        self.episodes.reseed(self.rng)
        start = self.episodes.sample_start(1)
        self._begin(apply_options(self._ep_meta, start, self._scene))

    def _begin(self, start: Start) -> None:
        self._start = start
        self._observation = self.episodes.reset(start=start)[0]
        self.sim.forward()
        self.sim_state_initial = self.sim.get_state()
        self.cur_time, self.timestep, self.done, self._reward = 0.0, 0, False, 0.0
        self._obs_cache: dict[str, Any] = {}
        for observable in self._observables.values():
            observable.reset()
        if self.has_renderer and self.viewer is None:
            self.initialize_renderer()

    def step(self, action: Array) -> tuple[OrderedDict[str, Any], float, bool, dict[str, Any]]:
        """Run one control step with an action (8,) in [-1, 1].

        Returns:
            Observations, reward, whether the episode is done, and info.

        Raises:
            EngineError: The action is not accepted, or the episode is done.
        """
        if self.done:
            raise EngineError("step after the episode was done: call reset() first")
        result = self.episodes.step(checked_action(action)[None])
        self._observation = result.observation[0]
        self._reward = self.reward_scale * float(result.reward[0])
        self.timestep += 1
        self.cur_time = self.timestep * self.control_timestep
        over = bool(result.done[0]) or self.timestep >= self.horizon
        self.done = over and not self.ignore_done
        if self.viewer is not None:
            self.viewer.update()
        observations = self._get_observations(force_update=True)
        return observations, self._reward, self.done, self._episode_info()

    def _episode_info(self) -> dict[str, Any]:
        info = episode_info(self.episodes.monitor, self._scene.task, self.episodes.state)
        return {name: values.tolist()[0] for name, values in info.items()}

    def reward(self, action: Array | None = None) -> float:
        """Return the reward of the last control step, a scalar; ``action`` (8,) is not used."""
        return self._reward

    def _check_success(self) -> bool:
        return bool(self._episode_info()["success"])

    def _setup_observables(self) -> OrderedDict[str, Observable]:
        sensors = [self._sensor_of(field) for field in OBSERVATION.fields]
        sensors.append(_sensor("policy_observation", "policy", lambda: np.array(self._observation)))
        if self.use_camera_obs:
            sizes = zip(self.camera_names, self.camera_widths, self.camera_heights, strict=True)
            sensors += [self._camera_of(*size) for size in sizes]
        observables: OrderedDict[str, Observable] = OrderedDict()
        for one in sensors:
            name = one.__name__
            observables[name] = Observable(name=name, sensor=one, sampling_rate=self.control_freq)
        return observables

    def _sensor_of(self, field: Field) -> Any:
        where = OBSERVATION.slice(field.name)
        modality = "object" if field.source == "estimator" else f"{ROBOT}proprio"
        return _sensor(field.name, modality, lambda: np.array(self._observation[where]))

    def _camera_of(self, name: str, width: int, height: int) -> Any:
        row_step = IMAGE_CONVENTION_MAPPING[macros.IMAGE_CONVENTION]

        def render() -> Pixels:
            image: Pixels = self.sim.render(width=width, height=height, camera_name=name)
            return image[::row_step]

        return _sensor(f"{name}_image", "image", render)

    def render(self) -> None:
        """Show the current state in the viewer.

        Raises:
            EngineError: There is no viewer.
            MissingError: There is no display.
        """
        if self.viewer is None:
            raise EngineError(
                "render without a viewer: make it with has_renderer=True, or use sim.render(...)"
            )
        self.viewer.update()

    def get_ep_meta(self) -> dict[str, Any]:
        """Return the start of the episode; :meth:`set_ep_meta` with it repeats that start."""
        start = self._start
        if start is None:
            return {}
        plain = {name: getattr(start, name)[0].tolist() for name in ("q", "opened", "width")}
        closing = float(start.closing[0])
        return {"episode_params": params_dict(start.params), **plain, "closing": closing}

    def reset_from_xml_string(self, xml_string: str) -> None:
        """Restart the current episode, whose model ``xml_string`` must be.

        Raises:
            EngineError: ``xml_string`` is another model.
        """
        if self._start is None or xml_string != self.sim.model.get_xml():
            raise EngineError(
                "reset_from_xml_string: not the model of the current episode; "
                "begin its episode with set_ep_meta(meta) and reset() first"
            )
        self._begin(self._start)

    def set_xml_processor(self, processor: Any) -> None:
        """Reject the call: the model is generated from the asset.

        Raises:
            EngineError: Always.
        """
        raise EngineError(
            "set_xml_processor: the model is generated from the asset; change the asset"
        )

    @property
    def action_spec(self) -> tuple[Array, Array]:
        """Lowest and highest action (8,), (8,), dimensionless."""
        return ACTION.low.astype(np.float64), ACTION.high.astype(np.float64)

    @property
    def action_dim(self) -> int:
        """Size of an action."""
        return ACTION.size

    def snapshot(self) -> dict[str, Any]:
        """Return the state that a bit-identical continuation needs, with the generator's."""
        state = {"timestep": self.timestep, "done": self.done, "observation": self._observation}
        return self.episodes.snapshot() | state

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from :meth:`snapshot`, of this environment or another of the same scene."""
        self.episodes.reseed(self.rng)  # its state is part of the snapshot
        self.episodes.restore(snapshot)
        self.timestep, self.done = int(snapshot["timestep"]), bool(snapshot["done"])
        self.cur_time = self.timestep * self.control_timestep
        self._observation = np.array(snapshot["observation"])
        self.sim.forward()

    def close(self) -> None:
        """Close the viewer, the renderers and the simulation; closing twice does nothing."""
        super().close()
        self.engine.close()


def _sensor(name: str, modality: str, read: Callable[[], Any]) -> Any:
    """Return a sensor of robosuite: a function of its cache, with a name and a modality."""

    def of_cache(_: Any) -> Any:
        return read()

    of_cache.__name__ = name
    return sensor(modality=modality)(of_cache)


def _check_robots(robots: Any) -> None:
    names = list(robots) if isinstance(robots, (list, tuple)) else [robots]
    if names != ["Panda"]:
        raise ConfigError(f"robots is {quote(robots)}; ArticulatedObject supports Panda")


def _check_controller(controller: Any) -> None:
    if controller is None:
        return
    name = controller.get("type", "?") if isinstance(controller, dict) else controller
    raise ConfigError(
        f"controller_configs names {quote(name)}; ArticulatedObject has a fixed control stack "
        "(set-point filter, joint impedance, gripper): omit controller_configs"
    )


def _check_cameras(names: list[str]) -> None:
    for name in names:
        if name not in CAMERAS:
            raise ConfigError(
                f"no camera {quote(name)}; ArticulatedObject has {', '.join(CAMERAS)}"
            )


def _per_camera(name: str, size: Any, n: int) -> list[int]:
    """Return ``size`` for each of ``n`` cameras: one number for all, or a list of ``n``."""
    sizes = list(size) if isinstance(size, (list, tuple, np.ndarray)) else [size] * n
    numbers = all(isinstance(s, (int, np.integer)) and 1 <= s <= MAX_PIXELS for s in sizes)
    if len(sizes) != n or not numbers:
        raise ConfigError(
            f"{name} is {quote(size)}; it must be 1 to {MAX_PIXELS} px, or a list of {n} such "
            "numbers, one for each camera"
        )
    return [int(s) for s in sizes]


def _without_fixed(arguments: dict[str, Any]) -> dict[str, Any]:
    """Return ``arguments`` without those of robosuite that are checked or have no effect."""
    parameters = {p.name for p in signature(ArticulatedObject.__init__).parameters.values()}
    known = {f.name for f in fields(EnvConfig)} | parameters | {*FIXED, *UNUSED}
    known -= {"self", "env_fields"}
    for name in arguments:
        if name not in known:
            raise ConfigError(f"ArticulatedObject: no argument {quote(name)}{nearest(name, known)}")
    for name, accepted in FIXED.items():
        value = arguments.get(name, accepted[0])
        values = value if name in PER_CAMERA and isinstance(value, (list, tuple)) else [value]
        if any(v not in accepted for v in values):
            choices = " or ".join(map(repr, accepted))
            raise ConfigError(f"{name} is {quote(value)}; ArticulatedObject accepts {choices}")
    return {k: v for k, v in arguments.items() if k not in FIXED and k not in UNUSED}


def _read(
    arguments: dict[str, Any], noise: Any, control_freq: float | None, scene: Scene | None
) -> EnvConfig:
    if scene is not None and control_freq not in (None, scene.control.rate_hz):
        rate = f"{scene.control.rate_hz:g}"
        raise ConfigError(f"control_freq is {control_freq}; the given scene has {rate}")
    if control_freq is not None and scene is None:
        control = to_plain(arguments.get("control") or {})
        arguments = {**arguments, "control": {**control, "rate_hz": float(control_freq)}}
    config = read_config(arguments, "ArticulatedObject", scene)
    if noise == "default":
        return config
    kind = noise.get("type") if isinstance(noise, dict) else None
    if noise is not None and kind != "uniform":
        raise ConfigError(
            f"initialization_noise is {quote(noise)}; accepted: 'default', None, or "
            "{'type': 'uniform', 'magnitude': rad}"
        )
    start_rad = 0.0 if noise is None else noise.get("magnitude") or 0.0
    if not isinstance(start_rad, int | float | np.floating) or not 0.0 <= start_rad < math.inf:
        raise ConfigError(
            f"initialization_noise has the magnitude {quote(start_rad)}; it must be an angle of 0 "
            "or more [rad]"
        )
    return replace(config, randomization=replace(config.randomization, start_rad=float(start_rad)))
