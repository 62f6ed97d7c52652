"""Parse programs safely: text and tokens are checked before Python's parser reads them.

The module needs only the standard library.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
import warnings
from collections.abc import Iterator

from articulate.reconstruct.program.language import MAX_DEPTH, MAX_SOURCE, RuleViolation

MAX_RUN = 12
"""Most unary operators or openers in a row."""
MAX_TOKENS = 9_000
"""Most tokens of a statement: a list of 2,000 items with commas and brackets."""
COOKIE = re.compile(r"^[ \t\f]*#.*?coding[:=][ \t]*[-\w.]+")
"""A comment that Python reads as an encoding declaration in the first two lines."""
INVISIBLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff\U000e0000-\U000e007f]"
)
"""Invisible characters and those that change the direction of writing."""


class RuleError(Exception):
    """A rule is broken; carries the violation."""

    def __init__(self, violation: RuleViolation) -> None:
        super().__init__(violation.message)
        self.violation = violation


def rule_error(line: int, column: int, message: str, kind: str = "rule") -> RuleError:
    """Create the exception for a broken rule at a line and column, both from 1."""
    return RuleError(RuleViolation(line, column, message, kind))


def _check_text(source: str) -> None:
    """Check the text before the parser reads it."""
    if len(source) > MAX_SOURCE:
        raise rule_error(
            0, 0, f"the program has {len(source)} characters; {MAX_SOURCE} are accepted"
        )
    lines = source.split("\n")
    for number, line in enumerate(lines, 1):
        found = INVISIBLE.search(line.removesuffix("\r"))
        if found:
            code = f"U+{ord(found[0]):04X}"
            what = f"the character {code} is invisible and not allowed; remove it"
            raise rule_error(number, found.start() + 1, what)
        if number <= 2 and COOKIE.match(line):
            raise rule_error(
                number, 1, "a declaration of the encoding is not allowed; remove the comment"
            )
    _check_tokens(source)


def _check_tokens(source: str) -> None:
    """Limit the nesting for the parser, which is recursive."""
    counts = _Counts()
    for token in _tokens(source):
        line, column = token.start[0], token.start[1] + 1
        if token.type not in {tokenize.STRING, tokenize.COMMENT} and not token.string.isascii():
            what = f"{token.string[:20]!r} is not ASCII; only texts and comments may contain others"
            raise rule_error(line, column, what)
        if counts.too_deep(token):
            raise rule_error(
                line, column, "nested too deeply or too long; break it into statements"
            )


class _Counts:
    """Counts of nested tokens of a statement."""

    def __init__(self) -> None:
        self.depth = self.run = self.length = self.lambdas = self.elifs = 0

    def too_deep(self, token: tokenize.TokenInfo) -> bool:
        """Count a token and return whether a limit is exceeded."""
        text = "" if token.type in {tokenize.STRING, tokenize.COMMENT} else token.string
        opens = text in {"(", "[", "{"}
        self.depth += opens - (text in {")", "]", "}"})
        self.run = self.run + 1 if opens or text in {"-", "+", "~", "not"} else 0
        self.length = 0 if token.type == tokenize.NEWLINE else self.length + 1
        self.lambdas = 0 if token.type == tokenize.NEWLINE else self.lambdas + (text == "lambda")
        self.elifs = 0 if text == "if" else self.elifs + (text == "elif")
        return (
            max(self.depth, self.elifs) > MAX_DEPTH
            or max(self.run, self.lambdas) > MAX_RUN
            or self.length > MAX_TOKENS
        )


def _tokens(source: str) -> Iterator[tokenize.TokenInfo]:
    """Yield tokens up to the first invalid one; the parser reports open brackets at the end."""
    try:
        yield from tokenize.generate_tokens(io.StringIO(source).readline)
    except tokenize.TokenError:
        return
    except SyntaxError as error:
        line, column = error.lineno or 0, error.offset or 0
        raise rule_error(line, max(column, 1), f"not Python: {error.msg}", "syntax") from None


def parse_program(source: str) -> ast.Module:
    """Parse a program.

    Raises:
        RuleError: It is too long, too deep, not Python, or contains invisible characters.
    """
    _check_text(source)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source)
    except SyntaxError as error:
        what = f"not Python: {(error.msg or '').splitlines()[0][:200]}"
        raise rule_error(error.lineno or 1, max(error.offset or 1, 1), what, "syntax") from None
    except (RecursionError, MemoryError):
        raise rule_error(0, 0, "the program is nested too deeply; simplify it", "syntax") from None
    except ValueError as error:
        raise rule_error(0, 0, f"not Python: {str(error)[:200]}", "syntax") from None
    if not source.isascii():
        _count_letters(tree, source)
    return tree


def _count_letters(tree: ast.Module, source: str) -> None:
    """Convert columns from bytes to characters."""
    lines = [line.encode() for line in source.split("\n")]
    for node in ast.walk(tree):
        at = getattr(node, "lineno", 0)
        if 0 < at <= len(lines):
            before = lines[at - 1][: getattr(node, "col_offset", 0)]
            node.col_offset = len(before.decode(errors="replace"))  # type: ignore[attr-defined]  # it has a line
