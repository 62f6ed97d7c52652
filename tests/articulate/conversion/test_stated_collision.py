"""Collision geometry that a file states itself: used where it fits, else listed and computed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from tests.articulate.conversion.boxes import BODY_BOX, loaded, made, repairs_text

TOUCHED = '<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'


@pytest.mark.parametrize(
    ("xyz", "rpy", "rebuilt"),
    [
        ("0 0 0", "0 0 0", False),
        ("0 0 0.00001", "0 0 0", False),
        ("0.15 0 0", "0 0 0", True),
        ("0 0 0", "0 0 0.7", True),
    ],
)
def test_collision_geometry_at_another_pose_is_listed_and_computed(
    tmp_path: Path, xyz: str, rpy: str, rebuilt: bool
) -> None:
    text = TOUCHED.format(xyz=xyz, rpy=rpy, shape=BODY_BOX)
    asset = made(tmp_path, ('<link name="body">', f'<link name="body">{text}'))
    assert (
        "collision geometry of link body differs from the visual geometry" in repairs_text(asset)
    ) is rebuilt


def test_collision_geometry_at_another_pose_but_fits_is_used(tmp_path: Path) -> None:
    text = TOUCHED.format(xyz="0.002 0 0", rpy="0 0 0", shape=BODY_BOX)
    asset = made(tmp_path, ('<link name="body">', f'<link name="body">{text}'))
    assert "collision geometry" not in repairs_text(asset)
    model = loaded(asset)
    touching = next(g for g in range(model.ngeom) if model.geom_contype[g])
    seen = next(g for g in range(model.ngeom) if not model.geom_contype[g])
    away = model.geom_pos[touching] - model.geom_pos[seen]
    np.testing.assert_allclose(away, [0.002, 0.0, 0.0], atol=1e-6)


def test_collision_meshes_of_another_scale_are_listed_and_computed(tmp_path: Path) -> None:
    trimesh.creation.box((0.02, 0.3, 0.1)).export(tmp_path / "front.stl")
    text = TOUCHED.format(xyz="0 0 0", rpy="0 0 0", shape='<mesh filename="front.stl" scale="{}"/>')
    for scale, rebuilt in (("1 1 1", False), ("2 2 2", True)):
        asset = made(
            tmp_path,
            ('<link name="drawer">', f'<link name="drawer">{text.format(scale)}'),
            ('<box size="0.02 0.3 0.1"/>', '<mesh filename="front.stl"/>'),
        )
        assert ("collision geometry of link drawer differs" in repairs_text(asset)) is rebuilt
