"""End of a control step in one compiled call: reward terms, episode monitor, observations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from articulate.jit import row_function
from articulate.task.episode_monitor import COLUMN, EpisodeMonitor, monitor_step
from articulate.task.observation import (
    OBSERVATION,
    ObservationInputs,
    ObservationParams,
    write_observation,
)
from articulate.task.state_estimation import (
    EstimatorParams,
    StateHistory,
    estimate_state,
    measured_force,
    push_state,
)
from articulate.task.task import GoalParams, is_at_rest
from articulate.transforms import Array, Ints, matrix_angle
from articulate_envs.compiled.entry_points import entry_point
from articulate_envs.compiled.rows import goal_of, observation_params_of, reward_task_of
from articulate_envs.engine import State
from articulate_envs.rewards import TERM_FUNCTIONS, RewardState, RewardTask, Travel

N_NOISES = 7
"""Random numbers per environment and control step: handle position, fraction open, force."""
_CODE = COLUMN["code"]
_SIZE = OBSERVATION.size


class RewardInputs(NamedTuple):
    """Arrays of a :class:`articulate_envs.engine.State` that the reward reads, first axis N."""

    T_wt: Array
    T_wh: Array
    opened: Array
    speed: Array
    width: Array
    smooth: Array
    closing: Array
    samples: Array


def reward_inputs(state: State) -> RewardInputs:
    """Return the arrays of ``state`` that the reward reads."""
    return RewardInputs(
        state.T_wt,
        state.T_wh,
        state.opened,
        state.speed,
        state.gripper_width,
        state.gripper.smooth,
        state.gripper.closing,
        state.samples,
    )


class PostStepParams(NamedTuple):
    """Constants of :func:`post_step`.

    ``task``, ``goal`` and ``observation`` hold arrays with one row per environment
    (:func:`.rows.stack_rows`), as environments can have different scenes.
    """

    terms: Any
    """Parameters of the reward terms, :func:`articulate_envs.rewards.term_params`."""
    travel: Travel
    task: RewardTask
    goal: GoalParams
    observation: ObservationParams
    estimator: EstimatorParams
    force_noise_n: float
    """Standard deviation of the noise of the measured force [N]."""
    steps: int
    """Length of an episode [control steps]."""


@row_function
def handle_offset(
    T_wt: Array, T_wh: Array, along_m: float, beside_m: float
) -> tuple[float, float, float]:
    """Return the tool in the axes of the handle [m], from the nearest point of its middle.

    Args:
        T_wt: Pose of the tool (4, 4).
        T_wh: Pose of the handle (4, 4), its x axis along the handle.
        along_m: Half length of what counts as its middle along x [m].
        beside_m: Places along y from 0 to here count as its middle [m].
    """
    dx, dy, dz = T_wt[0, 3] - T_wh[0, 3], T_wt[1, 3] - T_wh[1, 3], T_wt[2, 3] - T_wh[2, 3]
    x = T_wh[0, 0] * dx + T_wh[1, 0] * dy + T_wh[2, 0] * dz
    y = T_wh[0, 1] * dx + T_wh[1, 1] * dy + T_wh[2, 1] * dz
    z = T_wh[0, 2] * dx + T_wh[1, 2] * dy + T_wh[2, 2] * dz
    x -= min(max(x, -along_m), along_m)
    y -= min(max(y, min(beside_m, 0.0)), max(beside_m, 0.0))
    return x, y, z


@row_function
def handle_angle(T_wt: Array, T_wh: Array) -> float:
    """Return the angle between tool and handle [rad]."""
    m = np.empty((3, 3))
    for r in range(3):
        for c in range(3):
            m[r, c] = T_wt[0, r] * T_wh[0, c] + T_wt[1, r] * T_wh[1, c] + T_wt[2, r] * T_wh[2, c]
    angle: float = matrix_angle(m)
    return angle


@row_function
def reward_state(
    i: int,
    before: RewardInputs,
    now: RewardInputs,
    action: Array,
    progress: float,
    travel: Travel,
    task: RewardTask,
    goal: GoalParams,
) -> RewardState:
    """Return the quantities of environment ``i`` that the terms read.

    Args:
        i: Index of the environment.
        before: State at the beginning of the control step.
        now: State at its end.
        action: Action of the policy (8,).
        progress: Progress of the annealed weights, in [0, 1].
        travel: Shape of the reward over the travel of the part.
        task: Constants of task and handle.
        goal: Success criteria.
    """
    T_wt, T_wh, row = now.T_wt[i], now.T_wh[i], now.samples[i]
    offset = handle_offset(T_wt, T_wh, task.along_m, task.beside_m)
    across = ahead = motion = 0.0
    for r in range(3):
        along = T_wh[r, 0] * offset[0] + T_wh[r, 1] * offset[1] + T_wh[r, 2] * offset[2]
        across -= T_wt[r, 1] * along
        ahead -= T_wt[r, 2] * along
    for k in range(7):
        motion += action[k] ** 2
    return RewardState(
        task,
        travel,
        progress,
        offset,
        handle_angle(T_wt, T_wh),
        handle_offset(before.T_wt[i], before.T_wh[i], task.along_m, task.beside_m),
        handle_angle(before.T_wt[i], before.T_wh[i]),
        across,
        ahead,
        now.width[i],
        action[7],
        now.smooth[i],
        now.closing[i],
        now.opened[i],
        before.opened[i],
        now.speed[i],
        is_at_rest(goal, now.opened[i], now.speed[i]),
        np.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2),
        motion / 7.0,
        row[_CODE] > 0.0,
        before.samples[i, _CODE] > 0.0,
        False,
    )


def _write_all(terms: list[Callable[..., float]]) -> Callable[..., None]:
    """Return a row function ``write(params, state, out)`` that writes all ``terms`` in order."""

    @row_function
    def write(params: Any, state: RewardState, out: Array) -> None:
        return

    for k, term in enumerate(terms):
        write = _and_then(write, term, k)
    return write


def _and_then(rest: Callable[..., None], term: Callable[..., float], k: int) -> Callable[..., None]:
    @row_function
    def write(params: Any, state: RewardState, out: Array) -> None:
        rest(params, state, out)
        out[k] = term(params[k], state)

    return write


write_terms = _write_all(list(TERM_FUNCTIONS.values()))
"""Row function that writes all terms of the reward."""


@row_function
def write_rewards(
    before: RewardInputs,
    now: RewardInputs,
    action: Array,
    progress: float,
    params: PostStepParams,
    terms: Array,
) -> None:
    """Write the weighted terms (N, len(TERMS)) of a control step; what is not finite is 0."""
    for i in range(len(terms)):
        state = reward_state(
            i,
            before,
            now,
            action[i],
            progress,
            params.travel,
            reward_task_of(params.task, i),
            goal_of(params.goal, i),
        )
        write_terms(params.terms, state, terms[i])
        for k in range(terms.shape[1]):
            if not np.isfinite(terms[i, k]):
                terms[i, k] = 0.0


@row_function
def observe(
    inputs: ObservationInputs,
    samples: Array,
    history: StateHistory,
    values: Array,
    noise: Array,
    step: Ints,
    params: PostStepParams,
) -> Array:
    """Return the observations (N, size), with sampled errors; what is not finite is 0.

    Args:
        inputs: State of robot and controller.
        samples: Rows of the episode monitor (N, WIDTH), which begin with the filtered force.
        history: States of the objects.
        values: Episode parameters (N, columns).
        noise: Standard normal numbers (N, N_NOISES).
        step: Control steps since the episode began (N,).
        params: Constants.
    """
    out, T_wh, force = np.empty((len(noise), _SIZE)), np.zeros((4, 4)), np.zeros(3)
    for i in range(len(out)):
        opened, speed = estimate_state(history, i, values[i], noise[i], params.estimator, T_wh)
        measured_force(samples[i], values[i], noise[i, 4:], params.force_noise_n, force)
        left = 1.0 - step[i] / params.steps
        constants = observation_params_of(params.observation, i)
        write_observation(inputs, i, T_wh, opened, speed, force, left, constants, out[i])
        for j in range(_SIZE):
            if np.isnan(out[i, j]):  # of an environment that diverged
                out[i, j] = 0.0
    return out


@row_function
def post_step(
    before: RewardInputs,
    now: RewardInputs,
    action: Array,
    progress: float,
    monitor: EpisodeMonitor,
    inputs: ObservationInputs,
    history: StateHistory,
    values: Array,
    noise: Array,
    step: Ints,
    params: PostStepParams,
    terms: Array,
) -> Array:
    """Write reward terms (N, len(TERMS)), update the monitor, return observations (N, size).

    The terms of diverged environments are 0. The ``history`` takes in the state at the end of the
    control step. See :func:`write_rewards` and :func:`observe` for the arguments.
    """
    write_rewards(before, now, action, progress, params, terms)
    for i in range(len(terms)):
        goal, step_s = goal_of(params.goal, i), params.observation.step_s[i]  # type: ignore[index]
        monitor_step(monitor, i, now.opened[i], now.speed[i], goal, step_s)
        if monitor.diverged[i]:
            for k in range(terms.shape[1]):
                terms[i, k] = 0.0
    push_state(history, now.T_wh, now.opened, now.speed)
    return observe(inputs, monitor.samples, history, values, noise, step, params)


compiled_post_step = entry_point(post_step)
compiled_observe = entry_point(observe)
