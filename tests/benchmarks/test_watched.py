"""What a policy does is watched tick by tick, as it is judged, and with handles told deeper."""

import numpy as np
import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

from articulate.robot.kinematics import tool_pose
from articulate.task.randomization import COLUMNS, draw
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate.transforms import pose
from articulate_envs.initial_states import home_start
from articulate_train.evaluate import run_episodes
from articulate_train.policy import load_policy
from articulate_train.run import open_run
from watched import handles, told_deeper, watch


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("watched")
    return make_run(place / "run", make_cabinet(place / "cabinet"), episode_s=1.0)


def test_a_handle_is_told_deeper_along_its_approach_alone():
    drawn = draw(NO_RANDOMIZATION, np.random.default_rng(0), 2)
    along_x = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    T_wh = np.stack([np.eye(4), pose(np.zeros(3), along_x)])
    change = told_deeper(drawn, T_wh, 0.01).values - drawn.values
    expected = np.zeros((2, len(COLUMNS)))
    expected[0, COLUMNS.index("bias_z_m")] = expected[1, COLUMNS.index("bias_x_m")] = 0.01
    np.testing.assert_allclose(change, expected, atol=1e-15)


def test_episodes_are_those_that_an_evaluation_with_the_seed_would_run(folder):
    run = open_run(folder)
    policy, stream = load_policy(run.seed_folder(0)), np.random.SeedSequence(5)
    ended, drawn = run_episodes(run.scene(), policy, run.config.draw, stream, episodes=3, threads=1)
    seen = watch(folder, 0, episodes=3, draws=5)
    np.testing.assert_array_equal(seen.code, ended.code)
    np.testing.assert_array_equal(seen.drawn.values, drawn.values)
    again = watch(folder, 0, episodes=3, draws=5, threads=1)
    np.testing.assert_array_equal(again.place_t, seen.place_t)


def test_where_the_handle_is_told_to_be_changes_what_a_policy_does(folder):
    own, deeper = (watch(folder, 0, episodes=3, draws=5, deeper_m=d) for d in (0.0, 0.05))
    assert not np.array_equal(own.depth, deeper.depth)


def test_places_begin_as_home_and_the_drawn_object_say(folder):
    seen = watch(folder, 0, episodes=3, draws=5)
    T_wh = handles(seen.scene, seen.drawn)
    T_wt = tool_pose(seen.scene.arm, home_start(seen.scene, seen.drawn).q)
    place_t = (np.linalg.inv(T_wt) @ T_wh)[:, :3, 3]
    depth = (np.linalg.inv(T_wh) @ T_wt)[:, 2, 3]
    assert seen.depth.shape == seen.force.shape == (seen.scene.ticks - 1, 3)
    # A tick moves the tool by 8 mm at most, and turns it by 0.026 rad: 2 cm at 0.7 m.
    np.testing.assert_allclose(seen.place_t[0], place_t, atol=0.03)
    np.testing.assert_allclose(seen.depth[0], depth, atol=0.01)
