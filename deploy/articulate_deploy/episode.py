"""One episode of a policy on a robot, judged as in training."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from articulate.task.episode_monitor import (
    REASONS,
    EpisodeMonitor,
    failure_reason,
    goal_held,
    judge_sample,
    judge_tick,
    new_monitor,
)
from articulate.task.manifest import Manifest
from articulate.task.observation import Estimate, observation
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array
from articulate_deploy.estimators.estimator import Estimator
from articulate_deploy.policy_control import Plant
from articulate_deploy.policy_runner import Policy
from articulate_deploy.robots.robot import (
    FORCE_KEYS,
    GRIPPER_KEY,
    SPEED_KEYS,
    Robot,
    action_of,
    joints_of,
)
from articulate_deploy.safety import check_start, was_clipped

PEAKS = (
    "force",
    "force_short",
    "force_raw",
    "moment",
    "speed_share",
    "torque_share",
    "torque_rate",
)
"""Columns of the judgement that are reported."""


@dataclass(frozen=True)
class EpisodeResult:
    """How an episode ended."""

    reason: str
    """One of :data:`articulate.task.episode_monitor.REASONS`."""
    opened: bool
    """Whether the part was held at its target at the end, limits aside."""
    fraction: float
    """How far it was open at the end, 1 at its far limit."""
    ticks: int
    """Ticks that were run."""
    clipped: int
    """Ticks at which the robot made an action safe."""
    peaks: dict[str, float]
    """Largest values of :data:`PEAKS`."""

    @property
    def success(self) -> bool:
        """At the target, and deployable throughout."""
        return self.reason == REASONS[0]


@dataclass
class Recording:
    """What happened, one row per tick."""

    rows: dict[str, list[Array]] = field(default_factory=dict)

    def add(self, **values: Array | float) -> None:
        """One more tick."""
        for name, value in values.items():
            self.rows.setdefault(name, []).append(np.array(value, dtype=np.float64))

    def arrays(self) -> dict[str, Array]:
        """Arrays (T, ...) by name."""
        return {name: np.stack(values) for name, values in self.rows.items()}


def run_episode(
    policy: Policy,
    robot: Robot,
    estimator: Estimator,
    manifest: Manifest,
    *,
    delay_steps: int = 0,
    recording: Recording | None = None,
) -> EpisodeResult:
    """Run ``policy`` for the task's time on a robot that stands at its start.

    Args:
        policy: Observations to actions.
        robot: Connected, at rest.
        estimator: What is known of the object.
        manifest: Task, plant, limits.
        delay_steps: Age of the motions that are used.
        recording: Takes what happens at each tick.

    Raises:
        StartError: The robot does not stand at its start.
    """
    task, step_s = manifest.task, manifest.control.step_s
    ticks = round(task.episode_s / step_s)
    q = joints_of(robot.get_observation())
    check_start(q, manifest.start)
    plant = Plant(manifest, q, delay_steps=delay_steps)
    robot.take_samples()
    estimator.reset()
    judgement, torque = new_monitor(1), np.zeros(7)
    last, clipped, tick = np.zeros(manifest.action.size), 0, 0
    before: dict[str, float] | None = None
    for tick in range(ticks):
        seen, estimate = robot.get_observation(), estimator.estimate()
        before = seen if before is None else before
        observed = _observation(manifest, (before, seen), plant, estimate, last, 1.0 - tick / ticks)
        before = seen
        action = policy.act(observed)[0]
        wish, width = plant.tick(
            action, q=joints_of(seen), width_m=seen[GRIPPER_KEY], force=joints_of(seen, FORCE_KEYS)
        )
        sent = joints_of(robot.send_action(action_of(wish, width)))
        clipped += was_clipped(wish, sent)
        plant.sent(sent)
        last = action
        estimator.update()
        judgement, torque = _judged(judgement, torque, robot, estimator.judged(), manifest)
        if recording is not None:
            truth = estimator.judged()
            recording.add(
                time_s=tick * step_s,
                observation=observed[0],
                action=action,
                target=sent,
                joint_pos=joints_of(seen),
                joint_vel=joints_of(seen, SPEED_KEYS),
                gripper_width_m=seen[GRIPPER_KEY],
                measured_force_n=joints_of(seen, FORCE_KEYS),
                estimate_T_wh=estimate.T_wh[0],
                estimate_open=estimate.opened[0],
                part_open=truth.opened[0],
                part_speed=truth.speed[0],
                judgement=judgement.samples[0],
            )
        if judgement.diverged[0]:
            break
    robot.stop()
    return EpisodeResult(
        reason=REASONS[int(failure_reason(judgement, task)[0])],
        opened=bool(goal_held(judgement, task)[0]),
        fraction=float(estimator.judged().opened[0]),
        ticks=tick + 1,
        clipped=clipped,
        peaks={name: float(judgement.peak(name)[0]) for name in PEAKS},
    )


def start_of(manifest: Manifest, drawn: EpisodeParams) -> Array:
    """Angles of the arm (7,) at which an episode under ``drawn`` begins [rad]."""
    low, high = manifest.robot.bounds(manifest.control.margin_rad)
    return np.asarray(np.clip(np.asarray(manifest.start.q) + drawn["start"][0], low, high))


def _observation(
    manifest: Manifest,
    read: tuple[dict[str, float], dict[str, float]],
    plant: Plant,
    estimate: Estimate,
    last: Array,
    time_left: float,
) -> Array:
    before, seen = read
    step_s = manifest.control.step_s
    return observation(
        manifest.robot,
        q=joints_of(seen)[None],
        dq=joints_of(seen, SPEED_KEYS)[None],
        target=plant.target[None],
        gripper_width=np.array([seen[GRIPPER_KEY]]),
        gripper_speed=np.array([seen[GRIPPER_KEY] - before[GRIPPER_KEY]]) / step_s,
        measured_force=joints_of(seen, FORCE_KEYS)[None],
        gripper=plant.gripper,
        estimate=estimate,
        last_action=last[None],
        pending_actions=plant.pending_actions[None],
        move_m=manifest.control.move_m,
        time_left=np.array([time_left]),
        goal=manifest.task.target,
        closes=manifest.task.closes,
    )


def _judged(
    judgement: EpisodeMonitor, torque: Array, robot: Robot, now: Estimate, manifest: Manifest
) -> tuple[EpisodeMonitor, Array]:
    """The judgement after one more tick, and the last torque."""
    rows = judgement.samples
    for sample in robot.take_samples():
        rows = judge_sample(
            rows,
            dq=sample.dq[None],
            torque=sample.torque[None],
            torque_before=torque[None],
            wrench=sample.wrench[None],
            touch=np.array([sample.touch]),
            dt=sample.dt,
            arm=manifest.robot,
            limits=manifest.task.limits,
        )
        torque = sample.torque
    after = judge_tick(
        judgement,
        rows,
        manifest.task,
        opened=now.opened,
        speed=now.speed,
        step_s=manifest.control.step_s,
    )
    return after, torque
