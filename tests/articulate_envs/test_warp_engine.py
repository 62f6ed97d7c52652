"""The engine on MuJoCo Warp: its host side on MuJoCo, and all of it on Warp's CPU device."""

import dataclasses
import sys
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.articulate_envs.test_threaded_engine import actions, arrays, assert_same_bits
from tests.articulate_envs.test_threaded_engine import initial_states as threaded_starts
from tests.assets import make_cabinet
from tests.scenes import make_scene, rows_of

from articulate.simulator import mujoco
from articulate_envs import warp_engine
from articulate_envs.config import WarpConfig
from articulate_envs.engines import describe_engine, make_engine
from articulate_envs.threaded_engine import ThreadEngine
from articulate_envs.warp_engine import WarpEngine

N = 6
STEPS = 50


def initial_states(scene, seed=0):
    return threaded_starts(scene, N, seed)


def with_mesh_handle(folder):
    """The scene of the drawer with prisms of eight sides as handles."""
    asset = make_cabinet(folder)
    text = asset.mjcf_path.read_text()
    box = '<geom type="box" group="3" pos="-0.045 0.0 0.0" size="0.006 0.06 0.006"/>'
    assert box in text
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    points = [(0.006 * np.cos(a), y, 0.006 * np.sin(a)) for y in (-0.06, 0.06) for a in angles]
    vertices = " ".join(f"{x:.6f}" for point in points for x in point)
    mesh = f'<asset><mesh name="bar" vertex="{vertices}"/></asset><worldbody>'
    text = text.replace(box, '<geom type="mesh" mesh="bar" group="3" pos="-0.045 0 0"/>')
    asset.mjcf_path.write_text(text.replace("<worldbody>", mesh, 1))
    return make_scene(asset, "drawer_2_slide")


class WorldsOnMujoco:
    """The worlds of the engine, stepped by MuJoCo one after another."""

    def __init__(self, scene, n, config):
        self.scene, self.n = scene, n
        self.models: list[Any] = [None] * n
        self.data: list[Any] = [None] * n
        self.controls = np.zeros((scene.substeps, n, scene.nominal.nu), dtype=np.float32)
        self.forces = np.zeros((n, 3), dtype=np.float32)

    @staticmethod
    def device_name():
        return "mujoco"

    def pack(self, k, model, data):
        return mujoco.MjModel.__copy__(model), mujoco.MjData.__copy__(data)

    def load(self, packed):
        for i, (model, data) in packed.items():
            self.models[i], self.data[i] = model, data

    def step(self):
        at = self.scene.at
        samples: list[list[Any]] = [[] for _ in self.controls]
        for i, (model, data) in enumerate(zip(self.models, self.data, strict=True)):
            data.xfrc_applied[at.part_body, :3] = self.forces[i]
            for control, rows in zip(self.controls, samples, strict=True):
                data.ctrl[:] = control[i]
                mujoco.mj_step(model, data)
                tool_w = data.site_xpos[at.tool_site]
                rows.append(np.r_[data.qvel, data.qfrc_actuator, data.sensordata, tool_w])
        qpos = [data.qpos for data in self.data]
        return np.array(samples, dtype=np.float32), np.array(qpos, dtype=np.float32)

    def state(self):
        names = ("qpos", "qvel", "qacc_warmstart")
        return {name: np.stack([getattr(data, name) for data in self.data]) for name in names}


@pytest.fixture
def on_mujoco(monkeypatch):
    monkeypatch.setattr(warp_engine, "_worlds_class", lambda: WorldsOnMujoco)


def stepped(engine, start, plan):
    engine.reset(np.arange(engine.n_envs), start)
    return [engine.step(action) for action in plan]


@pytest.mark.parametrize("threads", [1, 3])
def test_controls_and_samples_of_a_control_step_are_those_of_the_threaded_engine(
    drawer, on_mujoco, threads
):
    """They differ by the rounding of controls to single precision."""
    start, plan = initial_states(drawer), actions(N, 10)
    ours = stepped(WarpEngine(drawer, N, threads=threads), start, plan)
    for a, b in zip(ours, stepped(ThreadEngine(drawer, N), start, plan), strict=True):
        for name, value in arrays(a).items():
            assert_allclose(value, arrays(b)[name], rtol=2e-3, atol=5e-4, err_msg=name)


def test_each_environment_has_its_own_numbers_and_state(drawer, on_mujoco):
    engine, other = WarpEngine(drawer, N), ThreadEngine(drawer, N)
    for one in (engine, other):
        stepped(one, initial_states(drawer), actions(N, 2))
    for i in range(N):
        (model, data), (own, theirs) = engine.physics_state(i), other.physics_state(i)
        assert_array_equal(model.body_mass, own.body_mass)
        assert_array_equal(model.geom_size, own.geom_size)
        assert_allclose(data.qpos, theirs.qpos, atol=1e-6)


def test_a_diverged_environment_rests_until_it_is_reset(drawer, on_mujoco):
    engine, plan = WarpEngine(drawer, N), actions(N, 5)
    stepped(engine, initial_states(drawer), plan[:1])
    engine._worlds.data[2].qvel[:] = 1e12
    for state in [engine.step(action) for action in plan[1:4]]:
        assert np.isnan(state.samples[2]).any()
        assert np.isfinite(state.q).all()
    assert np.isfinite(engine.physics_state(2)[1].qpos).all()
    engine.reset(np.array([2]), rows_of(initial_states(drawer), np.array([2])))
    assert np.isfinite(engine.step(plan[4]).samples).all()


def test_several_scenes_are_rejected(drawer, door, error_line):
    error_line("WarpEngine(two scenes)", lambda: WarpEngine([drawer, door], 2))


def test_without_the_package_the_extra_is_named(drawer, monkeypatch, error_line):
    monkeypatch.setitem(sys.modules, "warp", None)

    def make():
        return make_engine("warp", drawer, 1, threads=1, warp=WarpConfig())

    error_line("make_engine(warp)  # not installed", make)
    with pytest.raises(Exception, match="articulate-robots\\[warp\\]"):
        describe_engine("warp")
    assert describe_engine("cpu") == "cpu"
    assert isinstance(make_engine("cpu", drawer, 1, threads=1, warp=WarpConfig()), ThreadEngine)


def test_memory_for_nothing_is_rejected(error_line):
    error_line("WarpConfig(contacts=0)", lambda: WarpConfig(contacts=0))


@pytest.fixture(scope="module")
def engine(drawer):
    """An engine on Warp's device; the first kernels compile for minutes."""
    pytest.importorskip("mujoco_warp", reason="mujoco-warp is not installed (extra warp)")
    return WarpEngine(drawer, N)


@pytest.fixture(scope="module")
def states(engine, drawer):
    return stepped(engine, initial_states(drawer), actions(N, STEPS))


def force(state):
    return np.linalg.norm(state.samples[:, :3], axis=1)


def assert_near(states, scene, share, limits):
    """Compare with the threaded engine: ``share`` quantile and largest difference by quantity."""
    other = stepped(ThreadEngine(scene, N), initial_states(scene), actions(N, STEPS))
    assert max(force(state).max() for state in other) > 10.0
    for read, typical, largest in limits:
        found = [np.abs(read(a) - read(b)) for a, b in zip(states, other, strict=True)]
        assert np.quantile(found, share) <= typical
        assert np.max(found) <= largest


@pytest.mark.slow
def test_warp_agrees_with_the_threaded_engine_over_fifty_control_steps(states, drawer):
    """Half of the episodes hold the handle. A contact may begin one physics step apart."""
    limits = (
        (lambda s: s.q.T, 2e-5, 1e-3),  # [rad]
        (lambda s: s.opened, 2e-5, 4e-3),
        (force, 0.05, 8.0),  # [N]
        (lambda s: s.gripper_width, 2e-5, 3e-3),  # [m]
    )
    assert_near(states, drawer, 0.9, limits)


@pytest.mark.slow
def test_each_world_has_the_meshes_of_its_size(tmp_path):
    """A handle that is a mesh: its contact points differ more than those of boxes."""
    pytest.importorskip("mujoco_warp", reason="mujoco-warp is not installed (extra warp)")
    scene = with_mesh_handle(tmp_path)
    states = stepped(WarpEngine(scene, N), initial_states(scene), actions(N, STEPS))
    limits = (
        (lambda s: s.q.T, 1e-3, 5e-3),
        (lambda s: s.opened, 1e-4, 4e-3),
        (force, 0.2, 8.0),
        (lambda s: s.gripper_width, 1e-4, 3e-3),
    )
    assert_near(states, scene, 0.9, limits)


@pytest.mark.slow
def test_warp_gives_the_same_bits_again_on_a_cpu(engine, states, drawer):
    if warp_engine.warp_device() != "cpu":
        pytest.skip("a GPU sums in any order")
    assert_same_bits(stepped(engine, initial_states(drawer), actions(N, 12)), states[:12])


@pytest.mark.slow
def test_a_reset_of_some_worlds_does_not_change_the_others(engine, states, drawer):
    plan = actions(N, STEPS)
    stepped(engine, initial_states(drawer), plan[:5])
    engine.reset(np.array([0, 2]), rows_of(initial_states(drawer, 3), np.array([0, 2])))
    for action, expected in zip(plan[5:8], states[5:8], strict=True):
        state = engine.step(action)
        assert_allclose(state.q[[1, 3, 4, 5]], expected.q[[1, 3, 4, 5]], atol=1e-6)
        assert np.abs(state.q[[0, 2]] - expected.q[[0, 2]]).max() > 1e-4


@pytest.mark.slow
def test_warp_continues_from_a_snapshot_and_so_does_the_threaded_engine(engine, drawer):
    plan = actions(N, 14)
    stepped(engine, initial_states(drawer), plan[:8])
    kept = engine.snapshot()
    going_on = [engine.step(action) for action in plan[8:]]
    other = ThreadEngine(drawer, N)
    for one, tolerance in ((engine, 1e-6), (other, 1e-3)):
        one.restore(kept)
        for action, expected in zip(plan[8:], going_on, strict=True):
            assert_allclose(one.step(action).q, expected.q, atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("few", [{"contacts": 1}, {"constraints": 12}])
def test_too_little_memory_is_reported(engine, drawer, few, monkeypatch, error_line):
    monkeypatch.setattr("articulate_envs.warp_worlds.LEAST_CONTACTS", 1)
    small = WarpEngine(drawer, N, config=WarpConfig(**few))
    error_line(
        f"WarpEngine(too few {next(iter(few))})",
        lambda: stepped(small, initial_states(drawer), actions(N, 5)),
    )


@pytest.mark.slow
def test_geoms_of_every_world_are_where_mujoco_has_them(engine, drawer):
    """Also those of the carcass, which does not move, but has another pose in each world."""
    stepped(engine, initial_states(drawer), actions(N, 2))
    worlds = engine._worlds
    import mujoco_warp

    mujoco_warp.kinematics(worlds.model, worlds.data)
    found = worlds.data.geom_xpos.numpy(), worlds.data.geom_xmat.numpy()
    for i in range(N):
        model, data = engine.physics_state(i)
        mujoco.mj_kinematics(model, data)
        assert_allclose(found[0][i], data.geom_xpos, atol=1e-5)
        assert_allclose(found[1][i].reshape(-1, 9), data.geom_xmat, atol=1e-5)


@pytest.mark.slow
def test_a_scene_that_warp_does_not_support_is_rejected(engine, drawer, error_line):
    model = mujoco.MjModel.__copy__(drawer.nominal)
    model.opt.noslip_iterations = 1
    scene = dataclasses.replace(drawer, models=(model,), scales=(1.0,))
    error_line("WarpEngine(noslip)", lambda: WarpEngine(scene, 1))
