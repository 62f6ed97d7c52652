"""Objects generated from a box and its front."""

from __future__ import annotations

import numpy as np
import pytest

from articulate.reconstruct.fitting.box_fit import BoxFit
from articulate.reconstruct.fitting.categories import generate
from articulate.reconstruct.fitting.front_network import FrontPart
from articulate.reconstruct.fitting.object_front import ObjectFront
from articulate.render.camera import look_at, pinhole


@pytest.mark.parametrize("base_share", [0.0, 0.5, 0.93, 1.0])
@pytest.mark.parametrize("category", ["StorageFurniture", "Table"])
def test_legs_leave_room_for_the_front(category: str, base_share: float) -> None:
    layout = generate(category, front_with((), base_share), 0.75).layout
    assert layout is not None
    low, high = layout.front_z
    assert high - low > 0.05
    assert low <= 0.75 * base_share + 1e-3
    if base_share <= 0.5:
        assert low == pytest.approx(0.75 * base_share, abs=1e-3)


@pytest.mark.parametrize("category", ["Oven", "Dishwasher"])
def test_a_strip_below_the_door_is_no_drawer(category: str) -> None:
    strip = FrontPart(
        left=0.0,
        right=1.0,
        bottom=0.0,
        top=0.06,
        kinds=np.array([0.1, 0.9, 0.0, 0.0, 0.0]),
        support=0.9,
    )
    layout = generate(category, front_with((strip,), 0.0), 0.88).layout
    assert layout is not None
    assert [panel.kind for panel in layout.panels] == ["panel", "flap"]


def front_with(parts: tuple[FrontPart, ...], base_share: float) -> ObjectFront:
    """Return the front of a wide box."""
    camera = pinhole(
        width_px=64,
        height_px=64,
        fovy_rad=0.6,
        T_wc=look_at(np.array([4.0, 0.0, 1.0]), np.zeros(3)),
    )
    fit = BoxFit(width=1.5, depth=0.8, camera=camera, overlap=0.9, cost=0.1, parameters={})
    return ObjectFront(
        fit=fit,
        image=np.zeros((40, 60, 3), dtype=np.uint8),
        parts=parts,
        base_share=base_share,
        visible=1.0,
    )
