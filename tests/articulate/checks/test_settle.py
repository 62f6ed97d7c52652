"""What an object does when left alone, against closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.articulate.checks.objects import Part, make_object
from tests.assets import make_cabinet

from articulate.assets.asset import Asset
from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel, load_model
from articulate.checks.settle import check_settling, simulate, until_still, with_energy
from articulate.simulator import mujoco

G = 9.81
BALL = (((0.0, 0.0, 0.0), (0.02, 0.02, 0.02)),)


def clauses_of(asset: Asset) -> dict[tuple[str, str], Check]:
    """Clauses by name and joint."""
    return {(c.name, c.subject): c for c in check_settling(asset, load_model(asset))}


def flap(folder: Path, *, axis_y: float, span: float, com: tuple[float, float, float], **more):
    """An asset with a hinge along y; 1 kg at ``com``."""
    part = Part(
        name="flap", kind="hinge", axis=(0.0, axis_y, 0.0), span=span, com=com, mass_kg=1.0,
        inertia=0.002, boxes=BALL, **more,
    )  # fmt: skip
    return make_object(folder, part)


def test_a_cabinet_stays_closed_and_makes_no_energy(tmp_path):
    checks = clauses_of(make_cabinet(tmp_path / "a"))
    assert {c.outcome for c in checks.values()} == {"passed"}
    assert checks["energy", ""].measured == pytest.approx(0.0, abs=1e-9)
    for k in range(3):
        check = checks["settling", f"drawer_{k}_slide"]
        assert check.measured == pytest.approx(0.0, abs=1e-6)
        assert check.message == "stays closed; stays in place when released half open"


def test_a_lid_falls_shut_and_says_so(tmp_path):
    # closed it lies level at its stop; it opens upwards to 80 degrees
    asset = flap(tmp_path / "a", axis_y=-1.0, span=math.radians(80.0), com=(0.2, 0.0, 0.0))
    check = clauses_of(asset)["settling", "flap_joint"]
    assert check.outcome == "passed"
    assert check.message == "stays closed; falls shut when released half open"


def test_a_flap_that_hangs_falls_open_and_says_so(tmp_path):
    # closed it stands upright, leaning over a little; open it lies level
    asset = flap(tmp_path / "a", axis_y=1.0, span=math.pi / 2, com=(0.02, 0.0, 0.2), damping=0.05)
    check = clauses_of(asset)["settling", "flap_joint"]
    assert check.outcome == "passed"
    assert "falls open under gravity, to 100 % of its travel" in check.message
    assert "falls open when released half open" in check.message


def test_dry_friction_above_the_weight_holds_a_lid_half_open(tmp_path):
    asset = flap(
        tmp_path / "a", axis_y=-1.0, span=math.radians(80.0), com=(0.2, 0.0, 0.0),
        friction=1.1 * G * 0.2 * math.cos(math.radians(40.0)),
    )  # fmt: skip
    assert clauses_of(asset)["settling", "flap_joint"].message.endswith("when released half open")
    assert "stays in place" in clauses_of(asset)["settling", "flap_joint"].message


def test_a_pendulum_comes_to_rest_under_its_pivot(tmp_path):
    # it starts level and swings through 90 degrees of its 180
    asset = flap(tmp_path / "a", axis_y=1.0, span=math.pi, com=(0.2, 0.0, 0.0), damping=0.3)
    check = clauses_of(asset)["settling", "flap_joint"]
    assert check.outcome == "passed"
    assert "to 50 % of its travel" in check.message


def undamped(tmp_path: Path) -> tuple[ObjectModel, mujoco.MjModel]:
    """A pendulum of 1 kg, 0.2 m, inertia 0.002 about its middle, without any damping."""
    asset = flap(tmp_path / "a", axis_y=1.0, span=math.pi, com=(0.2, 0.0, 0.0))
    model = load_model(asset)
    return model, with_energy(model.model)


def test_the_trace_of_a_pendulum_has_its_period_and_keeps_its_energy(tmp_path):
    model, sim_model = undamped(tmp_path)
    data = mujoco.MjData(sim_model)
    data.qpos[0] = math.pi / 2 - 0.05  # hanging straight down is pi / 2
    trace = simulate(model, sim_model, data, 2.0)
    period = 2.0 * math.pi * math.sqrt((0.002 + 0.2**2) / (G * 0.2))
    expected = math.pi / 2 - 0.05 * np.cos(2.0 * math.pi * trace.times_s / period)
    assert trace.positions[:, 0] == pytest.approx(expected, abs=0.002)
    swing_j = G * 0.2 * (1.0 - math.cos(0.05))
    assert trace.rise_j < 0.05 * swing_j
    assert not trace.diverged


def test_until_still_ends_soon_after_the_motion(tmp_path):
    asset = flap(tmp_path / "a", axis_y=-1.0, span=math.radians(80.0), com=(0.2, 0.0, 0.0))
    model = load_model(asset)
    sim_model = with_energy(model.model)
    data = mujoco.MjData(sim_model)
    data.qpos[0] = math.radians(40.0)
    trace = until_still(model, sim_model, data)
    assert trace.positions[-1, 0] == pytest.approx(0.0, abs=0.02)
    assert 0.2 < trace.times_s[-1] < 5.0


@pytest.mark.parametrize(
    ("time_constant", "impedance", "outcome"),
    [(0.02, (0.9, 0.95), "failed"), (0.004, (0.99, 0.999), "passed")],
)
def test_creep_under_a_weight_that_friction_should_hold_is_measured(
    tmp_path, time_constant, impedance, outcome
):
    # steady slip of a soft friction: (1 - d) g = d v 2 / (d_max t), whatever the friction is
    friction = (
        f'solreffriction="{time_constant} 1" solimpfriction="{impedance[0]} {impedance[1]} 1"'
    )
    part = Part(name="bolt", kind="slide", axis=(0.0, 0.0, -1.0), span=0.1, mass_kg=1.0,
                boxes=BALL, friction=15.0, more=friction)  # fmt: skip
    check = clauses_of(make_object(tmp_path / "a", part))["settling", "bolt_joint"]
    low, high = impedance
    speed = (1.0 - low) / low * G * high * time_constant / 2.0
    assert check.measured == pytest.approx(2.0 * speed / 0.1, rel=0.05)
    assert check.outcome == outcome
    assert ("gives way" in check.message) == (outcome == "failed")


def test_parts_that_throw_each_other_out_make_energy(tmp_path):
    wide = (((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)),)
    part = Part(name="box", kind="slide", axis=(1.0, 0.0, 0.0), span=2.0, mass_kg=0.5, boxes=wide)
    body = (((-0.15, 0.0, 0.0), (0.1, 0.3, 0.3)),)  # 50 mm deep
    bad = clauses_of(make_object(tmp_path / "bad", part, body=body, excluded=False))
    assert bad["energy", ""].outcome == "failed"
    assert "throw each other" in bad["energy", ""].message
    good = clauses_of(make_object(tmp_path / "good", part, body=body, excluded=True))
    assert good["energy", ""].measured == pytest.approx(0.0, abs=1e-9)


def test_a_simulation_that_blows_up_is_said_so(tmp_path):
    stiff = Part(name="bolt", kind="slide", axis=(0.0, 0.0, -1.0), span=None, mass_kg=1e-3,
                 boxes=BALL, more='stiffness="1e6" springref="0.1"')  # fmt: skip
    checks = clauses_of(make_object(tmp_path / "a", stiff))
    assert {c.outcome for c in checks.values()} == {"failed"}
    assert all("blew up" in c.message for c in checks.values())


def test_energy_from_nothing_is_found(tmp_path):
    # negative damping pushes what begins to fall
    asset = flap(tmp_path / "a", axis_y=1.0, span=3.0, com=(0.2, 0.0, 0.0), damping=-2.0)
    check = clauses_of(asset)["energy", ""]
    assert check.outcome == "failed"


def test_a_rigid_object_has_nothing_to_settle(tmp_path):
    asset = make_object(tmp_path / "a")
    assert check_settling(asset, load_model(asset)) == ()
