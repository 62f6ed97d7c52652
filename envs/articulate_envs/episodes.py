"""Episodes over an engine: initial states, observations, monitor, reward, automatic reset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.errors import EngineError
from articulate.task.episode_monitor import (
    EpisodeMonitor,
    failure_reason,
    goal_held,
    new_monitor,
)
from articulate.task.grasp import grasp_of
from articulate.task.observation import ACTION, ObservationInputs, observation_params
from articulate.task.randomization import EpisodeParams, sample_episode_params
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.state_estimation import NoisyEstimator
from articulate.task.task import goal_params
from articulate.transforms import Array, Ints, Mask
from articulate_envs.compiled.post_step import (
    N_NOISES,
    PostStepParams,
    compiled_observe,
    compiled_post_step,
    reward_inputs,
)
from articulate_envs.compiled.rows import stack_rows
from articulate_envs.config import InitialStatesConfig
from articulate_envs.engine import Engine, Start, State
from articulate_envs.initial_states import (
    concatenate_starts,
    home_start,
    mix_starts,
    precompute_states,
)
from articulate_envs.privileged_observation import privileged
from articulate_envs.rewards import (
    TERMS,
    RewardConfig,
    RewardState,
    as_numbers,
    reward_task,
    success,
    term_params,
)


@dataclass(frozen=True)
class Ended:
    """Episodes that ended in a control step, M rows."""

    rows: Ints
    """Environments (M,) of int."""
    code: Ints
    """Codes of :class:`articulate.task.episode_monitor.FailureReason` (M,)."""
    opened: Mask
    """True where the part was held at its target at the end, ignoring limits (M,)."""
    from_home: Mask
    """True where the episode began at home, to run its full length: never one that training may
    truncate (M,)."""
    truncated: Mask
    """True where training truncated the episode while the part was at rest at the target (M,)."""
    terms: Array
    """Sums of the reward's terms (M, len(TERMS))."""
    peaks: Array
    """Rows of the monitor's samples (M, WIDTH)."""
    observation: Array
    """Last observations (M, size)."""
    privileged: Array
    """Last privileged observations (M, size)."""


@dataclass(frozen=True)
class StepResult:
    """Result of one control step of N environments."""

    observation: Array
    """Observations, of the new episode where one ended (N, size)."""
    reward: Array
    """Rewards (N,)."""
    done: Mask
    """True where the episode ended (N,)."""
    ended: Ended | None
    """The episodes that ended, if any."""


class Episodes:
    """N environments that run episodes of the task's fixed length, one after another."""

    def __init__(
        self,
        engine: Engine,
        *,
        randomization: RandomizationConfig,
        reward: RewardConfig,
        initial_states: InitialStatesConfig | None,
        seed: int | np.random.SeedSequence | np.random.Generator,
        renew: bool = True,
    ) -> None:
        """Prepare; call :meth:`reset`.

        Args:
            engine: Engine that is stepped.
            randomization: Ranges of the randomization.
            reward: Parameters of the reward.
            initial_states: Initial states along the task; None begins every episode at home.
            seed: Seed of all random numbers here.
            renew: Begin a new episode in the control step in which one ends; otherwise
                :meth:`reset` does.
        """
        self.engine = engine
        self.randomization = randomization
        self.reward = reward
        self.initial_states = initial_states
        self.progress = 0.0
        """Progress of the training, in [0, 1]."""
        self._renew = renew
        scene, n = engine.scene, engine.n_envs
        self._rng = np.random.default_rng(seed)
        tasks = [engine.scenes[k].task for k in engine.scene_of]
        spans, kinds = np.array([task.span for task in tasks]), [task.kind for task in tasks]
        self._estimator = NoisyEstimator(n, spans, kinds, randomization)
        self._params = sample_episode_params(randomization, self._rng, n, begin=scene.task.begin)
        self._precomputed = (
            None
            if initial_states is None
            else [
                precompute_states(one, initial_states, randomization, self._rng)
                for one in engine.scenes
            ]
        )
        self._constants = self._post_step_params()
        self._monitor = new_monitor(n)
        self._step = np.zeros(n, dtype=np.int64)
        self._home = np.zeros(n, dtype=bool)
        self._last_action = np.zeros((n, ACTION.size))
        self._width = np.zeros(n)
        self._terms = np.zeros((n, len(TERMS)))
        self._noise = np.zeros((n, N_NOISES))
        self._state: State | None = None

    def _post_step_params(self) -> PostStepParams:
        scenes = [self.engine.scenes[k] for k in self.engine.scene_of]
        grasps = [
            grasp_of(scene.asset.handle_of(scene.task.joint), scene.placement) for scene in scenes
        ]
        return PostStepParams(
            terms=term_params(self.reward),
            travel=as_numbers(self.reward.travel),
            task=stack_rows(
                [
                    reward_task(scene.task, grasp)
                    for scene, grasp in zip(scenes, grasps, strict=True)
                ]
            ),
            goal=stack_rows([goal_params(scene.task) for scene in scenes]),
            observation=stack_rows(
                [
                    observation_params(scene.control, scene.task, scene.asset, scene.placement)
                    for scene in scenes
                ]
            ),
            estimator=self._estimator.params,
            force_noise_n=float(self.randomization.force_noise_n),
            steps=self.engine.scene.n_steps,
        )

    @property
    def params(self) -> EpisodeParams:
        """Sampled parameters of the present episodes."""
        return EpisodeParams(self._params.values.copy())

    @property
    def monitor(self) -> EpisodeMonitor:
        """Monitor of the present episodes."""
        return self._monitor

    @property
    def begun(self) -> bool:
        """True after the first reset."""
        return self._state is not None

    @property
    def state(self) -> State:
        """Present state.

        Raises:
            EngineError: There was no reset.
        """
        if self._state is None:
            raise EngineError("step before the first reset: call reset() first")
        return self._state

    def observe_again(self) -> Array:
        """Return observations (N, size) of the present state with another sample of the noise."""
        return self._observe(self._sample_noise())

    def reseed(self, seed: int | np.random.SeedSequence | np.random.Generator) -> None:
        """Set the seed of all random numbers from the next reset on, except precomputed states."""
        self._rng = np.random.default_rng(seed)

    def sample_start(self, n: int) -> Start:
        """Sample the initial states of the next N episodes of the first scene."""
        return self._sample_of(0, n)

    def _sample_rows(self, rows: Ints) -> Start:
        """Sample the initial states of environments ``rows`` (M,), scene by scene."""
        scene_of = self.engine.scene_of[rows]
        parts = [np.flatnonzero(scene_of == k) for k in np.unique(scene_of)]
        starts = [self._sample_of(int(scene_of[part[0]]), len(part)) for part in parts]
        if len(starts) == 1:
            return starts[0]
        return concatenate_starts(starts, np.argsort(np.concatenate(parts)))

    def _sample_of(self, k: int, n: int) -> Start:
        """Sample the initial states of N episodes of scene ``k``."""
        scene = self.engine.scenes[k]
        params = sample_episode_params(self.randomization, self._rng, n, begin=scene.task.begin)
        if self.initial_states is None or self._precomputed is None:
            return home_start(scene, params)
        share = self.initial_states.share(self.progress)
        return mix_starts(scene, self._precomputed[k], params, share, self._rng)

    def reset(self, *, stagger: bool = False, start: Start | None = None) -> Array:
        """Begin all episodes and return the observations (N, size).

        Args:
            stagger: Let the first episodes end one after another; they do not count as begun at
                home.
            start: Initial states, sampled by default.
        """
        n = self.engine.n_envs
        rows = np.arange(n, dtype=np.int64)
        self._state = self._begin(rows, start)
        if stagger:
            self._step[:] = (rows * self.engine.scene.n_steps) // n
            self._home &= self._step == 0
        self._width = self._state.gripper_width
        self._estimator.push(self._state.T_wh, self._state.opened, self._state.speed)
        self._noise = self._sample_noise()
        return self._observe(self._noise)

    def _begin(self, rows: Ints, start: Start | None = None) -> State:
        """Begin episodes in environments ``rows`` (M,) and return the state of all environments."""
        start = self._sample_rows(rows) if start is None else start
        self.engine.reset(rows, start)
        self._params.values[rows] = start.params.values
        self._home[rows] = start.home
        for array, value in zip(self._monitor, new_monitor(len(rows)), strict=True):
            array[rows] = value
        self._step[rows] = 0
        self._last_action[rows] = 0.0
        self._terms[rows] = 0.0
        state = self.engine.state()
        self._estimator.reset(rows, state.T_wh[rows], state.opened[rows])
        return state

    def _inputs(self) -> ObservationInputs:
        """Return the inputs of the observations except the estimate."""
        state = self.state
        return ObservationInputs(
            q=state.q,
            dq=state.dq,
            target=state.target,
            T_wt=state.T_wt,
            T_wt_target=state.T_wt_target,
            gripper=state.gripper,
            gripper_width=state.gripper_width,
            last_gripper_width=self._width,
            pending_actions=state.pending_actions,
            last_action=self._last_action,
        )

    def _observe(self, noise: Array) -> Array:
        out: Array = compiled_observe(
            self._inputs(),
            self.state.samples,
            self._estimator.history,
            self._params.values,
            noise,
            self._step,
            self._constants,
        )
        return out

    def _sample_noise(self) -> Array:
        """Return the noise of the next observations (N, N_NOISES), standard normal."""
        return self._rng.normal(size=(self.engine.n_envs, N_NOISES))

    def privileged(self) -> Array:
        """Return the privileged observations of the present state (N, size)."""
        return privileged(self._constants.goal, self.state, self._monitor, self._params)

    def step(self, action: Array) -> StepResult:
        """Run one control step with actions (N, 8), clipped to [-1, 1]."""
        scene, before = self.engine.scene, self.state
        action = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self._state = self.engine.step(action)
        self._width = before.gripper_width
        self._last_action = action
        self._step += 1
        terms, observed = self._post_step(before, action)
        full = self._step >= scene.n_steps
        if full.any():
            ends = self._step == scene.n_steps  # once, also where no new episode begins
            succeeded = failure_reason(self._monitor, scene.task)[ends] == 0
            paid = success(self.reward.success, RewardState(succeeded=True))
            terms[ends, TERMS.index("success")] += paid * succeeded
        self._terms += terms
        truncated = self._truncated()
        done = full | self._monitor.diverged | truncated
        ended = None
        if done.any():
            ended = self._end(np.flatnonzero(done), observed, truncated)
            if self._renew:
                self._state = self._begin(ended.rows)
                self._width = self._width.copy()
                self._width[ended.rows] = self._state.gripper_width[ended.rows]
                noise = self._sample_noise()
                self._noise[ended.rows] = noise[ended.rows]
                observed = observed.copy()
                observed[ended.rows] = self._observe(noise)[ended.rows]
        return StepResult(observed, terms.sum(axis=1), done, ended)

    def _post_step(self, before: State, action: Array) -> tuple[Array, Array]:
        """Update the monitor; return reward terms (N, len(TERMS)) and observations (N, size)."""
        terms = np.empty((self.engine.n_envs, len(TERMS)))
        self._noise = self._sample_noise()
        self._monitor = self._monitor._replace(samples=self.state.samples).copy()
        observed: Array = compiled_post_step(
            reward_inputs(before),
            reward_inputs(self.state),
            action,
            min(self.progress / self.reward.until, 1.0),
            self._monitor,
            self._inputs(),
            self._estimator.history,
            self._params.values,
            self._noise,
            self._step,
            self._constants,
            terms,
        )
        return terms, observed

    def _may_truncate(self) -> Mask:
        """Environments whose episodes training may truncate (N,)."""
        n, config = self.engine.n_envs, self.initial_states
        share = 0.0
        if config is not None and config.truncation_probability > 0.0:
            share = config.truncation_env_share
        return np.asarray(np.arange(n) < round(share * n))

    def _truncated(self) -> Mask:
        """Episodes that training truncates now (N,)."""
        may = self._may_truncate()
        if self.initial_states is None or not may.any():
            return may
        chosen = may & (self._rng.random(len(may)) < self.initial_states.truncation_probability)
        return np.asarray(chosen & goal_held(self._monitor, self.engine.scene.task))

    def _end(self, rows: Ints, observed: Array, truncated: Mask) -> Ended:
        task = self.engine.scene.task
        return Ended(
            rows=rows,
            code=failure_reason(self._monitor, task)[rows],
            opened=goal_held(self._monitor, task)[rows],
            from_home=(self._home & ~self._may_truncate())[rows],
            truncated=(truncated & (self._step < self.engine.scene.n_steps))[rows],
            terms=self._terms[rows].copy(),
            peaks=self._monitor.samples[rows].copy(),
            observation=observed[rows],
            privileged=self.privileged()[rows],
        )

    def snapshot(self) -> dict[str, Any]:
        """Return all that bit-identical continuation needs: arrays, and the generator's state."""
        out: dict[str, Any] = {f"engine_{k}": v for k, v in self.engine.snapshot().items()}
        out |= self._estimator.snapshot()
        out |= {f"monitor_{k}": v for k, v in self._monitor.copy()._asdict().items()}
        return out | {
            "episode_step": self._step.copy(),
            "episode_home": self._home.copy(),
            "episode_last_action": self._last_action.copy(),
            "episode_width": self._width.copy(),
            "episode_terms": self._terms.copy(),
            "episode_noise": self._noise.copy(),
            "episode_params": self._params.values.copy(),
            "progress": np.array(self.progress),
            "generator": self._rng.bit_generator.state,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from :meth:`snapshot`; the next step equals the one that would have followed."""
        prefix = "engine_"
        self.engine.restore(
            {k[len(prefix) :]: v for k, v in snapshot.items() if k.startswith(prefix)}
        )
        self._estimator.restore(snapshot)
        self._monitor = EpisodeMonitor(
            *(snapshot[f"monitor_{name}"].copy() for name in EpisodeMonitor._fields)
        )
        self._step[:] = snapshot["episode_step"]
        self._home[:] = snapshot["episode_home"]
        self._last_action = snapshot["episode_last_action"].copy()
        self._width = snapshot["episode_width"].copy()
        self._terms[:] = snapshot["episode_terms"]
        # Checkpoints of earlier versions have no noise; only the next expert action depends on it.
        self._noise = np.array(snapshot.get("episode_noise", np.zeros_like(self._noise)))
        self._params.values[:] = snapshot["episode_params"]
        self.progress = float(snapshot["progress"])
        self._rng.bit_generator.state = snapshot["generator"]
        self._state = self.engine.state()
