"""Episodes over an engine: starts, observations, judgement, reward, automatic reset."""

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
from articulate.task.observation import ACTION
from articulate.task.randomization import EpisodeParams, sample_episode_params
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.state_estimation import NoisyEstimator
from articulate.transforms import Array, Ints, Mask
from articulate_envs.compiled.after import Judged, Rules, after
from articulate_envs.compiled.judge import asked_of
from articulate_envs.compiled.observe import NOISES, Past, Scales, Seen, observations
from articulate_envs.compiled.reward import view_of, way_of, weights_of
from articulate_envs.config import InitialStatesConfig, RewardConfig
from articulate_envs.engine import Engine, Start, State
from articulate_envs.initial_states import home_start, mix_starts, precompute_states
from articulate_envs.privileged_observation import privileged
from articulate_envs.rewards import TERMS, at_end, grasp_of


@dataclass(frozen=True)
class Ended:
    """Episodes that ended at a tick, M rows."""

    rows: Ints
    """Environments (M,) of int."""
    code: Ints
    """Codes of :data:`articulate.task.episode_monitor.REASONS` (M,)."""
    opened: Mask
    """Whether the part was held at its target at the end, limits aside (M,)."""
    from_home: Mask
    """Whether the episode began at home, to run its full length: never one that training may cut
    off (M,)."""
    cut: Mask
    """Whether training cut it off while the part rested at the target (M,)."""
    terms: Array
    """Sums of the reward's terms (M, len(TERMS))."""
    peaks: Array
    """Rows of the judgement's samples (M, WIDTH)."""
    observation: Array
    """Last observations (M, size)."""
    privileged: Array
    """Last observations of the value function alone (M, size)."""


@dataclass(frozen=True)
class Tick:
    """What one tick of N environments gives."""

    observation: Array
    """Observations, of the new episode where one ended (N, size)."""
    reward: Array
    """Rewards (N,)."""
    done: Mask
    """Whether the episode ended (N,)."""
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
            engine: What is stepped.
            randomization: Ranges of the randomization.
            reward: Weights.
            starts: Starts along the task; None begins every episode at home.
            seed: Decides all that is random here.
            renew: Begin a new episode in the tick in which one ends; otherwise :meth:`reset` does.
        """
        self.engine = engine
        self.randomization = randomization
        self.reward = reward
        self.initial_states = initial_states
        self.progress = 0.0
        self._renew = renew
        scene, n = engine.scene, engine.n_envs
        self._rng = np.random.default_rng(seed)
        self._estimator = NoisyEstimator(n, scene.task.span, scene.task.kind, randomization)
        self._drawn = sample_episode_params(randomization, self._rng, n, begin=scene.task.begin)
        self._bank = (
            None
            if initial_states is None
            else precompute_states(scene, initial_states, randomization, self._rng)
        )
        self._past = Past(self._estimator.poses, self._estimator.opened, self._estimator.speed)
        self._rules = self._make_rules()
        self._judgement = new_monitor(n)
        self._tick = np.zeros(n, dtype=np.int64)
        self._home = np.zeros(n, dtype=bool)
        self._last = np.zeros((n, ACTION.size))
        self._width = np.zeros(n)
        self._terms = np.zeros((n, len(TERMS)))
        self._state: State | None = None

    def _make_rules(self) -> Rules:
        scene = self.engine.scene
        grasp = grasp_of(scene.asset.handle_of(scene.task.joint))
        scales = Scales(
            step_s=scene.control.step_s,
            ticks=scene.ticks,
            move_m=scene.control.move_m,
            goal=scene.task.target,
            closes=scene.task.closes,
            noise_m=self.randomization.estimate_noise_m,
            noise_open=self._estimator.part_noise,
            noise_n=self.randomization.force_noise_n,
        )
        return Rules(
            weights=weights_of(self.reward),
            way=way_of(self.reward, scene.task),
            along_m=grasp.along_m,
            thick_m=grasp.thick_m,
            asked=asked_of(scene.task),
            scales=scales,
        )

    @property
    def drawn(self) -> EpisodeParams:
        """What was drawn for the episodes that run now."""
        return EpisodeParams(self._drawn.values.copy())

    @property
    def judgement(self) -> EpisodeMonitor:
        """What the episodes that run now have shown."""
        return self._judgement

    @property
    def begun(self) -> bool:
        """Whether there was a reset."""
        return self._state is not None

    @property
    def state(self) -> State:
        """What is true now.

        Raises:
            EngineError: Nothing was begun.
        """
        if self._state is None:
            raise EngineError("step before the first reset: call reset() first")
        return self._state

    def reseed(self, seed: int | np.random.SeedSequence | np.random.Generator) -> None:
        """Let ``seed`` decide all that is random from the next reset on, but for the bank."""
        self._rng = np.random.default_rng(seed)

    def draw_start(self, n: int) -> Start:
        """How the next N episodes would begin; what is random is drawn."""
        scene = self.engine.scene
        drawn = sample_episode_params(self.randomization, self._rng, n, begin=scene.task.begin)
        if self.initial_states is None or self._bank is None:
            return home_start(scene, drawn)
        share = self.initial_states.share(self.progress)
        return mix_starts(scene, self._bank, drawn, share, self._rng)

    def reset(self, *, stagger: bool = False, start: Start | None = None) -> Array:
        """Begin all episodes and return the observations (N, size).

        Args:
            stagger: Let the first episodes end one after another; they are not counted as
                begun at home.
            start: How they begin, instead of drawing it.
        """
        n = self.engine.n_envs
        rows = np.arange(n, dtype=np.int64)
        self._state = self._begin(rows, start)
        if stagger:
            self._tick[:] = (rows * self.engine.scene.ticks) // n
            self._home &= self._tick == 0
        self._width = self._state.gripper_width
        self._estimator.push(self._state.T_wh, self._state.opened, self._state.speed)
        return self._observe()

    def _begin(self, rows: Ints, start: Start | None = None) -> State:
        """Begin episodes in environments ``rows`` (M,); what is then true of all."""
        start = self.draw_start(len(rows)) if start is None else start
        self.engine.reset(rows, start)
        self._drawn.values[rows] = start.params.values
        self._home[rows] = start.home
        fresh = new_monitor(len(rows))
        self._judgement.rest_s[rows] = 0.0
        self._judgement.opened[rows] = False
        self._judgement.diverged[rows] = False
        self._judgement.samples[rows] = fresh.samples
        self._tick[rows] = 0
        self._last[rows] = 0.0
        self._terms[rows] = 0.0
        state = self.engine.state()
        self._estimator.reset(rows, state.T_wh[rows], state.opened[rows])
        return state

    def _seen(self) -> Seen:
        """What observations are made of, but for the estimate."""
        state, gripper = self.state, self.state.gripper
        return Seen(
            state.q,
            state.dq,
            state.target,
            state.gripper_width,
            self._width,
            gripper.smooth,
            gripper.wish,
            gripper.since_s,
            state.samples,
            state.T_wt,
            state.T_wt_target,
            state.pending_actions,
            self._last,
            self._tick,
        )

    def _noise(self) -> Array:
        return self._rng.normal(size=(self.engine.n_envs, NOISES))

    def _observe(self) -> Array:
        given = (self._past, self._drawn.values, self._noise(), self._rules.scales)
        out: Array = observations(self._seen(), *given)
        return out

    def privileged(self) -> Array:
        """What only the value function sees of the environments as they are (N, size)."""
        return privileged(self.engine.scene.task, self.state, self._judgement, self._drawn)

    def step(self, action: Array) -> Tick:
        """Run one tick with actions (N, 8), clipped to [-1, 1]."""
        scene, before = self.engine.scene, self.state
        action = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self._state = self.engine.step(action)
        self._width = before.gripper_width
        self._last = action
        self._tick += 1
        terms, seen = self._after(before, action)
        full = self._tick >= scene.ticks
        if full.any():
            ends = self._tick == scene.ticks  # once, where nobody begins anew either
            terms[ends] += at_end(
                self.reward, failure_reason(self._judgement, scene.task)[ends] == 0
            )
        self._terms += terms
        cut = self._cut()
        done = full | self._judgement.diverged | cut
        ended = None
        if done.any():
            ended = self._end(np.flatnonzero(done), seen, cut)
            if self._renew:
                self._state = self._begin(ended.rows)
                self._width = self._width.copy()
                self._width[ended.rows] = self._state.gripper_width[ended.rows]
                seen = seen.copy()
                seen[ended.rows] = self._observe()[ended.rows]
        return Tick(seen, terms.sum(axis=1), done, ended)

    def _after(self, before: State, action: Array) -> tuple[Array, Array]:
        """Judge the tick; the terms of its reward (N, len(TERMS)), and what is seen (N, size)."""
        n, was, now = self.engine.n_envs, self._judgement, self.state
        terms, judged = np.empty((n, len(TERMS))), _judged(new_monitor(n))
        seen: Array = after(
            self._rules,
            min(self.progress / self.reward.until, 1.0),
            view_of(before),
            view_of(now),
            action,
            _judged(was),
            judged,
            self._past,
            self._seen(),
            self._drawn.values,
            self._noise(),
            terms,
        )
        self._judgement = EpisodeMonitor(now.samples, *judged)
        return terms, seen

    def _may_cut(self) -> Mask:
        """Environments whose episodes training may cut off (N,)."""
        n = self.engine.n_envs
        share = (
            0.0
            if self.initial_states is None or self.initial_states.truncation_probability <= 0.0
            else self.initial_states.truncation_env_share
        )
        return np.asarray(np.arange(n) < round(share * n))

    def _cut(self) -> Mask:
        """Which episodes of training are cut off now (N,)."""
        may = self._may_cut()
        if self.initial_states is None or not may.any():
            return may
        chosen = may & (self._rng.random(len(may)) < self.initial_states.truncation_probability)
        return np.asarray(chosen & goal_held(self._judgement, self.engine.scene.task))

    def _end(self, rows: Ints, seen: Array, cut: Mask) -> Ended:
        task = self.engine.scene.task
        return Ended(
            rows=rows,
            code=failure_reason(self._judgement, task)[rows],
            opened=goal_held(self._judgement, task)[rows],
            from_home=(self._home & ~self._may_cut())[rows],
            cut=(cut & (self._tick < self.engine.scene.ticks))[rows],
            terms=self._terms[rows].copy(),
            peaks=self._judgement.samples[rows].copy(),
            observation=seen[rows],
            privileged=self.privileged()[rows],
        )

    def snapshot(self) -> dict[str, Any]:
        """All that resuming bit-identically needs: arrays, and the generator's state."""
        out: dict[str, Any] = {f"engine_{k}": v for k, v in self.engine.snapshot().items()}
        out |= self._estimator.snapshot()
        j = self._judgement
        return out | {
            "judgement_samples": j.samples.copy(),
            "judgement_rest_s": j.rest_s.copy(),
            "judgement_opened": j.opened.copy(),
            "judgement_diverged": j.diverged.copy(),
            "episode_tick": self._tick.copy(),
            "episode_home": self._home.copy(),
            "episode_last": self._last.copy(),
            "episode_width": self._width.copy(),
            "episode_terms": self._terms.copy(),
            "episode_drawn": self._drawn.values.copy(),
            "progress": np.array(self.progress),
            "generator": self._rng.bit_generator.state,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from :meth:`snapshot`; the next step is the one that would have come."""
        prefix = "engine_"
        self.engine.restore(
            {k[len(prefix) :]: v for k, v in snapshot.items() if k.startswith(prefix)}
        )
        self._estimator.restore(snapshot)
        self._judgement = EpisodeMonitor(
            snapshot["judgement_samples"].copy(),
            snapshot["judgement_rest_s"].copy(),
            snapshot["judgement_opened"].copy(),
            snapshot["judgement_diverged"].copy(),
        )
        self._tick[:] = snapshot["episode_tick"]
        self._home[:] = snapshot["episode_home"]
        self._last = snapshot["episode_last"].copy()
        self._width = snapshot["episode_width"].copy()
        self._terms[:] = snapshot["episode_terms"]
        self._drawn.values[:] = snapshot["episode_drawn"]
        self.progress = float(snapshot["progress"])
        self._rng.bit_generator.state = snapshot["generator"]
        self._state = self.engine.state()


def _judged(judgement: EpisodeMonitor) -> Judged:
    return Judged(judgement.rest_s, judgement.opened, judgement.diverged)
