"""What docs/program.md promises is so."""

import re
from pathlib import Path

import pytest
from tests.articulate.reconstruct.program import scenes
from tests.articulate.reconstruct.program.hostile import attacks

from articulate.reconstruct.program import api, interpret, language
from articulate.reconstruct.program.allow_list import check
from articulate.reconstruct.program.materials import DEFAULT, MATERIALS
from articulate.reconstruct.program.reference import reference
from articulate.reconstruct.program.sandbox import SandboxLimits

ROOT = Path(__file__).resolve().parents[4]
PAGE = (ROOT / "docs" / "program.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"^```text\n# program\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def rows(head):
    found = re.search(rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.MULTILINE)
    assert found, head
    return [[c.strip() for c in row.strip("|").split("|")] for row in found[1].splitlines()]


def test_the_table_of_functions_is_that_of_the_language():
    format_value = [(row[0].strip("`"), row[1]) for row in rows("function")]
    known = [
        (function.line(name), function.about[0].lower() + function.about[1:].rstrip("."))
        for name, function in language.FUNCTIONS.items()
    ]
    assert format_value == known


def test_the_table_of_placements_is_that_of_the_language():
    assert {name.strip("`"): words for name, words in rows("placement")} == language.PLACED


def test_every_helper_and_attribute_is_named():
    for name in (*language.HELPERS, *language.CONSTANTS, *language.ATTRIBUTES):
        assert re.search(rf"\b{name}\b", PAGE), name


def test_the_table_of_materials_is_that_of_the_code():
    format_value = {
        re.findall(r"`(\w+)`", name)[0]: [float(rho), float(mm)]
        for name, rho, mm in rows("material")
    }
    assert list(format_value) == list(MATERIALS)
    for name, material in MATERIALS.items():
        assert format_value[name] == pytest.approx([material.density, 1e3 * material.wall_m])
    assert f"`{DEFAULT}` (default)" in PAGE


def test_the_bounds_are_those_of_the_code():
    format_value = [re.findall(r"[\d.,e]+", row[1].replace(",", "")) for row in rows("bound")]
    limits = SandboxLimits()
    known = [
        [language.MAX_SOURCE], [language.MAX_DEPTH],
        [language.MAX_LOOPS, language.MAX_ITEMS, language.MAX_ROUNDS], [language.MAX_STEPS],
        [language.MAX_ITEMS, interpret.MAX_TOTAL], [language.MAX_TEXT],
        [language.MAX_NUMBER, language.MAX_POWER], [api.MOST_CALLS, api.MOST_SNAPS],
        [limits.seconds, limits.cpu_s, limits.memory_bytes / 1e6],
    ]  # fmt: skip
    assert [[float(value) for value in row] for row in format_value] == known


def test_the_number_of_attacks_is_told():
    safety = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
    found = attacks()
    assert f"{len(found)} named attacks in {len({a.family for a in found})} families" in safety


@pytest.mark.parametrize("number", range(len(PROGRAMS)))
def test_the_programs_of_the_page_run(number):
    parts = scenes.parts() | {"lid": scenes.box((0.4, 0.5, 0.02))}
    parts |= {f"drawer_{k}": scenes.box((0.36, 0.45, 0.2)) for k in range(3)}
    assert len(PROGRAMS) == 3
    built = scenes.built(PROGRAMS[number], parts)
    assert len(built.joints) == len(parts) - 1


def test_the_reference_names_everything_and_every_line_is_short():
    text = reference()
    for name in (*language.FUNCTIONS, *language.HELPERS, *language.PLACEMENTS, *MATERIALS):
        assert re.search(rf"\b{name}\b", text), name
    for name, function in language.FUNCTIONS.items():
        assert function.line(name) in text
    assert len(text) < 6000


def test_what_the_page_says_there_is_not_is_refused():
    for source in ("import os", "class A:\n    pass", "while True:\n    pass", "f = lambda: 1",
                   "try:\n    pass\nfinally:\n    pass", "x = [1].append(2)", "x: int = 1",
                   "x = [1, 2][0:1]", "if (y := 1):\n    pass"):  # fmt: skip
        assert isinstance(check(source), language.RuleViolation)
