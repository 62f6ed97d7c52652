import json
from dataclasses import replace

import pytest
from tests.articulate_train.test_train_seed import same_checkpoints, stop_after
from tests.runs import tiny_run

from articulate_train import train_seed as seeds
from articulate_train.config import EarlyStoppingConfig, TrainConfig
from articulate_train.evaluate_run import _early_stopping, _unfinished
from articulate_train.policy import read_checkpoint, trained_steps
from articulate_train.run import DONE, is_seed_done
from articulate_train.seed_runner import train_seeds
from articulate_train.target_evaluation import (
    KEY,
    TargetEvaluation,
    evaluate_target,
    is_evaluation_due,
    reached_target,
    target_episodes,
)
from articulate_train.train_seed import SeedProcess

STOPPING = EarlyStoppingConfig(every=64, first_episodes=2, episodes=3)


def evaluation(steps, successes, episodes=5):
    return TargetEvaluation(
        steps=steps, target=0.9, episodes=episodes, successes=successes, low=0.5, high=1.0,
        is_complete=episodes == 5,
    )  # fmt: skip


@pytest.fixture
def run(cabinet, tmp_path):
    return tiny_run(
        tmp_path / "run", cabinet, target_success=0.9, early_stopping=STOPPING, updates=8
    )


@pytest.fixture
def evaluated(monkeypatch):
    """Let the evaluation after 128 steps meet the target; the steps of all evaluations."""
    steps = []

    def evaluate(scene, config, seed, state, now, threads):
        assert trained_steps(state) == now
        steps.append(now)
        return evaluation(now, 5 if now == 128 else 1)

    monkeypatch.setattr(seeds, "evaluate_target", evaluate)
    return steps


def train(run, *, interrupted_after=None):
    process = SeedProcess(run, 0, threads=1)
    if interrupted_after:
        stop_after(process, interrupted_after)
    done = process.train()
    process.close()
    return done


def test_training_ends_when_the_target_is_met_and_keeps_that_policy(run, evaluated):
    assert train(run)
    folder = run.seed_folder(0)
    done = json.loads((folder / DONE).read_text())
    assert evaluated == [64, 128]
    assert done["steps"] == done["selected_step"] == 128
    assert done[KEY] == evaluation(128, 5).as_dict()
    assert trained_steps(read_checkpoint(folder, "policy.pt")) == 128
    assert is_seed_done(run.config, folder)
    assert _unfinished(run) == ""
    assert _early_stopping(run) == (
        "seed 0: 100.0% of 5 held-out episodes after 0.00M steps (target 90.0%)"
    )
    assert not is_seed_done(run.config, run.folder)


def test_interrupted_training_ends_at_the_same_policy(run, evaluated, cabinet, tmp_path):
    assert train(run)
    other = tiny_run(
        tmp_path / "other", cabinet, target_success=0.9, early_stopping=STOPPING, updates=8
    )
    assert not train(other, interrupted_after=3)
    assert train(other)
    same = [read_checkpoint(each.seed_folder(0), "policy.pt") for each in (run, other)]
    for name, value in same[0]["policy"].items():
        assert value.equal(same[1]["policy"][name])


def test_evaluations_do_not_change_the_training(run, cabinet, tmp_path):
    plain = tiny_run(tmp_path / "plain", cabinet, updates=8)
    assert train(run)  # its policy never meets the target
    assert train(plain)
    same_checkpoints(run.seed_folder(0), plain.seed_folder(0))
    assert reached_target(run.seed_folder(0) / DONE) is None


def test_first_episodes_decide_about_the_others(run, monkeypatch):
    scene, process = run.scene(), SeedProcess(run, 0, threads=1)
    state = process.ensemble.policy_state()
    process.close()
    found = evaluate_target(scene, run.config, 0, state, 64, 1)
    assert (found.episodes, found.successes, found.is_complete) == (2, 0, False)
    low = replace(run.config, target_success=0.01)
    found = evaluate_target(scene, low, 0, state, 64, 1)
    assert (found.episodes, found.is_complete, found.is_reached) == (5, True, False)


def test_success_is_met_only_by_a_complete_evaluation():
    assert evaluation(64, 5).is_reached
    assert not evaluation(64, 4).is_reached
    assert not evaluation(64, 2, episodes=2).is_reached


def test_evaluations_are_due_at_intervals_before_the_end(run):
    config = run.config
    due = [now for now in range(32, 257, 32) if is_evaluation_due(config, now - 32, now)]
    assert due == [64, 128, 192]
    assert target_episodes(config) == 3 * 5
    without = replace(config, target_success=0.0)
    assert not is_evaluation_due(without, 0, 64)
    assert target_episodes(without) == 0


def test_damaged_record_is_no_reached_target(tmp_path):
    path = tmp_path / DONE
    assert reached_target(path) is None
    for content in ({}, {KEY: 1}, {KEY: {"steps": 1}}):
        path.write_text(json.dumps(content))
        assert reached_target(path) is None


def test_command_reports_the_end_and_repeats_nothing(run, monkeypatch):
    folder = run.seed_folder(0)

    def start(*_):
        folder.mkdir()
        (folder / DONE).write_text(json.dumps({"steps": 128, KEY: evaluation(128, 5).as_dict()}))
        return type("Process", (), {"returncode": 0, "poll": lambda _: 0})()

    monkeypatch.setattr("articulate_train.seed_runner._start", start)
    lines = []
    assert train_seeds(run, lambda _: None, lambda seed, text: lines.append((seed, text)))
    assert lines == [
        (0, f"target success met, training ends: {evaluation(128, 5).text()}"),
    ]
    assert train_seeds(run, lambda _: None, lambda *_: pytest.fail("reported"))


@pytest.mark.parametrize("value", [-0.1, 1.0])
def test_target_success_is_a_share_below_one(value, error_line):
    error_line(
        f"target_success {value}", lambda: TrainConfig(asset="cabinet.urdf", target_success=value)
    )


def test_early_stopping_needs_episodes(error_line):
    error_line("early_stopping.every 0", lambda: EarlyStoppingConfig(every=0))
