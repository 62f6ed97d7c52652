"""The interpreter computes what Python computes, and stops where values grow too large."""

import ast
import json
import math
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from articulate.reconstruct.program.allow_list import check
from articulate.reconstruct.program.interpret import interpret
from articulate.reconstruct.program.parse import RuleError
from articulate.reconstruct.program.values import InvalidValueError


def run(source, answer=lambda name, arguments: None):
    """Calls that a program makes, as (name, arguments, (line, column))."""
    tree = check(source)
    assert isinstance(tree, ast.Module), tree
    calls = []

    def ask(name, arguments, at):
        calls.append((name, arguments, at))
        return answer(name, arguments)

    interpret(tree, ask)
    return calls


def value(expression, before=""):
    """What an expression gives."""
    return run(f"{before}\nmove('a', {expression})")[0][1]["by"]


def outcome(source):
    """What ``move`` gets, or why it never does."""
    try:
        return run(source)[0][1]["by"], None
    except RuleError as refused:
        return None, refused.violation.message


def rejection(source):
    with pytest.raises(RuleError) as caught:
        run(source)
    return caught.value.violation


@pytest.mark.parametrize(
    "expression",
    [
        "1 + 2 * 3 - 4 / 8", "7 // 2 - 7 % 3", "2 ** 3 + (-2) ** -2", "-(3 - 5)",
        "1 if 2 > 1 else 5",
        "min(3, 1, 2) + max([4, 5]) + abs(-6)", "sum([1, 2, 3]) + len('abcd')", "round(2.567, 2)",
        "sin(0.3) + cos(0.2) * tan(0.1)", "atan2(1, 2) + asin(0.5) + acos(0.5) + sqrt(2)",
        "radians(90) + degrees(1)", "int(3.7) + float(2)", "(1, 2, 3)[1] + [4, 5][-1]",
        "{'a': 1, 'b': 2}['b']", "1 < 2 < 3 and 3 or 4", "0 or 7", "not 0", "2 in [1, 2]",
        "'a' in 'cab'", "'b' not in {'a': 1}", "[k * k for k in range(5) if k % 2 == 1]",
        "f'x{1 + 1}y'", "'a' + 'b'", "[1] + [2]", "True", "pi", "1.5e3", "1 == 1.0", "2 != 3",
        "[i + x for i, x in enumerate([5, 6])]", "[a * b for a, b in zip([1, 2], [3, 4])]",
    ],
)  # fmt: skip
def test_expressions_are_those_of_python(expression):
    names = {name: getattr(math, name) for name in dir(math) if not name.startswith("_")}
    expected = eval(expression, dict(names))
    assert value(expression) == (list(expected) if isinstance(expected, tuple) else expected)


@given(
    st.recursive(
        st.one_of(st.integers(-50, 50), st.floats(-50, 50).map(lambda x: round(x, 3))).map(repr),
        lambda inner: st.one_of(
            st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "//", "%", "<", "=="]), inner)
            .map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
            inner.map(lambda a: f"(-{a})"),
            inner.map(lambda a: f"abs({a})"),
        ),
        max_leaves=8,
    )
)  # fmt: skip
def test_arithmetic_agrees_with_python(expression):
    source = f"move('a', {expression})"
    try:
        expected = eval(expression)
    except ZeroDivisionError:
        assert (
            "division by zero" in rejection(source).message or "number" in rejection(source).message
        )
        return
    found, message = outcome(source)
    if message is None:
        assert type(found) is type(expected)
        assert found == expected
    else:  # a bool is no number here, and large results are refused
        assert "a number was expected" in message or "beyond" in message


def test_vectors_add_scale_and_have_parts():
    assert value("vec(1, 2, 3) + (1, 1, 1)") == [2, 3, 4]
    assert value("2 * vec(1, 2, 3) - vec(1, 0, 0) / 2") == [1.5, 4, 6]
    assert value("-vec(1, 2, 3)") == [-1, -2, -3]
    assert value("cross(vec(1, 0, 0), (0, 1, 0))") == [0, 0, 1]
    assert value("[dot(vec(1, 2, 3), vec(4, 5, 6)), norm((3, 4, 0)), unit((0, 0, 9)).z]") == [
        32, 5.0, 1.0,
    ]  # fmt: skip
    assert value("[v.x + v.y for v in [vec(1, 2, 3)]]") == [3]


def test_boxes_have_corners_middle_and_size():
    def answer(name, arguments):
        return [[0, 0, 0], [2, 4, 6]] if name == "box" else None

    source = (
        "b = box('a')\nmove('a', b.low)\nmove('a', b.high)\nmove('a', b.centre)\nmove('a', b.size)"
    )
    moves = [arguments["by"] for name, arguments, _ in run(source, answer) if name == "move"]
    assert moves == [[0, 0, 0], [2, 4, 6], [1, 2, 3], [2, 4, 6]]


def test_statements_run_in_order():
    source = """
total = 0
for k in range(10):
    if k == 2:
        continue
    elif k == 5:
        break
    total += k
a, b = 1, (2, 3)
def twice(x, by=2):
    for k in range(3):
        if k == 1:
            return x * by
    return 0
def nothing():
    pass
move("a", [total, twice(3), twice(3, by=5), b[1]])
move("a", nothing())
"""
    calls = run(source)
    assert calls[0][1]["by"] == [0 + 1 + 3 + 4, 6, 15, 3]
    assert calls[1][1]["by"] is None


def test_a_call_carries_defaults_and_its_place():
    calls = run("x = 1\nplace_relative_to('a', 'b', clearance=x)")
    name, arguments, at = calls[0]
    assert name == "place_relative_to"
    assert arguments == {
        "child": "a", "parent": "b", "placement": "above", "clearance": 1, "snap": True,
        "align": False,
    }  # fmt: skip
    assert at == (2, 1)


def test_a_name_of_a_function_is_not_seen_outside():
    assert "has no value here" in rejection("def f():\n    z = 1\n    return z\nf()\nx = z").message


LIMITED = {
    "list that doubles": "x = [0]\nfor k in range(60):\n    x = x + x",
    "text that doubles": "x = 'a'\nfor k in range(60):\n    x = x + x",
    "text of texts": "x = 'a'\nfor k in range(60):\n    x = f'{x}{x}'",
    "number that squares": "x = 10\nfor k in range(60):\n    x = x * x",
    "number to a power": "x = 10\nfor k in range(60):\n    x = x ** 8",
    "loops over lists": "x = [k for k in range(1000)]\nfor a in x:\n  for b in x:\n    y = a",
    "loops in functions": (
        "def f():\n  for k in range(2000):\n    x = k\n"
        "def g():\n  for k in range(2000):\n    f()\ng()"
    ),
    "functions that fan out": "def f0():\n  return 1\n" + "".join(
        f"def f{k}():\n  return f{k - 1}() + f{k - 1}()\n" for k in range(1, 40)
    ) + "x = f39()",
    "functions in a chain": "def f0():\n  return 1\n" + "".join(
        f"def f{k}():\n  return f{k - 1}()\n" for k in range(1, 900)
    ) + "x = f899()",
    "many lists": "n = 2000\nfor a in range(n):\n  y = [0] + [k for k in range(90)]",
    "nested lists": "x = []\nfor k in range(50):\n  x = [x, x]\ny = x == [x]",
    "range from a name": "n = 1000000000\nfor k in range(n):\n  y = k",
    "division": "x = 1 / 0",
    "remainder": "x = 1 % 0",
    "root": "x = sqrt(-1)",
    "root by power": "x = (-8) ** 0.5",
    "zero to a power": "x = 0 ** -1",
    "index": "x = [1][5]",
    "key": "x = {'a': 1}['b']",
    "item of a number": "n = 1\nx = n[0]",
    "text times number": "t = 'a'\nx = t * 5",
    "text in percent": "t = '%s'\nx = t % 5",
    "number and text": "t = 'a'\nx = 1 + t",
    "loop over a number": "for k in 5:\n  pass",
    "names and values": "a, b = [1, 2, 3]",
    "attribute of a number": "n = 1\nx = n.low",
    "box as an argument": "n = vec(1, 2, 3)\nmove('a', [n])",
    "unit of nothing": "x = unit((0, 0, 0))",
    "least of nothing": "x = min([])",
    "whole rounds": "for k in range(1.5):\n  pass",
    "step of nothing": "n = 0\nfor k in range(0, 5, n):\n  pass",
    "digits": "x = round(1.5, 99)",
    "list in braces": "a = [1]\nx = f'{a}'",
    "in a number": "x = 1 in 2",
    "not a vector": "x = vec('a', 1, 2)",
    "exponential": "x = tan(pi / 2) * 1e9",
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITED)
def test_values_that_grow_or_do_not_fit_are_refused_with_their_place(name):
    found = rejection(LIMITED[name])
    assert found.kind == "value"
    assert found.line >= 1 or name == "functions in a chain"
    assert "\n" not in found.message


def test_what_the_parent_refuses_is_told_at_the_call():
    def answer(name, arguments):
        raise InvalidValueError("part 'a' is not known")

    with pytest.raises(RuleError) as caught:
        run("x = 1\ny = box('a')", answer)
    assert vars(caught.value.violation) == vars(
        SimpleNamespace(line=2, column=5, message="part 'a' is not known", kind="value")
    )


ATOMS = [
    "1", "-2.5", "0", "True", "None", "'a'", "''", "'door'", "pi", "[]", "[1, 2, 3]", "(1, 2)",
    "(0, 0, 1)",
    "{'a': 1}", "{1: [2]}", "vec(1, 2, 3)", "box('a')", "parts()", "corners('a')", "[vec(0, 0, 0)]",
    "1000000000", "1e-9", "move('a', 1)", "box('a').low", "range(3)", "[[1], [2]]",
]  # fmt: skip
WHOLE = [
    "({} + {})", "({} - {})", "({} * {})", "({} / {})", "({} // {})", "({} % {})", "({} == {})",
    "({} < {})", "({} in {})", "({} and {})", "({} or {})", "{}[{}]", "max({}, {})", "dot({}, {})",
    "cross({}, {})", "zip({}, {})", "round({}, {})", "atan2({}, {})", "range({}, {})", "[{}, {}]",
    "place({}, {})", "place_relative_to({}, {})", "material({}, {})", "({} if {} else 0)",
    "[k for k in {} if {}]", "{{'a': {}, 'b': {}}}",
]  # fmt: skip
HALF = [
    "(-{})", "(not {})", "{}.x", "{}.size", "len({})", "sum({})", "min({})", "unit({})", "int({})",
    "float({})", "sqrt({})", "enumerate({})", "abs({})", "box({})", "({} ** 3)", "({} ** -2)",
    "vertices({})", "frame({})", "[k for k in {}]",
]  # fmt: skip
expressions = st.recursive(
    st.sampled_from(ATOMS),
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(WHOLE), inner, inner).map(lambda t: t[0].format(t[1], t[2])),
        st.tuples(st.sampled_from(HALF), inner).map(lambda t: t[0].format(t[1])),
    ),
    max_leaves=6,
)


def stub(name, arguments):
    """Answers of the right shape to whatever is asked."""
    points = [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]
    return {"box": points, "corners": points, "vertices": points, "parts": ["a", "b"]}.get(name)


@settings(max_examples=400)
@given(expressions, expressions)
def test_a_program_that_passes_the_guard_ends_or_is_refused_and_nothing_else(one, other):
    source = f"x = {one}\ny = {other}\nz = [x, y]\nfor a in z:\n    b = a == x\n"
    tree = check(source)
    if isinstance(tree, ast.Module):
        try:
            interpret(
                tree, lambda name, arguments, at: stub(name, json.loads(json.dumps(arguments)))
            )
        except RuleError as refused:
            message = refused.violation.message
        else:
            message = "done"
        assert message
        assert "\n" not in message
