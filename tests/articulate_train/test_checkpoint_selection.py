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
    STATES,
    Judged,
    choose_acting,
    choose_state,
    is_due,
)
from articulate_train.config import CheckpointSelectionConfig
from articulate_train.policy import (
    ACTS,
    CHOSEN,
    load_policy,
    members_of,
    policy_of,
    read_checkpoint,
    trained_steps,
    write_state,
)
from articulate_train.run import DONE
from articulate_train.train_seed import SeedProcess

THREE = CheckpointSelectionConfig(states=3, episodes=2, finalists=2, more=3)


@pytest.fixture
def scored(monkeypatch):
    """Episodes whose successes are said by the test, by ticks of the policy, round by round."""
    asked = []

    def use(rates):
        def episodes(scene, policy, draws, stream, *, episodes, threads):
            steps = policy.steps
            asked.append((steps, episodes, tuple(stream.entropy)))
            code = np.ones(episodes, dtype=int)
            code[: round(rates[steps] * episodes)] = 0
            return type("Ended", (), {"code": code}), None

        monkeypatch.setattr(checkpoint_selection, "run_episodes", episodes)
        monkeypatch.setattr(
            checkpoint_selection,
            "policy_of",
            lambda state: type(
                "Policy", (), {"steps": json.loads(state["plain"])["num_timesteps"]}
            ),
        )
        return asked

    return use


def trained(folder, asset, config):
    """A seed's process after its training of 192 ticks, before a state is chosen."""
    run = tiny_run(folder / "run", asset, select=config)
    process = SeedProcess(run, 0, threads=1)
    return run, process


def test_moments_begin_at_a_share_and_leave_out_the_end():
    assert CheckpointSelectionConfig(states=5, since=0.6).moments(1000) == (600, 700, 800, 900)
    assert CheckpointSelectionConfig(states=1).moments(1000) == ()


def test_a_moment_is_due_once_whatever_the_length_of_updates():
    config = CheckpointSelectionConfig(states=4, since=0.25)
    for update in (7, 32, 100):
        ends = range(update, 1000 + update, update)
        due = [e for e in ends if is_due(config, 1000, e - update, e)]
        assert len(due) == 3


@pytest.mark.parametrize(
    "wrong",
    [
        {"states": 0}, {"episodes": 0}, {"finalists": 0}, {"more": 0}, {"since": 1.0},
        {"alone": -1}, {"wider": 0.9}, {"wider": math.inf}, {"wider": math.nan},
    ],
)  # fmt: skip
def test_settings_that_cannot_be_are_refused(wrong):
    name = next(iter(wrong))
    with pytest.raises(ConfigError, match=f"select.{name}"):
        CheckpointSelectionConfig(**wrong)


def test_the_best_of_the_states_is_the_policy_and_the_others_are_deleted(cabinet, tmp_path, scored):
    asked = scored({96: 1.0, 160: 0.5, 192: 1.0})
    run, process = trained(
        tmp_path, cabinet, CheckpointSelectionConfig(states=3, episodes=2, finalists=2)
    )
    assert process.train()
    process.close()
    folder = run.seed_folder(0)
    assert not (folder / STATES).exists()
    said = json.loads((folder / DONE).read_text())
    assert said["chosen"] == 192  # of equals the later
    assert [j["episodes"] for j in said["judged"]] == [302, 2, 302]  # 2 finalists, none as good
    assert {e for e in asked if e[0] == 160} == {(160, 2, (run.config.evaluation_seed, 0, 2, 0))}


def test_states_that_tie_with_the_last_finalist_are_judged_once_more(
    cabinet, tmp_path, scored, monkeypatch
):
    rates = {96: 1.0, 160: 1.0, 192: 1.0}
    asked = scored(rates)
    policy_of = vars(checkpoint_selection)["policy_of"]

    def lost_later(state):  # after the first round the later states turn out worse
        if len(asked) == 3:
            rates.update({160: 0.5, 192: 0.0})
        return policy_of(state)

    monkeypatch.setattr(checkpoint_selection, "policy_of", lost_later)
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    said = json.loads((run.seed_folder(0) / DONE).read_text())
    assert said["chosen"] == 96
    assert [j["episodes"] for j in said["judged"]] == [7, 7, 4]
    assert [entropy[-1] for _, _, entropy in asked] == [0, 0, 0, 2, 2, 2, 1, 1]


def test_what_is_lost_at_the_end_of_training_is_not_the_policy(cabinet, tmp_path, scored):
    scored({96: 1.0, 160: 0.0, 192: 0.0})
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    folder = run.seed_folder(0)
    assert json.loads((folder / DONE).read_text())["chosen"] == 96
    chosen = read_checkpoint(folder, CHOSEN)
    assert json.loads(chosen["plain"])["num_timesteps"] == 96
    seen = np.zeros((1, OBSERVATION.size))
    weights = read_checkpoint(folder)["policy"]["action_net.weight"]
    assert not np.array_equal(chosen["policy"]["action_net.weight"], weights)
    assert load_policy(folder).act(seen).shape == (1, 8)


def test_states_are_really_judged_on_episodes(cabinet, tmp_path):
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    said = json.loads((run.seed_folder(0) / DONE).read_text())
    assert sorted(j["episodes"] for j in said["judged"]) == [4, 7, 7]  # all fail alike


def test_choosing_that_is_interrupted_is_done_again_with_the_same_choice(cabinet, tmp_path):
    run, first = trained(tmp_path, cabinet, THREE)
    first.members.run(first._after_round)
    checkpoint_selection.keep_state(first.folder, first.members.acting())
    assert choose_state(run, 0, threads=1, goes_on=lambda: False) is None
    once, again = (choose_state(run, 0, threads=1) for _ in range(2))
    first.close()
    assert once is not None
    assert again is not None
    assert once[1] == again[1]
    assert once[0]["plain"] == again[0]["plain"]


def test_a_training_that_goes_on_keeps_the_policy_of_the_shorter_one_until_it_is_done(
    cabinet, tmp_path
):
    run, process = trained(tmp_path, cabinet, THREE)
    assert process.train()
    process.close()
    chosen = run.seed_folder(0) / CHOSEN
    before, steps = chosen.read_bytes(), trained_steps(read_checkpoint(chosen.parent, CHOSEN))
    longer = dataclasses.replace(run, config=dataclasses.replace(run.config, steps=6 * 64))
    process = SeedProcess(longer, 0, threads=1)
    assert chosen.read_bytes() == before
    assert f"{steps}.pt" in {path.name for path in (chosen.parent / STATES).iterdir()}
    assert process.train()
    process.close()
    judged = json.loads((chosen.parent / DONE).read_text())["judged"]
    assert steps in [row["steps"] for row in judged]


def test_rate_of_what_was_not_judged_is_zero():
    assert Judged(5).rate == 0.0
    assert Judged(5, 4, 3).rate == 0.75


def who_acts(run, state, goes_on=lambda: True):
    """What :func:`choose_acting` chooses of a state; it is not stopped."""
    found = choose_acting(run, 0, state, threads=1, goes_on=goes_on)
    assert found is not None
    return found


FIELDS = ("alone", "episodes", "successes", "wider_episodes", "wider_successes")


def two_members(folder, asset, **settings):
    """A run whose seed has two members, its process, and their state."""
    select = CheckpointSelectionConfig(**({"states": 1, "alone": 10} | settings))
    run = tiny_run(folder / "run", asset, select=select, members=2)
    process = SeedProcess(run, 0, threads=1)
    return run, process, process.members.acting()


@pytest.fixture
def acted(monkeypatch):
    """Successes of ten that the test says of all, of member 0 and 1; again with wider ranges."""
    asked = []

    def use(state, successes, wider):
        weights = [m["policy"]["action_net.weight"] for m in members_of(state)]

        def episodes(scene, policy, draws, stream, *, episodes, threads):
            heads = [np.asarray(network.head.weight.detach()) for network in policy.networks]
            who = 0
            if len(heads) == 1:
                who = 1 + [np.array_equal(heads[0], w) for w in weights].index(True)
            wide = draws.position_m > RandomizationConfig().position_m
            asked.append((who, wide, episodes, tuple(stream.entropy)))
            code = np.ones(episodes, dtype=int)
            code[: (wider if wide else successes)[who]] = 0
            return type("Ended", (), {"code": code}), None

        monkeypatch.setattr(checkpoint_selection, "run_episodes", episodes)
        return asked

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
def test_a_member_acts_alone_where_it_gains_more_than_it_loses_with_wider_ranges(
    cabinet, tmp_path, acted, successes, wider, acts
):
    run, process, state = two_members(tmp_path, cabinet)
    asked = acted(state, successes, wider)
    chosen, judged = who_acts(run, state)
    process.close()
    assert chosen.get(ACTS) == acts
    best = 1 + int(np.argmax(successes[1:]))
    further = {0, best} if successes[best] > successes[0] else set()
    assert [(j.episodes, j.successes) for j in judged] == [
        (20, 2 * n) if k in further else (10, n) for k, n in enumerate(successes)
    ]
    assert [(j.wider_episodes, j.wider_successes) for j in judged] == [
        (20, wider[k]) if k in further else (0, 0) for k in range(3)
    ]
    draws = {(wide, entropy[-1], episodes) for _, wide, episodes, entropy in asked}
    assert draws == {(False, 3, 10)} | ({(False, 4, 10), (True, 5, 20)} if further else set())
    assert len(policy_of(chosen).networks) == (2 if acts is None else 1)
    assert trained_steps(chosen) == trained_steps(state)  # of all that the seed spent


def test_one_that_is_ahead_at_first_and_not_on_more_draws_does_not_act(cabinet, tmp_path, acted):
    run, process, state = two_members(tmp_path, cabinet)
    successes = [8, 9, 7]
    asked = acted(state, successes, (0, 9, 9))

    def goes_on():
        if len(asked) == 3:
            successes[:] = [9, 8, 0]
        return True

    chosen, judged = who_acts(run, state, goes_on)
    process.close()
    assert ACTS not in chosen
    assert [j.successes for j in judged] == [17, 17, 7]
    assert [j.wider_episodes for j in judged] == [0, 0, 0]


def test_who_acts_is_chosen_anew_for_a_state_of_a_shorter_training(cabinet, tmp_path, acted):
    run, process, state = two_members(tmp_path, cabinet)
    acted(state, (9, 8, 8), (0, 0, 0))
    chosen, _ = who_acts(run, state | {ACTS: 1})
    process.close()
    assert ACTS not in chosen


def test_wider_ranges_are_judged_on_objects_of_the_sizes_that_are_drawn(
    cabinet, tmp_path, monkeypatch
):
    run, process, state = two_members(tmp_path, cabinet)
    seen = []

    def episodes(scene, policy, draws, stream, *, episodes, threads):
        seen.append(scene.scales)
        assert scene.scales == draws.scale_values
        alone = len(policy.networks) == 1
        return type("Ended", (), {"code": np.full(episodes, 0 if alone else 1)}), None

    monkeypatch.setattr(checkpoint_selection, "run_episodes", episodes)
    choose_acting(run, 0, state, threads=1)
    process.close()
    assert len(set(seen)) == 2


def test_ranges_that_cannot_be_wider_are_asked_of_as_they_are(cabinet, tmp_path, acted):
    run, process, state = two_members(tmp_path, cabinet, wider=50.0)
    asked = acted(state, (8, 9, 7), (0, 0, 0))
    chosen, _ = who_acts(run, state)
    process.close()
    assert chosen[ACTS] == 0
    assert [(wide, entropy[-1]) for _, wide, _, entropy in asked[5:]] == [(False, 5), (False, 5)]


@pytest.mark.parametrize("asked_before", range(7))
def test_choosing_who_acts_can_be_stopped_before_each_judgement(
    cabinet, tmp_path, acted, asked_before
):
    run, process, state = two_members(tmp_path, cabinet)
    asked = acted(state, (8, 9, 7), (6, 7, 0))
    found = choose_acting(run, 0, state, threads=1, goes_on=lambda: len(asked) < asked_before)
    process.close()
    assert found is None
    assert len(asked) == asked_before


def test_a_seed_says_who_acts_and_its_policy_is_that_member(cabinet, tmp_path, acted):
    run, process, _ = two_members(tmp_path, cabinet)
    process.members.run(process._after_round)
    acted(process.members.acting(), (8, 7, 9), (6, 0, 7))
    assert process.train()
    process.close()
    folder = run.seed_folder(0)
    said = json.loads((folder / DONE).read_text())
    assert said["acts"] == 1
    assert said["members"] == [
        dict(zip(FIELDS, numbers, strict=True))
        for numbers in ((None, 20, 16, 20, 6), (0, 10, 7, 0, 0), (1, 20, 18, 20, 7))
    ]
    policy = load_policy(folder)
    assert len(policy.networks) == 1
    assert policy.steps == said["chosen"] == said["steps"]


def test_members_are_really_judged_on_episodes(cabinet, tmp_path):
    run, process, _ = two_members(tmp_path, cabinet, alone=3)
    assert process.train()
    process.close()
    said = json.loads((run.seed_folder(0) / DONE).read_text())
    assert [j["alone"] for j in said["members"]] == [None, 0, 1]
    assert said["acts"] is None  # none of them succeeds


def test_of_one_member_and_where_none_is_to_act_alone_nothing_is_judged(cabinet, tmp_path, acted):
    run, process, state = two_members(tmp_path, cabinet, alone=0)
    asked = acted(state, (0, 9, 9), (0, 9, 9))
    assert choose_acting(run, 0, state, threads=1) == (state, [])
    process.close()
    single = {k: v for k, v in state.items() if k != "further"}
    several = dataclasses.replace(run, config=dataclasses.replace(run.config, select=THREE))
    assert choose_acting(several, 0, single, threads=1) == (single, [])
    assert asked == []


@pytest.mark.parametrize("acts", [2, -1, "0", 1.0])
def test_a_member_that_is_not_there_is_refused(cabinet, tmp_path, acts):
    _, process, state = two_members(tmp_path, cabinet)
    process.close()
    write_state(process.folder / CHOSEN, state | {ACTS: acts})
    with pytest.raises(RunError, match="acts"):
        load_policy(process.folder)
