"""What the benchmark of another engine compares: recorded episodes, how far joints are apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from articulate.simulator import mujoco
from gpu_physics import Episodes, OnMuJoCo, _saved, nearness

TICKS, SUBSTEPS, N = 4, 3, 2
PARTS = 8
"""The part's joint and seven of an arm."""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Two episodes of eight joints, each driven by a motor, the second with twice the masses."""
    bodies = "".join(
        f'<body pos="{k} 0 0"><joint name="j{k}" type="slide" axis="1 0 0"/>'
        '<geom size="0.1" mass="1" contype="0"/></body>'
        for k in range(PARTS)
    )
    motors = "".join(f'<motor joint="j{k}"/>' for k in range(PARTS))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><option gravity='0 0 0' timestep='0.01'/><worldbody>{bodies}</worldbody>"
        f"<actuator>{motors}</actuator></mujoco>"
    )
    rng = np.random.default_rng(0)
    path = tmp_path / "recorded.npz"
    mass = np.stack([model.body_mass, 2.0 * model.body_mass])
    np.savez_compressed(
        path,
        model=_saved(model),
        name=np.array("slide"),
        unit=np.array("mm"),
        way=np.array(0.3),
        part=np.array([0, 1]),
        arm=np.array(1),
        controls=rng.normal(size=(N, TICKS, SUBSTEPS, PARTS)).astype(np.float32),
        pushes=np.zeros((N, TICKS, 3), dtype=np.float32),
        qpos=rng.normal(size=(N, PARTS)),
        qvel=rng.normal(size=(N, PARTS)),
        drawn_body_mass=mass,
        drawn_dof_M0=np.stack([model.dof_M0, 2.0 * model.dof_M0]),  # as mj_setConst has it
    )
    return path


def test_episodes_go_as_newton_says(recording: Path) -> None:
    episodes = Episodes(recording)
    joints, _ = OnMuJoCo(episodes, 2 * N, threads=1).run()
    dt, speed = 0.01, episodes.arrays["qvel"].copy()
    place = episodes.arrays["qpos"].copy()
    for t in range(TICKS):
        for s in range(SUBSTEPS):  # what MuJoCo integrates: speeds first, then places
            speed += dt * episodes.controls[:, t, s] / np.array([[1.0], [2.0]])
            place += dt * speed
        np.testing.assert_allclose(joints[:N, t], place, atol=1e-9)
    np.testing.assert_array_equal(joints[:N], joints[N:])  # the recorded ones, once more


def test_a_push_moves_the_part_alone(recording: Path) -> None:
    episodes = Episodes(recording)
    calm, _ = OnMuJoCo(episodes, N, threads=1).run()
    episodes.pushes[:, 1] = [3.0, 0.0, 0.0]
    pushed, _ = OnMuJoCo(episodes, N, threads=1).run()
    np.testing.assert_array_equal(pushed[:, 0], calm[:, 0])
    np.testing.assert_array_equal(pushed[:, :, 1:], calm[:, :, 1:])
    assert (pushed[:, 1, 0] > calm[:, 1, 0]).all()


def test_nearness_tells_part_from_arm_and_what_is_no_number() -> None:
    exact = np.zeros((4, 30, PARTS))
    mine = exact.copy()
    mine[0, 25:, 0] = 0.002  # the part of one, after the first second
    mine[1, 0, 3] = 0.5  # an arm of another, in the first tick alone
    mine[2, 10:, 0] = np.nan
    found = nearness(mine, exact, way=50.0)
    assert found["not_finite"] == 1
    assert found["part_tick_p90"] == 0.0
    assert found["arm_tick_p90"] == pytest.approx(350.0)  # 500, 0, 0, 0 interpolated
    assert found["same_end"] == 0.5  # 2 mm of 50 mm are too many, and so is no number
