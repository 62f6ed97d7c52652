"""The guard refuses every attack and lets ordinary programs pass."""

import ast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.articulate.reconstruct.program.hostile import attacks

from articulate.reconstruct.program.allow_list import PLAIN, WHY, check
from articulate.reconstruct.program.language import FUNCTIONS, MAX_SOURCE, RuleViolation

ALL = attacks()
CABINET = '''
"""A cabinet with doors on both sides."""
WIDTH = 0.4
sides = {"left": -1, "right": 1}

def hinge(name, side=1):
    b = box(name)
    y = b.low.y if side < 0 else b.high.y
    return vec(b.low.x, y, b.centre.z)

for k, name in enumerate(["door_left", "door_right"]):
    side = -1 if k == 0 else 1
    place_relative_to(name, "body", placement="front", clearance=0.001)
    move(name, (0, side * WIDTH / 2, 0))
    revolute(name, "body", axis=(0, 0, -side), pivot=hinge(name, side=side), lower=0,
             upper=radians(110), name=f"{name}_hinge")
    if len(vertices(name)) > 3 and not (norm(box(name).size) <= 0.01 or k > 5):
        continue
heights = [corner.z for corner in corners("body") if corner.z > 0]
top = max(heights) ** 2 // 1 % 7
'''


def test_there_are_two_hundred_attacks_and_more_with_names_of_their_own():
    assert len(ALL) >= 200
    assert len({str(attack) for attack in ALL}) == len(ALL)
    assert len({attack.family for attack in ALL}) >= 25


@pytest.mark.parametrize("attack", ALL, ids=str)
def test_every_attack_is_refused_with_its_place_and_a_sentence(attack):
    found = check(attack.source)
    assert isinstance(found, RuleViolation)
    assert found.kind in {"rule", "syntax"}
    assert 10 < len(found.message) < 600
    assert "\n" not in found.message
    lines = attack.source.count("\n") + 1
    if "characters" in found.message and "accepted" in found.message and found.line == 0:
        assert len(attack.source) > MAX_SOURCE  # no place is to blame
    else:
        assert 1 <= found.line <= lines + 1
        assert found.column >= 1


def test_an_ordinary_program_passes():
    assert isinstance(check(CABINET), ast.Module)


def test_an_empty_program_passes():
    assert isinstance(check(""), ast.Module)


def test_texts_and_comments_may_hold_any_letters():
    assert isinstance(check('x = "Türgriff 門"  # größer als 90°\n'), ast.Module)


@pytest.mark.parametrize(
    ("source", "line", "column", "words"),
    [
        ("x = 1\nwhile x:\n    pass", 2, 1, "for k in range"),
        ("b = box('a')\ny = b.__class__", 2, 5, "allowed after a dot"),
        ("import math", 1, 1, "imports are not needed"),
        ("place('a')", 1, 1, "position missing; write place(part, position, rpy=(0.0, 0.0, 0.0))"),
        ("place('a', (0, 0, 0), angle=3)", 1, 23, "'angle' is unknown"),
        ("box(\n  'a',\n  'b')", 1, 1, "too many arguments; write box(part)"),
        ("x = y + 1", 1, 5, "'y' is not known; assign it first"),
        ("def f():\n    return f()", 2, 12, "calls itself"),
        ("x = 'ä' + open('f')", 1, 11, "'open' is no function"),
        ("x = 3 ** 9", 1, 5, "at most 8"),
        ("for k in range(5000):\n  pass", 1, 10, "at most 2000 rounds"),
        ("x = f'{1:.2f}'", 1, 0, "without ! or :"),
        ("x = (1,\n", 1, 5, "not Python: '(' was never closed"),
        ("range = 3", 1, 1, "is a name of the language"),
    ],
)
def test_a_refusal_names_the_place_and_what_to_do(source, line, column, words):
    found = check(source)
    assert isinstance(found, RuleViolation)
    assert (found.line, words in found.message) == (line, True), found
    if column:
        assert found.column == column


def test_every_node_of_python_is_allowed_looked_at_or_refused():
    """A node that a new Python brings is refused, for it stands in no list."""
    allowed = {kind.__name__ for kind in PLAIN}
    assert not allowed & {kind.__name__ for kind in WHY}
    assert not allowed & {"Attribute", "Call", "Name", "Import", "While", "Lambda", "ClassDef"}


@given(st.text(max_size=200))
def test_no_text_makes_the_guard_raise(source):
    assert isinstance(check(source), ast.Module | RuleViolation)


SNIPPETS = [
    "x = 1\n", "for k in range(3):\n", "    x = x + k\n", "(", ")", "[", "f'{x}'", "lambda: ", "\n",
    "box('a')", ".low", ".__class__", "-", " not ", "**", "if x:\n", "import os\n", "*", "@", ":=",
    "'", "\\", "#", "\t", "async ", "def f(a):\n    return a\n",
]  # fmt: skip


@given(st.lists(st.sampled_from(SNIPPETS), max_size=30))
def test_no_mixture_of_python_makes_the_guard_raise(pieces):
    found = check("".join(pieces))
    if isinstance(found, ast.Module):
        for node in ast.walk(found):
            assert not isinstance(node, ast.Import | ast.Lambda | ast.While | ast.Starred)
            assert not (isinstance(node, ast.Attribute) and "_" in node.attr)


def test_each_function_can_be_called_with_its_own_arguments():
    for name, function in FUNCTIONS.items():
        arguments = ", ".join(f"{key}='a'" for key in function.names)
        assert isinstance(check(f"{name}({arguments})"), ast.Module), name
