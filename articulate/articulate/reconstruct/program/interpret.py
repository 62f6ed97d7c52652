"""Interpret the checked syntax tree of a program with a limited number of steps.

Nothing is compiled. No object of Python's runtime (function, frame, class, module) is ever a value,
so that a program cannot reach the interpreter. The module needs only the standard library.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from typing import Any

from articulate.reconstruct.program.language import (
    CONSTANTS,
    FUNCTIONS,
    HELPERS,
    MAX_ITEMS,
    MAX_STEPS,
    Function,
    RuleViolation,
)
from articulate.reconstruct.program.parse import RuleError
from articulate.reconstruct.program.values import (
    ARITHMETIC,
    COMPARISONS,
    HELPER_FUNCTIONS,
    AxisBox,
    InvalidValueError,
    Value,
    Vector,
    attribute,
    bounded,
    format_value,
    item,
    items,
    negated,
    vector,
)

CallParent = Callable[[str, dict[str, Any], tuple[int, int]], Any]
"""Calls a function of the parent: name, arguments as JSON, line and column; raises ValueRefused."""
MAX_TOTAL = 200_000
"""Most items that all lists made in a run have together."""


class _Jump(Exception):  # noqa: N818  # it is not an error
    """Leaves a loop or a function."""

    def __init__(self, kind: str, value: Value = None) -> None:
        super().__init__(kind)
        self.kind, self.value = kind, value


def interpret(tree: ast.Module, call_parent: CallParent) -> None:
    """Run a checked tree.

    Args:
        tree: Tree from ``allow_list.check``.
        call_parent: Function that calls the functions of the language.

    Raises:
        RuleError: A value breaks a rule, with its line and column.
    """
    interpreter = _Interpreter(call_parent)
    try:
        interpreter.body(tree.body, interpreter.globals)
    except RecursionError:
        what = "functions call functions too deeply; simplify"
        raise RuleError(RuleViolation(0, 0, what, "value")) from None


class _Interpreter:
    def __init__(self, call_parent: CallParent) -> None:
        self.call_parent = call_parent
        self.functions: dict[str, ast.FunctionDef] = {}
        self.globals: dict[str, Value] = {}
        self.steps = self.made = 0

    def at(self, node: ast.AST, message: str) -> RuleError:
        line, column = getattr(node, "lineno", 0), getattr(node, "col_offset", -1)
        return RuleError(RuleViolation(line, column + 1, message, "value"))

    def step(self, node: ast.AST) -> None:
        self.steps += 1
        if self.steps > MAX_STEPS:
            raise self.at(node, f"the program takes more than {MAX_STEPS} steps; shorten its loops")

    def checked(self, node: ast.AST, value: Value) -> Value:
        """Return ``value`` if it is within all limits, and count its items."""
        bounded(value)
        if isinstance(value, (list, tuple, dict)):
            self.made += len(value)
            if self.made > MAX_TOTAL:
                raise self.at(node, f"the program makes more than {MAX_TOTAL} items")
        return value

    # Statements

    def body(self, statements: list[ast.stmt], local: dict[str, Value] | None) -> None:
        for statement in statements:
            self.step(statement)
            getattr(self, f"do_{type(statement).__name__}")(statement, local)

    def do_FunctionDef(self, node: ast.FunctionDef, local: Any) -> None:  # noqa: ARG002,RUF100
        self.functions[node.name] = node

    def do_Pass(self, node: ast.Pass, local: Any) -> None:
        pass

    def do_Expr(self, node: ast.Expr, local: dict[str, Value]) -> None:
        self.value(node.value, local)

    def do_Return(self, node: ast.Return, local: dict[str, Value]) -> None:
        raise _Jump("return", None if node.value is None else self.value(node.value, local))

    def do_Break(self, node: ast.Break, local: Any) -> None:
        raise _Jump("break")

    def do_Continue(self, node: ast.Continue, local: Any) -> None:
        raise _Jump("continue")

    def do_Assign(self, node: ast.Assign, local: dict[str, Value]) -> None:
        value = self.value(node.value, local)
        for target in node.targets:
            self.assign(target, value, local)

    def do_AugAssign(self, node: ast.AugAssign, local: dict[str, Value]) -> None:
        assert isinstance(node.target, ast.Name)
        before = self.of_Name(node.target, local)
        after = self.computed(node, node.op, before, self.value(node.value, local))
        self.assign(node.target, after, local)

    def do_If(self, node: ast.If, local: dict[str, Value]) -> None:
        self.body(node.body if self.true(node.test, local) else node.orelse, local)

    def do_For(self, node: ast.For, local: dict[str, Value]) -> None:
        for each in self.iterated(node.iter, local):
            self.assign(node.target, each, local)
            try:
                self.body(node.body, local)
            except _Jump as jump:
                if jump.kind == "break":
                    break
                if jump.kind == "return":
                    raise

    def assign(self, target: ast.expr, value: Value, local: dict[str, Value]) -> None:
        if isinstance(target, ast.Name):
            local[target.id] = value
            return
        assert isinstance(target, ast.Tuple)
        parts = self.apply(target, items, value)
        if len(parts) != len(target.elts):
            raise self.at(target, f"{len(parts)} values for {len(target.elts)} names")
        for name, part in zip(target.elts, parts, strict=True):
            self.assign(name, part, local)

    # Expressions

    def value(self, node: ast.expr, local: dict[str, Value]) -> Value:
        self.step(node)
        return getattr(self, f"of_{type(node).__name__}")(node, local)

    def apply(self, node: ast.AST, function: Callable[..., Value], *values: Value) -> Value:
        """Apply a function; errors get the position of ``node``."""
        try:
            return self.checked(node, function(*values))
        except InvalidValueError as error:
            raise self.at(node, str(error)) from None
        except OverflowError:
            raise self.at(node, "the result is too large") from None

    def iterated(self, node: ast.expr, local: dict[str, Value]) -> list[Value]:
        found: list[Value] = self.apply(node, items, self.value(node, local))
        return found

    def true(self, node: ast.expr, local: dict[str, Value]) -> bool:
        return bool(self.value(node, local))

    def of_Constant(self, node: ast.Constant, local: Any) -> Value:
        return node.value

    def of_Name(self, node: ast.Name, local: dict[str, Value]) -> Value:
        for known in (local, self.globals, CONSTANTS):
            if node.id in known:
                return known[node.id]
        raise self.at(node, f"{node.id!r} has no value here; assign it before")

    def of_Attribute(self, node: ast.Attribute, local: dict[str, Value]) -> Value:
        return self.apply(node, attribute, self.value(node.value, local), node.attr)

    def of_Subscript(self, node: ast.Subscript, local: dict[str, Value]) -> Value:
        container, index = self.value(node.value, local), self.value(node.slice, local)
        return self.apply(node, item, container, index)

    def of_Tuple(self, node: ast.Tuple, local: dict[str, Value]) -> Value:
        return self.checked(node, tuple(self.value(each, local) for each in node.elts))

    def of_List(self, node: ast.List, local: dict[str, Value]) -> Value:
        return self.checked(node, [self.value(each, local) for each in node.elts])

    def of_Dict(self, node: ast.Dict, local: dict[str, Value]) -> Value:
        keys = [key.value for key in node.keys if isinstance(key, ast.Constant)]
        values = [self.value(each, local) for each in node.values]
        return self.checked(node, dict(zip(keys, values, strict=True)))

    def of_ListComp(self, node: ast.ListComp, local: dict[str, Value]) -> Value:
        generator, inner, out = node.generators[0], dict(local), []
        for each in self.iterated(generator.iter, local):
            self.assign(generator.target, each, inner)
            if all(self.true(test, inner) for test in generator.ifs):
                out.append(self.value(node.elt, inner))
        return self.checked(node, out)

    def of_JoinedStr(self, node: ast.JoinedStr, local: dict[str, Value]) -> Value:
        parts = []
        for part in node.values:
            inner = part.value if isinstance(part, ast.FormattedValue) else part
            value = self.value(inner, local)
            if type(value) not in {str, int, float}:
                raise self.at(
                    node, f"a text or number was expected in braces, not {format_value(value)}"
                )
            parts.append(str(value))
        return self.apply(node, "".join, parts)

    def of_BinOp(self, node: ast.BinOp, local: dict[str, Value]) -> Value:
        left, right = self.value(node.left, local), self.value(node.right, local)
        return self.computed(node, node.op, left, right)

    def computed(self, node: ast.AST, sign: ast.operator, left: Value, right: Value) -> Value:
        return self.apply(node, ARITHMETIC[type(sign).__name__], left, right)

    def of_UnaryOp(self, node: ast.UnaryOp, local: dict[str, Value]) -> Value:
        if isinstance(node.op, ast.Not):
            return not self.true(node.operand, local)
        value = self.value(node.operand, local)
        return self.apply(node, negated, value) if isinstance(node.op, ast.USub) else value

    def of_BoolOp(self, node: ast.BoolOp, local: dict[str, Value]) -> Value:
        is_or, value = isinstance(node.op, ast.Or), None
        for each in node.values:
            value = self.value(each, local)
            if bool(value) is is_or:
                break
        return value

    def of_Compare(self, node: ast.Compare, local: dict[str, Value]) -> Value:
        left = self.value(node.left, local)
        for sign, other in zip(node.ops, node.comparators, strict=True):
            right = self.value(other, local)
            if not self.apply(node, COMPARISONS[type(sign).__name__], left, right):
                return False
            left = right
        return True

    def of_IfExp(self, node: ast.IfExp, local: dict[str, Value]) -> Value:
        return self.value(node.body if self.true(node.test, local) else node.orelse, local)

    def of_Call(self, node: ast.Call, local: dict[str, Value]) -> Value:
        assert isinstance(node.func, ast.Name)
        name = node.func.id
        values = [self.value(each, local) for each in node.args]
        named = {str(k.arg): self.value(k.value, local) for k in node.keywords}
        if name in HELPERS:
            return self.apply(node, HELPER_FUNCTIONS[name], *values)
        if name in FUNCTIONS:
            function = FUNCTIONS[name]
            passed = dict(zip(function.names, values, strict=False)) | named
            return self.called_parent(node, name, function, {**function.optional, **passed})
        return self.called(node, self.functions[name], values, named)

    def called_parent(
        self, node: ast.Call, name: str, function: Function, passed: Mapping[str, Value]
    ) -> Value:
        try:
            arguments = {key: plain(value) for key, value in passed.items()}
            answer = self.call_parent(name, arguments, (node.lineno, node.col_offset + 1))
            return self.checked(node, from_answer(answer, function))
        except InvalidValueError as error:
            raise self.at(node, str(error)) from None

    def called(
        self, node: ast.Call, function: ast.FunctionDef, values: list[Value], named: dict[str, Any]
    ) -> Value:
        own = [argument.arg for argument in function.args.args]
        defaults = function.args.defaults
        local: dict[str, Value] = {
            name: default.value
            for name, default in zip(own[len(own) - len(defaults) :], defaults, strict=True)
            if isinstance(default, ast.Constant)
        }
        local |= dict(zip(own, values, strict=False)) | named
        try:
            self.body(function.body, local)
        except _Jump as jump:
            return jump.value
        return None


def plain(value: Value) -> Any:
    """Convert a value to JSON."""
    if isinstance(value, Vector):
        return list(value.all)
    if isinstance(value, AxisBox):
        raise InvalidValueError("a box is no argument; give its .low, .high, .centre or .size")
    if isinstance(value, (list, tuple)):
        if len(value) > MAX_ITEMS:
            raise InvalidValueError("too many items")
        return [number_or_text(each) for each in value]
    return number_or_text(value)


def number_or_text(value: Value) -> Any:
    """Return ``value`` if it is a number, a text, a boolean or None."""
    if value is None or type(value) in {bool, int, float, str}:
        return value
    raise InvalidValueError(f"{format_value(value)} is no argument here")


def from_answer(answer: Any, function: Function) -> Value:
    """Convert the parent's answer to a value of the language."""
    if function.returns == "box":
        low, high = answer
        return AxisBox(vector(low), vector(high))
    if function.returns == "points":
        return [vector(point) for point in answer]
    if function.returns == "names":
        return [str(name) for name in answer]
    return str(answer) if function.returns == "name" else None
