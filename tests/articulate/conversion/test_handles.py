"""A handle has a frame for a part around its axis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.articulate.conversion.boxes import made

HINGE = ('type="prismatic"', 'type="revolute"')
AXES = {"upright": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "level": (1.0, 0.0, 0.0)}


@pytest.mark.parametrize("which", AXES)
def test_a_part_around_its_axis_has_a_handle_with_a_frame(tmp_path: Path, which: str) -> None:
    axis = " ".join(f"{v:g}" for v in AXES[which])
    asset = made(
        tmp_path,
        HINGE,
        ('<axis xyz="-1 0 0"/>', f'<axis xyz="{axis}"/>'),
        ('<box size="0.02 0.3 0.1"/>', '<box size="0.06 0.06 0.06"/>'),
        ('xyz="-0.22 0 0"', 'xyz="0 0 0.3"'),
    )
    (handle,) = asset.handles
    normal, along = np.array(handle.normal_l), np.array(handle.along_l)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert np.linalg.norm(along) == pytest.approx(1.0)
    assert normal @ along == pytest.approx(0.0, abs=1e-9)
