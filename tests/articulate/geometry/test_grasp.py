"""Fingers hold a handle where their tips clear what stands behind it."""

import math

import numpy as np
import pytest
import trimesh

from articulate.geometry.grasp import (
    BITE_M,
    CLEAR_M,
    DEEP_M,
    DEEPEST_M,
    LEAST_BITE_M,
    TIP_M,
    best_grasp,
    held_depth,
    room_behind,
)

X, Y, Z = np.eye(3)


def front_with(piece, *, out_m):
    """A front in the plane x = 0 seen from +x, and a piece that stands out to ``out_m``."""
    panel = trimesh.creation.box((0.02, 0.4, 0.3))
    panel.apply_translation((-0.01, 0.0, 0.0))
    piece = piece.copy()
    piece.apply_translation((out_m - piece.bounds[1, 0], 0.0, 0.0))
    owner = np.r_[np.ones(len(panel.faces), int), np.full(len(piece.faces), 2)]
    return trimesh.util.concatenate([panel, piece]), owner


def knob(depth_m):
    return trimesh.creation.box((depth_m, 0.03, 0.03))


@pytest.mark.parametrize("out_m", [0.012, 0.018, 0.022, 0.027, 0.035, 0.05])
def test_tips_clear_the_front_behind_a_knob_as_far_as_they_can(out_m):
    """A knob that stands ``out_m`` off its front leaves that much room behind its own front."""
    surface, owner = front_with(knob(out_m), out_m=out_m)
    grasp = best_grasp(surface, owner, opening=X, far_from=None)
    assert grasp is not None
    tips_m = float(grasp.pos_o @ X) - TIP_M
    bite_m = out_m - tips_m
    assert tips_m >= min(CLEAR_M, out_m - LEAST_BITE_M) - 1e-6
    assert bite_m >= LEAST_BITE_M - 1e-6
    assert bite_m <= DEEPEST_M + TIP_M + 1e-6


def test_bar_with_room_behind_it_is_held_as_deep_as_it_would_be_alone():
    surface, owner = front_with(trimesh.creation.box((0.012, 0.16, 0.012)), out_m=0.05)
    grasp = best_grasp(surface, owner, opening=X, far_from=None)
    assert grasp is not None
    assert float(grasp.pos_o @ X) == pytest.approx(0.05 - DEEP_M, abs=1e-6)


@pytest.mark.parametrize(
    ("thick_m", "free_m", "depth_m"),
    [
        (0.018, math.inf, 0.009),
        (0.012, math.inf, DEEP_M),
        (0.002, math.inf, DEEP_M),
        (0.002, 0.02, 0.02 - CLEAR_M - TIP_M),
        (0.05, math.inf, DEEPEST_M),
        (0.05, DEEPEST_M + TIP_M + CLEAR_M, DEEPEST_M),
        (0.05, 0.02, 0.02 - CLEAR_M - TIP_M),
        (0.05, LEAST_BITE_M, LEAST_BITE_M - TIP_M),
        (0.05, BITE_M[1], BITE_M[1] - TIP_M),
    ],
)
def test_pads_go_half_through_a_least_way_or_as_far_as_room_allows(thick_m, free_m, depth_m):
    assert held_depth(thick_m, free_m) == pytest.approx(depth_m)


def test_room_behind_is_the_distance_to_the_first_thing_fingers_would_meet():
    surface, _ = front_with(knob(0.02), out_m=0.02)
    at = np.array([0.02, 0.0, 0.0])
    assert room_behind(surface, at, X, Z, 0.03) == pytest.approx(0.02, abs=1e-9)
    stud = trimesh.creation.box((0.013, 0.002, 0.002))
    stud.apply_translation((0.0065, 0.03, 0.0))
    narrow = trimesh.creation.box((0.005, 0.1, 0.1))
    narrow.apply_translation((0.0105, 0.07, 0.0))
    crowded = trimesh.util.concatenate([surface, narrow])
    assert room_behind(crowded, at, X, Z, 0.03) == pytest.approx(0.007, abs=1e-9)
    assert room_behind(stud, np.array([5.0, 0.0, 0.0]), X, Z, 0.03) == math.inf


@pytest.mark.parametrize("gap_m", [0.0, 0.0005])
def test_knob_of_many_pieces_is_held_like_the_knob_in_one(gap_m):
    """Convex decomposition leaves pieces side by side; one of them is not what a hand holds."""
    whole, owner = front_with(knob(0.028), out_m=0.028)
    cells = []
    for x, y, z in np.ndindex(4, 3, 3):
        cell = trimesh.creation.box((0.007 - gap_m, 0.01 - gap_m, 0.01 - gap_m))
        cell.apply_translation((0.007 * x, 0.01 * (y - 1), 0.01 * (z - 1)))
        cells.append(cell)
    pieces, owners = front_with(trimesh.util.concatenate(cells), out_m=0.028)
    want = best_grasp(whole, owner, opening=X, far_from=None)
    got = best_grasp(pieces, owners, opening=X, far_from=None)
    assert want is not None
    assert got is not None
    assert got.pos_o == pytest.approx(want.pos_o, abs=2e-3)
    assert got.extent == pytest.approx(want.extent, abs=2e-3)


def test_pieces_that_run_on_into_a_panel_do_not_count_as_what_is_held():
    """A rib of 12 mm on a panel of many strips, all of one part without a named handle."""
    strips = []
    for k in range(40):
        strip = trimesh.creation.box((0.02, 0.01, 0.3))
        strip.apply_translation((-0.01, 0.01 * (k - 20), 0.0))
        strips.append(strip)
    rib = trimesh.creation.box((0.03, 0.012, 0.2))
    rib.apply_translation((0.015, 0.0, 0.0))
    surface = trimesh.util.concatenate([*strips, rib])
    grasp = best_grasp(surface, np.ones(len(surface.faces), int), opening=X, far_from=None)
    assert grasp is not None
    assert grasp.extent[1] == pytest.approx(0.012, abs=1e-6)
    assert float(grasp.pos_o @ X) < 0.03


def test_rim_of_a_leaf_that_does_not_lie_flat_is_as_thick_as_the_leaf():
    """Over its whole depth a leaf tilted by 3 degrees rises by three times its thickness."""
    leaf = trimesh.creation.box((0.3, 0.3, 0.005))
    leaf.apply_transform(trimesh.transformations.rotation_matrix(math.radians(3.0), Y))
    base = trimesh.creation.box((0.2, 0.3, 0.02))
    base.apply_translation((-0.04, 0.0, -0.05))
    surface = trimesh.util.concatenate([leaf, base])
    owner = np.r_[np.ones(len(leaf.faces), int), np.zeros(len(base.faces), int)]
    hinge = np.array([[-0.15, 0.0, 0.0], Y])
    grasp = best_grasp(surface, owner, opening=Z, far_from=hinge)
    assert grasp is not None
    assert grasp.kind == "edge"
    assert grasp.extent[1] == pytest.approx(0.005 / math.cos(math.radians(3.0)), abs=1e-3)
    along_leaf = float(grasp.pos_o @ X)
    assert float(grasp.pos_o @ Z) == pytest.approx(
        -along_leaf * math.tan(math.radians(3.0)), abs=5e-4
    )
