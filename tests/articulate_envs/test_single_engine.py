"""The engines agree: plain Python, compiled and batched, behind gymnasium and behind robosuite."""

import dataclasses
import functools
from itertools import islice

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.assets import make_cabinet, make_cupboard
from tests.scenes import DRAWS, make_scene, rows_of

from articulate.task.observation import OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate.task.task import TASK_RULES
from articulate_envs import placement_search
from articulate_envs.config import InitialStatesConfig
from articulate_envs.gym_env import ArticulateEnv
from articulate_envs.initial_states import home_start, precompute_states
from articulate_envs.interface import params_dict
from articulate_envs.robosuite_env import ArticulatedObject
from articulate_envs.single_engine import SingleEngine
from articulate_envs.threaded_engine import ThreadEngine
from articulate_envs.vector_env import ArticulateVectorEnv

TICKS, TOLERANCE = 200, 1e-6
EXACT = dataclasses.replace(DRAWS, estimate_noise_m=0.0, part_noise=0.0, force_noise_n=0.0)
"""Without what is drawn anew each tick, of which N environments draw N times as much."""


@pytest.fixture(scope="module")
def scene_of(tmp_path_factory):
    """``scene_of(part, verb)``: a drawer or a door, in episodes of full length."""
    cabinet = make_cabinet(tmp_path_factory.mktemp("drawer"))
    cupboard = make_cupboard(tmp_path_factory.mktemp("door"), degrees=75.0)
    parts = {"drawer": (cabinet, "drawer_2_slide"), "door": (cupboard, "door_hinge")}

    @functools.cache
    def make(part, verb="open"):
        with pytest.MonkeyPatch.context() as patch:  # any placement will do
            patch.setattr(placement_search, "SEARCH_STAGES", placement_search.SEARCH_STAGES[:1])
            return make_scene(*parts[part], episode_s=10.0, verb=verb)

    return make


@pytest.fixture(scope="module")
def drawer(scene_of):
    return scene_of("drawer")


def begun(scene, how):
    """A start from home, or with the hand closed on the handle of a part on its way."""
    rng = np.random.default_rng(11)
    bank = precompute_states(
        scene, InitialStatesConfig(n_precomputed=4, grip_share=1.0), DRAWS, rng
    )
    gripping = rows_of(bank, np.array([0]))
    return gripping if how == "gripping" else home_start(scene, gripping.params)


def plan(seed=3):
    """Slow random motion; the hand is told to close most of the time."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.uniform(-1, 1, (TICKS // 8, 8)), 8, axis=0)
    held[:, 7] = np.where(np.arange(TICKS) % 100 < 70, 1.0, -1.0)
    return held


def options_of(start):
    """What to ask a reset for to begin like ``start``."""
    plain = {name: getattr(start, name)[0].tolist() for name in ("q", "opened", "width")}
    closing = float(start.closing[0])
    return {"episode_params": params_dict(start.params), **plain, "closing": closing}


def through_gymnasium(scene, start, draws):
    env = ArticulateEnv(scene=scene, randomization=draws)
    env.reset(seed=7, options=options_of(start))
    for action in plan():
        observation, reward, terminated, truncated, info = env.step(action.astype(np.float32))
        assert not truncated
        yield observation, reward, env.episodes.state.q[0], terminated, info["reason"]
    env.close()


def through_robosuite(scene, start, draws):
    env = ArticulatedObject("Panda", scene=scene, randomization=draws)
    env.rng = np.random.default_rng(7)
    env.set_ep_meta(options_of(start))
    env.reset()
    for action in plan():
        told, reward, done, info = env.step(action.astype(np.float32))
        yield told["policy-state"], reward, env.sim.data.qpos[:7].copy(), done, info["reason"]
    env.close()


def through_batch(scene, start, draws, n=1, threads=1):
    env = ArticulateVectorEnv(num_envs=n, threads=threads, scene=scene, randomization=draws)
    env.reset(seed=7, options=options_of(start))
    for action in plan():
        before = env.engine.physics_state(n - 1)[1]
        batch = np.tile(action.astype(np.float32), (n, 1))
        observation, reward, terminated, truncated, info = env.step(batch)
        assert not truncated.any()
        q, reason, last = before.qpos[:7].copy(), info["reason"][-1], observation[-1]
        if terminated[-1]:  # the next episode has begun
            last, reason = info["final_obs"][-1], info["final_info"]["reason"][-1]
            q = last[OBSERVATION.slice("joint_pos")]
        yield last, reward[-1], q, bool(terminated[-1]), reason
    env.close()


CASES = [
    ("drawer", "open", "home"),
    ("drawer", "open", "gripping"),
    ("door", "open", "gripping"),
    ("drawer", "close", "gripping"),
    ("door", "close", "home"),
]


@pytest.mark.parametrize(
    ("part", "verb", "how"), [case for case in CASES if f"{case[1]}_joint" in TASK_RULES]
)
def test_all_engines_agree_over_two_hundred_ticks(part, verb, how, scene_of):
    """Observation, reward, joints and end, from the same start, draw and actions."""
    scene = scene_of(part, verb)
    assert scene.n_steps == TICKS
    start = begun(scene, how)
    batch = list(through_batch(scene, start, DRAWS))
    others = {
        "gymnasium": list(through_gymnasium(scene, start, DRAWS)),
        "robosuite": list(through_robosuite(scene, start, DRAWS)),
    }
    for engine, trace in others.items():
        for tick, (ours, theirs) in enumerate(zip(trace, batch, strict=True)):
            for a, b in zip(ours[:3], theirs[:3], strict=True):
                assert_allclose(a, b, rtol=0, atol=TOLERANCE, err_msg=f"{engine} at {tick}")
            assert ours[3:] == theirs[3:]
    moved = np.array([row[2] for row in batch])
    assert np.abs(np.diff(moved, axis=0)).max() > 1e-3
    assert [row[3] for row in batch] == [False] * (TICKS - 1) + [True]


def test_one_of_many_agrees_with_one_alone(drawer):
    start = begun(drawer, "gripping")
    many = through_batch(drawer, start, EXACT, n=3, threads=2)
    for ours, theirs in islice(zip(through_gymnasium(drawer, start, EXACT), many, strict=True), 60):
        for a, b in zip(ours[:3], theirs[:3], strict=True):
            assert_allclose(a, b, rtol=0, atol=TOLERANCE)


def stepped(engine, actions):
    return [engine.step(action[None]) for action in actions]


@pytest.mark.parametrize("first", [SingleEngine, lambda scene: ThreadEngine(scene, 1)])
def test_either_engine_continues_from_the_others_snapshot(drawer, first):
    """The two states are the same, field by field."""
    start = begun(drawer, "gripping")
    engine, single, batched = first(drawer), SingleEngine(drawer), ThreadEngine(drawer, 1)
    engine.reset(np.zeros(1, dtype=int), start)
    stepped(engine, plan()[:30])
    kept = engine.snapshot()
    ends = []
    for other in (engine, single, batched):
        other.restore(kept)
        ends.append(stepped(other, plan()[30:60])[-1])
    for name in ("q", "dq", "target", "opened", "speed", "gripper_width", "T_wh"):
        for end in ends[1:]:
            assert_allclose(getattr(end, name), getattr(ends[0], name), rtol=0, atol=1e-9)
    assert_allclose(ends[1].samples, ends[2].samples, rtol=1e-9, atol=1e-7)


def test_continued_from_its_own_snapshot_it_gives_the_same_bits(drawer):
    engine = SingleEngine(drawer)
    engine.reset(np.zeros(1, dtype=int), begun(drawer, "home"))
    stepped(engine, plan()[:10])
    kept = engine.snapshot()
    going_on = stepped(engine, plan()[10:20])
    other = SingleEngine(drawer)
    other.restore(kept)
    for ours, theirs in zip(stepped(other, plan()[10:20]), going_on, strict=True):
        assert_array_equal(ours.q, theirs.q)
        assert_array_equal(ours.samples, theirs.samples)


def test_a_state_that_diverges_stands_still_and_says_so(drawer, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log where it runs
    env = ArticulateEnv(scene=drawer)
    env.reset(seed=0)
    env.step(np.zeros(8, dtype=np.float32))
    env.engine.data.qvel[:] = 1e12
    observation, reward, terminated, truncated, info = env.step(np.zeros(8, dtype=np.float32))
    assert (terminated, truncated, info["reason"]) == (True, False, "diverged")
    assert np.isfinite(observation).all()
    assert reward == 0.0
    assert np.isfinite(env.engine.state().q).all()


def test_drawn_columns_are_those_that_may_be_asked_for(drawer):
    env = gymnasium.wrappers.PassiveEnvChecker(ArticulateEnv(scene=drawer))
    _, info = env.reset(seed=1)
    assert list(info["episode_params"]) == list(COLUMNS)
    _, again = env.reset(seed=2, options={"episode_params": info["episode_params"]})
    assert again["episode_params"] == info["episode_params"]
