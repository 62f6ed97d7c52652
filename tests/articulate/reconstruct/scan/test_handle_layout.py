"""Fronts without seams are divided by their handles."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.scan.handle_layout import Grip, divided, parts_by_handles
from articulate.reconstruct.scan.panels import Handle
from articulate.reconstruct.scan.propose import propose_parts
from articulate.reconstruct.scan.read_scan import LARGEST_MOVE, _smoothed
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation

FRONT = np.array([0.0, 0.0, 1.0, 0.9])


def grip(y, z, direction):
    half = {"level": (0.06, 0.007), "upright": (0.007, 0.06)}.get(direction, (0.015, 0.015))
    rect = np.array([y - half[0], z - half[1], y + half[0], z + half[1]])
    return Grip(handle=Handle(rect=rect, height=0.04), direction=direction)


@pytest.mark.parametrize(
    ("grips", "rects"),
    [
        (  # three drawers
            [(0.5, 0.15, "level"), (0.5, 0.45, "level"), (0.5, 0.75, "level")],
            [(0, 0, 1, 0.3), (0, 0.3, 1, 0.6), (0, 0.6, 1, 0.9)],
        ),
        (  # two doors
            [(0.45, 0.4, "upright"), (0.55, 0.4, "upright")],
            [(0, 0, 0.5, 0.9), (0.5, 0, 1, 0.9)],
        ),
        (  # a drawer above two doors
            [(0.5, 0.75, "level"), (0.45, 0.3, "upright"), (0.55, 0.3, "upright")],
            [(0, 0, 0.5, 0.6), (0.5, 0, 1, 0.6), (0, 0.6, 1, 0.9)],
        ),
        (  # three drawers beside a door
            [(0.45, 0.45, "upright"), *((0.2, z, "level") for z in (0.15, 0.45, 0.75))],
            [(0, 0, 0.4, 0.3), (0, 0.3, 0.4, 0.6), (0, 0.6, 0.4, 0.9), (0.4, 0, 1, 0.9)],
        ),
        (  # four drawers with knobs
            [(y, z, "round") for y in (0.25, 0.75) for z in (0.2, 0.7)],
            [(0, 0, 0.5, 0.45), (0.5, 0, 1, 0.45), (0, 0.45, 0.5, 0.9), (0.5, 0.45, 1, 0.9)],
        ),
    ],
)
def test_a_front_is_divided_between_its_handles(grips, rects):
    leaves = divided(FRONT, [grip(*one) for one in grips])
    np.testing.assert_allclose(sorted(tuple(leaf.rect) for leaf in leaves), sorted(rects))


def shell(*handles):
    """Return one closed surface of a box of 0.5 x 0.8 x 0.9 m with bars (y, z, wide, high)."""
    pieces = [trimesh.creation.box(extents=(0.5, 0.8, 0.9))]
    for y, z, wide, high in handles:
        bar = trimesh.creation.box(extents=(0.015, wide, high))
        pieces.append(bar.apply_translation([0.29, y, z]))
        for end in (-0.4, 0.4):
            post = trimesh.creation.box(extents=(0.06, 0.012, 0.012))
            offset = (end * wide, 0.0) if wide > high else (0.0, end * high)
            pieces.append(post.apply_translation([0.27, y + offset[0], z + offset[1]]))
    mesh = trimesh.boolean.union(pieces, engine="manifold")
    mesh = mesh.subdivide_to_size(0.03)
    mesh.merge_vertices()
    return ScanMesh(
        vertices=np.asarray(mesh.vertices, dtype=np.float64),
        faces=np.asarray(mesh.faces, dtype=np.int64),
        rgb=np.full((len(mesh.faces), 3), 0.7),
        group=np.zeros(len(mesh.faces), dtype=np.int64),
    )


def test_bars_on_a_closed_shell_are_those_of_drawers():
    mesh = shell((0.0, -0.3, 0.2, 0.015), (0.0, 0.0, 0.2, 0.015), (0.0, 0.3, 0.2, 0.015))
    found = propose_parts(mesh, smooth=True).parts
    assert [one.kind for one in found] == ["drawer"] * 3
    assert all(one.axis == pytest.approx([1.0, 0.0, 0.0]) for one in found)
    heights = [one.panel[3] - one.panel[1] for one in found if one.panel is not None]
    assert heights == pytest.approx([0.3] * 3, abs=0.02)


def test_upright_bars_are_those_of_doors_that_turn_about_the_other_edge():
    found = parts_by_handles(Segmentation(shell((-0.05, 0, 0.015, 0.2), (0.05, 0, 0.015, 0.2))))
    assert [one.kind for one in found] == ["door", "door"]
    assert [one.pivot[1] for one in found] == pytest.approx([-0.4, 0.4], abs=0.01)
    assert [one.axis[2] for one in found] == [-1.0, 1.0]


def test_a_bar_at_the_upper_edge_is_that_of_a_flap():
    (flap,) = parts_by_handles(Segmentation(shell((0.0, 0.35, 0.5, 0.015))))
    assert flap.kind == "flap"
    assert flap.pivot[2] < -0.4


def test_a_bar_between_two_others_is_that_of_a_drawer_though_one_handle_was_lost():
    found = parts_by_handles(
        Segmentation(
            shell((0.0, -0.35, 0.2, 0.015), (0.0, 0.05, 0.2, 0.015), (0, 0.35, 0.2, 0.015))
        )
    )
    assert [one.kind for one in found] == ["drawer"] * 3


def test_a_front_without_handles_has_no_parts():
    assert parts_by_handles(Segmentation(shell())) == []


def test_a_row_of_equal_knobs_at_the_top_is_not_divided():
    knobs = [(y, 0.4, 0.03, 0.03) for y in (-0.2, 0.0, 0.2)]
    assert parts_by_handles(Segmentation(shell(*knobs))) == []


def test_smoothing_leaves_thin_bars_where_they_are():
    mesh = shell((0.0, 0.0, 0.2, 0.015))
    moved = np.linalg.norm(_smoothed(mesh).vertices - mesh.vertices, axis=1)
    assert 0.0 < moved.max() <= LARGEST_MOVE * mesh.diagonal * (1.0 + 1e-9)
