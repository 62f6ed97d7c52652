import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.runs import write_checkpoint

from articulate.errors import RunError
from articulate.task.episode_monitor import REASONS, WIDTH
from articulate.task.observation import OBSERVATION
from articulate.task.randomization import COLUMNS, sample_episode_params
from articulate_envs.episodes import Ended
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_envs.rewards import TERMS
from articulate_train.evaluate import evaluate_seed, first_ends, run_with_params, timelines
from articulate_train.policy import load_policy


@pytest.fixture
def trained(tiny):
    write_checkpoint(tiny.seed_folder(0), 0)
    return tiny


def test_same_evaluation_twice_and_on_more_threads_has_the_same_bits(trained):
    a, b = (evaluate_seed(trained, 0, episodes=4, threads=t) for t in (1, 3))
    for field in dataclasses.fields(a[0]):
        assert_array_equal(getattr(a[0], field.name), getattr(b[0], field.name), err_msg=field.name)
    assert_array_equal(a[1].traces.qpos, b[1].traces.qpos)


def test_every_episode_counts_once_from_home_with_sampled_parameters(trained):
    result, rollout = evaluate_seed(trained, 0, episodes=5, threads=1)
    assert result.codes.shape == result.opened.shape == result.nominal_codes.shape == (5,)
    assert result.params.shape == (5, len(COLUMNS))
    assert rollout.ended.rows.tolist() == [0, 1, 2, 3, 4]
    assert rollout.ended.from_home.all()
    assert np.ptp(result.params[:, COLUMNS.index("scale")]) > 0
    steps = trained.scene().n_steps
    for array in (rollout.traces.force, rollout.traces.opened, rollout.traces.speed_share):
        assert array.shape == (steps, 5)
    assert {REASONS[c] for c in result.codes} <= set(REASONS)


def test_more_episodes_than_run_at_once_have_the_same_parameters_and_each_is_reported(trained):
    scene, policy = trained.scene(), load_policy(trained.seed_folder(0))
    ranges = trained.config.randomization
    params = sample_episode_params(ranges, np.random.default_rng(1), 5, begin=scene.task.begin)
    seen: dict[int, int] = {}

    def run(batch_size):
        qpos = np.zeros((scene.n_steps - 1, 5, scene.nominal.nq))

        def watch(t, which, engine):
            seen[batch_size] = max(seen.get(batch_size, 0), engine.n_envs)
            for i in range(engine.n_envs):
                qpos[t, which.start + i] = engine.physics_state(i)[1].qpos

        ended = run_with_params(
            scene,
            policy,
            ranges,
            params,
            np.random.SeedSequence(2),
            threads=1,
            on_step=watch,
            batch_size=batch_size,
        )
        return ended, qpos

    (few, few_qpos), (all_at_once, qpos) = run(2), run(5)
    assert seen == {2: 2, 5: 5}
    assert few.rows.tolist() == all_at_once.rows.tolist() == [0, 1, 2, 3, 4]
    assert few.observation.shape == all_at_once.observation.shape
    assert_allclose(few_qpos[0], qpos[0], atol=0.01)  # each begins as its parameters define
    assert np.abs(qpos[0, 0] - qpos[0, 4]).max() > 0.02
    assert np.abs(few_qpos).sum(axis=(0, 2)).min() > 0


def test_parameters_of_seeds_differ(trained):
    write_checkpoint(trained.seed_folder(1), 1)
    a, b = (evaluate_seed(trained, seed, episodes=4, threads=1)[0] for seed in (0, 1))
    assert np.abs(a.params - b.params).max() > 1e-3


def test_seed_without_a_checkpoint_is_an_error(tiny, error_line):
    error_line("evaluate_seed(untrained)", lambda: evaluate_seed(tiny, 0, episodes=2, threads=1))


def test_damaged_checkpoint_is_an_error(trained):
    path = trained.seed_folder(0) / "checkpoint.pt"
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(RunError, match="cannot be read"):
        evaluate_seed(trained, 0, episodes=2, threads=1)


def ends(rows, codes):
    n = len(rows)
    return Ended(
        rows=np.array(rows),
        code=np.array(codes),
        opened=np.zeros(n, dtype=bool),
        from_home=np.ones(n, dtype=bool),
        terms=np.zeros((n, len(TERMS))),
        peaks=np.zeros((n, WIDTH)),
        observation=np.zeros((n, OBSERVATION.size)),
        truncated=np.zeros(n, dtype=bool),
        privileged=np.zeros((n, PRIVILEGED.size)),
    )


def test_of_an_episode_that_ended_early_the_first_end_counts():
    first = first_ends([ends([2], [7]), ends([0, 1, 2], [0, 1, 0])], 3)
    assert first.rows.tolist() == [0, 1, 2]
    assert first.code.tolist() == [0, 1, 7]


def test_timelines_are_of_the_first_success_and_the_first_failure(trained):
    _, rollout = evaluate_seed(trained, 0, episodes=4, threads=1)
    code = np.array([3, 0, 3, 0])
    known = dataclasses.replace(rollout, ended=dataclasses.replace(rollout.ended, code=code))
    lines = timelines(known, 0.05)
    assert [(line.name, line.reason, k) for line, k in lines] == [
        ("success", "success", 1),
        ("failure", REASONS[3], 0),
    ]
    assert lines[0][0].t[0] == pytest.approx(0.05)
    none = dataclasses.replace(rollout, ended=dataclasses.replace(rollout.ended, code=0 * code))
    assert [line.name for line, _ in timelines(none, 0.05)] == ["success"]


def test_objects_are_not_sampled_in_sizes_that_the_scene_does_not_have(trained):
    wide = trained.config.randomization.widened(1.5)
    sampled = sample_episode_params(wide, np.random.default_rng(0), 8, begin=trained.task.begin)
    policy = load_policy(trained.seed_folder(0))
    with pytest.raises(ValueError, match="object sizes outside"):
        run_with_params(
            trained.scene(), policy, wide, sampled, np.random.SeedSequence(0), threads=1
        )
