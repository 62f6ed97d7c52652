import pytest

from articulate.simulator import mujoco
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import apply_physics


@pytest.mark.parametrize(("step_s", "count"), [(0.005, 10), (0.002, 25), (0.001, 50), (0.05, 1)])
def test_a_tick_holds_a_whole_number_of_steps(step_s, count):
    assert PhysicsConfig(timestep_s=step_s).substeps(0.05) == count


def test_a_step_that_does_not_divide_the_tick_is_refused(error_line):
    error_line(
        "PhysicsConfig(timestep_s=0.003).substeps(0.05)",
        lambda: PhysicsConfig(timestep_s=0.003).substeps(0.05),
    )


def test_settings_reach_the_model():
    config = PhysicsConfig(timestep_s=0.001, cone="pyramidal", impratio=3.0, iterations=7)
    spec = mujoco.MjSpec()
    apply_physics(spec, config)
    option = spec.compile().opt
    assert (option.timestep, option.impratio, option.iterations) == (0.001, 3.0, 7)
    assert option.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL


def test_a_state_that_diverges_is_not_quietly_begun_anew():
    spec = mujoco.MjSpec()
    apply_physics(spec, PhysicsConfig())
    assert spec.option.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET
