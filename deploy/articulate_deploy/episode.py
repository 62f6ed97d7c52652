"""Episode of a policy on a robot, with the monitor and the success criteria of training."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from articulate.robot.kinematics import tool_pose
from articulate.task.episode_monitor import (
    REASONS,
    EpisodeMonitor,
    FailureReason,
    failure_reason,
    goal_held,
    monitor_params,
    monitor_sample,
    monitor_step,
    new_monitor,
)
from articulate.task.manifest import Manifest
from articulate.task.observation import (
    Estimate,
    ObservationInputs,
    observation,
    observation_params,
)
from articulate.task.randomization import EpisodeParams
from articulate.task.task import Task, goal_params
from articulate.transforms import Array
from articulate_deploy.estimators.estimator import Estimator
from articulate_deploy.policy_control import PolicyController
from articulate_deploy.policy_runner import Policy
from articulate_deploy.robots.robot import (
    FORCE_KEYS,
    GRIPPER_KEY,
    SPEED_KEYS,
    ForceStopError,
    Robot,
    action_dict,
    read_keys,
)
from articulate_deploy.safety import (
    ToolLimits,
    check_start,
    limit_tool,
    safe_target,
    was_clipped,
)

PEAKS = (
    "force",
    "force_short",
    "force_raw",
    "moment",
    "speed_share",
    "torque_share",
    "torque_rate",
)
"""Columns of the monitor that are reported."""


@dataclass(frozen=True)
class EpisodeResult:
    """Outcome of an episode."""

    reason: str
    """Name of a :class:`articulate.task.episode_monitor.FailureReason`."""
    opened: bool
    """True if the part was held at its target at the end, ignoring limits."""
    fraction: float
    """Fraction open at the end, 1 at its far limit."""
    steps: int
    """Control steps that were run."""
    clipped: int
    """Control steps whose targets the safety filter changed."""
    peaks: dict[str, float]
    """Largest values of :data:`PEAKS`."""

    @property
    def success(self) -> bool:
        """True at the target without a violation."""
        return self.reason == str(FailureReason.SUCCESS)


@dataclass
class Recording:
    """Record of an episode, one row per control step."""

    rows: dict[str, list[Array]] = field(default_factory=dict)

    def add(self, **values: Array | float) -> None:
        """Append a control step."""
        for name, value in values.items():
            self.rows.setdefault(name, []).append(np.array(value, dtype=np.float64))

    def arrays(self) -> dict[str, Array]:
        """Return arrays (T, ...) by name."""
        return {name: np.stack(values) for name, values in self.rows.items()}


def run_episode(
    policy: Policy,
    robot: Robot,
    estimator: Estimator,
    manifest: Manifest,
    *,
    delay_steps: int = 0,
    recording: Recording | None = None,
    speed_scale: float = 1.0,
    tool_limits: ToolLimits | None = None,
    check: Callable[[], None] = lambda: None,
) -> EpisodeResult:
    """Run ``policy`` for the task's time on a robot at its start.

    All targets pass the safety filter (:func:`articulate_deploy.safety.safe_target`) here, before
    the driver of any robot.

    Args:
        policy: Network from observations to actions.
        robot: Connected, at rest.
        estimator: Estimator of the object's state.
        manifest: Task, control stack, limits.
        delay_steps: Delay of the motions [control steps].
        recording: Record to which each control step is appended.
        speed_scale: Speed of the policy's clock, by which ``manifest`` is scaled
            (:func:`articulate_deploy.time_scale.scaled_manifest`).
        tool_limits: Limits of the tool; None for simulated robots.
        check: Called in each control step; its exceptions end the episode.

    Raises:
        StartError: The robot is not at its start.
    """
    task, step_s = manifest.task, manifest.control.step_s
    steps = round(task.episode_s / (step_s * speed_scale))
    q = read_keys(robot.get_observation())
    check_start(q, manifest.start)
    controller = PolicyController(manifest, q, delay_steps=delay_steps)
    robot.take_samples()
    estimator.reset()
    monitor, torque = new_monitor(1), np.zeros(7)
    observer = _Observer(manifest, controller, speed_scale)
    clipped, step, stopped_by_force = 0, 0, False
    for step in range(steps):
        check()
        begun_s = time.perf_counter()
        measured = robot.get_observation()
        estimate = _policy_time(estimator.estimate(), speed_scale)
        inputs, observed = observer.observe(measured, estimate, 1.0 - step / steps)
        action = policy.act(observed)[0]
        width, force = measured[GRIPPER_KEY], read_keys(measured, FORCE_KEYS)
        requested, opening = controller.step(action, q=inputs.q[0], width_m=width, force=force)
        safe = _safe(requested, controller.target, manifest, tool_limits)
        clipped += was_clipped(requested, safe)
        policy_s = time.perf_counter() - begun_s
        try:
            sent = read_keys(robot.send_action(action_dict(safe, opening)))
        except ForceStopError:
            stopped_by_force = True
            break
        controller.set_sent(sent)
        observer.last_action = action
        estimator.update()
        truth = estimator.monitored_state()
        _monitor(monitor, torque, robot, truth, manifest)
        if recording is not None:
            recording.add(
                time_s=step * step_s,
                observation=observed[0],
                action=action,
                target=sent,
                monitor=monitor.samples[0],
                policy_s=policy_s,
                **_robot_columns(inputs, force),
                **_object_columns(estimate, truth),
            )
        if monitor.diverged[0]:
            break
    robot.stop()
    ended = _result(monitor, task, estimator.monitored_state(), steps=step + 1, clipped=clipped)
    return replace(ended, reason=str(FailureReason.FORCE)) if stopped_by_force else ended


def _result(
    monitor: EpisodeMonitor, task: Task, truth: Estimate, *, steps: int, clipped: int
) -> EpisodeResult:
    """Return the outcome of the monitored episode."""
    return EpisodeResult(
        reason=REASONS[int(failure_reason(monitor, task)[0])],
        opened=bool(goal_held(monitor, task)[0]),
        fraction=float(truth.opened[0]),
        steps=steps,
        clipped=clipped,
        peaks={name: float(monitor.peak(name)[0]) for name in PEAKS},
    )


def _safe(
    requested: Array, last: Array, manifest: Manifest, tool_limits: ToolLimits | None
) -> Array:
    """Return the requested targets (7,) [rad] within the limits of joints and tool."""
    control, arm = manifest.control, manifest.robot
    safe = safe_target(requested, last, control, arm)
    return safe if tool_limits is None else limit_tool(safe, last, tool_limits, control, arm)


def _robot_columns(inputs: ObservationInputs, force: Array) -> dict[str, Array | float]:
    """Return the columns of a recording that describe arm and gripper."""
    return {
        "joint_pos": inputs.q[0],
        "joint_vel": inputs.dq[0],
        "gripper_width_m": float(inputs.gripper_width[0]),
        "measured_force_n": force,
    }


def _object_columns(estimate: Estimate, truth: Estimate) -> dict[str, Array | float]:
    """Return the columns of a recording that describe the object."""
    return {
        "estimate_T_wh": estimate.T_wh[0],
        "estimate_open": float(estimate.opened[0]),
        "part_open": float(truth.opened[0]),
        "part_speed": float(truth.speed[0]),
    }


def start_of(manifest: Manifest, params: EpisodeParams) -> Array:
    """Return the start angles of the arm (7,) [rad] under the episode parameters (one row)."""
    low, high = manifest.robot.bounds(manifest.control.margin_rad)
    return np.asarray(np.clip(np.asarray(manifest.start.q) + params["start"][0], low, high))


class _Observer:
    """Observations of a policy, of one robot.

    Args:
        manifest: Task and control stack.
        controller: Controller of the policy's actions.
        speed_scale: Speed of the policy's clock.
    """

    def __init__(
        self, manifest: Manifest, controller: PolicyController, speed_scale: float
    ) -> None:
        self.last_action: Array = np.zeros(manifest.action.size)
        """Action of the last control step."""
        self._robot = manifest.robot
        self._controller = controller
        self._speed_scale = speed_scale
        self._last_width: float | None = None
        constants = observation_params(
            manifest.control, manifest.task, manifest.object, manifest.placement
        )
        self._constants = constants._replace(step_s=constants.step_s * speed_scale)

    def observe(
        self, measured: dict[str, float], estimate: Estimate, time_left: float
    ) -> tuple[ObservationInputs, Array]:
        """Return the inputs of the observation and the observation (1, size) of a control step.

        Args:
            measured: Measurements of the robot.
            estimate: State of the object, in the policy's time.
            time_left: Share of the episode that is left.
        """
        inputs = self._inputs(measured)
        self._last_width = measured[GRIPPER_KEY]
        force = read_keys(measured, FORCE_KEYS)[None]
        return inputs, observation(inputs, estimate, force, time_left, self._constants)

    def _inputs(self, measured: dict[str, float]) -> ObservationInputs:
        """Return the inputs of the observation, one row, with speeds in the policy's time."""
        controller, scale = self._controller, self._speed_scale
        q, target = read_keys(measured)[None], controller.target[None]
        width = measured[GRIPPER_KEY]
        T_wt, T_wt_target = tool_pose(self._robot, np.concatenate([q, target]))
        return ObservationInputs(
            q=q,
            dq=read_keys(measured, SPEED_KEYS)[None] / scale,
            target=target,
            T_wt=T_wt[None],
            T_wt_target=T_wt_target[None],
            gripper=controller.gripper._replace(since_s=controller.gripper.since_s * scale),
            gripper_width=np.array([width]),
            last_gripper_width=np.array([width if self._last_width is None else self._last_width]),
            pending_actions=controller.pending_actions[None],
            last_action=self.last_action[None],
        )


def _policy_time(estimate: Estimate, speed_scale: float) -> Estimate:
    """Return an estimate with the speed in the policy's time."""
    if speed_scale == 1.0:
        return estimate
    return replace(estimate, speed=estimate.speed / speed_scale)


def _monitor(
    monitor: EpisodeMonitor, torque: Array, robot: Robot, now: Estimate, manifest: Manifest
) -> None:
    """Update the monitor and the last torque (7,) with the samples of a control step."""
    for sample in robot.take_samples():
        params = monitor_params(manifest.robot, manifest.task.limits, sample.dt)
        monitor_sample(
            monitor.samples[0],
            sample.dq,
            sample.torque,
            torque,
            sample.wrench,
            sample.touch,
            params,
        )
    goal, step_s = goal_params(manifest.task), manifest.control.step_s
    monitor_step(monitor, 0, now.opened[0], now.speed[0], goal, step_s)
