"""Parser: from a text to its :class:`Description`."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from articulate.errors import ConfigError, quote
from articulate.reconstruct.text.arrangement import DEFINITE, ArrangementReader
from articulate.reconstruct.text.consistency import check_counts, set_sizes
from articulate.reconstruct.text.description import (
    Description,
    Handles,
    PartGroup,
    Position,
    Side,
    with_article,
)
from articulate.reconstruct.text.idioms import Noun, replace_idioms, replace_nouns
from articulate.reconstruct.text.measures import Measured, find_measures, find_volume, with_digits
from articulate.reconstruct.text.reader import (
    PLURALS,
    SEPARATORS,
    Pending,
    normalise,
    tokens_of,
)
from articulate.reconstruct.text.size_owner import is_component_size
from articulate.reconstruct.text.vocabulary import (
    COLOURS,
    FILLER,
    FIXED_COUNTS,
    FIXED_FEATURES,
    MATERIALS,
    NO_EFFECT,
    SIZE_WORDS,
)

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
ROUND_WORDS = frozenset({"round", "cylindrical", "circular"})
ROUND_CLASSES = frozenset({"trash_can", "bucket", "bottle", "kettle", "kitchen_pot"})
COMPOUND = {
    "freezer": frozenset({"drawer", "door", "handle", "knob"}),
    "door": frozenset({"handle", "knob"}),
    "lever": frozenset({"handle"}),
    "drawer": frozenset({"handle", "knob"}),
    "cover": frozenset({"seat", "handle"}),
}
"""Kinds of parts whose noun specifies a following one of these kinds."""
WITHOUT_EFFECT = frozenset(
    {
        "hinged",
        "hinge",
        "hinges",
        "swivel",
        "rotary",
        "open",
        "opens",
        "opening",
    }
)
"""Words for the motion that a part has anyway."""
MOTION_WORDS = {
    "sliding_window": frozenset({"slides", "sliding", "sideways"}),
    "office_chair": frozenset({"tilts", "tilting", "tilt", "reclining", "reclines"}),
}
"""Words for the motion that the parts of a class have anyway."""


def parse(text: str) -> Description:
    """Parse an English text.

    Raises:
        ConfigError: The counts contradict each other, or several objects are described.
    """
    plain = with_digits(
        re.sub(r"\bone (?=(?:above|over|on top|below|under)\b)", "1 ", text.lower())
    )
    plain, volume_m3 = find_volume(with_digits(normalise(plain)))
    measured = find_measures(plain)
    # A noun may contain words of an idiom ("fridge freezer below"); nouns come first.
    with_object, nouns = replace_nouns(measured.text)
    parser = _Parser(
        tokens=tokens_of(replace_idioms(with_object)),
        measured=measured,
        nouns=nouns,
        out=Description(text=text, volume_m3=volume_m3),
    )
    return parser.run()


@dataclass(kw_only=True)
class _Parser(ArrangementReader):
    """Reads symbols from left to right."""

    measured: Measured
    nouns: list[Noun]
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
        self._finish_phrase()
        if self.relation is not None and self.current is not None:
            self._adverb(self.relation[0])
        if self.member:
            out.unknown.append(f"the {self.member} one")
        set_sizes(out, self.sizes)
        check_counts(out)
        return out

    def _step(self, word: str) -> None:
        if word.startswith("@"):
            self._symbol(word)
            return
        number = re.fullmatch(r"\d+(?:\.\d+)?", word)
        if number:
            self._number(word)
            return
        if word in SEPARATORS or word == ":":
            self._separator(word)
            return
        length, kind = self.part_at(self.at)
        if kind:
            words = self.tokens[self.at : self.at + length]
            self.at += length - 1
            self._part(kind, words)
            return
        self._word(word)

    def _symbol(self, symbol: str) -> None:
        name, _, value = symbol[1:].partition("_")
        if name.startswith("size"):
            self._measure(int(name[4:]))
            return
        actions: dict[str, Callable[[str], None]] = {
            "object": lambda _: self._object(),
            "again": lambda _: self._flush_adjectives_to_object(),
            "no": lambda _: self._exclude(),
            "hinge": lambda side: self._hinge(cast(Side, side)),
            "handle": self._handle_side,
            "slide": lambda _: self._slide(),
            "pos": self._position,
            "rel": self._relation,
            "row": lambda _: self._stack("row"),
            "column": lambda _: self._stack("column"),
            "grid": lambda sizes: self._grid(*(int(n) for n in sizes.split("_"))),
            "rows": lambda number: self._rows_or_columns("rows", int(number)),
            "columns": lambda number: self._rows_or_columns("columns", int(number)),
            "mult": lambda number: setattr(self.pending, "multiple", int(number)),
            "opt": self.out.options.add,
            "member": lambda member: setattr(self, "member", member),
            "unknown": lambda words: self.out.unknown.append(words.replace("_", " ")),
        }
        if name in actions:
            actions[name](value)

    def _slide(self) -> None:
        """Read ``sliding doors`` and ``doors that slide``."""
        group = self.group
        if self.out.category not in {"furniture", ""}:
            self.out.unknown.append("sliding")
        elif self.next_kind(self.at + 1) == "door":
            self.pending.slides = True
        elif group is not None and group.kind == "door":
            group.slides = True
        else:
            self.out.unknown.append("sliding")

    def _exclude(self) -> None:
        self._finish_phrase()
        self.pending.absent = True
        self.no_list = True

    def _handle_side(self, side: str) -> None:
        """Read ``handle on the left``: the hinge is opposite."""
        opposite: dict[str, Side] = {"left": "right", "right": "left"}
        if side in opposite:
            self._hinge(opposite[side])

    def _number(self, word: str) -> None:
        value = float(word)
        if not value.is_integer():
            self.out.unknown.append(word)
            return
        if self.pending.number is not None:
            self.out.unknown.append(str(self.pending.number))
        self.pending.number = int(value)
        before = self.before
        if before in {":", "="} and self.current is not None:  # "doors: 2"
            following = self.next_kind(self.at + 1)
            group = self.out.groups[self.current]
            if not following and group.count is None:
                group.count, self.pending.number = int(value), None

    def _separator(self, word: str) -> None:
        if word in {"and", "or"} and self.no_list and self.next_kind(self.at + 1):
            # "no doors or shelves", but "no doors and a drawer"
            counted = self.following.isdigit() or self.following in {"a", "an"}
            if word == "or" or not counted:
                self.pending.absent = True
            return
        if word == "and" and self.pending.material and self.is_material_at(self.at + 1):
            return  # "black and white"
        if word in {"with", "having", "has", ",", ";", ".", "but"}:
            self.no_list = False
        self._finish_phrase()
        if word in {";", "."}:
            self.next_position = ""

    def _word(self, word: str) -> None:
        if self._material(word) or self._determiner(word):
            return
        pending, out = self.pending, self.out
        if word in ADJECTIVE_POSITIONS and self.next_kind(self.at + 1):
            pending.position = ADJECTIVE_POSITIONS[word]
        elif word in SIZE_WORDS:
            dimension, factor = SIZE_WORDS[word]
            pending.scale[dimension] = factor
            pending.weight = 1.4 if factor > 1.0 else 0.7
        elif word in {"bar", "bars"}:
            out.handles = "bar"
            out.handle_material = pending.material
            self.pending = Pending()
        elif word in ROUND_WORDS and out.category not in ROUND_CLASSES:
            if self.next_kind(self.at + 1) not in {"knob", "handle", "dial"}:
                out.unknown.append(word)
        elif word in {"top", "left", "right", "bottom", "middle"}:
            self._position(ADJECTIVE_POSITIONS[word])
        elif word in NO_EFFECT:
            self._no_effect(word)
        elif word not in FILLER | WITHOUT_EFFECT and not (
            word in MOTION_WORDS.get(out.category, ())
            or (word in {"tilting", "tilt"} and self.next_kind(self.at + 1) == "flap")
        ):
            out.unknown.append(word)

    def _material(self, word: str) -> bool:
        """Read a material or colour; return False for other words."""
        pending, pair = self.pending, f"{word} {self.following}"
        if pair in MATERIALS:
            self.at += 1
            pending.material = pair
        elif word == "plastic":
            pending.plastic = True
            pending.material = f"{pending.material} plastic".strip()
        elif word in MATERIALS:
            pending.material = word
        elif word in COLOURS:
            pending.material = f"{word} plastic" if pending.plastic else word
        else:
            return False
        self._material_after()
        return True

    def _determiner(self, word: str) -> bool:
        """Read ``only``, ``both`` and definite articles; return False for other words."""
        if word == "only":
            self._only()
        elif word == "both":
            self.pending.both = self.pending.definite = True
        elif word in DEFINITE:
            self.pending.definite = True
        else:
            return False
        return True

    def _no_effect(self, word: str) -> None:
        if word not in self.out.ignored:
            self.out.ignored.append(word)
        self.pending.words.append(word)

    def _object(self) -> None:
        noun, pending = self.nouns[0], self.pending
        number = pending.number
        switches = noun.object_class.name == "switch" and number is not None
        if noun.plural and (number or 2) > 1 and not switches:
            raise ConfigError(
                f"{quote(self.out.text)}: describes several objects; describe one, for "
                f'example "{with_article(noun.text)}"'
            )
        for count in (number, pending.multiple):
            if count is not None and count > 1:
                self.out.options.add(f"times_{count}")
        if pending.stack:
            self.out.stack = pending.stack
        if pending.position and not self.out.groups:
            self.out.unknown.append(pending.position)
        self._flush_adjectives_to_object()

    def _flush_adjectives_to_object(self) -> None:
        pending, out = self.pending, self.out
        if pending.material:
            out.material = pending.material
        out.scale |= pending.scale
        if pending.hinge:
            out.hinge = pending.hinge
        self.pending = Pending()

    def _part(self, kind: str, words: list[str]) -> None:
        pending, out = self.pending, self.out
        length, next_kind = self.part_at(self.at + 1)
        if kind == "freezer" and next_kind == "door":
            self.at += length  # the freezer has a door
            pending.words.append("door")
        elif length and kind in COMPOUND and next_kind in COMPOUND[kind]:
            pending.words.append(kind)  # "freezer drawer", "door handle"
            return
        if kind in {"handle", "knob"} and self._are_handles(kind):
            self._handles(words[-1])
            return
        features = FIXED_FEATURES.get(out.category, frozenset())
        if kind in features or (kind == "open" and out.category == "oven"):
            self._fixed_feature(kind, " ".join(words))
            return
        if pending.absent:
            out.absent.add(kind)
            self.pending = Pending()
            return
        if kind == "open" and self.following == ":" and self.next_kind(self.at + 2):
            self.pending = Pending()  # "three compartments: a door, two drawers …"
            return
        plural = words[-1].endswith("s") or words[-1] in PLURALS
        existing = [k for k, group in enumerate(out.groups) if group.kind == kind]
        numbers = (pending.number, pending.multiple, pending.grid, pending.rows, pending.columns)
        uncounted = all(number is None for number in numbers)
        placed = pending.position or self.next_position
        if existing and uncounted and (pending.definite or (plural and not placed)):
            self._refer(existing, plural=plural)
            return
        out.groups.append(self._new_group(kind, plural=plural))
        self.next_position = ""
        self._relate(len(out.groups) - 1)
        self.current = len(out.groups) - 1
        self.pending = Pending()
        if kind == "freezer" and self.member:  # "the upper one for the freezer"
            out.groups[-1].position = cast(Position, self.member)
            self.member = ""

    def _fixed_feature(self, kind: str, words: str) -> None:
        """Compare a part that does not move with what objects of the class have."""
        pending, out = self.pending, self.out
        usual = FIXED_COUNTS.get((out.category, kind))
        if pending.absent:
            out.doubts.append(f"{words} cannot be left out of {with_article(out.noun)}")
        elif out.category == "door" and kind == "panel" and pending.number is not None:
            out.options.add(f"panels_{pending.number}")
        elif usual is not None and pending.number not in {None, usual}:
            out.doubts.append(
                f"{with_article(out.noun)} is made with {usual} {words}, not {pending.number}"
            )
        else:
            out.ignored.append(words)
        self.pending = Pending()

    def _new_group(self, kind: str, *, plural: bool) -> PartGroup:
        """Return a group with the words before its noun."""
        pending = self.pending
        adjective = not plural and self.following in {"@object", "@again"}
        count = pending.multiple if pending.number is None else pending.number
        if count is None:
            count = 2 if pending.both else None if plural or adjective else 1
        rows, columns = pending.grid or (pending.rows, pending.columns)
        if rows and columns and pending.number in {None, rows * columns}:
            count = rows * columns
        return PartGroup(
            kind=kind,
            count=count,
            position=pending.position or self.next_position,
            stack=pending.stack or ("row" if pending.multiple else ""),
            rows=rows,
            columns=columns,
            hinge=pending.hinge,
            slides=pending.slides and kind == "door",
            weight=pending.weight,
            material=pending.material,
            words=tuple(pending.words),
            is_adjective=adjective,
        )

    def _refer(self, existing: list[int], *, plural: bool) -> None:
        """Apply the words before a part that was named earlier, as in ``the doors are white``."""
        pending, out = self.pending, self.out
        index = existing[-1]
        if pending.position and not plural:  # "the left door"
            self.member = pending.position
            if pending.hinge:
                out.groups[index].member_hinges[self.member] = pending.hinge
                self.member = ""
            self.current = index
            self.pending = Pending()
            return
        for k in existing if plural else [index]:
            group = out.groups[k]
            group.hinge = pending.hinge or group.hinge
            group.slides = pending.slides or group.slides
            group.material = pending.material or group.material
            if pending.both and group.count is None:
                group.count = 2
        self._relate(index)
        self.current = index
        self.pending = Pending()

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
        self.pending = Pending()

    def _only(self) -> None:
        """``doors only`` and ``only doors`` exclude the other kind."""
        kind = self.next_kind(self.at + 1)
        before = self.before
        if before and self.current is not None and self.part_at(self.at - 1)[1]:
            kind = self.out.groups[self.current].kind
        if kind in {"door", "drawer"}:
            self.out.only = kind

    def _material_after(self) -> None:
        """``made of oak`` and ``in white`` follow their noun."""
        back = self.tokens[max(0, self.at - 4) : self.at]
        after_noun = (bool(back) and back[-1] in {"of", "in", "from", "is", "are", "painted"}) or (
            len(back) > 1 and back[-1] in {"plastic", "metal"}
        )
        following = self.following
        continues = following in MATERIALS or following in COLOURS
        names_next = self.next_kind(self.at + 1) or self.object_follows()
        if continues or names_next:
            return
        pending, out = self.pending, self.out
        material = pending.material
        group = out.groups[self.current] if self.current is not None else None
        direct = after_noun and group is not None and self.part_within(self.at - 5)
        if direct and group is not None:
            group.material = material
        else:
            out.material = material
        pending.material = ""

    def _measure(self, index: int) -> None:
        if is_component_size(self, self.measured.measures[index]):
            texts = ", ".join(m.text for m in self.measured.measures[index])
            self.out.doubts.append(f'"{texts}" is a size of a part, which cannot be set')
            return
        for m in self.measured.measures[index]:
            self.sizes.append((m.dimension, m.value, m.unit_m))

    def _finish_phrase(self) -> None:
        """Handle words before a separator that no part followed."""
        pending, out = self.pending, self.out
        if pending.number is not None:
            group = None if self.current is None else out.groups[self.current]
            back = self.tokens[max(0, self.at - 3) : self.at]
            lines = 0 if group is None else group.columns or group.rows or 0
            if group is not None and "each" in back and group.count is None and lines:
                group.count = pending.number * lines
            elif group is not None and ({"of", "them"} & set(back) or ":" in back):
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
        if not self.out.groups:
            out.scale |= {name: value for name, value in pending.scale.items() if name != "all"}
        position = pending.position
        self.pending = Pending()
        if position and self.current is not None:
            out.groups[self.current].position = position
