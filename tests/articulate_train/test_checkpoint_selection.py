import dataclasses
import json
import math

import numpy as np
import pytest
from tests.runs import tiny_run

from articulate.errors import ConfigError, RunError
from articulate.task.observation import OBSERVATION
from articulate.task.randomization_config import RandomizationConfig
from articulate_train import checkpoint_selection
from articulate_train.checkpoint_selection import (
    CANDIDATES,
    CheckpointScore,
    is_due,
    select_active_members,
    select_checkpoint,
)
from articulate_train.config import CheckpointSelectionConfig
from articulate_train.policy import (
    ACTIVE_MEMBER,
    POLICY,
    ensemble_of,
    load_policy,
    policy_of,
    read_checkpoint,
    trained_steps,
    write_state,
)
from articulate_train.run import DONE
from articulate_train.train_seed import SeedProcess

THREE = CheckpointSelectionConfig(n_checkpoints=3, episodes=2, finalists=2, final_episodes=3)


@pytest.fixture
def scored(monkeypatch):
    """Episodes with the success rates of the test, by steps of the policy and by stage."""
    calls = []

    def use(rates):
        def episodes(scene, policy, params, stream, *, episodes, threads):
            steps = policy.steps
            calls.append((steps, episodes, tuple(stream.entropy)))
            code = np.ones(episodes, dtype=int)
            code[: round(rates[steps] * episodes)] = 0
            return type("Ended", (), {"code": code}), None

        monkeypatch.setattr(checkpoint_selection, "run_episodes", episodes)
        monkeypatch.setattr(
            checkpoint_selection,
            "policy_of",
            lambda state: type(
                "Policy", (), {"steps": json.loads(state["metadata"])["num_timesteps"]}
            ),
        )
        return calls

    return use


def trained(folder, asset, config):
    """Run and process of a seed of 192 steps, not trained yet."""
    run = tiny_run(folder / "run", asset, checkpoint_selection=config)
    process = SeedProcess(run, 0, threads=1)
    return run, process


def test_moments_begin_at_a_share_and_leave_out_the_end():
    assert CheckpointSelectionConfig(n_checkpoints=5, start_fraction=0.6).candidate_steps(1000) == (
        600,
        700,
        800,
        900,
    )
    assert CheckpointSelectionConfig(n_checkpoints=1).candidate_steps(1000) == ()


def test_a_moment_is_due_once_whatever_the_length_of_updates():
    config = CheckpointSelectionConfig(n_checkpoints=4, start_fraction=0.25)
    for update in (7, 32, 100):
        ends = range(update, 1000 + update, update)
        due = [e for e in ends if is_due(config, 1000, e - update, e)]
        assert len(due) == 3


@pytest.mark.parametrize(
    "wrong",
    [
        {"n_checkpoints": 0},
        {"episodes": 0},
        {"finalists": 0},
        {"final_episodes": 0},
        {"start_fraction": 1.0},
        {"member_episodes": -1},
        {"ood_scale": 0.9},
        {"ood_scale": math.inf},
        {"ood_scale": math.nan},
    ],
)
def test_settings_that_cannot_be_are_rejected(wrong):
    name = next(iter(wrong))
    with pytest.raises(ConfigError, match=f"checkpoint_selection.{name}"):
        CheckpointSelectionConfig(**wrong)


def test_the_best_of_the_states_is_the_policy_and_the_others_are_deleted(cabinet, tmp_path, scored):
    calls = scored({96: 1.0, 160: 0.5, 192: 1.0})
    run, process = trained(
        tmp_path, cabinet, CheckpointSelectionConfig(n_checkpoints=3, episodes=2, finalists=2)
    )
    assert process.train()
    process.close()
    folder = run.seed_folder(0)
    assert not (folder / CANDIDATES).exists()
    done = json.loads((folder / DONE).read_text())
    assert done["selected_step"] == 192  # of equals the later
    assert [j["episodes"] for j in done["selection_scores"]] == [
        302,
        2,
        302,
    ]  # 2 finalists, none as good
    assert {e for e in calls if e[0] == 160} == {(160, 2, (run.config.evaluation_seed, 0, 2, 0))}


def test_the_initial_policy_is_kept_if_training_makes_it_worse(cabinet, tmp_path, scored):
    scored({0: 1.0, 96: 0.5, 160: 0.5, 192: 0.5})
    run = tiny_run(
        tmp_path / "run", cabinet, checkpoint_selection=THREE, initial_policy="generalist"
    )
    process = SeedProcess(run, 0, threads=1)
    assert process.train()
    process.close()
    done = json.loads((run.seed_folder(0) / DONE).read_text())
    assert done["selected_step"] == 0


def test_states_that_tie_with_the_last_finalist_are_evaluated_once_more(
    cabinet, tmp_path, scored, monkeypatch
):
    rates = {96: 1.0, 160: 1.0, 192: 1.0}
    calls = scored(rates)
    policy_of = vars(checkpoint_selection)["policy_of"]

    def lost_later(state):  # after the first round the later states turn out worse
        if len(calls) == 3:
            rates.update({160: 0.5, 192: 0.0})
        return policy_of(state)

    monkeypatch.setattr(checkpoint_selection, "policy_of", lost_later)
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    done = json.loads((run.seed_folder(0) / DONE).read_text())
    assert done["selected_step"] == 96
    assert [j["episodes"] for j in done["selection_scores"]] == [7, 7, 4]
    assert [entropy[-1] for _, _, entropy in calls] == [0, 0, 0, 2, 2, 2, 1, 1]


def test_what_is_lost_at_the_end_of_training_is_not_the_policy(cabinet, tmp_path, scored):
    scored({96: 1.0, 160: 0.0, 192: 0.0})
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    folder = run.seed_folder(0)
    assert json.loads((folder / DONE).read_text())["selected_step"] == 96
    chosen = read_checkpoint(folder, POLICY)
    assert json.loads(chosen["metadata"])["num_timesteps"] == 96
    seen = np.zeros((1, OBSERVATION.size))
    weights = read_checkpoint(folder)["policy"]["action_net.weight"]
    assert not np.array_equal(chosen["policy"]["action_net.weight"], weights)
    assert load_policy(folder).act(seen).shape == (1, 8)


def test_states_are_really_evaluated_on_episodes(cabinet, tmp_path):
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    done = json.loads((run.seed_folder(0) / DONE).read_text())
    assert sorted(j["episodes"] for j in done["selection_scores"]) == [4, 7, 7]  # all fail alike


def test_choosing_that_is_interrupted_is_done_again_with_the_same_choice(cabinet, tmp_path):
    run, first = trained(tmp_path, cabinet, THREE)
    first.ensemble.run(first._after_round)
    checkpoint_selection.keep_candidate(first.folder, first.ensemble.policy_state())
    assert select_checkpoint(run, 0, threads=1, should_continue=lambda: False) is None
    once, again = (select_checkpoint(run, 0, threads=1) for _ in range(2))
    first.close()
    assert once is not None
    assert again is not None
    assert once[1] == again[1]
    assert once[0]["metadata"] == again[0]["metadata"]


def test_a_training_that_goes_on_keeps_the_policy_of_the_shorter_one_until_it_is_done(
    cabinet, tmp_path
):
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    chosen = run.seed_folder(0) / POLICY
    before, steps = chosen.read_bytes(), trained_steps(read_checkpoint(chosen.parent, POLICY))
    longer = dataclasses.replace(run, config=dataclasses.replace(run.config, steps=6 * 64))
    process = SeedProcess(longer, 0, threads=1)
    assert chosen.read_bytes() == before
    assert f"{steps}.pt" in {path.name for path in (chosen.parent / CANDIDATES).iterdir()}
    assert process.train()
    process.close()
    scores = json.loads((chosen.parent / DONE).read_text())["selection_scores"]
    assert steps in [row["steps"] for row in scores]


def test_rate_of_what_was_not_evaluated_is_zero():
    assert CheckpointScore(5).rate == 0.0
    assert CheckpointScore(5, 4, 3).rate == 0.75


def members_of(run, state, should_continue=lambda: True):
    """Run :func:`select_active_members`, which is not stopped."""
    found = select_active_members(run, 0, state, threads=1, should_continue=should_continue)
    assert found is not None
    return found


FIELDS = ("member", "episodes", "successes", "ood_episodes", "ood_successes")


def two_members(folder, asset, **settings):
    """A run whose seed has two members, its process, and their state."""
    select = CheckpointSelectionConfig(**({"n_checkpoints": 1, "member_episodes": 10} | settings))
    run = tiny_run(folder / "run", asset, checkpoint_selection=select, ensemble_size=2)
    process = SeedProcess(run, 0, threads=1)
    return run, process, process.ensemble.policy_state()


@pytest.fixture
def member_scores(monkeypatch):
    """Successes of ten, of the ensemble and of members 0 and 1; and with wider ranges."""
    calls = []

    def use(state, successes, wider):
        weights = [m["policy"]["action_net.weight"] for m in ensemble_of(state)]

        def episodes(scene, policy, params, stream, *, episodes, threads):
            heads = [np.asarray(network.head.weight.detach()) for network in policy.networks]
            who = 0
            if len(heads) == 1:
                who = 1 + [np.array_equal(heads[0], w) for w in weights].index(True)
            wide = params.position_m > RandomizationConfig().position_m
            calls.append((who, wide, episodes, tuple(stream.entropy)))
            code = np.ones(episodes, dtype=int)
            code[: (wider if wide else successes)[who]] = 0
            return type("Ended", (), {"code": code}), None

        monkeypatch.setattr(checkpoint_selection, "run_episodes", episodes)
        return calls

    return use


@pytest.mark.parametrize(
    ("successes", "wider", "acts"),
    [
        ((8, 9, 7), (6, 7, 10), 0),
        ((8, 9, 10), (6, 0, 7), 1),
        ((8, 9, 7), (6, 5, 0), 0),  # of twenty each, two are gained here and one is lost there
        ((8, 9, 7), (6, 4, 0), None),  # as many are lost as are gained
        ((8, 9, 7), (6, 3, 9), None),  # the one that is better there was worse here
        ((8, 8, 8), (0, 9, 9), None),
    ],
)
def test_a_member_acts_only_where_it_gains_more_than_it_loses_with_wider_ranges(
    cabinet, tmp_path, member_scores, successes, wider, acts
):
    run, process, state = two_members(tmp_path, cabinet)
    calls = member_scores(state, successes, wider)
    chosen, scores = members_of(run, state)
    process.close()
    assert chosen.get(ACTIVE_MEMBER) == acts
    best = 1 + int(np.argmax(successes[1:]))
    further = {0, best} if successes[best] > successes[0] else set()
    assert [(j.episodes, j.successes) for j in scores] == [
        (20, 2 * n) if k in further else (10, n) for k, n in enumerate(successes)
    ]
    assert [(j.ood_episodes, j.ood_successes) for j in scores] == [
        (20, wider[k]) if k in further else (0, 0) for k in range(3)
    ]
    params = {(wide, entropy[-1], episodes) for _, wide, episodes, entropy in calls}
    assert params == {(False, 3, 10)} | ({(False, 4, 10), (True, 5, 20)} if further else set())
    assert len(policy_of(chosen).networks) == (2 if acts is None else 1)
    assert trained_steps(chosen) == trained_steps(state)  # of all that the seed spent


def test_one_that_is_ahead_at_first_and_not_on_more_episodes_does_not_act(
    cabinet, tmp_path, member_scores
):
    run, process, state = two_members(tmp_path, cabinet)
    successes = [8, 9, 7]
    calls = member_scores(state, successes, (0, 9, 9))

    def should_continue():
        if len(calls) == 3:
            successes[:] = [9, 8, 0]
        return True

    chosen, scores = members_of(run, state, should_continue)
    process.close()
    assert ACTIVE_MEMBER not in chosen
    assert [j.successes for j in scores] == [17, 17, 7]
    assert [j.ood_episodes for j in scores] == [0, 0, 0]


def test_who_acts_is_chosen_again_for_a_state_of_a_shorter_training(
    cabinet, tmp_path, member_scores
):
    run, process, state = two_members(tmp_path, cabinet)
    member_scores(state, (9, 8, 8), (0, 0, 0))
    chosen, _ = members_of(run, state | {ACTIVE_MEMBER: 1})
    process.close()
    assert ACTIVE_MEMBER not in chosen


def test_wider_ranges_are_evaluated_on_objects_of_the_sizes_that_are_sampled(
    cabinet, tmp_path, monkeypatch
):
    run, process, state = two_members(tmp_path, cabinet)
    seen = []

    def episodes(scene, policy, params, stream, *, episodes, threads):
        seen.append(scene.scales)
        assert scene.scales == params.scale_values
        single = len(policy.networks) == 1
        return type("Ended", (), {"code": np.full(episodes, 0 if single else 1)}), None

    monkeypatch.setattr(checkpoint_selection, "run_episodes", episodes)
    select_active_members(run, 0, state, threads=1)
    process.close()
    assert len(set(seen)) == 2


def test_ranges_that_cannot_be_wider_are_evaluated_as_they_are(cabinet, tmp_path, member_scores):
    run, process, state = two_members(tmp_path, cabinet, ood_scale=50.0)
    calls = member_scores(state, (8, 9, 7), (0, 0, 0))
    chosen, _ = members_of(run, state)
    process.close()
    assert chosen[ACTIVE_MEMBER] == 0
    assert [(wide, entropy[-1]) for _, wide, _, entropy in calls[5:]] == [(False, 5), (False, 5)]


@pytest.mark.parametrize("n_calls", range(7))
def test_choosing_who_acts_can_be_stopped_before_each_evaluation(
    cabinet, tmp_path, member_scores, n_calls
):
    run, process, state = two_members(tmp_path, cabinet)
    calls = member_scores(state, (8, 9, 7), (6, 7, 0))
    lines: list[str] = []
    found = select_active_members(
        run,
        0,
        state,
        threads=1,
        should_continue=lambda: len(calls) < n_calls,
        on_progress=lines.append,
    )
    assert len(lines) == n_calls
    process.close()
    assert found is None
    assert len(calls) == n_calls


def test_a_seed_reports_who_acts_and_its_policy_is_that_member(cabinet, tmp_path, member_scores):
    run, process, _ = two_members(tmp_path, cabinet)
    process.ensemble.run(process._after_round)
    member_scores(process.ensemble.policy_state(), (8, 7, 9), (6, 0, 7))
    assert process.train()
    process.close()
    folder = run.seed_folder(0)
    done = json.loads((folder / DONE).read_text())
    assert done["active_member"] == 1
    assert done["ensemble"] == [
        dict(zip(FIELDS, numbers, strict=True))
        for numbers in ((None, 20, 16, 20, 6), (0, 10, 7, 0, 0), (1, 20, 18, 20, 7))
    ]
    policy = load_policy(folder)
    assert len(policy.networks) == 1
    assert policy.steps == done["selected_step"] == done["steps"]


def test_members_are_really_evaluated_on_episodes(cabinet, tmp_path):
    run, process, _ = two_members(tmp_path, cabinet, member_episodes=3)
    assert process.train()
    process.close()
    done = json.loads((run.seed_folder(0) / DONE).read_text())
    assert [j["member"] for j in done["ensemble"]] == [None, 0, 1]
    assert done["active_member"] is None  # none of them succeeds


def test_of_one_member_and_where_none_is_to_act_only_nothing_is_evaluated(
    cabinet, tmp_path, member_scores
):
    run, process, state = two_members(tmp_path, cabinet, member_episodes=0)
    calls = member_scores(state, (0, 9, 9), (0, 9, 9))
    assert select_active_members(run, 0, state, threads=1) == (state, [])
    process.close()
    single = {k: v for k, v in state.items() if k != "other_members"}
    several = dataclasses.replace(
        run, config=dataclasses.replace(run.config, checkpoint_selection=THREE)
    )
    assert select_active_members(several, 0, single, threads=1) == (single, [])
    assert calls == []


@pytest.mark.parametrize("acts", [2, -1, "0", 1.0])
def test_a_member_that_is_not_there_is_rejected(cabinet, tmp_path, acts):
    _, process, state = two_members(tmp_path, cabinet)
    process.close()
    write_state(process.folder / POLICY, state | {ACTIVE_MEMBER: acts})
    with pytest.raises(RunError, match="active member"):
        load_policy(process.folder)
