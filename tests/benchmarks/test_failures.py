"""The failed episodes of a policy that learned nothing are all there, and told as they were."""

import numpy as np
import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

import failures
from watched import watch


@pytest.mark.parametrize(
    ("width_mm", "closed", "when"),
    [
        ([80, 60, 41, 41, 41, 41, 41, 10], 1, 7),
        ([80, 60, 41, 41, 41, 41, 41, 41], 1, None),
        ([80, 60, 41, 10, 0, 0, 0, 0], 1, None),  # never held
        ([41, 41, 41, 41, 41, 60, 80, 80], 0, None),  # let go
        ([41, 41, 41, 41, 41, 33, 26, 24], 1, 7),  # 0.6 of 41 mm are 24.6
    ],
)
def test_a_hold_is_lost_when_the_fingers_come_together(width_mm, closed, when):
    width = 1e-3 * np.array(width_mm, dtype=float)
    assert failures.slip(width, np.full(8, bool(closed)), 0.041) == when


def test_every_episode_of_a_policy_that_learned_nothing_is_listed(tmp_path):
    run = make_run(tmp_path / "run", make_cabinet(tmp_path / "cabinet"), episode_s=1.0)
    seen = watch(run, 0, episodes=3, draws=5)
    found = failures.failures(seen)
    assert [f.episode for f in found] == [0, 1, 2]
    for failure in found:
        assert failure.reason != "success"
        assert 0 <= failure.tick < seen.scene.ticks - 1
        assert 0.0 <= failure.width_mm <= 82.0
        assert failure.drawn["hand_latency_s"] >= 0.1
        assert failures.line(failure).startswith(f"{failure.episode:4d} {failure.reason}")
