"""Allow-list of Python's syntax for programs, checked before anything runs.

Everything that is not listed here is rejected with line, column and an alternative. The module
needs only the standard library; the child process runs it before the interpreter.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable

from articulate.reconstruct.program.language import (
    ATTRIBUTES,
    FUNCTIONS,
    HELPERS,
    MAX_DEPTH,
    MAX_ITEMS,
    MAX_LOOPS,
    MAX_NODES,
    MAX_NUMBER,
    MAX_POWER,
    MAX_ROUNDS,
    MAX_TEXT,
    RESERVED,
    RuleViolation,
)
from articulate.reconstruct.program.parse import RuleError, parse_program, rule_error

MAX_LISTED = 600
"""Most characters of a list of known names."""
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,49}|_")

WHY: dict[type[ast.AST], str] = {
    ast.Import: "imports are not needed: every function of the language is there already",
    ast.ImportFrom: "imports are not needed: every function of the language is there already",
    ast.While: "while loops are not allowed; write `for k in range(n):`",
    ast.AsyncFor: "async is not allowed; write a plain for loop",
    ast.AsyncWith: "async is not allowed; leave it out",
    ast.AsyncFunctionDef: "async is not allowed; write a plain def",
    ast.Await: "await is not allowed; leave it out",
    ast.Yield: "generators are not allowed; return a list",
    ast.YieldFrom: "generators are not allowed; return a list",
    ast.GeneratorExp: "generator expressions are not allowed; write a list in brackets",
    ast.SetComp: "set comprehensions are not allowed; write a list in brackets",
    ast.DictComp: "dict comprehensions are not allowed; write the dict out",
    ast.Set: "sets are not allowed; write a list in brackets",
    ast.Lambda: "lambda is not allowed; write a def at the top of the program",
    ast.ClassDef: "classes are not allowed; a program needs only functions and values",
    ast.Try: "try is not allowed; make sure that the call is valid",
    ast.Raise: "raise is not allowed; end the program without the call instead",
    ast.Assert: "assert is not allowed; write an if",
    ast.With: "with is not allowed; a program opens nothing",
    ast.Global: "global is not allowed; pass values as arguments",
    ast.Nonlocal: "nonlocal is not allowed; pass values as arguments",
    ast.Delete: "del is not allowed; keep the value",
    ast.Match: "match is not allowed; write if and elif",
    ast.NamedExpr: "`:=` is not allowed; assign on a separate line",
    ast.Starred: "`*` before a value is not allowed; write the arguments or items out",
    ast.AnnAssign: "type annotations are not allowed; leave them out",
    ast.Slice: "slices are not allowed; take single items by their index",
    ast.MatMult: "`@` is not allowed; write dot(a, b)",
    ast.BitAnd: "bit operators are not allowed; write `and`",
    ast.BitOr: "bit operators are not allowed; write `or`",
    ast.BitXor: "bit operators are not allowed; write `!=`",
    ast.LShift: "shifts are not allowed; multiply instead",
    ast.RShift: "shifts are not allowed; divide instead",
    ast.Invert: "`~` is not allowed; write `not`",
    ast.Is: "`is` is not allowed; write `==`",
    ast.IsNot: "`is not` is not allowed; write `!=`",
}
"""Alternatives to constructs that people and models often write."""
PLAIN: tuple[type[ast.AST], ...] = (
    ast.Module, ast.Expr, ast.If, ast.Pass, ast.Load, ast.Store, ast.And, ast.Or, ast.BoolOp,
    ast.UnaryOp, ast.Not, ast.USub, ast.UAdd, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv,
    ast.Mod, ast.Pow, ast.Compare, ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.In,
    ast.NotIn, ast.IfExp, ast.keyword,
)  # fmt: skip
"""Nodes that need no check beyond their children."""


def check(source: str) -> ast.Module | RuleViolation:
    """Return the syntax tree of a program, or the first violation of a rule.

    Args:
        source: Text of the program.
    """
    try:
        tree = parse_program(source)
        _Checker(tree).check()
    except RuleError as error:
        return error.violation
    return tree


class _Checker:
    """Checks all nodes of a tree once, in the order of the text."""

    def __init__(self, tree: ast.Module) -> None:
        self.tree = tree
        self.functions: dict[str, ast.FunctionDef] = {}
        """Functions defined so far; a function can call only those above it, never itself."""
        self.names: set[str] = set()
        self.special: dict[type[ast.AST], Callable[[ast.AST], None]] = {
            ast.Constant: self._constant, ast.Name: self._name, ast.Attribute: self._attribute,
            ast.Call: self._call, ast.Subscript: self._subscript, ast.BinOp: self._arithmetic,
            ast.For: self._for, ast.FunctionDef: self._function, ast.Assign: self._assign,
            ast.AugAssign: self._augment, ast.Return: self._return, ast.Break: self._jump,
            ast.Continue: self._jump, ast.List: self._items, ast.Tuple: self._items,
            ast.Dict: self._dict, ast.JoinedStr: self._joined,
            ast.FormattedValue: self._formatted, ast.ListComp: self._comprehension,
            ast.arguments: self._arguments, ast.arg: self._argument,
            ast.comprehension: self._comprehension_for,
        }  # fmt: skip
        self.top = {id(statement) for statement in tree.body}
        self.loops = 0
        self.rounds = 1
        self.inside: ast.FunctionDef | None = None
        self.comprehended = False

    def check(self) -> None:
        """Raise RuleError at the first violation."""
        self._measure()
        self.names = {
            node.id
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        } | {node.arg for node in ast.walk(self.tree) if isinstance(node, ast.arg)}
        self._look(self.tree)

    def _measure(self) -> None:
        """Limit the number and depth of the nodes, without recursion."""
        stack: list[tuple[ast.AST, int, ast.AST]] = [(self.tree, 0, self.tree)]
        count = 0
        while stack:
            node, depth, place = stack.pop()
            count += 1
            place = node if hasattr(node, "lineno") else place
            if depth > MAX_DEPTH:
                raise self._at(place, "nested too deeply; break it into several statements")
            if count > MAX_NODES:
                raise self._at(place, f"the program has more than {MAX_NODES} elements; shorten it")
            stack += [(child, depth + 1, place) for child in ast.iter_child_nodes(node)]

    def _at(self, node: ast.AST, message: str) -> RuleError:
        line, column = getattr(node, "lineno", 0), getattr(node, "col_offset", -1)
        return rule_error(line, column + 1, message)

    def _look(self, node: ast.AST) -> None:
        kind = type(node)
        if kind in self.special:
            self.special[kind](node)
        elif kind in PLAIN:
            self._children(node)
        else:
            advice = WHY.get(kind, f"{kind.__name__} is no part of the language; leave it out")
            raise self._at(node, advice)

    def _children(self, node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            self._look_at(child, node)

    def _look_at(self, child: ast.AST, parent: ast.AST) -> None:
        """Check ``child``; operators have no position and use their parent's."""
        if hasattr(child, "lineno") or type(child) in self.special or type(child) in PLAIN:
            self._look(child)
        else:
            name = type(child).__name__
            raise self._at(parent, WHY.get(type(child), f"{name} is no part of the language"))

    # Values

    def _constant(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Constant)
        value = node.value
        if value is None or isinstance(value, bool):
            return
        if isinstance(value, (int, float)):
            if not abs(value) <= MAX_NUMBER:  # also rejects NaN
                raise self._at(node, f"numbers are accepted up to {MAX_NUMBER:g}")
        elif isinstance(value, str):
            if len(value) > MAX_TEXT:
                raise self._at(node, f"texts of at most {MAX_TEXT} characters are accepted")
        else:
            raise self._at(node, f"{type(value).__name__} is no part of the language")

    def _name(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Name)
        name = node.id
        self._spelt(node, name)
        if isinstance(node.ctx, ast.Store):
            if name in RESERVED or name in self.functions:
                raise self._at(node, f"{name!r} is a name of the language; choose another name")
        elif name in FUNCTIONS or name in HELPERS or name in self.functions:
            raise self._at(node, f"{name!r} is a function, not a value; call it")
        elif name not in self.names and name not in RESERVED:
            raise self._at(node, f"{name!r} is not known; assign it first")

    def _spelt(self, node: ast.AST, name: str) -> None:
        if name.startswith("__"):
            raise self._at(node, f"{name[:30]!r}: names with two underscores are not allowed")
        if not NAME.fullmatch(name):
            raise self._at(node, f"{name[:30]!r}: names are ASCII, begin with a letter, <= 50 long")

    def _attribute(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Attribute)
        if node.attr not in ATTRIBUTES or not isinstance(node.ctx, ast.Load):
            known = ", ".join(sorted(ATTRIBUTES))
            what = f"`.{node.attr[:30]}` is not allowed; allowed after a dot: {known}"
            raise self._at(node, what)
        self._look(node.value)

    def _subscript(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Subscript)
        if not isinstance(node.ctx, ast.Load):
            raise self._at(node, "items cannot be set; write a new list")
        if isinstance(node.slice, ast.Tuple):
            raise self._at(node, "one index at a time is accepted")
        if isinstance(node.value, (ast.Constant, ast.JoinedStr)):
            raise self._at(node, "a text or number has no items")
        self._children(node)

    def _items(self, node: ast.AST) -> None:
        assert isinstance(node, (ast.List, ast.Tuple))
        if len(node.elts) > MAX_ITEMS:
            raise self._at(node, f"at most {MAX_ITEMS} items are accepted")
        self._children(node)

    def _dict(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Dict)
        if len(node.keys) > MAX_ITEMS:
            raise self._at(node, f"at most {MAX_ITEMS} items are accepted")
        for key in node.keys:
            if not (isinstance(key, ast.Constant) and isinstance(key.value, (str, int))):
                raise self._at(key or node, "keys are literal texts or integers")
        self._children(node)

    def _joined(self, node: ast.AST) -> None:
        self._children(node)

    def _formatted(self, node: ast.AST) -> None:
        assert isinstance(node, ast.FormattedValue)
        if node.conversion != -1 or node.format_spec is not None:
            raise self._at(node, "in an f-text write the plain name in braces, without ! or :")
        if not all(
            isinstance(part, (ast.Name, ast.Constant, ast.BinOp, ast.operator, ast.expr_context))
            for part in ast.walk(node.value)
        ):
            raise self._at(node, "in an f-text write a name in braces; compute its value before")
        if any(
            isinstance(p, ast.Constant) and isinstance(p.value, str) for p in ast.walk(node.value)
        ):
            raise self._at(node, "no text within the braces of an f-text")
        self._look(node.value)

    def _arithmetic(self, node: ast.AST) -> None:
        assert isinstance(node, ast.BinOp)
        written = [type(side) for side in (node.left, node.right)]
        if isinstance(node.op, ast.Pow) and not _small(node.right):
            raise self._at(node, f"an exponent is a literal number of at most {MAX_POWER:g}")
        texts = (ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp, ast.Dict)
        sides = any(kind in texts for kind in written) or any(
            isinstance(s, ast.Constant) and isinstance(s.value, str)
            for s in (node.left, node.right)
        )
        if sides and not isinstance(node.op, ast.Add):
            raise self._at(node, "texts and lists can be added, and nothing else")
        self._children(node)

    def _comprehension(self, node: ast.AST) -> None:
        assert isinstance(node, ast.ListComp)
        if self.comprehended or len(node.generators) != 1:
            raise self._at(node, "one `for` in a list and no list within; write a for loop")
        self.comprehended = True
        with_rounds = self._rounds_of(node.generators[0].iter)
        self.loops, self.rounds = self.loops + 1, self.rounds * with_rounds
        self._bounded(node)
        self._children(node)
        self.loops, self.rounds = self.loops - 1, self.rounds // with_rounds
        self.comprehended = False

    def _comprehension_for(self, node: ast.AST) -> None:
        assert isinstance(node, ast.comprehension)
        if node.is_async:
            raise self._at(node.target, "async is not allowed; write a plain for")
        self._target(node.target)
        self._children(node)

    # Calls

    def _call(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Call)
        if not isinstance(node.func, ast.Name):
            raise self._at(node, "only functions of the language can be called, by their names")
        name = node.func.id
        self._spelt(node.func, name)
        for argument in node.args:
            if isinstance(argument, ast.Starred):
                raise self._at(argument, WHY[ast.Starred])
        if any(keyword.arg is None for keyword in node.keywords):
            raise self._at(node, "`**` before an argument is not allowed; write the arguments out")
        if name in FUNCTIONS:
            self._bound(node, FUNCTIONS[name].names, FUNCTIONS[name].required, name)
        elif name in HELPERS:
            least, most = HELPERS[name]
            if node.keywords or not least <= len(node.args) <= most:
                count = f"{least}" if least == most else f"{least} to {most}"
                raise self._at(node, f"{name}() takes {count} arguments, without names")
        elif name in self.functions:
            own = [a.arg for a in self.functions[name].args.args]
            free = len(own) - len(self.functions[name].args.defaults)
            self._bound(node, tuple(own), tuple(own[:free]), name)
        else:
            raise self._at(node, self._unknown(name))
        for part in (*node.args, *(k.value for k in node.keywords)):
            self._look(part)

    def _unknown(self, name: str) -> str:
        if self.inside is not None and name == self.inside.name:
            return f"{name}() calls itself, which is not allowed; write a loop"
        known = ", ".join(sorted({*FUNCTIONS, *HELPERS, *self.functions}))
        return f"{name[:30]!r} is no function of the language; known: {known[:MAX_LISTED]}"

    def _bound(
        self, node: ast.Call, names: tuple[str, ...], required: tuple[str, ...], name: str
    ) -> None:
        head = FUNCTIONS[name].line(name) if name in FUNCTIONS else f"{name}({', '.join(names)})"
        if len(node.args) > len(names):
            raise self._at(node, f"too many arguments; write {head}")
        passed = list(names[: len(node.args)])
        for keyword in node.keywords:
            if keyword.arg not in names or keyword.arg in passed:
                what = f"argument {str(keyword.arg)[:30]!r} is unknown or given twice"
                raise self._at(keyword, f"{what}; write {head}")
            passed.append(keyword.arg)
        lacking = [key for key in required if key not in passed]
        if lacking:
            raise self._at(node, f"{', '.join(lacking)} missing; write {head}")

    # Statements

    def _for(self, node: ast.AST) -> None:
        assert isinstance(node, ast.For)
        if node.orelse:
            raise self._at(node, "else after for is not allowed; leave it out")
        self._target(node.target)
        self._look(node.target)
        self._look(node.iter)
        rounds = self._rounds_of(node.iter)
        self.loops, self.rounds = self.loops + 1, self.rounds * rounds
        self._bounded(node)
        for statement in node.body:
            self._look(statement)
        self.loops, self.rounds = self.loops - 1, self.rounds // rounds

    def _bounded(self, node: ast.AST) -> None:
        if self.loops > MAX_LOOPS:
            raise self._at(node, f"loops may be nested {MAX_LOOPS} deep")
        if self.rounds > MAX_ROUNDS:
            raise self._at(node, f"these loops take more than {MAX_ROUNDS} rounds")

    def _rounds_of(self, node: ast.expr) -> int:
        """Return the rounds of a range of literal numbers; 1 if they are known only at run time."""
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
            return 1
        if node.func.id != "range":
            return 1
        ends = [_number(argument) for argument in node.args]
        if not ends or any(end is None or end != int(end) for end in ends):
            return 1
        try:
            count = len(range(*(int(end) for end in ends if end is not None)))
        except (ValueError, OverflowError, TypeError):
            raise self._at(node, "range() needs one to three integers") from None
        if count > MAX_ITEMS:
            raise self._at(node, f"a loop takes at most {MAX_ITEMS} rounds")
        return max(count, 1)

    def _target(self, node: ast.expr) -> None:
        names = node.elts if isinstance(node, ast.Tuple) else [node]
        for name in names:
            if not isinstance(name, ast.Name):
                raise self._at(name, "assign to plain names")

    def _assign(self, node: ast.AST) -> None:
        assert isinstance(node, ast.Assign)
        for target in node.targets:
            self._target(target)
        self._children(node)

    def _augment(self, node: ast.AST) -> None:
        assert isinstance(node, ast.AugAssign)
        self._target(node.target)
        if isinstance(node.op, ast.Pow) and not _small(node.value):
            raise self._at(node, f"an exponent is a literal number of at most {MAX_POWER:g}")
        if node.target.id not in self.names:  # type: ignore[union-attr]  # _target saw a name
            raise self._at(node, "assign it first")
        self._children(node)

    def _function(self, node: ast.AST) -> None:
        assert isinstance(node, ast.FunctionDef)
        self._spelt(node, node.name)
        if id(node) not in self.top:
            raise self._at(node, "define functions at the top, not within others or loops")
        if node.decorator_list:
            raise self._at(node.decorator_list[0], "decorators are not allowed; leave them out")
        if node.returns is not None or getattr(
            node, "type_params", None
        ):  # the latter from 3.12 on
            raise self._at(node.returns or node, WHY[ast.AnnAssign])
        if node.name in RESERVED or node.name in self.functions or node.name in self.names:
            raise self._at(node, f"{node.name!r} is already used; choose another name")
        self._look(node.args)
        self.inside = node
        for statement in node.body:
            self._look(statement)
        self.inside = None
        self.functions[node.name] = node

    def _arguments(self, node: ast.AST) -> None:
        assert isinstance(node, ast.arguments)
        if node.vararg or node.kwarg or node.kwonlyargs or node.posonlyargs:
            found = node.vararg or node.kwarg or [*node.kwonlyargs, *node.posonlyargs][0]
            raise self._at(found, "only plain arguments are allowed: no `*`, `**` and `/`")
        for default in node.defaults:
            if not isinstance(default, ast.Constant):
                raise self._at(default, "a default is a number, a text, True, False or None")
        self._children(node)

    def _argument(self, node: ast.AST) -> None:
        assert isinstance(node, ast.arg)
        self._spelt(node, node.arg)
        if node.annotation is not None:
            raise self._at(node.annotation, WHY[ast.AnnAssign])
        if node.arg in RESERVED:
            raise self._at(node, f"{node.arg!r} is a name of the language; choose another name")

    def _return(self, node: ast.AST) -> None:
        if self.inside is None:
            raise self._at(node, "return is outside of a function; leave it out")
        self._children(node)

    def _jump(self, node: ast.AST) -> None:
        if self.loops == 0:
            raise self._at(node, "break and continue are only allowed in a loop")


def _number(node: ast.expr) -> float | None:
    """Return a literal number with its sign."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        inner = _number(node.operand)
        return None if inner is None else -inner
    if isinstance(node, ast.Constant) and type(node.value) in {int, float}:
        return float(node.value) if abs(node.value) <= MAX_NUMBER else math.inf  # type: ignore[arg-type]  # a number
    return None


def _small(node: ast.expr) -> bool:
    value = _number(node)
    return value is not None and abs(value) <= MAX_POWER
