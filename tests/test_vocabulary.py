"""The project's vocabulary: the field's terms in names, docstrings, comments, messages and docs.

``python tests/test_vocabulary.py [PATH ...]`` lists the findings of files or folders.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = (
    "articulate/articulate",
    "envs/articulate_envs",
    "train/articulate_train",
    "deploy/articulate_deploy",
)
OTHER_PLACES = ("benchmarks", "tests/benchmarks", "docs", "README.md", "CONTRIBUTING.md")
"""Other files and folders that use the vocabulary."""

NAME_WORDS = set(
    re.findall(
        r"\w+",
        """
        told tell tells said say says saying asked asks shown heeded heeds heed anew gone
        drawn draw draws judged judge judges judging judgement felt plant tick ticks film
        films filmed clips company suspects wish wishes worth price prices priced story
        clause clauses proof proofs prove proven proves refused refuse refuses refusal
        recipe mend mended mends meeting meetings astray lies lied stood stands relief
        spoken whole alone taken given picture pictures sentence sentences hand hands way
        ways unheard
        """,
    )
)
"""Parts of names (split at ``_`` and capitals) for which the field has another term."""

TEXT_WORDS = re.compile(
    r"""\b(told|tells?|said|says?|asked|asks|shown|heed(?:s|ed)?|anew|gone|drawn|draws?|judgement
    |judge[sd]?|felt|feels?|plant|ticks?|films?|filmed|clips|stand-ins?|stands|lies|clauses?
    |proofs?|proven|proves?|refus(?:e|ed|es|al)|recipe|mend(?:s|ed)?|pictures?|hands?|whole|alone
    |besides|rests|heard|hears?|wants?|nobody|somebody|himself|herself|strangers?
    |of\ (?:its|their)\ own|of\ now)\b""",
    re.VERBOSE | re.IGNORECASE,
)
"""Words in running text for which the field has another term, and personification."""

REAL_USES = re.compile(
    r"""`[^`]*`                                  # code keeps the names it quotes
    |\b(?:by|other|left|right|first|second)[ -]hand\b|\bhand-?(?:held|written|made|eye)\b
    |\bpanda_hand\b|\bConnection\ refused\b
    |\b(?:as|is|are|was|were|be)\ shown\ (?:in|by|on|at|to|with|as|below|above)\b   # figures
    |\bhttps?://\S+""",
    re.VERBOSE | re.IGNORECASE,
)
"""Uses of these words that are standard English or code."""

ALLOWED: dict[str, str] = {
    "text/idioms.py: hand": "pattern for words of users",
    "text/vocabulary.py: hand": "pattern for words of users",
    "text/vocabulary.py: rests": "pattern for words of users",
    "text/vocabulary.py: want": "word of users",
    "text/vocabulary.py: stands": "word of users",
    "text/vocabulary.py: refuse": "pattern for words of users",
    "semantic/embeddings.py: picture": "input of the text encoder, whose cosines would change",
    "semantic/embeddings.py: hand": "input of the text encoder, whose cosines would change",
}
"""``file suffix: name or word`` -> reason, for real uses that no pattern covers."""

OPENERS = re.compile(r"^(What|Whether|How|Where|Who|Whose|Which|When|Why)\b")
LONGEST_SENTENCE = 35
SHAPE = re.compile(r"\([A-Za-z0-9_+* ]+(?:, [A-Za-z0-9_+* .…]+)*,?\)|\bshape\b|\bscalars?\b")
UNIT = re.compile(
    r"\[[^\]]{1,24}\]|\b(?:pixels?|px|unit vector|dimensionless|no unit|in metres|in radians|"
    r"homogeneous|rotation matri|quaternion|boolean|mask|indices)",
)


@dataclass(frozen=True)
class Finding:
    """A name or text that does not follow the vocabulary."""

    path: str
    line: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.kind}: {self.text}"


def words_of(name: str) -> list[str]:
    """Split an identifier at underscores and capitals, in lower case."""
    return [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def defined_names(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the name of everything that a module defines, binds or takes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, ast.alias) and node.asname:
            yield node.lineno, node.asname


def docstrings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of docstrings, those of attributes and constants included."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            if (
                isinstance(statement, ast.Expr)
                and isinstance(statement.value, ast.Constant)
                and isinstance(statement.value.value, str)
            ):
                yield statement.lineno, statement.value.value


def texts_of(source: str, tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield comments and strings of at least two words, with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def is_allowed(path: str, word: str) -> bool:
    """Return whether ``ALLOWED`` lists this word for this file."""
    return any(path.endswith(key.split(": ")[0]) and key.split(": ")[1] == word for key in ALLOWED)


def text_findings(path: str, line: int, text: str) -> Iterator[Finding]:
    """Yield the words of a text that have another term."""
    for match in TEXT_WORDS.finditer(REAL_USES.sub(" ", text)):
        if not is_allowed(path, match.group(0).lower()):
            around = text[max(0, match.start() - 30) : match.end() + 30].replace("\n", " ")
            yield Finding(path, line, "text", f"{match.group(0)!r} in {around!r}")


def python_findings(file: Path) -> Iterator[Finding]:
    """Yield the findings of one Python file."""
    source, path = file.read_text(encoding="utf-8"), file.relative_to(ROOT).as_posix()
    tree = ast.parse(source)
    for word in words_of(file.stem):
        if word in NAME_WORDS and not is_allowed(path, word):
            yield Finding(path, 1, "module name", file.stem)
    seen = set()
    for line, name in defined_names(tree):
        for word in words_of(name):
            if word in NAME_WORDS and name not in seen and not is_allowed(path, name):
                seen.add(name)
                yield Finding(path, line, "name", name)
    for line, text in docstrings(tree):
        if OPENERS.match(text.strip()):
            yield Finding(path, line, "docstring opens with a question word", text.split("\n")[0])
    for line, text in texts_of(source, tree):
        yield from text_findings(path, line, text)


def prose_of(markdown: str) -> Iterator[tuple[int, str]]:
    """Yield paragraphs, list items and table cells of a page, without code."""
    block: list[str] = []
    start, fenced = 1, False
    for number, row in enumerate([*markdown.splitlines(), ""], start=1):
        if row.lstrip().startswith("```"):
            fenced = not fenced
            row = ""
        stripped = row.strip()
        new_item = re.match(r"([-*]|\d+\.|#+|>|\|)\s?", stripped)
        if fenced or not stripped or new_item:
            if block:
                yield start, " ".join(block)
            block = []
        if fenced or not stripped:
            continue
        if stripped.startswith("|"):
            yield from ((number, cell.strip()) for cell in stripped.split("|") if cell.strip())
            continue
        if not block:
            start = number
        block.append(re.sub(r"^([-*]|\d+\.|#+|>)\s+", "", stripped))


def page_findings(file: Path) -> Iterator[Finding]:
    """Yield the findings of one Markdown page."""
    path = file.relative_to(ROOT).as_posix()
    for line, text in prose_of(file.read_text(encoding="utf-8")):
        yield from text_findings(path, line, text)
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
        for sentence in re.split(r"(?<=[.!?:;])\s+", plain):
            if len(sentence.split()) > LONGEST_SENTENCE:
                yield Finding(path, line, "long sentence", sentence[:80])


def findings(path: Path) -> list[Finding]:
    """Return the findings of a file, or of all files below a folder."""
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    found: list[Finding] = []
    for file in files:
        if file.suffix == ".py":
            found += python_findings(file)
        elif file.suffix == ".md":
            found += page_findings(file)
        elif file.name == "error_lines.txt":
            rows = file.read_text(encoding="utf-8").splitlines()
            for number, row in enumerate(rows, start=1):
                if row.startswith("    "):
                    found += text_findings("tests/error_lines.txt", number, row)
    return found


def array_functions() -> tuple[int, int, list[str]]:
    """Count the public functions that take arrays, those with shape and unit; name the others."""
    total, good, missing = 0, 0, []
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.FunctionDef) or node.name.startswith("_"):
                    continue
                arguments = [*node.args.args, *node.args.kwonlyargs]
                kinds = [ast.unparse(a.annotation) for a in arguments if a.annotation]
                if not any(re.search(r"\b(Array|NDArray|ndarray|Mask)\b", kind) for kind in kinds):
                    continue
                text = ast.get_docstring(node) or ""
                total += 1
                if SHAPE.search(text) and UNIT.search(text):
                    good += 1
                else:
                    missing.append(f"{file.relative_to(ROOT)}:{node.lineno} {node.name}")
    return total, good, missing


@pytest.mark.parametrize("place", [*PACKAGES, *OTHER_PLACES])
def test_names_and_texts_use_the_terms_of_the_field(place: str) -> None:
    found = findings(ROOT / place)
    assert not found, "\n".join(map(str, found[:20]))


def test_error_lines_use_the_terms_of_the_field() -> None:
    found = findings(ROOT / "tests" / "error_lines.txt")
    assert not found, "\n".join(map(str, found[:20]))


def test_half_of_the_functions_that_take_arrays_give_shapes_and_units() -> None:
    total, good, missing = array_functions()
    assert good >= 0.5 * total, "\n".join([f"{good} of {total}", *missing[:20]])


@pytest.mark.parametrize(
    ("name", "words"),
    [("HandState", ["hand", "state"]), ("read_URDF_file", ["read", "urdf", "file"])],
)
def test_names_are_split_into_words(name: str, words: list[str]) -> None:
    assert words_of(name) == words


def test_findings_name_coined_words_and_spare_code_and_real_uses() -> None:
    text = "The judge of `told` says so; moved by hand, as shown in the figure."
    assert [f.text.split("'")[1] for f in text_findings("x.py", 1, text)] == ["judge", "says"]


if __name__ == "__main__":
    places = [ROOT / p for p in sys.argv[1:]] or [ROOT / p for p in PACKAGES]
    listed = [finding for place in places for finding in findings(place.resolve())]
    for one in listed:
        sys.stdout.write(f"{one}\n")
    sys.stdout.write(f"{len(listed)} findings\n")
