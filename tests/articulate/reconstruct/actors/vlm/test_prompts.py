from __future__ import annotations

from importlib import resources

import numpy as np
import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import box

from articulate.reconstruct.actors.vlm.programs import (
    joints_error,
    parts_of_meshes,
    placements_in,
    program_joints,
)
from articulate.reconstruct.actors.vlm.prompts import NAMES, prompt
from articulate.reconstruct.program.result import ProgramObject
from articulate.reconstruct.program.run import run_program

GAPS = {
    "frame": set(),
    "joint_program": {"which", "reference"},
    "link_program": {"hint", "reference"},
    "movers": {"which"},
    "choices": {"candidates"},
    "critic": {"criterion", "joints"},
    "link_critic": set(),
    "affordance": set(),
    "object_detector": set(),
    "category_selector": {"categories"},
    "object_selector": {"description"},
    "task_specifier": set(),
    "layout_planner": set(),
    "part_annotator": {"parts"},
}


@pytest.mark.parametrize("name", NAMES)
def test_a_prompt_has_a_version_and_its_gaps(name):
    found = prompt(name)
    assert found.version >= 1
    assert found.placeholders == GAPS[name]
    filled = found.filled(**{gap: f"<{gap}>" for gap in found.placeholders})
    assert "$" not in filled
    assert all(f"<{gap}>" in filled for gap in found.placeholders)


def test_every_file_is_listed():
    files = {p.name for p in resources.files("articulate.reconstruct.actors.vlm.prompts").iterdir()}
    assert {f"{name}.txt" for name in NAMES} == {name for name in files if name.endswith(".txt")}


def test_a_gap_that_is_not_filled_is_a_bug():
    with pytest.raises(ValueError, match=r"movers: placeholders \['which'\], values \[\]"):
        prompt("movers").filled()


def example(name):
    """The program at the end of a prompt."""
    return prompt(name).text.split(":\n\n")[-1] + "\n"


def test_the_example_of_joints_is_a_door_that_opens_to_the_front():
    meshes = (
        box("body", (-0.3, -0.4, 0.0), (0.3, 0.4, 1.0), (0.5, 0.5, 0.5)),
        box("door", (0.3, -0.4, 0.0), (0.32, 0.4, 1.0), (0.5, 0.5, 0.5)),
        box("grip", (0.32, -0.38, 0.4), (0.35, -0.35, 0.6), (0.5, 0.5, 0.5)),
    )
    built = run_program(example("joint_program"), parts_of_meshes(meshes))
    assert isinstance(built, ProgramObject), built
    assert joints_error(built) == ""
    joints = {joint.part: joint for joint in program_joints(built)}
    assert (joints["grip"].kind, joints["grip"].parent) == ("fixed", "door")
    grip = joints["door"].T_o(joints["door"].upper or 0.0) @ np.append(meshes[2].centre, 1.0)
    assert grip[0] > 0.9


def test_the_example_of_places_is_a_chest_on_the_floor_with_drawers_in_a_row():
    meshes = (
        box("body", (-0.3, -0.4, -0.5), (0.3, 0.4, 0.5), (0.5, 0.5, 0.5)),
        box("drawer_a", (-0.2, -0.35, -0.2), (0.2, 0.35, 0.2), (0.5, 0.5, 0.5)),
        box("drawer_b", (-0.2, -0.35, -0.2), (0.2, 0.35, 0.2), (0.5, 0.5, 0.5)),
    )
    built = run_program(example("link_program"), parts_of_meshes(meshes))
    assert isinstance(built, ProgramObject), built
    places = {name: T[:3, 3] for name, T in placements_in(built).items()}
    np.testing.assert_allclose(places["body"], (0.0, 0.0, 0.5), atol=1e-9)
    np.testing.assert_allclose(places["drawer_a"], (0.1, 0.0, 0.75), atol=1e-9)
    np.testing.assert_allclose(places["drawer_b"], (0.1, 0.0, 0.25), atol=1e-9)
