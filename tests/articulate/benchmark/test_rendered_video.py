"""Rendered videos of operated joints."""

import numpy as np
import pytest

from articulate.benchmark.dataset import LibraryDataset
from articulate.benchmark.operated_joint import Conditions, sample_joint, sample_positions
from articulate.benchmark.rendered_video import MOVING, render_operated
from articulate.library.procedural.library import ProceduralLibrary


@pytest.fixture(scope="module")
def box():
    return LibraryDataset("procedural", ProceduralLibrary(10)).load("box_with_lid-0001")


def test_positions_stay_within_the_limits(box):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        joint = sample_joint(rng, box, "revolute", Conditions(other_joint=0.0))
        q = sample_positions(rng, joint, 50)
        assert len(q) == 50
        assert joint.lower - 0.1 <= q.min() <= q.max() <= joint.upper + 0.1
        assert np.ptp(q) > 0.3 * abs(joint.upper - joint.lower)


@pytest.mark.slow
@pytest.mark.render
def test_the_same_seed_gives_the_same_video(box):
    first = render_operated(box, 3, kind="revolute", conditions=Conditions(other_joint=0.0))
    again = render_operated(box, 3, kind="revolute", conditions=Conditions(other_joint=0.0))
    assert first is not None
    assert again is not None
    assert np.array_equal(first.video.frames, again.video.frames)
    assert first.truth == again.truth
    left, right, top, bottom = first.truth.box_px
    rows, columns = np.nonzero(first.labels[0] == MOVING)
    assert 2 * columns.min() >= left - 4
    assert 2 * columns.max() <= right + 4
    assert 2 * rows.min() >= top - 4
    assert 2 * rows.max() <= bottom + 4
