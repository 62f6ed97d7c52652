import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate_deploy.safety import safe_target, was_clipped

CONFIG = ControlConfig()
LOW, HIGH = PANDA.bounds(CONFIG.margin_rad)
ANY = st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=7, max_size=7)
WITHIN = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)


@given(ANY, WITHIN)
def test_whatever_is_wished_is_a_number_within_limits_and_one_step(wish, share):
    last = LOW + np.array(share) * (HIGH - LOW)
    sent = safe_target(np.array(wish), last, CONFIG, PANDA)
    assert np.all(np.isfinite(sent))
    assert np.all(sent >= LOW - 1e-12)
    assert np.all(sent <= HIGH + 1e-12)
    assert np.all(np.abs(sent - last) <= joint_steps(CONFIG, PANDA) + 1e-12)


@given(WITHIN)
def test_what_is_safe_is_sent_as_it_is(share):
    last = np.asarray(PANDA.home)
    wish = last + (2.0 * np.array(share) - 1.0) * joint_steps(CONFIG, PANDA)
    sent = safe_target(wish, last, CONFIG, PANDA)
    assert not was_clipped(wish, sent)


def test_what_was_clipped_is_seen_as_such():
    assert was_clipped(np.zeros(7), np.full(7, 1e-6))
    assert was_clipped(np.full(7, np.nan), np.zeros(7))
