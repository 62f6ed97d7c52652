"""Parser: from a text to its :class:`Description`."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import cast

from articulate.errors import ConfigError, quote
from articulate.reconstruct.text.description import (
    Description,
    Handles,
    PartGroup,
    Position,
    Relation,
    Side,
    Stack,
)
from articulate.reconstruct.text.idioms import Noun, replace_idioms, replace_nouns
from articulate.reconstruct.text.measures import (
    Measured,
    find_measures,
    guessed_unit,
    with_digits,
)
from articulate.reconstruct.text.vocabulary import (
    COLOURS,
    FILLER,
    FIXED_FEATURES,
    MATERIALS,
    NO_EFFECT,
    PARTS,
    SIZE_WORDS,
)

SEPARATORS = frozenset({",", ";", ".", "and", "with", "plus", "having", "has", "but", "then", "or"})
DEFINITE = frozenset({"the", "its", "their", "these", "those", "all"})
PRONOUNS = frozenset({"it", "them", "that", "this", "which", "those"})
ADJECTIVE_POSITIONS: dict[str, Position] = {
    "left": "left",
    "right": "right",
    "upper": "top",
    "top": "top",
    "uppermost": "top",
    "lower": "bottom",
    "bottom": "bottom",
    "lowest": "bottom",
    "middle": "middle",
    "central": "middle",
    "centre": "middle",
    "center": "middle",
}
HANDLE_WORDS: dict[str, Handles] = {
    "bar": "bar",
    "bars": "bar",
    "handle": "bar",
    "handles": "bar",
    "pull": "bar",
    "pulls": "bar",
    "grip": "bar",
    "grips": "bar",
    "knob": "knob",
    "knobs": "knob",
}
HINGED = frozenset({"door", "flap", "freezer"})
MAX_PARTS = 60
"""Most parts of one kind."""
_PART_PATTERNS = sorted(
    ((kind, re.compile(rf"(?:{pattern})$")) for kind, pattern in PARTS.items()),
    key=lambda item: -len(item[1].pattern),
)
_TOKEN = re.compile(r"@[a-z_]+[0-9_]*|\d+(?:\.\d+)?|[a-z][a-z']*|[,;:.]|[^\s()\[\]\"'`?!/-]")
ROUND_WORDS = frozenset({"round", "cylindrical", "circular"})
ROUND_CLASSES = frozenset({"trash_can", "bucket", "bottle", "kettle", "kitchen_pot"})


def normalise(text: str) -> str:
    """Return a text in lower case, with plain quotation marks and without hyphens."""
    text = text.lower().replace("’", "'").replace("‘", "'").replace("′", "'")
    text = text.replace("“", '"').replace("”", '"').replace("″", '"').replace("''", '"')
    text = re.sub(r"n't\b", " not", text)
    text = re.sub(r"'(?:s|re|ve|ll)\b", " ", text)
    text = re.sub(r"(?<=[a-z])[-–—](?=[a-z\d])|(?<=\d)[-–—](?=[a-z])", " ", text)
    text = re.sub(r"[–—]", ", ", text)
    text = re.sub(r'(?<![\d\s])"|(?<!\d)"', " ", text)
    text = re.sub(r"(?<![\d])'(?![a-z])|(?<![a-z\d])'", " ", text)
    return re.sub(r"\s+", " ", text)


def parse(text: str) -> Description:
    """Parse an English text.

    Raises:
        ConfigError: The counts contradict each other, or several objects are described.
    """
    plain = with_digits(
        re.sub(r"\bone (?=(?:above|over|on top|below|under)\b)", "1 ", text.lower())
    )
    plain = with_digits(normalise(plain))
    measured = find_measures(plain)
    # A noun may contain words of an idiom ("fridge freezer below"); nouns come first.
    with_object, nouns = replace_nouns(measured.text)
    parser = _Parser(
        tokens=_TOKEN.findall(replace_idioms(with_object)),
        measured=measured,
        nouns=nouns,
        out=Description(text=text),
    )
    return parser.run()


@dataclass(kw_only=True)
class _Pending:
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
    scale: tuple[str, float] | None = None
    stack: Stack = ""
    grid: tuple[int, int] | None = None
    plastic: bool = False
    words: list[str] = field(default_factory=list)


@dataclass(kw_only=True)
class _Parser:
    """Reads symbols from left to right."""

    tokens: list[str]
    measured: Measured
    nouns: list[Noun]
    out: Description
    at: int = 0
    pending: _Pending = field(default_factory=_Pending)
    current: int | None = None
    """Index of the last group."""
    relation: tuple[str, int] | None = None
    """Relation whose second group is still to come."""
    next_position: Position = ""
    """Position of the group that comes next."""
    sizes: list[tuple[str, float, float | None]] = field(default_factory=list)
    no_list: bool = False
    """True in a list of excluded parts."""

    def run(self) -> Description:
        """Parse all tokens."""
        out = self.out
        if self.nouns:
            first = self.nouns[0]
            out.category, out.noun = first.object_class.name, first.text
            others = [noun.text for noun in self.nouns[1:]]
            if others:
                raise ConfigError(
                    f"{quote(out.text)}: names several objects, {first.text} and "
                    f"{', '.join(others)}; describe one object"
                )
        while self.at < len(self.tokens):
            self._step(self.tokens[self.at])
            self.at += 1
        self._close_clause()
        if self.relation is not None and self.current is not None:
            self._adverb(self.relation[0])
        self._finish_sizes()
        self._check_counts()
        return out

    # -- one token ---------------------------------------------------------------------------
    def _step(self, token: str) -> None:
        if token.startswith("@"):
            self._symbol(token)
            return
        number = re.fullmatch(r"\d+(?:\.\d+)?", token)
        if number:
            self._number(token)
            return
        if token in SEPARATORS or token == ":":
            self._separator(token)
            return
        length, kind = self._part_at(self.at)
        if kind:
            words = self.tokens[self.at : self.at + length]
            self.at += length - 1
            self._part(kind, words)
            return
        self._word(token)

    def _symbol(self, token: str) -> None:
        name, _, value = token[1:].partition("_")
        out, pending = self.out, self.pending
        if name.startswith("size"):
            self._measure(int(name[4:]))
        elif name == "object":
            self._object()
        elif name == "again":
            self._flush_adjectives_to_object()
        elif name == "no":
            self._close_clause()
            self.pending.absent = True
            self.no_list = True
        elif name == "hinge":
            self._hinge(cast(Side, value))
        elif name == "handle":
            opposite: dict[str, Side] = {"left": "right", "right": "left"}
            if value in opposite:
                self._hinge(opposite[value])
        elif name == "pos":
            self._position(value)
        elif name == "rel":
            self._relation(value)
        elif name in {"row", "column"}:
            self._stack(cast(Stack, name))
        elif name == "grid":
            rows, columns = (int(n) for n in value.split("_"))
            self._grid(rows, columns)
        elif name in {"rows", "columns"}:
            self._rows_or_columns(name, int(value))
        elif name == "mult":
            pending.multiple = int(value)
        elif name == "opt":
            out.options.add(value)

    def _number(self, token: str) -> None:
        value = float(token)
        if not value.is_integer():
            self.out.unknown.append(token)
            return
        if self.pending.number is not None:
            self.out.unknown.append(str(self.pending.number))
        self.pending.number = int(value)
        before = self.tokens[self.at - 1] if self.at else ""
        if before in {":", "="} and self.current is not None:  # "doors: 2"
            following = self._next_kind(self.at + 1)
            group = self.out.groups[self.current]
            if not following and group.count is None:
                group.count, self.pending.number = int(value), None

    def _separator(self, token: str) -> None:
        if token in {"and", "or"} and self.no_list and self._next_kind(self.at + 1):
            number = self.pending.number
            if (
                (number is None and self.tokens[self.at + 1] in {"no"})
                or token == "or"
                or (
                    not self.tokens[self.at + 1].isdigit()
                    and self.tokens[self.at + 1]
                    not in {
                        "a",
                        "an",
                    }
                )
            ):
                self.pending.absent = True
            return
        if token == "and" and self.pending.material and self._material_at(self.at + 1):
            return  # "black and white"
        if token in {"with", "having", "has", ",", ";", ".", "but"}:
            self.no_list = False
        self._close_clause()
        if token in {";", "."}:
            self.next_position = ""

    def _word(self, token: str) -> None:
        pending = self.pending
        pair = f"{token} {self.tokens[self.at + 1]}" if self.at + 1 < len(self.tokens) else token
        if pair in MATERIALS:
            self.at += 1
            pending.material = pair
        elif token in MATERIALS and not (token == "ash" and pending.material):
            if token == "plastic":
                pending.plastic = True
                pending.material = f"{pending.material} plastic".strip()
            else:
                pending.material = token
            self._material_after()
        elif token in COLOURS:
            pending.material = token if not pending.plastic else f"{token} plastic"
            self._material_after()
        elif token in ADJECTIVE_POSITIONS and self._next_kind(self.at + 1):
            pending.position = ADJECTIVE_POSITIONS[token]
        elif token in SIZE_WORDS:
            pending.scale = SIZE_WORDS[token]
            pending.weight = 1.4 if pending.scale[1] > 1.0 else 0.7
        elif token in {"bar", "bars"}:
            self.out.handles = "bar"
            self.out.handle_material = pending.material
            self.pending = _Pending()
        elif token == "only":
            self._only()
        elif token == "both":
            pending.both = True
            pending.definite = True
        elif token in DEFINITE:
            pending.definite = True
        elif token in ROUND_WORDS and self.out.category not in ROUND_CLASSES:
            self.out.unknown.append(token)
        elif (
            token in {"slides", "sliding", "sideways", "slide"}
            and (self.out.category == "sliding_window")
        ) or token in {"hinged", "hinge", "hinges", "swivel", "tilts", "tilting", "rotary"}:
            pass
        elif token in {"top", "left", "right", "bottom", "middle"}:
            self._position(ADJECTIVE_POSITIONS[token])
        elif token in {"open", "opens", "opening"}:
            pass
        elif token in NO_EFFECT:
            self._no_effect(token)
        elif token not in FILLER:
            self.out.unknown.append(token)

    def _no_effect(self, token: str) -> None:
        if token not in self.out.ignored:
            self.out.ignored.append(token)
        self.pending.words.append(token)

    # -- objects and parts -------------------------------------------------------------------
    def _object(self) -> None:
        noun, pending = self.nouns[0], self.pending
        number = pending.number
        if noun.plural and noun.text not in {"toilet"} and (number or 2) > 1:
            if number is not None or noun.text not in {"drawers"}:
                raise ConfigError(
                    f"{quote(self.out.text)}: describes several objects; describe one, for "
                    f'example "a {noun.text}"'
                )
        elif number is not None and number > 1:
            self.out.options.add(f"times_{number}")
        if pending.multiple is not None:
            self.out.options.add(f"times_{pending.multiple}")
        if pending.stack:
            self.out.stack = pending.stack
        if pending.position and not self.out.groups:
            self.out.unknown.append(pending.position)
        self._flush_adjectives_to_object()

    def _flush_adjectives_to_object(self) -> None:
        pending, out = self.pending, self.out
        if pending.material:
            out.material = pending.material
        if pending.scale:
            dimension, factor = pending.scale
            out.scale[dimension] = factor
        if pending.hinge:
            out.hinge = pending.hinge
        self.pending = _Pending()

    def _part_at(self, at: int) -> tuple[int, str]:
        """Return the number of tokens and the kind of the part that starts at a token."""
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
        if kind in {"freezer"}:
            return category == "fridge"
        if kind == "pedal" or kind == "panel":
            return True
        return True

    def _next_kind(self, at: int) -> str:
        """Return the kind of the part that the noun phrase at ``at`` ends with."""
        for k in range(at, min(at + 6, len(self.tokens))):
            token = self.tokens[k]
            _, kind = self._part_at(k)
            if kind:
                return kind
            if (
                token in SEPARATORS
                or token == ":"
                or (token.startswith("@") and not token.startswith(("@mult", "@hinge", "@grid")))
            ):
                return ""
        return ""

    def _part(self, kind: str, words: list[str]) -> None:
        pending, out = self.pending, self.out
        following, next_kind = self._part_at(self.at + 1)
        if (
            kind in {"freezer", "door", "drawer", "cover"}
            and following
            and next_kind
            in {
                "drawer",
                "door",
                "handle",
                "knob",
                "seat",
            }
        ):
            if not (kind == "drawer" and next_kind == "door"):
                pending.words.append(kind)  # "freezer drawer", "door handle"
                return
        if kind in {"handle", "knob"} and self._are_handles(kind):
            self._handles(words[-1])
            return
        plural = words[-1].endswith("s") or words[-1] in {"leaves", "feet", "shelving", "keys"}
        features = FIXED_FEATURES.get(out.category, frozenset())
        if kind in features or (kind == "open" and out.category in {"fridge", "safe", "oven"}):
            out.ignored.append(" ".join(words))
            self.pending = _Pending()
            return
        if pending.absent:
            out.absent.add(kind)
            self.pending = _Pending()
            return
        existing = [k for k, group in enumerate(out.groups) if group.kind == kind]
        refers = pending.definite and existing and pending.number is None
        if refers:
            self._refer(existing, plural)
            return
        count = pending.number
        if count is None:
            count = pending.multiple
            if count is None:
                count = 2 if pending.both else None if plural else 1
        if pending.grid is not None:
            rows, columns = pending.grid
            if pending.number is None or pending.number == rows * columns:
                count = rows * columns
        adjective = not plural and (
            self.at + 1 < len(self.tokens) and self.tokens[self.at + 1] in {"@object", "@again"}
        )
        if adjective and pending.number is None and pending.multiple is None:
            count = None
        group = PartGroup(
            kind=kind,
            count=count,
            position=pending.position or self.next_position,
            stack=pending.stack or ("row" if pending.multiple else ""),
            hinge=pending.hinge,
            weight=pending.weight,
            material=pending.material,
            words=tuple(pending.words),
            is_adjective=adjective,
        )
        if pending.grid is not None:
            group.rows, group.columns = pending.grid
        out.groups.append(group)
        self.next_position = ""
        self._relate(len(out.groups) - 1)
        self.current = len(out.groups) - 1
        self.pending = _Pending()

    def _refer(self, existing: list[int], plural: bool) -> None:
        """Apply the words before a part that was named earlier, as in ``the doors are white``."""
        pending, out = self.pending, self.out
        index = existing[-1]
        for k in existing if plural else [index]:
            group = out.groups[k]
            group.hinge = pending.hinge or group.hinge
            group.material = pending.material or group.material
            if pending.both and group.count is None:
                group.count = 2
        self._relate(index)
        self.current = index
        self.pending = _Pending()

    def _are_handles(self, kind: str) -> bool:
        """Return whether handles or knobs are fixed to doors and drawers of this object."""
        category = self.out.category or "furniture"
        if category in {"furniture", "table_with_drawers", "fridge"}:
            return True
        return kind == "handle" and category in {
            "microwave",
            "oven",
            "dishwasher",
            "washing_machine",
        }

    def _handles(self, word: str) -> None:
        pending, out = self.pending, self.out
        if pending.absent:
            out.handles = "none" if word not in {"knob", "knobs"} else (out.handles or "bar")
            if word in {"knob", "knobs"} and out.handles == "knob":
                out.handles = "bar"
        else:
            out.handles = HANDLE_WORDS.get(word, "bar")
            if word in {"handle", "handles"} and "bar" in pending.words:
                out.handles = "bar"
            out.handle_material = pending.material or out.handle_material
        self.pending = _Pending()

    def _only(self) -> None:
        """``doors only`` and ``only doors`` exclude the other kind."""
        kind = self._next_kind(self.at + 1)
        before = self.tokens[self.at - 1] if self.at else ""
        if before and self.current is not None and self._part_at(self.at - 1)[1]:
            kind = self.out.groups[self.current].kind
        if kind in {"door", "drawer"}:
            self.out.only = kind

    # -- arrangement -------------------------------------------------------------------------
    def _relate(self, index: int) -> None:
        if self.relation is None:
            return
        name, first = self.relation
        self.relation = None
        if first == index:
            return
        links: dict[str, tuple[int, str, int]] = {
            "above": (first, "above", index),
            "below": (index, "above", first),
            "left": (first, "left", index),
            "right": (index, "left", first),
            "beside": (first, "beside", index),
            "between": (first, "between", index),
            "flanked": (first, "between", index),
            "flanking": (index, "between", first),
        }
        a, link, b = links[name]
        self.out.relations.append(Relation(first=a, link=cast("str", link), second=b))  # type: ignore[arg-type]

    def _relation(self, name: str) -> None:
        following = self.tokens[self.at + 1] if self.at + 1 < len(self.tokens) else ""
        self._number_as_subset()
        if self.current is None:
            if self._next_kind(self.at + 1) and name in {"above", "below"}:
                self.next_position = "top" if name == "above" else "bottom"
            return
        if following in PRONOUNS:  # "a door and below it a drawer", "a drawer below it"
            self.at += 1
            if self._next_kind(self.at + 1):
                reversed_name = {"above": "below", "below": "above", "left": "right"}
                self.relation = (
                    reversed_name.get(name, "left" if name == "right" else name),
                    self.current,
                )
            else:
                self._adverb(name)
            return
        if self._next_kind(self.at + 1):
            before = self._previous(self.at)
            if (
                before in {"and", ",", ";", "with"}
                and name in {"above", "below"}
                and (self.tokens[self.at + 1] not in DEFINITE)
            ):
                # "one drawer and below two doors"
                self.relation = ("below" if name == "above" else "above", self.current)
            else:
                self.relation = (name, self.current)
        elif following in {",", ":"} and self._next_kind(self.at + 2):
            self.at += 1  # "one drawer and, underneath, a door"
            self.relation = ("below" if name == "above" else "above", self.current)
        else:
            self._adverb(name)

    def _previous(self, at: int) -> str:
        return self.tokens[at - 1] if at else ""

    def _adverb(self, name: str) -> None:
        """``an open shelf below``: the position of the last group relative to the others."""
        self.relation = None
        if self.current is None:
            return
        position: dict[str, Position] = {
            "above": "top",
            "below": "bottom",
            "left": "left",
            "right": "right",
            "between": "middle",
        }
        group = self.out.groups[self.current]
        if name in position and not group.position:
            group.position = position[name]

    def _position(self, value: str) -> None:
        each = value == "each"
        position = cast(Position, "ends" if each else value)
        before = self._previous(self.at)
        subset = self._number_as_subset(each=each)
        out = self.out
        if subset:
            out.groups[-1].position = position
            return
        starts = before in SEPARATORS or before in {":", ""} or before.startswith("@object")
        if self._next_kind(self.at + 1) and (starts or self.current is None):
            self.next_position = position
            return
        if (
            starts
            and self._next_kind(self.at + 2)
            and (self.tokens[self.at + 1 : self.at + 2] in ([","], [":"]))
        ):
            self.next_position = position
            self.at += 1
            return
        if self.current is None:
            self.next_position = position
            return
        group = out.groups[self.current]
        if group.position and group.position != position and self._next_kind(self.at + 1):
            self.next_position = position
            return
        group.position = position
        if each and group.count is not None:
            group.count *= 2

    def _number_as_subset(self, *, each: bool = False) -> bool:
        """``six drawers, two on the left``: a number without a noun is a part of the last group."""
        number, out = self.pending.number, self.out
        if number is None or self.current is None:
            return False
        last = out.groups[self.current]
        self.pending = _Pending()
        kind = last.kind
        whole = next((k for k, g in enumerate(out.groups) if g.kind == kind), self.current)
        out.groups.append(
            PartGroup(
                kind=kind,
                count=number * (2 if each else 1),
                subset_of=str(whole),
                material=last.material,
                hinge=last.hinge,
            )
        )
        self.current = len(out.groups) - 1
        return True

    def _stack(self, stack: Stack) -> None:
        if (
            self._next_kind(self.at + 1)
            and (self.current is None or self._previous(self.at) in SEPARATORS)
            and not self.pending.number
        ):
            self.pending.stack = stack
            return
        if self.current is None:
            self.out.stack = stack
            return
        group = self.out.groups[self.current]
        before = self.out.groups[self.current - 1] if self.current else None
        if group.count == 1 and before is not None and group.kind != before.kind:
            first, second = self.current - 1, self.current
            link = "beside" if stack == "row" else "above"
            self.out.relations.append(Relation(first=first, link=link, second=second))  # type: ignore[arg-type]
        else:
            group.stack = stack

    def _grid(self, rows: int, columns: int) -> None:
        if self._next_kind(self.at + 1) and not self._next_is_new_clause():
            self.pending.grid = (rows, columns)
            return
        if self.current is None:
            self.out.unknown.append(f"{rows} x {columns}")
            return
        group = self.out.groups[self.current]
        if group.count is None:
            group.count = rows * columns
        if group.count != rows * columns:
            raise ConfigError(
                f"{quote(self.out.text)}: {rows} x {columns} is not {group.count}; give one number"
            )
        group.rows, group.columns = rows, columns

    def _next_is_new_clause(self) -> bool:
        following = self.tokens[self.at + 1] if self.at + 1 < len(self.tokens) else ""
        return following in SEPARATORS or following in {":"}

    def _rows_or_columns(self, name: str, value: int) -> None:
        if value < 1 or self.current is None:
            self.out.unknown.append(f"{value} {name}")
            return
        group = self.out.groups[self.current]
        setattr(group, name, value)

    def _hinge(self, side: Side) -> None:
        following = self._next_kind(self.at + 1)
        before = self._previous(self.at)
        near = following in HINGED and not self._next_is_new_clause()
        if near and (
            self.current is None
            or before in {"a", "an", "the", *SEPARATORS}
            or before.isdigit()
            or self.pending.number is not None
        ):
            self.pending.hinge = side
            return
        if self.tokens[self.at + 1 : self.at + 2] == ["@object"]:
            self.pending.hinge = side
            return
        group = None if self.current is None else self.out.groups[self.current]
        if group is not None and group.kind in HINGED:
            group.hinge = side
        else:
            self.out.hinge = side

    # -- materials and sizes -----------------------------------------------------------------
    def _material_at(self, at: int) -> bool:
        return at < len(self.tokens) and (
            self.tokens[at] in COLOURS or self.tokens[at] in MATERIALS
        )

    def _material_after(self) -> None:
        """``made of oak`` and ``in white`` follow their noun."""
        back = self.tokens[max(0, self.at - 4) : self.at]
        after_noun = (bool(back) and back[-1] in {"of", "in", "from", "is", "are", "painted"}) or (
            len(back) > 1 and back[-1] in {"plastic", "metal"}
        )
        following = self.tokens[self.at + 1] if self.at + 1 < len(self.tokens) else ""
        continues = following in MATERIALS or following in COLOURS
        names_next = self._next_kind(self.at + 1) or self._object_follows()
        if continues or names_next:
            return
        pending, out = self.pending, self.out
        material = pending.material
        group = out.groups[self.current] if self.current is not None else None
        direct = after_noun and group is not None and self._part_within(self.at - 5)
        if direct and group is not None:
            group.material = material
        else:
            out.material = material
        pending.material = ""

    def _object_follows(self) -> bool:
        for token in self.tokens[self.at + 1 : self.at + 5]:
            if token in {"@object", "@again"}:
                return True
            if token in SEPARATORS:
                return False
        return False

    def _part_within(self, start: int) -> bool:
        """Return whether a part is named between ``start`` and here without a separator."""
        for k in range(self.at - 1, max(-1, start), -1):
            if self.tokens[k] in SEPARATORS:
                return False
            if self._part_at(k)[1]:
                return True
        return False

    def _measure(self, index: int) -> None:
        following = self.tokens[self.at + 1] if self.at + 1 < len(self.tokens) else ""
        before = self._previous(self.at)
        kind = self._part_at(self.at + 1)[1]
        of_part = bool(kind) and self.out.category not in {"door", "sliding_window"}
        if of_part or before == "each" or following == "each":
            texts = ", ".join(m.text for m in self.measured.measures[index])
            self.out.doubts.append(f'"{texts}" is a size of a part, which cannot be set')
            return
        for m in self.measured.measures[index]:
            self.sizes.append((m.dimension, m.value, m.unit_m))

    def _finish_sizes(self) -> None:
        out = self.out
        unitless = [value for _, value, unit in self.sizes if unit is None]
        given = [unit for _, _, unit in self.sizes if unit is not None]
        guess = 1.0
        if unitless:
            guess = given[0] if given else guessed_unit(unitless)
            name = {0.001: "mm", 0.01: "cm", 1.0: "m"}.get(guess, f"{guess:g} m")
            values = ", ".join(f"{value:g}" for value in unitless)
            out.assumptions.append(f"{values} without a unit: {name}")
        for dimension, value, unit in self.sizes:
            length = value * (guess if unit is None else unit)
            known = out.sizes_m.get(dimension)
            if known is not None and abs(known - length) > 1e-3 * known:
                raise ConfigError(
                    f"{quote(out.text)}: the {dimension} is given twice, {known:g} m and "
                    f"{length:g} m; give one"
                )
            out.sizes_m[dimension] = length

    # -- ends --------------------------------------------------------------------------------
    def _close_clause(self) -> None:
        """Handle words before a separator that no part followed."""
        pending, out = self.pending, self.out
        if pending.number is not None:
            group = None if self.current is None else out.groups[self.current]
            back = self.tokens[max(0, self.at - 3) : self.at]
            if group is not None and ({"of", "them"} & set(back) or ":" in back):
                if group.count is None:
                    group.count = pending.number
                elif group.count != pending.number:
                    out.unknown.append(str(pending.number))
            else:
                out.unknown.append(str(pending.number))
        if pending.material and not out.material:
            out.material = pending.material
        elif pending.material and self.current is not None:
            out.groups[self.current].material = pending.material
        if pending.scale and not self.out.groups and pending.scale[0] != "all":
            out.scale[pending.scale[0]] = pending.scale[1]
        position = pending.position
        self.pending = _Pending()
        if position and self.current is not None:
            out.groups[self.current].position = position

    def _check_counts(self) -> None:
        out = self.out
        text = quote(out.text)
        self._resolve_subsets()
        for group in out.groups:
            if group.kind in out.absent:
                raise ConfigError(
                    f"{text}: {group.kind}s are both given and excluded; give one of them"
                )
            if out.only in {"door", "drawer"} and group.kind in {"door", "drawer"} - {out.only}:
                raise ConfigError(
                    f"{text}: only {out.only}s and {group.kind}s are given; give one of them"
                )
            if group.count is not None and group.count > MAX_PARTS:
                raise ConfigError(
                    f"{text}: {group.count} {group.kind}s are too many; at most {MAX_PARTS}"
                )
            if group.rows is not None and group.columns is not None and group.count is not None:
                if group.rows * group.columns != group.count:
                    raise ConfigError(
                        f"{text}: {group.rows} x {group.columns} is not {group.count}; give one "
                        "number"
                    )
        if out.only == "door":
            out.absent.add("drawer")
        if out.only == "drawer":
            out.absent.add("door")
        self._merge_repeats()

    def _resolve_subsets(self) -> None:
        """Replace a group by its parts where the text divides it."""
        out = self.out
        wholes = {int(g.subset_of) for g in out.groups if g.subset_of}
        for index in sorted(wholes):
            whole = out.groups[index]
            subsets = [g for g in out.groups if g.subset_of == str(index)]
            total = sum(g.count or 0 for g in subsets)
            if whole.count is not None and total > whole.count:
                raise ConfigError(
                    f"{quote(out.text)}: {total} {whole.kind}s are placed and {whole.count} are "
                    "given; give one number"
                )
            if whole.count is not None and not whole.position:
                whole.count -= total
            elif whole.count is None:
                whole.count = 0
        self._drop([k for k in wholes if out.groups[k].count == 0])

    def _merge_repeats(self) -> None:
        """Drop a group that repeats an earlier one: ``two-drawer cabinet with two drawers``."""
        out, repeated = self.out, []
        for k, group in enumerate(out.groups):
            for before in out.groups[:k]:
                if before.kind != group.kind or group.subset_of:
                    continue
                if before.is_adjective and before.count in {group.count, None}:
                    before.count = group.count
                    before.position = before.position or group.position
                    before.stack = before.stack or group.stack
                    before.rows = before.rows or group.rows
                    before.columns = before.columns or group.columns
                    before.hinge = before.hinge or group.hinge
                    repeated.append(k)
                    break
                if before.is_adjective and group.count is None:
                    repeated.append(k)
                    break
                if before.is_adjective and group.count is not None:
                    raise ConfigError(
                        f"{quote(out.text)}: {before.count} and {group.count} {group.kind}s are "
                        "given; give one number"
                    )
        self._drop(repeated)

    def _drop(self, indices: list[int]) -> None:
        """Remove groups; relations refer to the others afterwards."""
        out = self.out
        keep = [k for k in range(len(out.groups)) if k not in indices]
        moved = {old: new for new, old in enumerate(keep)}
        kinds = {k: out.groups[k].kind for k in range(len(out.groups))}
        for old in indices:  # a relation to a repeated group is one to the first of its kind
            moved[old] = next((moved[k] for k in keep if kinds[k] == kinds[old]), -1)
        out.groups = [out.groups[k] for k in keep]
        out.relations = [
            Relation(first=moved[r.first], link=r.link, second=moved[r.second])
            for r in out.relations
            if min(moved[r.first], moved[r.second]) >= 0 and moved[r.first] != moved[r.second]
        ]
