import copy
import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import DRAWS, rows_of

from articulate.robot.kinematics import relative
from articulate.task.episode_monitor import REASONS, FailureReason
from articulate.task.observation import OBSERVATION
from articulate.task.randomization import nominal_params
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import home_start, precompute_states
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_envs.rewards import TERMS, RewardConfig
from articulate_envs.threaded_engine import ThreadEngine

N = 4
STARTS = InitialStatesConfig(n_precomputed=24)


def episodes(scene, *, n=N, seed=0, initial_states=STARTS, randomization=DRAWS, threads=1):
    engine = ThreadEngine(scene, n, threads=threads)
    return Episodes(
        engine,
        randomization=randomization,
        reward=RewardConfig(),
        initial_states=initial_states,
        seed=seed,
    )


def actions(ticks, n=N, seed=1):
    return np.random.default_rng(seed).uniform(-1, 1, (ticks, n, 8))


def field(observation, name):
    return observation[:, OBSERVATION.slice(name)]


def test_every_episode_has_the_tasks_length_and_the_next_begins_by_itself(drawer):
    runs = episodes(drawer)
    runs.reset()
    for k, action in enumerate(actions(2 * drawer.n_steps)):
        tick = runs.step(action)
        last = (k + 1) % drawer.n_steps == 0
        assert tick.done.tolist() == [last] * N
        assert (tick.ended is not None) == last
        left = 1 - ((k + 1) % drawer.n_steps) / drawer.n_steps
        assert_allclose(field(tick.observation, "time_left"), left, atol=1e-6)


def test_observation_of_a_tick_that_ends_an_episode_is_of_the_new_one(drawer):
    runs = episodes(drawer, initial_states=None, randomization=NO_RANDOMIZATION)
    first = runs.reset()
    for action in actions(drawer.n_steps):
        tick = runs.step(action)
    assert_allclose(tick.observation, first, atol=1e-9)
    assert tick.ended is not None
    assert_allclose(field(tick.ended.observation, "time_left"), 0.0, atol=1e-9)
    assert np.abs(tick.ended.observation - first).max() > 0.1


def test_staggered_episodes_end_one_after_another_and_the_short_ones_are_not_from_home(drawer):
    runs = episodes(drawer, initial_states=None)
    runs.reset(stagger=True)
    done, home = [], []
    for action in actions(2 * drawer.n_steps):
        tick = runs.step(action)
        done.append(tick.done)
        if tick.ended is not None:
            home.append((len(done), tick.ended.from_home.tolist()))
    assert np.sum(done, axis=1).max() == 1
    assert np.sum(done, axis=0).tolist() == [2] * N
    first = dict(home[:N])
    assert [v for k, v in sorted(first.items())] == [[False]] * (N - 1) + [[True]]
    assert all(v == [True] for _, v in home[N:])


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_observations_are_finite_and_within_their_layout(name, request):
    scene = request.getfixturevalue(name)
    runs = episodes(scene)
    first = runs.reset(stagger=True)
    seen = np.concatenate([first, *(runs.step(action).observation for action in actions(30))])
    assert seen.shape[1] == OBSERVATION.size
    assert np.isfinite(seen).all()
    assert np.all((seen >= OBSERVATION.low) & (seen <= OBSERVATION.high))


def test_speed_of_the_hand_is_the_change_of_its_width_and_nothing_at_a_start(drawer):
    runs = episodes(drawer)
    before = runs.reset()
    assert_allclose(field(before, "gripper_speed"), 0.0)
    close = np.zeros((N, 8))
    close[:, 7] = 1.0
    moved = 0.0
    for _ in range(drawer.n_steps):
        tick = runs.step(close)
        change = field(tick.observation, "gripper_width") - field(before, "gripper_width")
        speed = field(tick.observation, "gripper_speed")
        going = ~tick.done
        assert_allclose(speed[going], 10 * change[going], atol=1e-9)
        assert_allclose(speed[tick.done], 0.0)
        moved = min(moved, float(speed.min()))
        before = tick.observation
    assert moved < -0.5


def test_actions_beyond_one_count_as_one(drawer):
    a, b = episodes(drawer), episodes(drawer)
    a.reset(), b.reset()
    x, y = a.step(np.full((N, 8), 7.0)), b.step(np.ones((N, 8)))
    assert_array_equal(x.observation, y.observation)
    assert_array_equal(x.reward, y.reward)
    assert_allclose(field(x.observation, "last_action"), 1.0)


def test_sums_of_terms_are_the_sum_of_rewards(drawer):
    runs = episodes(drawer)
    runs.reset()
    total = np.zeros(N)
    for action in actions(drawer.n_steps):
        tick = runs.step(action)
        total += tick.reward
    assert tick.ended is not None
    assert tick.ended.terms.shape == (N, len(TERMS))
    assert_allclose(tick.ended.terms.sum(axis=1), total)


def held_open(scene, n):
    """Starts with the arm turned away from a part that is just beyond its target."""
    start = home_start(scene, nominal_params(n))
    start.opened[:] = scene.task.target + 0.01
    start.q[:, 0] += 1.5
    start.home[:] = False
    return start


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_part_that_rests_beyond_the_target_is_a_success_and_one_that_is_shut_is_not(name, request):
    scene = request.getfixturevalue(name)
    runs = episodes(scene, initial_states=None, randomization=NO_RANDOMIZATION)
    start = held_open(scene, N)
    start.opened[0], start.q[0], start.home[0] = 0.0, scene.placement.start_q, True
    runs.reset(start=start)
    for _ in range(scene.n_steps):
        tick = runs.step(np.zeros((N, 8)))
    assert tick.ended is not None
    assert [REASONS[c] for c in tick.ended.code] == ["goal_not_reached"] + ["success"] * (N - 1)
    assert tick.ended.opened.tolist() == [False] + [True] * (N - 1)
    assert tick.ended.from_home.tolist() == [True] + [False] * (N - 1)
    fresh = runs.monitor  # nothing of it is left to the episodes that now run
    assert not fresh.rest_s.any()
    assert not fresh.samples.any()
    assert not fresh.at_goal.any()


def test_same_seed_gives_the_same_bits_whatever_the_threads(drawer):
    a, b = episodes(drawer), episodes(drawer, threads=3)
    assert_array_equal(a.reset(stagger=True), b.reset(stagger=True))
    for action in actions(30):
        x, y = a.step(action), b.step(action)
        assert_array_equal(x.observation, y.observation)
        assert_array_equal(x.reward, y.reward)


def test_other_seed_draws_otherwise(drawer):
    a, b = episodes(drawer), episodes(drawer, seed=1)
    assert np.abs(a.reset() - b.reset()).max() > 1e-3


def test_run_continues_from_a_snapshot_in_mid_episode_with_the_same_bits(drawer):
    plan = actions(40)
    runs = episodes(drawer)
    runs.reset(stagger=True)
    runs.progress = 0.4
    for action in plan[:7]:
        runs.step(action)
    held = runs.snapshot()
    kept = copy.deepcopy(held)
    going_on = [runs.step(action) for action in plan[7:]]
    other = episodes(drawer, threads=2)
    other.restore(held)
    assert other.progress == 0.4
    assert_array_equal(other.monitor.samples, kept["monitor_samples"])
    for action, ours in zip(plan[7:], going_on, strict=True):
        theirs = other.step(action)
        assert_array_equal(theirs.observation, ours.observation)
        assert_array_equal(theirs.reward, ours.reward)
        assert_array_equal(theirs.done, ours.done)
        if ours.ended is not None:
            assert theirs.ended is not None
            for name, value in vars(ours.ended).items():
                assert_array_equal(getattr(theirs.ended, name), value, err_msg=name)
    for name, value in kept.items():
        if isinstance(value, np.ndarray):
            assert_array_equal(held[name], value, err_msg=name)


def test_what_was_drawn_is_what_the_engine_runs(drawer):
    runs = episodes(drawer)
    runs.reset()
    assert_array_equal(runs.params.values, runs.engine.snapshot()["episode_params"])


def test_starts_along_the_task_are_not_counted_as_from_home(drawer):
    always = InitialStatesConfig(n_precomputed=24, share_first=1.0, share_last=1.0)
    runs = episodes(drawer, initial_states=always)
    runs.reset()
    for action in actions(drawer.n_steps):
        tick = runs.step(action)
    assert tick.ended is not None
    assert not tick.ended.from_home.any()


def open_and_idle(scene, **initial_states):
    """Episodes that begin with the part open at rest, and what their ticks give."""
    runs = episodes(
        scene,
        initial_states=dataclasses.replace(STARTS, **initial_states),
        randomization=NO_RANDOMIZATION,
    )
    start = home_start(scene, nominal_params(N))
    runs.reset(start=dataclasses.replace(start, opened=np.ones(N)))
    return [runs.step(np.zeros((N, 8))) for _ in range(scene.n_steps)]


def test_training_cuts_episodes_once_the_part_has_rested_as_long_as_success_asks(drawer):
    ticks = open_and_idle(drawer, truncation_probability=1.0, truncation_env_share=0.5)
    when = [k for k, tick in enumerate(ticks) if tick.done.any()]
    held = round(drawer.task.hold_s / drawer.control.step_s)
    assert when[0] + 1 == held
    ended = ticks[when[0]].ended
    assert ended is not None
    assert ended.rows.tolist() == [0, 1]
    assert ended.truncated.all()
    assert ended.opened.all()
    rest = ended.privileged[:, PRIVILEGED.slice("rest")]
    assert_allclose(rest, drawer.task.hold_s, atol=1e-9)
    assert field(ended.observation, "time_left").min() > 0.0


def test_only_episodes_that_are_never_cut_count_as_from_home(drawer):
    ended = [
        t.ended
        for t in open_and_idle(drawer, truncation_probability=1.0, truncation_env_share=0.5)
        if t.ended is not None
    ]
    counted = np.concatenate([e.rows[e.from_home] for e in ended])
    assert sorted(counted.tolist()) == [2, 3]
    assert not any(e.truncated[e.from_home].any() for e in ended)


def test_success_is_paid_once_at_the_end_of_a_whole_episode(drawer, monkeypatch):
    judged = np.array(
        [
            FailureReason.SUCCESS,
            FailureReason.FORCE,
            FailureReason.SUCCESS,
            FailureReason.NOT_AT_REST,
        ]
    )
    monkeypatch.setattr(f"{Episodes.__module__}.failure_reason", lambda *_: judged)
    ticks = open_and_idle(drawer, truncation_probability=0.0)
    *before, last = ticks
    ended = last.ended
    assert ended is not None
    bonus = RewardConfig().success.weight * np.array([1.0, 0.0, 1.0, 0.0])
    assert_allclose(ended.terms[:, TERMS.index("success")], bonus)
    assert_allclose(last.reward - last.reward[1], bonus, atol=1e-9)  # else the four are alike
    assert max(tick.reward.max() for tick in before) < RewardConfig().success.weight / 2


def test_training_that_never_cuts_and_evaluation_run_to_the_end(drawer):
    for never in (
        {"truncation_probability": 0.0},
        {"truncation_probability": 1.0, "truncation_env_share": 0.0},
    ):
        ticks = open_and_idle(drawer, **never)
        assert [k for k, tick in enumerate(ticks) if tick.done.any()] == [drawer.n_steps - 1]
        assert not ticks[-1].ended.truncated.any()
        assert ticks[-1].ended.from_home.all()
    runs = episodes(drawer, initial_states=None, randomization=NO_RANDOMIZATION)
    start = home_start(drawer, nominal_params(N))
    runs.reset(start=dataclasses.replace(start, opened=np.ones(N)))
    done = [runs.step(np.zeros((N, 8))).done.any() for _ in range(drawer.n_steps)]
    assert done == [False] * (drawer.n_steps - 1) + [True]


def test_episode_that_diverges_ends_with_that_reason_and_a_new_one_begins(
    drawer, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log where it runs
    runs = episodes(drawer)
    runs.reset()
    plan = actions(6)
    runs.step(plan[0])
    runs.engine.physics_state(1)[1].qvel[:] = 1e12
    tick = runs.step(plan[1])
    assert tick.ended is not None
    assert tick.ended.rows.tolist() == [1]
    assert tick.ended.code.tolist() == [FailureReason.DIVERGED]
    assert tick.done.tolist() == [False, True, False, False]
    for action in plan[2:]:
        after = runs.step(action)
        assert not after.done.any()
        assert np.isfinite(after.observation).all()
        assert np.isfinite(after.reward).all()
    assert np.isfinite(tick.observation).all()
    assert np.isfinite(tick.reward).all()


def test_a_bank_row_can_be_replayed_by_itself(drawer):
    bank = precompute_states(drawer, STARTS, DRAWS, np.random.default_rng(0))
    runs = episodes(drawer)
    runs.reset(start=rows_of(bank, np.arange(N)))
    assert_array_equal(runs.params.values, bank.params.values[:N])


def test_without_renewal_an_episode_stays_as_it_ended(drawer):
    runs = Episodes(
        ThreadEngine(drawer, 2),
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=None,
        seed=0,
        renew=False,
    )
    runs.reset()
    ticks = [runs.step(np.zeros((2, 8))) for _ in range(drawer.n_steps)]
    assert [tick.ended is not None for tick in ticks] == [False] * (drawer.n_steps - 1) + [True]
    last = ticks[-1].ended
    assert last is not None
    assert ticks[-1].done.all()
    assert_array_equal(ticks[-1].observation, last.observation)
    assert_array_equal(runs.monitor.samples, last.peaks)
    again = runs.reset()
    assert_array_equal(again[:, OBSERVATION.slice("time_left")], np.ones((2, 1)))


def test_another_observation_differs_in_what_is_noisy_only(drawer):
    noisy = dataclasses.replace(NO_RANDOMIZATION, estimate_noise_m=0.01, estimate_bias_m=0.01)
    runs = episodes(drawer, initial_states=None, randomization=noisy)
    seen = runs.reset()
    again = np.array([runs.observe_again() for _ in range(500)])
    same = np.ptp(again, axis=0).max(axis=0) == 0.0
    names = {f.name for f in OBSERVATION.fields if not same[OBSERVATION.slice(f.name)].all()}
    assert names >= {"handle_pos", "handle_pos_predicted", "expert_action"}
    assert names.isdisjoint({"joint_pos", "gripper_width", "last_action", "time_left"})
    assert_array_equal(seen[:, same], again[0][:, same])
    handle = relative(runs.state.T_wt, runs.state.T_wh)
    bias = np.stack([runs.params[f"bias_{axis}_m"] for axis in "xyz"], axis=1)
    expected = handle[:, :3, 3] + np.einsum("nji,nj->ni", runs.state.T_wt[:, :3, :3], bias)
    assert_allclose(
        0.2 * again[:, :, OBSERVATION.slice("handle_pos")].mean(axis=0), expected, atol=0.002
    )


def test_a_snapshot_without_noise_continues(drawer):
    runs, other = episodes(drawer), episodes(drawer)
    runs.reset()
    snapshot = runs.snapshot()
    assert np.any(snapshot.pop("episode_noise"))
    other.reset()
    other.restore(snapshot)
    action = np.zeros((N, 8))
    assert_array_equal(other.step(action).observation, runs.step(action).observation)


def test_a_new_seed_decides_what_comes(drawer):
    runs = Episodes(
        ThreadEngine(drawer, 2),
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=None,
        seed=0,
    )
    seen = []
    for seed in (5, np.random.default_rng(5), np.random.SeedSequence(5), 6):
        runs.reseed(seed)
        seen.append(runs.reset())
    assert_array_equal(seen[0], seen[1])
    assert_array_equal(seen[0], seen[2])
    assert np.any(seen[0] != seen[3])


def test_a_step_before_the_first_reset_is_answered_in_one_line(drawer, error_line):
    runs = Episodes(
        ThreadEngine(drawer, 1),
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=None,
        seed=0,
    )
    assert not runs.begun
    error_line("Episodes.step() before reset()", lambda: runs.step(np.zeros((1, 8))))
