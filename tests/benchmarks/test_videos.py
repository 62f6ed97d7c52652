"""Joints of proposed objects are compared with the truth in the frame of the object's box."""

from __future__ import annotations

import numpy as np
import pytest

import videos
from articulate.benchmark.dataset import LibraryDataset
from articulate.library.procedural.front_layout import FrontLayout, HingeSide, grid
from articulate.library.procedural.library import ProceduralLibrary
from articulate.reconstruct.proposal import ObjectProposal


def proposal(hinge: HingeSide) -> ObjectProposal:
    layout = FrontLayout(
        panels=grid(1, 1, "door", hinges=(hinge,)), width_m=0.6, depth_m=0.5, height_m=0.8
    )
    return ObjectProposal(
        name="furniture",
        category="StorageFurniture",
        parts=tuple(layout.parts()),
        confidence=0.9,
        evidence={"door_0": "video"},
    )


@pytest.mark.parametrize(
    ("hinge", "upper", "side", "in_range"),
    [("left", 1.75, True, True), ("right", 1.75, False, True), ("left", 3.1, True, False)],
)
def test_side_axis_and_range_of_a_door(
    hinge: HingeSide, upper: float, side: bool, in_range: bool
) -> None:
    truth = {
        "category": "StorageFurniture",
        "kind": "door",
        "type": "revolute",
        "axis": list(videos.OPENING_AXES["left"]),
        "range": upper,
    }
    row = videos.compare(proposal(hinge), truth)
    assert row["kind_right"]
    assert row["axis_right"]
    assert (row["side_right"], row["range_right"]) == (side, in_range)
    assert videos.right(row) == side


def test_a_drawer_opens_to_the_front_and_a_lid_about_its_rear_edge() -> None:
    library = LibraryDataset("procedural", ProceduralLibrary(10))
    for name, axis in (("chest_of_drawers-0001", (1, 0, 0)), ("box_with_lid-0001", (0, -1, 0))):
        true = library.load(name)
        found, span = videos.opening(true, true.joints[0])
        assert np.allclose(found, axis)
        assert span is not None
        assert span > 0.0
