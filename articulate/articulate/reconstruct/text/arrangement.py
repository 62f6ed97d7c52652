"""Arrangement in a text: relations, positions, rows and columns, hinged edges."""

from __future__ import annotations

from typing import cast

from articulate.errors import ConfigError, quote
from articulate.reconstruct.text.description import (
    Link,
    PartGroup,
    Position,
    Relation,
    Side,
    Stack,
)
from articulate.reconstruct.text.reader import HINGED, SEPARATORS, Pending, Reader

PRONOUNS = frozenset({"it", "them", "that", "this", "which", "those"})
DEFINITE = frozenset({"the", "its", "their", "these", "those", "all"})


class ArrangementReader(Reader):
    """Reads symbols for the arrangement of groups."""

    def _relate(self, index: int) -> None:
        if self.relation is None:
            return
        name, first = self.relation
        self.relation = None
        if first == index:
            return
        links: dict[str, tuple[int, Link, int]] = {
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
        self.out.relations.append(Relation(first=a, link=link, second=b))

    def _relation(self, name: str) -> None:
        following, before = self.following, self.before
        opens = before in SEPARATORS  # "a door and below it a drawer"
        self._number_as_subset()
        if self.current is None:
            if self.next_kind(self.at + 1) and name in {"above", "below"}:
                self.next_position = "bottom" if name == "above" else "top"
            return
        if following == "each" and not self.next_kind(self.at + 2) and self.current:
            group, other = self.out.groups[self.current], self.out.groups[self.current - 1]
            if group.count is not None and other.count is not None:
                group.count *= other.count  # "two flaps and a drawer beneath each"
                group.stack = other.stack or "row"
            self._adverb(name)
            return
        if following in PRONOUNS:  # "a door and below it a drawer", "a drawer below it"
            self.at += 1
            comma = self.following == ","
            if self.next_kind(self.at + (2 if comma else 1)) and (not comma or opens):
                self.at += comma
                reversed_name = {"above": "below", "below": "above", "left": "right"}
                self.relation = (
                    reversed_name.get(name, "left" if name == "right" else name),
                    self.current,
                )
            else:
                self._adverb(name)
            return
        if self.next_kind(self.at + 1):
            if opens and name in {"above", "below"} and (self.tokens[self.at + 1] not in DEFINITE):
                # "one drawer and below two doors"
                self.relation = ("below" if name == "above" else "above", self.current)
            else:
                self.relation = (name, self.current)
        elif opens and following in {",", ":"} and self.next_kind(self.at + 2):
            self.at += 1  # "one drawer and, underneath, a door"
            self.relation = ("below" if name == "above" else "above", self.current)
        else:
            self._adverb(name)

    def _adverb(self, name: str) -> None:
        """Set the position of the last group, as in ``an open shelf below``."""
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
        before = self.before
        subset = self._number_as_subset(each=each)
        out = self.out
        if subset:
            out.groups[-1].position = position
            return
        if before in {"@again", "@object"} and not self.next_kind(self.at + 1) and out.groups:
            return  # "freezer on the left, fridge on the right"
        starts = before in SEPARATORS or before in {":", ""} or before.startswith("@object")
        if self.next_kind(self.at + 1) and (starts or self.current is None):
            self.next_position = position
            return
        if (
            starts
            and self.next_kind(self.at + 2)
            and (self.tokens[self.at + 1 : self.at + 2] in ([","], [":"]))
        ):
            self.next_position = position
            self.at += 1
            return
        if self.current is None:
            self.next_position = position
            return
        group = out.groups[self.current]
        if group.position and group.position != position and self.next_kind(self.at + 1):
            self.next_position = position
            return
        opposite = {group.position, position} == {"left", "right"}
        if opposite and group.count != 1:  # "doors on the left and on the right"
            position = "ends"
        elif group.position and group.position != position:
            out.doubts.append(f"{group.kind}s have two positions")
        group.position = position
        if each and group.count is not None:
            group.count *= 2

    def _number_as_subset(self, *, each: bool = False) -> bool:
        """Read a number without a noun as a part of a group: ``six drawers, two on the left``."""
        number, out = self.pending.number, self.out
        if number is None or self.current is None:
            return False
        last = out.groups[self.current]
        self.pending = Pending()
        kind = last.kind
        divided = next((k for k, g in enumerate(out.groups) if g.kind == kind), self.current)
        out.groups.append(
            PartGroup(
                kind=kind,
                count=number * (2 if each else 1),
                subset_of=str(divided),
                material=last.material,
                hinge=last.hinge,
            )
        )
        self.current = len(out.groups) - 1
        return True

    def _stack(self, stack: Stack) -> None:
        if (
            self.next_kind(self.at + 1)
            and (
                self.current is None or self.before in SEPARATORS or self.before.startswith("@pos")
            )
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
            link: Link = "beside" if stack == "row" else "above"
            self.out.relations.append(Relation(first=first, link=link, second=second))
        else:
            group.stack = stack

    def _grid(self, rows: int, columns: int) -> None:
        if self.next_kind(self.at + 1) and not self.separator_follows():
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

    def _rows_or_columns(self, name: str, value: int) -> None:
        if value >= 1 and self.next_kind(self.at + 1) and not self.separator_follows():
            setattr(self.pending, name, value)
            return
        if value < 1 or self.current is None:
            self.out.unknown.append(f"{value} {name}")
            return
        group = self.out.groups[self.current]
        setattr(group, name, value)

    def _hinge(self, side: Side) -> None:
        following = self.next_kind(self.at + 1)
        before = self.before
        near = following in HINGED and not self.separator_follows()
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
        if group is not None and group.kind in HINGED and self.member:
            group.member_hinges[self.member] = side
            self.member = ""
        elif group is not None and group.kind in HINGED:
            group.hinge = side
        else:
            self.out.hinge = side
