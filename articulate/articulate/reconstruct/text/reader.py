"""Words of a text and what was read so far: state of the parser and look-ahead."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from articulate.reconstruct.text.description import Description, PartGroup, Position, Side, Stack
from articulate.reconstruct.text.vocabulary import COLOURS, FIXED_FEATURES, MATERIALS, PARTS

SEPARATORS = frozenset({",", ";", ".", "and", "with", "plus", "having", "has", "but", "then", "or"})
HINGED = frozenset({"door", "flap", "freezer"})
AMBIGUOUS = frozenset(
    {"arms", "arm", "outlet", "outlets", "rings", "ring", "keys", "body", "bodies"}
)
"""Words that name a part of few objects only."""
PLURALS = frozenset({"leaves", "feet", "shelving", "keys"})
_PART_PATTERNS = sorted(
    ((kind, re.compile(rf"(?:{pattern})$")) for kind, pattern in PARTS.items()),
    key=lambda item: -len(item[1].pattern),
)
_TOKEN = re.compile(
    r"@unknown_-\d+|@[a-z_]+[0-9_]*|\d+(?:\.\d+)?|[a-z][a-z']*|[,;:.]|[^\s()\[\]\"'`?!/-]"
)


def normalise(text: str) -> str:
    """Return a text in lower case, with plain quotation marks and without hyphens."""
    text = (
        text.lower()
        .replace("@", " ")
        .replace("#", " ")
        .replace("’", "'")
        .replace("‘", "'")
        .replace("′", "'")
    )
    text = text.replace("“", '"').replace("”", '"').replace("″", '"').replace("''", '"')
    text = text.replace("&", " and ")
    text = re.sub(r"\bw/o\b", "without", text)
    text = re.sub(r"\bw/\s*(?![dh]\b)", "with ", text)
    text = re.sub(r"n't\b", " not", text)
    text = re.sub(r"'(?:s|re|ve|ll|d|m)\b", " ", text)
    text = re.sub(r"(?<=[a-z])[-–—](?=[a-z\d])|(?<=\d)[-–—](?=[a-z])", " ", text)
    text = re.sub(r"[–—]", ", ", text)
    text = re.sub(r'(?<![\d\s])"|(?<!\d)"', " ", text)
    text = re.sub(r"(?<![\d])'(?![a-z])|(?<![a-z\d])'", " ", text)
    return re.sub(r"\s+", " ", text)


def tokens_of(text: str) -> list[str]:
    """Split a text with symbols into words, numbers, symbols and punctuation."""
    return _TOKEN.findall(text)


@dataclass(kw_only=True)
class Pending:
    """Words before a part that describe it."""

    number: int | None = None
    multiple: int | None = None
    absent: bool = False
    definite: bool = False
    both: bool = False
    material: str = ""
    hinge: Side = ""
    position: Position = ""
    weight: float = 1.0
    scale: dict[str, float] = field(default_factory=dict)
    stack: Stack = ""
    grid: tuple[int, int] | None = None
    rows: int | None = None
    columns: int | None = None
    plastic: bool = False
    slides: bool = False
    words: list[str] = field(default_factory=list)


@dataclass(kw_only=True)
class Reader:
    """State of the parser, and look-ahead."""

    tokens: list[str]
    out: Description
    at: int = 0
    pending: Pending = field(default_factory=Pending)
    current: int | None = None
    """Index of the last group."""
    relation: tuple[str, int] | None = None
    """Relation whose second group is still to come."""
    next_position: Position = ""
    """Position of the group that comes next."""
    member: str = ""
    """Position of the single part to which the next hinge belongs."""

    @property
    def following(self) -> str:
        """Return the next word; empty at the end."""
        return self.tokens[self.at + 1] if self.at + 1 < len(self.tokens) else ""

    @property
    def before(self) -> str:
        """Return the previous word; empty at the start."""
        return self.tokens[self.at - 1] if self.at else ""

    @property
    def group(self) -> PartGroup | None:
        """Return the last group."""
        return None if self.current is None else self.out.groups[self.current]

    def part_at(self, at: int) -> tuple[int, str]:
        """Return the number of tokens and the kind of the part that starts at a word."""
        for length in (3, 2, 1):
            words = " ".join(self.tokens[at : at + length])
            if "@" in words or len(self.tokens) < at + length:
                continue
            for kind, pattern in _PART_PATTERNS:
                if pattern.match(words) and self._is_part_here(kind, words):
                    return length, kind
        return 0, ""

    def _is_part_here(self, kind: str, words: str) -> bool:
        category = self.out.category or "furniture"
        if words in {"arms", "arm", "outlet", "outlets", "rings", "ring", "keys", "body", "bodies"}:
            return kind in FIXED_FEATURES.get(category, frozenset()) or category == "faucet"
        if kind == "top" and words in {"top", "tops"}:
            return False
        if kind == "cap" and words == "tops":
            return category == "bottle"
        if kind == "freezer":
            return category == "fridge"
        if words.startswith("switch"):
            return category == "switch"
        if kind in {"screen", "tank", "drum", "rack", "plate", "top"}:
            return kind in FIXED_FEATURES.get(category, frozenset())
        return True

    def next_kind(self, at: int) -> str:
        """Return the kind of the part that the noun phrase at ``at`` ends with."""
        for k in range(at, min(at + 6, len(self.tokens))):
            word = self.tokens[k]
            _, kind = self.part_at(k)
            if kind:
                return kind
            if (
                word in SEPARATORS
                or word == ":"
                or (
                    word.startswith("@")
                    and not word.startswith(("@mult", "@hinge", "@grid", "@row", "@column"))
                )
            ):
                return ""
        return ""

    def separator_follows(self) -> bool:
        """Return whether a separator follows."""
        return self.following in SEPARATORS or self.following == ":"

    def is_material_at(self, at: int) -> bool:
        """Return whether a word is a material or colour."""
        return at < len(self.tokens) and (
            self.tokens[at] in COLOURS or self.tokens[at] in MATERIALS
        )

    def object_follows(self) -> bool:
        """Return whether the noun of the object follows in the same phrase."""
        for word in self.tokens[self.at + 1 : self.at + 5]:
            if word in {"@object", "@again"}:
                return True
            if word in SEPARATORS:
                return False
        return False

    def part_within(self, start: int) -> bool:
        """Return whether a part is named between ``start`` and here without a separator."""
        for k in range(self.at - 1, max(-1, start), -1):
            if self.tokens[k] in SEPARATORS:
                return False
            if self.part_at(k)[1]:
                return True
        return False
