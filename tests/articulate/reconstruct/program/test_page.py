"""The reference page of the language agrees with its tables."""

import re
from pathlib import Path

import pytest
from tests.articulate.reconstruct.program import scenes
from tests.articulate.reconstruct.program.hostile import attacks

from articulate.reconstruct.program import language
from articulate.reconstruct.program.allow_list import check
from articulate.reconstruct.program.materials import MATERIALS
from articulate.reconstruct.program.reference import reference
from articulate.reconstruct.program.sandbox import SandboxLimits

ROOT = Path(__file__).resolve().parents[4]
PAGE = (ROOT / "docs" / "reference" / "program.md").read_text(encoding="utf-8")


def rows(head):
    found = re.search(rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.MULTILINE)
    assert found, head
    return [[c.strip() for c in row.strip("|").split("|")] for row in found[1].splitlines()]


def test_the_table_of_functions_is_that_of_the_language():
    listed = [call for row in rows("function") for call in re.findall(r"`([^`]+)`", row[0])]
    assert listed == [function.line(name) for name, function in language.FUNCTIONS.items()]


def test_every_placement_is_named():
    sides = {name.removesuffix("_inside") for name in language.PLACEMENTS}
    assert all(f"`{side}`" in PAGE for side in sides)
    assert {f"{side}_inside" for side in sides - {"inside"}} <= set(language.PLACEMENTS)


def test_every_helper_and_attribute_is_named():
    for name in (*language.HELPERS, *language.CONSTANTS, *language.VECTOR_FIELDS):
        assert re.search(rf"\b{name}\b", PAGE), name
    assert all(f".{name}" in PAGE for name in language.BOX_FIELDS if name != "center")


def test_every_material_is_named():
    [row] = [row for row in rows("function") if row[0].startswith("`material(")]
    assert re.findall(r"`(\w+)`", row[1]) == list(MATERIALS)


def test_the_limits_are_those_of_the_code():
    limits = SandboxLimits()
    for text in (
        f"{language.MAX_SOURCE:,} characters",
        f"nesting of {language.MAX_DEPTH}",
        f"{language.MAX_STEPS:,} steps",
        f"{language.MAX_ITEMS:,} items",
        f"{limits.seconds:g} s",
        f"{limits.memory_bytes / 1e6:g} MB",
    ):
        assert text in PAGE, text


def test_the_kinds_of_errors_are_listed():
    assert [row[0] for row in rows("kind")] == ["`syntax`", "`rule`", "`value`", "`limit`"]


def test_the_number_of_attacks_is_that_of_the_suite():
    assert f"{len(attacks())} named attacks" in PAGE


def test_the_programs_of_the_page_run():
    first = re.search(r'program = """\n(.*?)"""', PAGE, re.DOTALL)
    assert first is not None
    parts = {
        "body": scenes.box((0.4, 0.5, 0.7)),
        "door": scenes.box((0.02, 0.5, 0.7)),
        "knob": scenes.box((0.04, 0.04, 0.04)),
    }
    assert len(scenes.built(first[1], parts).joints) == 2
    [loop] = re.findall(r"^```text\n(for .*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    drawers = {f"drawer_{k}": scenes.box((0.36, 0.45, 0.2)) for k in range(3)}
    built = scenes.built(loop, {"body": scenes.parts()["body"], **drawers})
    assert [joint.kind for joint in built.joints] == ["prismatic"] * 3


def test_the_reference_names_everything_and_is_short():
    text = reference()
    for name in (*language.FUNCTIONS, *language.HELPERS, *language.PLACEMENTS, *MATERIALS):
        assert re.search(rf"\b{name}\b", text), name
    for name, function in language.FUNCTIONS.items():
        assert function.line(name) in text
    assert len(text) < 6000


@pytest.mark.parametrize(
    "source",
    [
        "import os",
        "class A:\n    pass",
        "while True:\n    pass",
        "f = lambda: 1",
        "try:\n    pass\nfinally:\n    pass",
        "x = [1].append(2)",
        "x: int = 1",
        "x = [1, 2][0:1]",
        "if (y := 1):\n    pass",
    ],
)
def test_constructs_that_the_page_excludes_are_rejected(source):
    assert isinstance(check(source), language.RuleViolation)
