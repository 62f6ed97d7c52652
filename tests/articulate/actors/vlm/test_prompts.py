from __future__ import annotations

from importlib import resources

import pytest

from articulate.actors.vlm.prompts import NAMES, prompt

GAPS = {
    "frame": set(),
    "joint_program": {"which", "reference"},
    "link_program": {"look", "reference"},
    "movers": {"which"},
    "picks": {"candidates"},
    "critic": {"by", "joints"},
}


@pytest.mark.parametrize("name", NAMES)
def test_a_prompt_has_a_version_and_its_gaps(name):
    found = prompt(name)
    assert found.version >= 1
    assert found.gaps == GAPS[name]
    filled = found.filled(**{gap: f"<{gap}>" for gap in found.gaps})
    assert "$" not in filled
    assert all(f"<{gap}>" in filled for gap in found.gaps)


def test_every_file_is_listed():
    files = {p.name for p in resources.files("articulate.actors.vlm.prompts").iterdir()}
    assert {f"{name}.txt" for name in NAMES} == {name for name in files if name.endswith(".txt")}


def test_a_gap_that_is_not_filled_is_a_bug():
    with pytest.raises(ValueError, match=r"movers: gaps \['which'\], values \[\]"):
        prompt("movers").filled()
