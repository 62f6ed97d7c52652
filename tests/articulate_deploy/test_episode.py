import dataclasses
from typing import cast

import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.robot.control import joint_steps
from articulate.task.episode_monitor import REASONS
from articulate.task.observation import Estimate
from articulate.task.randomization import COLUMNS, EpisodeParams, sample_episode_params
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_deploy.episode import Recording, run_episode, start_of
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.policy_control import PolicyController
from articulate_deploy.policy_runner import Policy
from articulate_deploy.robots.mujoco import MujocoRobot
from articulate_deploy.robots.robot import (
    FORCE_KEYS,
    GRIPPER_KEY,
    JOINT_KEYS,
    SPEED_KEYS,
    Robot,
    read_keys,
)
from articulate_envs.engine import Start
from articulate_envs.episodes import Episodes
from articulate_envs.rewards import RewardConfig
from articulate_envs.threaded_engine import ThreadEngine

QUIET = dataclasses.replace(NO_RANDOMIZATION, gripper_latency_s=(0.2, 0.2), start_rad=0.1)


def late_draw(seed):
    """Everything drawn but noise: the delays, the biases and the push stay."""
    config = dataclasses.replace(
        QUIET, delay_steps=(1, 2), estimate_delay_steps=(1, 2), estimate_bias_m=0.003,
        estimate_yaw_rad=0.02, position_m=0.02, yaw_rad=0.1, push_n=(2.0, 5.0),
        force_bias_n=1.5,
    )  # fmt: skip
    return sample_episode_params(config, np.random.default_rng(seed))


def played(bundle, drawn, policy):
    """The result and recording of one episode on the stand-in."""
    manifest, recording = bundle.manifest, Recording()
    with MujocoRobot(bundle) as robot:
        robot.set_episode_params(drawn)
        robot.reset_to(start_of(manifest, drawn), manifest.start.gripper_width_m)
        estimator = TruthEstimator(robot, QUIET, manifest.task, drawn, np.random.default_rng(0))
        delay = int(drawn["delay_steps"][0])
        result = run_episode(
            policy, robot, estimator, manifest, delay_steps=delay, recording=recording
        )
    return result, recording.arrays()


@pytest.mark.parametrize("seed", [0, 1])
def test_an_episode_is_the_one_of_training(bundle, run, seed):
    """Same draw, same policy: every observation, every action and the failure_reason agree."""
    drawn, policy = late_draw(seed), Policy(bundle)
    result, record = played(bundle, drawn, policy)
    engine = ThreadEngine(run.scene((1.0,)), 1)
    episodes = Episodes(
        engine, randomization=QUIET, reward=RewardConfig(), initial_states=None, seed=0
    )
    start = Start(
        params=EpisodeParams(drawn.values.copy()),
        q=start_of(bundle.manifest, drawn)[None],
        opened=np.zeros(1),
        width=np.full(1, bundle.manifest.start.gripper_width_m),
        closing=-np.ones(1),
        home=np.ones(1, dtype=bool),
    )
    seen = episodes.reset(start=start)
    for tick in range(engine.scene.n_steps):
        assert_allclose(record["observation"][tick], seen[0], rtol=0, atol=1e-6, err_msg=str(tick))
        step = episodes.step(record["action"][tick][None])
        seen = step.observation
    assert step.ended is not None
    assert REASONS[step.ended.code[0]] == result.reason
    assert_allclose(result.peaks["force"], step.ended.peaks[0, 9], rtol=1e-3, atol=1e-3)
    assert result.steps == engine.scene.n_steps
    engine.close()


def test_nothing_is_clipped_because_the_plant_keeps_its_own_limits(bundle):
    result, record = played(bundle, late_draw(2), Policy(bundle))
    assert result.clipped == 0
    assert len(record["time_s"]) == result.steps


def test_an_arm_that_stands_still_leaves_the_drawer_closed(bundle):
    class Still:
        def act(self, observation):
            return np.zeros((1, 8))

    values = late_draw(0).values.copy()
    values[:, COLUMNS.index("push_x_n") : COLUMNS.index("push_z_n") + 1] = 0.0
    result, record = played(bundle, EpisodeParams(values), Still())
    assert result.reason == "goal_not_reached"
    assert not result.success
    assert not result.opened
    assert abs(result.fraction) < 1e-2
    assert record["part_open"].max() < 1e-2
    assert result.peaks["force"] == 0.0


def test_an_arm_that_does_not_stand_at_its_start_is_refused(bundle, error_line):
    manifest, drawn = bundle.manifest, late_draw(0)
    with MujocoRobot(bundle) as robot:
        robot.reset_to(np.asarray(manifest.start.q) + 0.2, 0.08)
        estimator = TruthEstimator(robot, QUIET, manifest.task, drawn, np.random.default_rng(0))
        error_line(
            "run_episode: 0.2 rad from the start",
            lambda: run_episode(Policy(bundle), robot, estimator, manifest),
        )


def test_a_start_is_within_tolerance_and_limits(bundle):
    manifest = bundle.manifest
    for seed in range(20):
        q = start_of(
            manifest, sample_episode_params(manifest.randomization, np.random.default_rng(seed))
        )
        assert np.all(np.abs(q - np.asarray(manifest.start.q)) <= manifest.start.tolerance_rad)
        assert np.all(q >= np.asarray(manifest.robot.q_min))
        assert np.all(q <= np.asarray(manifest.robot.q_max))


class RecordingDriver:
    """Driver that records its actions and does nothing else."""

    name = "recording"

    def __init__(self, q):
        self.q, self.actions = np.asarray(q), []

    def get_observation(self):
        zero = dict.fromkeys((*SPEED_KEYS, *FORCE_KEYS), 0.0)
        return zero | dict(zip(JOINT_KEYS, self.q, strict=True)) | {GRIPPER_KEY: 0.08}

    def send_action(self, action):
        self.actions.append(action)
        return action

    def take_samples(self):
        return []

    def stop(self):
        pass


class StillObject:
    """Estimator of a closed object that never moves."""

    def reset(self):
        pass

    def update(self):
        pass

    def estimate(self):
        return Estimate(np.eye(4)[None], np.zeros(1), np.zeros(1))

    monitored_state = estimate


@pytest.mark.parametrize("value", [1e3, -1e3, np.nan, np.inf])
def test_unsafe_targets_never_reach_a_driver(bundle, monkeypatch, value):
    """A faulty controller requests targets far away, or none at all."""
    manifest = bundle.manifest
    driver = RecordingDriver(manifest.start.q)

    def faulty(self, action, **measured):
        return np.full(7, value), 0.08

    monkeypatch.setattr(PolicyController, "step", faulty)
    run_episode(Policy(bundle), cast(Robot, driver), StillObject(), manifest)
    sent = np.array([read_keys(action) for action in driver.actions])
    assert len(sent) == round(manifest.task.episode_s / manifest.control.step_s)
    assert np.isfinite(sent).all()
    low, high = manifest.robot.bounds(manifest.control.margin_rad)
    assert np.all((sent >= low - 1e-9) & (sent <= high + 1e-9))
    path = np.concatenate([np.asarray(manifest.start.q)[None], sent])
    steps = joint_steps(manifest.control, manifest.robot)
    assert np.all(np.abs(np.diff(path, axis=0)) <= steps + 1e-9)
