import copy
import dataclasses
import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import DRAWS, rows_of

from articulate.assets.asset import handle_frame
from articulate.errors import EngineError
from articulate.robot.contact import contact_wrench
from articulate.robot.control import (
    apply_gripper_latency,
    discretize_filter,
    exceeds_force_limit,
    filter_start,
    filter_step,
    finger_params,
    finger_start,
    finger_step,
    force_limits,
    gripper_params,
    new_gripper_state,
    send_gripper_command,
    target_params,
    target_workspace,
    update_targets,
)
from articulate.simulator import mujoco
from articulate.task.episode_monitor import (
    COLUMN,
    REASONS,
    WIDTH,
    monitor_params,
    monitor_sample,
)
from articulate.task.randomization import (
    COLUMNS,
    EpisodeParams,
    nominal_params,
    push_is_active,
    sample_episode_params,
)
from articulate.task.task import Limits
from articulate.transforms import pose
from articulate_envs.config import InitialStatesConfig
from articulate_envs.initial_states import home_start, precompute_states
from articulate_envs.threaded_engine import ThreadEngine

ROOT = Path(__file__).resolve().parents[2]
N = 4


def initial_states(scene, n=N, seed=0):
    """Half from home, half along the task with the hand closed on the handle."""
    rng = np.random.default_rng(seed)
    config = InitialStatesConfig(n_precomputed=8 * n, grip_share=1.0)
    bank = rows_of(precompute_states(scene, config, DRAWS, rng), np.arange(n))
    home = home_start(scene, bank.params)
    odd = np.arange(n) % 2 == 1

    def mix(a, b):
        return np.where(odd if a.ndim == 1 else odd[:, None], b, a)

    fields = ("q", "opened", "width", "closing")
    return dataclasses.replace(home, **{f: mix(getattr(home, f), getattr(bank, f)) for f in fields})


def actions(n=N, ticks=40, seed=1):
    """Slow random motion, hands told to open and close now and then."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.uniform(-1, 1, (ticks // 5 + 1, n, 8)), 5, axis=0)[:ticks]
    held[..., 7] = np.where(np.arange(n) % 2 == 1, 1.0, held[..., 7])
    return held


def run(scene, *, threads=1, n=N, ticks=40, engine=None):
    """The states after each tick."""
    if engine is None:
        engine = ThreadEngine(scene, n, threads=threads)
        engine.reset(np.arange(n), initial_states(scene, n))
    out = [engine.step(action) for action in actions(n, ticks)]
    engine.close()
    return out


def arrays(state):
    """All arrays of a state, by name."""
    plain = {k: v for k, v in vars(state).items() if k != "gripper"}
    return plain | {f"gripper_{k}": v for k, v in state.gripper._asdict().items()}


def assert_same_bits(ours, theirs):
    assert len(ours) == len(theirs)
    for a, b in zip(ours, theirs, strict=True):
        for name, value in arrays(a).items():
            assert_array_equal(value, arrays(b)[name], err_msg=name)


def digest(states):
    content = hashlib.sha256()
    for state in states:
        for name, value in sorted(arrays(state).items()):
            content.update(name.encode() + np.ascontiguousarray(value).tobytes())
    return content.hexdigest()


@pytest.mark.parametrize("threads", [2, 3])
def test_results_do_not_depend_on_the_number_of_threads(drawer, threads):
    assert_same_bits(run(drawer, threads=threads), run(drawer))


def test_same_seed_gives_the_same_bits_twice_and_in_another_process(drawer, tmp_path):
    ours = digest(run(drawer))
    assert digest(run(drawer)) == ours
    code = (
        "import sys; from pathlib import Path; "
        "import tests.articulate_envs.test_threaded_engine as t; "
        "from tests.scenes import drawer_scene; "
        "print(t.digest(t.run(drawer_scene(Path(sys.argv[1])), threads=2)))"
    )
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == ours


def test_an_environment_does_what_it_would_do_alone(drawer):
    together = run(drawer)
    alone = ThreadEngine(drawer, 1)
    alone.reset(np.zeros(1, dtype=int), rows_of(initial_states(drawer), np.array([1])))
    for state, action in zip(together, actions(), strict=True):
        only = alone.step(action[1:2])
        assert_array_equal(only.q[0], state.q[1])
        assert_array_equal(only.samples[0], state.samples[1])


def model_arrays(model):
    """All arrays of a model, and its statistic, by name."""
    names = [name for name in dir(model) if not name.startswith("_")]
    found = {name: getattr(model, name) for name in names}
    stat = {n: np.array(getattr(model.stat, n)) for n in ("meaninertia", "meanmass", "extent")}
    return {k: v for k, v in found.items() if isinstance(v, np.ndarray)} | stat


def test_a_thread_steps_each_environment_with_all_that_it_has_drawn(drawer):
    """A thread's model of a size is that of the environment it stepped last, to the bit."""
    engine = ThreadEngine(drawer, N)
    engine.reset(np.arange(N), initial_states(drawer))
    sizes = {int(engine._model_of[i]) for i in range(N)}
    assert len(sizes) > 1
    assert any(np.sum(engine._model_of == size) > 1 for size in sizes)
    engine.step(actions()[0])
    for size in sizes:
        last = [i for i in engine._order if engine._model_of[i] == size][-1]
        own, desk = (
            model_arrays(m) for m in (engine._models[last], engine._thread_models[0][size])
        )
        for name, value in own.items():
            assert_array_equal(desk[name], value, err_msg=name)


def test_engine_continues_from_a_snapshot_with_the_same_bits_in_another_engine(drawer):
    plan = actions()
    engine = ThreadEngine(drawer, N)
    engine.reset(np.arange(N), initial_states(drawer))
    for action in plan[:17]:
        engine.step(action)
    held = engine.snapshot()
    kept = {k: v.copy() for k, v in held.items()}
    going_on = [engine.step(action) for action in plan[17:]]
    other = ThreadEngine(drawer, N, threads=2)
    other.restore(held)
    assert_same_bits([other.step(action) for action in plan[17:]], going_on)
    for name, value in kept.items():
        assert_array_equal(held[name], value, err_msg=name)
    engine.restore(held)
    assert_same_bits([engine.step(action) for action in plan[17:]], going_on)


def test_states_given_out_stay_as_they_were(drawer):
    engine = ThreadEngine(drawer, N)
    engine.reset(np.arange(N), initial_states(drawer))
    first = engine.step(actions()[0])
    kept = copy.deepcopy(arrays(first))
    for action in actions()[1:5]:
        engine.step(action)
    for name, value in kept.items():
        assert_array_equal(arrays(first)[name], value, err_msg=name)


class Reference:
    """One environment stepped in plain Python by the functions that a robot runs."""

    def __init__(self, engine, i, start):
        """Copy environment ``i`` just after its reset with row ``i`` of ``start``."""
        self.scene = scene = engine.scene
        model, data = engine.physics_state(i)
        self.model, self.data = copy.copy(model), copy.copy(data)
        one = rows_of(start, np.array([i]))
        self.params, self.q = one.params, one.q[0]
        self.target, self.filter = self.q.copy(), filter_start(self.q)
        self.finger = one.width[0] / 2
        self.gripper = new_gripper_state(1)
        self.gripper.smooth[:] = 0.5 * np.maximum(one.closing, 0.0)
        self.gripper.command[:] = self.gripper.closing[:] = one.closing
        self.samples, self.torque, self.wrench = np.zeros(WIDTH), np.zeros(7), np.empty(6)
        self.past, self.step_count = [np.zeros(7)] * 8, 0
        dt, arm, control = scene.physics.timestep_s, scene.arm, scene.control
        self.step_matrices = discretize_filter(control.omega_rad_s, dt)
        self.monitor = monitor_params(arm, scene.task.limits, dt)
        self.fingers, self.limits = finger_params(arm.gripper, dt), force_limits(control)
        self.gripper_params = gripper_params(arm.gripper, control.step_s)
        self.targets, self.work = target_params(arm, control), target_workspace()

    def value(self, name):
        return self.params[name][0]

    def step(self, action):
        scene, at, data = self.scene, self.scene.at, self.data
        self.past = [action[:7], *self.past[:-1]]
        motion = self.past[int(self.value("delay_steps"))]
        width = data.qpos[at.finger_q] - data.qpos[at.finger_q + 1]
        sent = send_gripper_command(self.gripper, 0, action[7], width, self.gripper_params)
        latency_s = self.value("gripper_latency_s")
        apply_gripper_latency(self.gripper, 0, sent, latency_s, scene.control.step_s)
        force = self.samples[:3] + self.value("force_bias")
        command = self.gripper.command[0]
        fx, fy, fz = force
        retract = exceeds_force_limit(fx, fy, fz, command, width, self.limits)
        update_targets(self.target, motion, self.q, retract, self.targets, self.work)
        self.finger = finger_start(self.finger, width, self.gripper.closing[0])
        time_s, values = self.step_count * scene.control.step_s, self.params.values[0]
        active = push_is_active(values, time_s, scene.task.episode_s)
        data.xfrc_applied[at.part_body, :3] = active * self.value("push")
        for _ in range(scene.substeps):
            self._substep()
        self.q = data.qpos[at.arm_q : at.arm_q + 7].copy()
        self.step_count += 1

    def _substep(self):
        at, data = self.scene.at, self.data
        filter_step(self.filter, self.target, *self.step_matrices)
        self.finger = finger_step(self.finger, self.gripper.closing[0], self.fingers)
        data.ctrl[at.arm_ctrl : at.arm_ctrl + 7] = self.filter[:, 0]
        data.ctrl[at.finger_ctrl : at.finger_ctrl + 2] = self.finger, -self.finger
        mujoco.mj_step(self.model, data)
        tool_w = data.site_xpos[at.tool_site]
        gripper, floor, robot = at.sensors
        contact = contact_wrench(data.sensordata, gripper, floor, robot, tool_w, self.wrench)
        arm_v = slice(at.arm_q, at.arm_q + 7)
        dq, torque = data.qvel[arm_v], data.qfrc_actuator[arm_v]
        monitor_sample(self.samples, dq, torque, self.torque, self.wrench, contact, self.monitor)


@pytest.mark.parametrize(
    ("name", "limits", "reason"),
    [
        ("drawer", Limits(moment_nm=0.1), "moment"),
        ("drawer", Limits(force_n=2.0), "force"),
        ("door", Limits(speed_share=0.05), "speed"),
        ("closing_drawer", Limits(force_n=2.0), "force"),
        ("closing_door", Limits(speed_share=0.05), "speed"),
        ("closing_lid", Limits(moment_nm=0.1), "moment"),
    ],
)
def test_compiled_loop_does_number_by_number_what_the_python_functions_do(
    name, limits, reason, request
):
    """Under limits so narrow that some episode breaks one."""
    scene = request.getfixturevalue(name)
    scene = dataclasses.replace(scene, task=dataclasses.replace(scene.task, limits=limits))
    start = initial_states(scene)
    engine = ThreadEngine(scene, N, threads=2)
    engine.reset(np.arange(N), start)
    references = [Reference(engine, i, start) for i in range(N)]
    forces = np.zeros(N)
    for action in actions(ticks=60):
        state = engine.step(action)
        for i, ref in enumerate(references):
            ref.step(action[i])
            data = ref.data
            assert_allclose(state.q[i], ref.q, atol=1e-9)
            assert_allclose(state.dq[i], data.qvel[scene.at.arm_q : scene.at.arm_q + 7], atol=1e-8)
            assert_allclose(state.target[i], ref.target, atol=1e-9)
            assert_array_equal(state.gripper.closing[i], ref.gripper.closing[0])
            size = ref.value("scale") if scene.task.kind == "slide" else 1.0
            opened = data.qpos[scene.at.part_q] / (size * scene.task.span)
            assert_allclose(state.opened[i], opened, atol=1e-9)
            assert_allclose(state.samples[i], ref.samples, rtol=1e-9, atol=1e-7)
            forces[i] = ref.samples[COLUMN["force"]]
    assert forces.max() > 5.0
    assert reason in {REASONS[int(code)] for code in state.samples[:, COLUMN["code"]]}


ROW = {name: i for i, name in enumerate(COLUMNS)}


def model_with(engine, **values):
    """A copy of environment 0's model after a reset with nominal draws but for ``values``."""
    drawn = nominal_params(engine.n_envs)
    for name, value in values.items():
        drawn.values[:, ROW[name]] = value
    engine.reset(np.arange(engine.n_envs), home_start(engine.scene, drawn))
    return copy.copy(engine.physics_state(0)[0])


ARM = slice(0, 7)
CHANGES = {
    "friction": lambda m, at: [m.geom_friction[list(at.finger_geoms), 0]],
    "joint_damping": lambda m, at: [m.dof_damping[list(at.object_v)]],
    "joint_friction": lambda m, at: [m.dof_frictionloss[list(at.object_v)]],
    "armature": lambda m, at: [m.dof_armature[ARM]],
    "mass": lambda m, at: [
        m.body_mass[list(at.moving_bodies)],
        m.body_inertia[list(at.moving_bodies)],
    ],
    "stiffness": lambda m, at: [m.actuator_gainprm[ARM, 0], m.actuator_biasprm[ARM, 1]],
    "damping": lambda m, at: [m.actuator_biasprm[ARM, 2]],
}
FIELDS = (
    "geom_friction",
    "dof_damping",
    "dof_frictionloss",
    "dof_armature",
    "body_mass",
    "body_inertia",
    "actuator_gainprm",
    "actuator_biasprm",
    "body_pos",
    "body_quat",
    "geom_size",
    "jnt_range",
    "dof_invweight0",
    "body_invweight0",
    "body_subtreemass",
    "qpos0",
)


@pytest.mark.parametrize("name", CHANGES)
def test_each_drawn_factor_changes_its_own_field_and_no_other(drawer, name):
    engine = ThreadEngine(drawer, 1)
    nominal, changed = model_with(engine), model_with(engine, **{name: 1.3})
    for before, after in zip(
        *(CHANGES[name](m, drawer.at) for m in (nominal, changed)), strict=True
    ):
        assert_allclose(after, 1.3 * before, rtol=1e-12)
        assert np.all(before != 0)
    for other in set(CHANGES) - {name}:
        for before, after in zip(
            *(CHANGES[other](m, drawer.at) for m in (nominal, changed)), strict=True
        ):
            assert_array_equal(after, before)


def test_random_draws_leave_nothing_behind_in_the_model(drawer):
    """A reset begins from the prepared model, not from what the last episode left."""
    engine, rng = ThreadEngine(drawer, 1), np.random.default_rng(5)
    fresh = model_with(engine)
    for _ in range(5):
        engine.reset(
            np.zeros(1, dtype=int), home_start(drawer, sample_episode_params(DRAWS, rng, 1))
        )
        engine.step(np.ones((1, 8)))
    again = model_with(engine)
    for name in FIELDS:
        assert_array_equal(getattr(again, name), getattr(fresh, name), err_msg=name)


def test_an_episode_leaves_nothing_behind_in_the_next(drawer):
    used = ThreadEngine(drawer, N)
    used.reset(np.arange(N), initial_states(drawer, seed=9))
    for action in actions(seed=9):
        used.step(action)
    used.reset(np.arange(N), initial_states(drawer))
    assert_same_bits(run(drawer, engine=used), run(drawer))


def test_reset_of_some_leaves_the_others_alone(drawer):
    plan = actions()
    one, two = ThreadEngine(drawer, N), ThreadEngine(drawer, N)
    for engine in (one, two):
        engine.reset(np.arange(N), initial_states(drawer))
        for action in plan[:5]:
            engine.step(action)
    two.reset(np.array([0, 2]), rows_of(initial_states(drawer, seed=3), np.array([0, 2])))
    for action in plan[5:10]:
        a, b = one.step(action), two.step(action)
    for name in ("q", "dq", "samples", "opened", "T_wh"):
        assert_array_equal(arrays(a)[name][[1, 3]], arrays(b)[name][[1, 3]], err_msg=name)
    assert np.all(np.abs(a.q[[0, 2]] - b.q[[0, 2]]).max(axis=1) > 1e-6)


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_handle_of_the_state_is_the_handle_of_the_model_at_every_size(name, request):
    scene = request.getfixturevalue(name)
    n, rng = 12, np.random.default_rng(0)
    drawn = sample_episode_params(DRAWS, rng, n)
    drawn.values[:, ROW["scale"]] = np.resize(scene.scales, n)
    start = dataclasses.replace(home_start(scene, drawn), opened=rng.random(n))
    engine = ThreadEngine(scene, n)
    engine.reset(np.arange(n), start)
    T_lh = handle_frame(scene.asset.handle_of(scene.task.joint))
    flip = np.diag([-1.0, -1.0, 1.0]) if scene.placement.flip else np.eye(3)
    for i in range(n):
        model, data = engine.physics_state(i)
        mujoco.mj_forward(model, data)
        body = scene.at.part_body
        T_wl = pose(data.xpos[body], data.xmat[body].reshape(3, 3))
        T_wh = T_wl @ pose(drawn["scale"][i] * T_lh[:3, 3], T_lh[:3, :3] @ flip)
        assert_allclose(engine.state().T_wh[i], T_wh, atol=1e-9)
    assert_allclose(engine.state().opened, start.opened, atol=1e-12)


def test_actions_act_after_the_drawn_delay(drawer):
    drawn = nominal_params(3)
    drawn.values[:, ROW["delay_steps"]] = [0, 1, 2]
    engine = ThreadEngine(drawer, 3)
    engine.reset(np.arange(3), home_start(drawer, drawn))
    seen = np.array([engine.step(0.5 * np.ones((3, 8))).target for _ in range(5)])
    assert np.abs(np.diff(seen[:, 0], axis=0)).max(axis=1).min() > 0.1 * drawer.control.step_rad
    home = np.asarray(drawer.placement.start_q)
    late = np.array([[home, *seen[:-1, 0]], [home, home, *seen[:-2, 0]]])
    assert_allclose(seen[:, 1:].swapaxes(0, 1), late, atol=1e-12)


def test_motions_due_are_those_said_and_not_used_yet(drawer):
    drawn = nominal_params(3)
    drawn.values[:, ROW["delay_steps"]] = [0, 1, 2]
    engine = ThreadEngine(drawer, 3)
    engine.reset(np.arange(3), home_start(drawer, drawn))
    assert_array_equal(engine.state().pending_actions, 0.0)
    said = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 3, 8))
    for tick, action in enumerate(said):
        due = engine.step(action).pending_actions
        for i in range(3):
            late = said[max(0, tick + 1 - i) : tick + 1, i, :7]
            assert_allclose(due[i], late.sum(axis=0), atol=1e-12)
    engine.reset(np.array([2]), home_start(drawer, EpisodeParams(drawn.values[2:])))
    assert_array_equal(engine.state().pending_actions[2], 0.0)


def test_hands_move_after_the_drawn_latency(drawer):
    drawn = nominal_params(2)
    drawn.values[:, ROW["gripper_latency_s"]] = [0.0, 0.2]
    engine = ThreadEngine(drawer, 2)
    engine.reset(np.arange(2), home_start(drawer, drawn))
    action = np.zeros((2, 8))
    action[:, 7] = 1.0
    closing = np.array([engine.step(action).gripper.closing for _ in range(30)])
    first = np.argmax(closing > 0, axis=0)
    assert (first[1] - first[0]) * drawer.control.step_s == pytest.approx(0.2)


def test_push_acts_on_the_part_at_its_time_alone(drawer):
    """Closed form: 5 N against dry friction and damping of a drawer that nothing holds."""
    drawn = nominal_params(2)
    drawn.values[0, ROW["push_x_n"]] = -5.0
    drawn.values[:, ROW["push_time"]] = 0.2
    engine = ThreadEngine(drawer, 2)
    engine.reset(np.arange(2), home_start(drawer, drawn))
    speed = np.array([engine.step(np.zeros((2, 8))).speed for _ in range(12)])
    begin = round(0.2 * drawer.n_steps)
    joint, link = drawer.asset.joint(drawer.task.joint), drawer.asset.link("drawer_2")
    assert_allclose(speed[:begin], 0.0, atol=1e-9)
    t = 0.1
    mass = link.mass_kg + 0.01
    expected = (5.0 - joint.frictionloss) / joint.damping * -np.expm1(-joint.damping * t / mass)
    assert speed[begin + 1, 0] == pytest.approx(expected, rel=0.03)
    assert_allclose(speed[:, 1], 0.0, atol=1e-9)
    assert speed[begin + 3, 0] > speed[begin + 5, 0]


def test_a_part_that_opens_backwards_has_positive_speed_when_it_opens(drawer):
    engine = ThreadEngine(drawer, 1)
    engine.reset(np.zeros(1, dtype=int), home_start(drawer, nominal_params()))
    assert engine.state().speed[0] * drawer.task.span >= 0


def test_an_environment_that_diverges_says_so_and_leaves_the_others_alone(
    drawer, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log where it runs
    engine, plan = ThreadEngine(drawer, N), actions()
    engine.reset(np.arange(N), initial_states(drawer))
    engine.step(plan[0])
    engine.physics_state(2)[1].qvel[:] = 1e12
    states = [engine.step(action) for action in plan[1:4]]
    for state in states:
        assert np.isnan(state.samples[2]).any()
        assert np.isfinite(state.q).all()
        assert np.isfinite(state.T_wh).all()
        assert np.isfinite(state.samples[[0, 1, 3]]).all()
    engine.reset(np.array([2]), rows_of(initial_states(drawer), np.array([2])))
    assert np.isfinite(engine.step(plan[4]).samples).all()


def test_objects_whose_sizes_are_not_alike_in_memory_are_refused(drawer, door, error_line):
    mixed = dataclasses.replace(drawer, models=(drawer.models[0], door.models[0]))
    error_line("ThreadEngine(models of two kinds)", lambda: ThreadEngine(mixed, 1))


@pytest.mark.parametrize("name", ["delay_steps", "estimate_delay_steps"])
@pytest.mark.parametrize("value", [-1.0, 6.0, 0.5, np.nan])
def test_a_delay_that_is_not_kept_is_refused_before_compiled_code_reads_it(drawer, name, value):
    engine, start = ThreadEngine(drawer, N), initial_states(drawer)
    start.params.values[1, COLUMNS.index(name)] = value
    with pytest.raises(EngineError, match=f"{name} must be integers from 0 to 5"):
        engine.reset(np.arange(N), start)
