"""Dry friction holds what it is said to hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.articulate.conversion.boxes import AXIS, LIMIT, loaded, made

from articulate.simulator import mujoco

FRICTION_N = 20.0


@pytest.mark.parametrize(("share", "moves"), [(0.9, False), (1.2, True)])
def test_a_joint_holds_up_to_its_dry_friction(tmp_path: Path, share: float, moves: bool) -> None:
    dynamics = f'{LIMIT}<dynamics damping="1" friction="{FRICTION_N}"/>'
    model = loaded(made(tmp_path, (LIMIT, dynamics), (AXIS, '<axis xyz="-1 0 0"/>')))
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = share * FRICTION_N
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    crept = float(np.abs(data.qpos[0]))
    assert (crept > 0.1) if moves else (crept < 0.0005)


@pytest.mark.parametrize("way_m", [0.0004, 0.0009])
def test_a_button_does_not_creep_under_its_weight(tmp_path: Path, way_m: float) -> None:
    dynamics = f'<limit lower="0" upper="{way_m}"/><dynamics damping="1" friction="{FRICTION_N}"/>'
    model = loaded(made(tmp_path, (LIMIT, dynamics), (AXIS, '<axis xyz="0 0 -1"/>')))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3 * way_m
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    assert abs(float(data.qpos[0]) - 0.3 * way_m) < 0.01 * way_m
