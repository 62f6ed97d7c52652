"""The study of physics settings replays the same actions, and measures what it says."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

import physics
from articulate.simulator import mujoco
from articulate.task.randomization import draw
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_envs.initial_states import home_start
from articulate_train.run import open_run
from gains import motion_to


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("physics")
    return make_run(folder / "run", make_cabinet(folder / "cabinet"), episode_s=1.0)


@pytest.fixture(scope="module")
def stage(run, tmp_path_factory):
    found = open_run(run)
    config = replace(found.config, draw=NO_RANDOMIZATION)
    cache = tmp_path_factory.mktemp("cache")
    return physics.Stage(config, found.asset.folder, found.asset, found.task, found.place, cache)


def test_every_candidate_is_written_into_every_model(stage):
    named = {c.name: c for c in physics.candidates([])}
    assert len(named) == len(physics.candidates([]))
    euler = stage.scene(named["2 ms, Euler"]).models[0].opt
    assert euler.timestep == 0.002
    assert euler.integrator == mujoco.mjtIntegrator.mjINT_EULER
    few = stage.scene(named["5 ms, CG, 30 iterations"]).models[0].opt
    assert (few.solver, few.iterations) == (mujoco.mjtSolver.mjSOL_CG, 30)
    cold = stage.scene(named["no warm start"]).models[0].opt
    assert cold.disableflags & mujoco.mjtDisableBit.mjDSBL_WARMSTART
    shipped = stage.scene(named[physics.SHIPPED]).models[0].opt
    assert shipped.timestep == 0.005
    assert not shipped.disableflags & mujoco.mjtDisableBit.mjDSBL_WARMSTART


def test_a_replay_of_what_was_taken_is_the_episode_itself(stage):
    scene = stage.scene(physics.Candidate(name="shipped"))
    drawn = draw(NO_RANDOMIZATION, np.random.default_rng(0), 2, begin=scene.task.begin)
    start = home_start(scene, drawn)
    engine = physics.TimedEngine(scene, 2)
    goals, hand = physics.script(scene, start, np.random.default_rng(1))

    def act(t):
        motion = motion_to(scene, engine.state().target, goals[t])
        return np.column_stack([motion, hand[t]])

    first, taken = physics.replay(engine, start, act, scene.ticks)
    again, _ = physics.replay(engine, start, taken.__getitem__, scene.ticks)
    assert np.array_equal(first.tool_w, again.tool_w)
    assert np.abs(first.tool_w[-1] - first.tool_w[0]).max() > 0.002
    told = physics.difference(again, first, 40.0)
    assert told["same_verdict"] == 1.0
    assert told["tool_mm_p90"] == told["opened_mm_p90"] == told["force_n_p90"] == 0.0
    assert again.tick_us > 0.0


def test_a_longer_step_is_told_to_be_farther_from_the_reference(run, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    flags = ["--episodes", "2", "--ticks", "6", "--rounds", "1", "--only", "10", "1", "--json"]
    monkeypatch.setattr(sys, "argv", ["physics.py", "--run", str(run), *flags, "--budgets"])
    assert physics.main() == 0
    (found,) = json.loads(capsys.readouterr().out)["objects"]
    rows = {row["setting"]: row for row in found["rows"]}
    assert found["actions"] == "policy"
    assert rows[physics.REFERENCE.name]["tool_mm_median"] == 0.0
    distance = [rows[name]["tool_mm_median"] for name in ("1 ms", "shipped", "10 ms")]
    assert distance == sorted(distance)
    assert 0.0 < distance[0] < distance[2]
    assert rows["shipped"]["cost"] == 1.0
    assert rows["1 ms"]["tick_us"] > 0.0
