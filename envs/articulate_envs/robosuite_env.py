"""Our environment for robosuite: ``robosuite.make("ArticulatedObject", robots="Panda", …)``.

Importing this module registers it, as robosuite's own environments are. What runs is the same
model under the same plant (follower, joint impedance, hand) as in every other engine, so that a
policy finds what it was trained on; other controllers are refused. Of robosuite it has the way
to make, reset, step, render and look into an environment.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import fields, replace
from inspect import signature
from typing import Any

import numpy as np
from robosuite import macros
from robosuite.environments.base import MujocoEnv
from robosuite.utils.mjcf_utils import IMAGE_CONVENTION_MAPPING
from robosuite.utils.observables import Observable, sensor

from articulate.config import to_plain
from articulate.errors import ConfigError, EngineError, nearest
from articulate.render.canvas import Pixels
from articulate.task.layout import Field
from articulate.task.observation import ACTION, OBSERVATION
from articulate.transforms import Array
from articulate_envs.engine import Start
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
"""Arguments of robosuite's that have one meaning here, with what is accepted."""
UNUSED = (
    "lite_physics", "hard_reset", "render_collision_mesh", "render_visual_mesh",
    "render_gpu_device_id", "renderer_config",
)  # fmt: skip
"""Arguments of robosuite's that change nothing here."""


class ArticulatedObject(MujocoEnv):  # type: ignore[misc]  # robosuite has no types
    """A Panda before an articulated object, as robosuite's users know environments.

    Observations hold each field of :data:`articulate.task.observation.OBSERVATION` by its name, the two
    vectors ``object-state`` and ``robot0_proprio-state`` that robosuite's wrappers look for, and
    ``policy-state``, the whole vector as policies see it.
    """

    def __init__(
        self,
        robots: str | list[str] | tuple[str, ...] = "Panda",
        *,
        controller_configs: Any = None,
        initialization_noise: Any = "default",
        use_camera_obs: bool = False,
        camera_names: str | list[str] = "agentview",
        camera_heights: int = 256,
        camera_widths: int = 256,
        has_renderer: bool = False,
        has_offscreen_renderer: bool = False,
        render_camera: str = "agentview",
        control_freq: float | None = None,
        horizon: int | None = None,
        ignore_done: bool = False,
        reward_scale: float = 1.0,
        seed: int | None = None,
        scene: Scene | None = None,
        **given: Any,
    ) -> None:
        """Make the environment.

        Args:
            robots: ``Panda``.
            controller_configs: None: the plant is part of the task.
            initialization_noise: ``default`` as ``randomization.start_rad`` says, None for none, or
                robosuite's dictionary of a uniform one.
            use_camera_obs: Add pictures to observations.
            camera_names: Their cameras, of :data:`articulate_envs.robosuite_sim.CAMERAS`.
            camera_heights: Height of pictures [px].
            camera_widths: Width of pictures [px].
            has_renderer: Show MuJoCo's viewer, where there is a display.
            has_offscreen_renderer: Accepted; pictures are drawn when they are asked for.
            render_camera: Where the viewer looks from; its user moves on from there.
            control_freq: Ticks a second [Hz]; by default ``control.rate_hz``.
            horizon: Ticks after which an episode is done; by default the task's length.
            ignore_done: Let episodes go on; their time stands at its end.
            reward_scale: Factor on rewards.
            seed: Decides everything; ``env.rng`` may be set for that, too.
            scene: A scene that is there already, in place of ``asset``, ``task`` and ``joint``.
            **given: Fields of :class:`articulate_envs.make_scene.EnvConfig`, ``asset`` at least, and what
                else robosuite's environments take (:data:`FIXED`, :data:`UNUSED`).

        Raises:
            UsageError: An argument is not accepted, the object was refused or cannot be reached, or
                a window is asked for where there is no display.
        """
        if horizon is not None and horizon < 1:
            raise ConfigError(f"horizon is {horizon}; it must be at least 1 tick")
        _check_robots(robots)
        _check_controller(controller_configs)
        names = [camera_names] if isinstance(camera_names, str) else list(camera_names)
        _check_cameras([*names, render_camera])
        self.config = _read(_without_fixed(given), initialization_noise, control_freq, scene)
        self._scene = scene or make_scene(self.config)
        self.reward_scale = reward_scale
        self.use_object_obs, self.use_camera_obs = True, use_camera_obs
        self.camera_names, self.num_cameras = names, len(names)
        self.camera_heights = [camera_heights] * len(names)
        self.camera_widths = [camera_widths] * len(names)
        self.sim: Any = None  # a SceneSim until it is closed
        self.viewer: RobosuiteViewer | None = None
        self.robots: list[RobosuiteRobot] = []
        self._observation = np.zeros(OBSERVATION.size)
        self._reward = 0.0
        self._start: Start | None = None
        super().__init__(
            has_renderer=has_renderer,
            has_offscreen_renderer=False,  # robosuite's own context would draw the bare model
            render_camera=render_camera,
            control_freq=self._scene.control.rate_hz,
            horizon=horizon or self._scene.ticks,
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
        """The scene's own times; ``control_freq`` is theirs."""
        self.cur_time = 0.0
        self.control_freq = control_freq
        self.model_timestep = self._scene.physics.timestep_s
        self.control_timestep = self._scene.control.step_s

    def initialize_renderer(self) -> None:
        """Prepare the viewer if there shall be one; it opens with the first picture."""
        self.viewer = RobosuiteViewer(self.sim) if self.has_renderer else None

    def reset(self) -> OrderedDict[str, Any]:
        """Begin an episode and return its first observations; ``env.rng`` decides it.

        Raises:
            EngineError: What :meth:`set_ep_meta` asked for is not accepted.
        """
        if self.sim is None:
            self._initialize_sim()
        self._reset_internal()
        observations: OrderedDict[str, Any] = self._get_observations(force_update=True)
        return observations

    def _reset_internal(self) -> None:
        self.episodes.reseed(self.rng)
        start = self.episodes.draw_start(1)
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
        """Run one tick: observations, reward, done, info.

        Raises:
            EngineError: The action is not accepted, or the episode is done.
        """
        if self.done:
            raise EngineError("step after the episode was done: call reset() first")
        tick = self.episodes.step(checked_action(action)[None])
        self._observation = tick.observation[0]
        self._reward = self.reward_scale * float(tick.reward[0])
        self.timestep += 1
        self.cur_time = self.timestep * self.control_timestep
        over = bool(tick.done[0]) or self.timestep >= self.horizon
        self.done = over and not self.ignore_done
        if self.viewer is not None:
            self.viewer.update()
        observations = self._get_observations(force_update=True)
        return observations, self._reward, self.done, self._episode_info()

    def _episode_info(self) -> dict[str, Any]:
        every = episode_info(self.episodes.judgement, self._scene.task, self.episodes.state)
        return {name: values.tolist()[0] for name, values in every.items()}

    def reward(self, action: Array | None = None) -> float:
        """The reward of the last tick; it depends on the states before and after, not on more."""
        return self._reward

    def _check_success(self) -> bool:
        return bool(self._episode_info()["success"])

    def _setup_observables(self) -> OrderedDict[str, Observable]:
        found = [self._sensor_of(field) for field in OBSERVATION.fields]
        found.append(_sensor("policy_observation", "policy", lambda: np.array(self._observation)))
        if self.use_camera_obs:
            sizes = zip(self.camera_names, self.camera_widths, self.camera_heights, strict=True)
            found += [self._camera_of(*size) for size in sizes]
        observables: OrderedDict[str, Observable] = OrderedDict()
        for one in found:
            name = one.__name__
            observables[name] = Observable(name=name, sensor=one, sampling_rate=self.control_freq)
        return observables

    def _sensor_of(self, field: Field) -> Any:
        where = OBSERVATION.slice(field.name)
        modality = "object" if field.source == "estimator" else f"{ROBOT}proprio"
        return _sensor(field.name, modality, lambda: np.array(self._observation[where]))

    def _camera_of(self, name: str, width: int, height: int) -> Any:
        way = IMAGE_CONVENTION_MAPPING[macros.IMAGE_CONVENTION]

        def look() -> Pixels:
            picture: Pixels = self.sim.render(width=width, height=height, camera_name=name)
            return picture[::way]

        return _sensor(f"{name}_image", "image", look)

    def render(self) -> None:
        """Show the state of now in the viewer.

        Raises:
            EngineError: There is none.
            MissingError: There is no display.
        """
        if self.viewer is None:
            raise EngineError(
                "render without a viewer: make it with has_renderer=True, or take sim.render(...)"
            )
        self.viewer.update()

    def get_ep_meta(self) -> dict[str, Any]:
        """How the episode began; :meth:`set_ep_meta` with it begins another one in the same way."""
        start = self._start
        if start is None:
            return {}
        plain = {name: getattr(start, name)[0].tolist() for name in ("q", "opened", "width")}
        closing = float(start.closing[0])
        return {"episode_params": params_dict(start.params), **plain, "closing": closing}

    def reset_from_xml_string(self, xml_string: str) -> None:
        """Begin the episode that runs anew, if ``xml_string`` is its model.

        Raises:
            EngineError: It is another model.
        """
        if self._start is None or xml_string != self.sim.model.get_xml():
            raise EngineError(
                "reset_from_xml_string: not the model of the episode that runs; "
                "begin its episode with set_ep_meta(meta) and reset() first"
            )
        self._begin(self._start)

    def set_xml_processor(self, processor: Any) -> None:
        """Refused: the model is made of the asset.

        Raises:
            EngineError: Always.
        """
        raise EngineError("set_xml_processor: the model is made of the asset; change the asset")

    @property
    def action_spec(self) -> tuple[Array, Array]:
        """Lowest and highest action (8,), (8,)."""
        return ACTION.low.astype(np.float64), ACTION.high.astype(np.float64)

    @property
    def action_dim(self) -> int:
        """Size of an action."""
        return ACTION.size

    def snapshot(self) -> dict[str, Any]:
        """All that continuing bit-identically needs, the generator's state included."""
        kept = {"timestep": self.timestep, "done": self.done, "observation": self._observation}
        return self.episodes.snapshot() | kept

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from :meth:`snapshot`, of this environment or another of the same scene."""
        self.episodes.reseed(self.rng)  # whose state is among what is restored
        self.episodes.restore(snapshot)
        self.timestep, self.done = int(snapshot["timestep"]), bool(snapshot["done"])
        self.cur_time = self.timestep * self.control_timestep
        self._observation = np.array(snapshot["observation"])
        self.sim.forward()

    def close(self) -> None:
        """Give back viewer, pictures and simulation; closing twice is no harm."""
        super().close()
        self.engine.close()


def _sensor(name: str, modality: str, read: Callable[[], Any]) -> Any:
    """A sensor as robosuite has them: a function of its cache, with a name and a modality."""

    def of_cache(_: Any) -> Any:
        return read()

    of_cache.__name__ = name
    return sensor(modality=modality)(of_cache)


def _check_robots(robots: Any) -> None:
    named = list(robots) if isinstance(robots, (list, tuple)) else [robots]
    if named != ["Panda"]:
        raise ConfigError(f"robots is {robots!r}; ArticulatedObject knows Panda")


def _check_controller(controller: Any) -> None:
    if controller is None:
        return
    name = controller.get("type", "?") if isinstance(controller, dict) else controller
    raise ConfigError(
        f"controller_configs names {name!r}; ArticulatedObject runs its own plant (follower, joint "
        "impedance, hand), which policies are trained under: leave controller_configs out"
    )


def _check_cameras(names: list[str]) -> None:
    for name in names:
        if name not in CAMERAS:
            raise ConfigError(f"no camera {name!r}; ArticulatedObject has {', '.join(CAMERAS)}")


def _without_fixed(given: dict[str, Any]) -> dict[str, Any]:
    own = {p.name for p in signature(ArticulatedObject.__init__).parameters.values()}
    known = ({f.name for f in fields(EnvConfig)} | own | {*FIXED, *UNUSED}) - {"self", "given"}
    for name in given:
        if name not in known:
            raise ConfigError(f"ArticulatedObject: no argument {name!r}{nearest(name, known)}")
    for name, accepted in FIXED.items():
        if name in given and given[name] not in accepted:
            right = " or ".join(map(repr, accepted))
            raise ConfigError(f"{name} is {given[name]!r}; ArticulatedObject accepts {right}")
    return {k: v for k, v in given.items() if k not in FIXED and k not in UNUSED}


def _read(
    given: dict[str, Any], noise: Any, control_freq: float | None, scene: Scene | None
) -> EnvConfig:
    if scene is not None and control_freq not in (None, scene.control.rate_hz):
        rate = f"{scene.control.rate_hz:g}"
        raise ConfigError(f"control_freq is {control_freq}; the scene that is given has {rate}")
    if control_freq is not None and scene is None:
        control = to_plain(given.get("control") or {})
        given = {**given, "control": {**control, "rate_hz": float(control_freq)}}
    config = read_config(given, "ArticulatedObject", scene)
    if noise == "default":
        return config
    kind = noise.get("type") if isinstance(noise, dict) else None
    if noise is not None and kind != "uniform":
        raise ConfigError(
            f"initialization_noise is {noise!r}; accepted: 'default', None, or "
            "{'type': 'uniform', 'magnitude': rad}"
        )
    start_rad = 0.0 if noise is None else float(noise.get("magnitude") or 0.0)
    return replace(config, randomization=replace(config.randomization, start_rad=start_rad))
