"""Panels with handles that the gripper can hold."""

import numpy as np
import pytest

from generalist_panels import KINDS, panel_parts, write_panel

WITHOUT_HANDLE = {
    "panel_edge_door", "panel_edge_drawer", "panel_thin_lid",
    "panel_hook_drawer", "panel_hook_door", "panel_hook_lid",
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(1, 20))
def test_a_panel_has_one_joint_and_something_to_hold(kind, seed):
    body, panel = panel_parts(kind, seed)
    assert body.motion is None
    assert panel.motion is not None
    assert panel.motion.kind == ("prismatic" if kind.endswith("drawer") else "revolute")
    handle = next((one for one in panel.shapes if "handle" in one.name), panel.shapes[0])
    assert ("handle" in handle.name) == (kind not in WITHOUT_HANDLE)
    for solid in handle.solids:
        corners = solid.mesh()[0]
        assert np.all(corners.max(axis=0) - corners.min(axis=0) > 0.002)


def test_the_same_id_gives_the_same_file(tmp_path):
    first, second = (write_panel("panel_lid-0003", tmp_path / name) for name in "ab")
    assert first.read_bytes() == second.read_bytes()


def test_handles_of_small_doors_are_near_the_hinge():
    for seed in range(1, 20):
        _, panel = panel_parts("panel_small_door", seed)
        handle = next(one for one in panel.shapes if "handle" in one.name)
        corners = np.concatenate([solid.mesh()[0] for solid in handle.solids])
        middle = (corners.max(axis=0) + corners.min(axis=0)) / 2.0
        assert np.hypot(middle[0], middle[1]) < 0.26  # the link's frame is at the hinge
        assert abs(middle[1]) > 0.05


def test_levers_turn_about_the_normal_of_the_front():
    for seed in range(1, 20):
        _, panel = panel_parts("panel_lever_door", seed)
        assert panel.motion is not None
        assert tuple(abs(a) for a in panel.motion.axis) == (1.0, 0.0, 0.0)
        corners = np.concatenate([solid.mesh()[0] for solid in panel.shapes[0].solids])
        assert np.hypot(corners[:, 1], corners[:, 2]).max() > 0.06  # an arm, from the hinge
        assert corners[:, 0].max() < 0.0  # in front of it
