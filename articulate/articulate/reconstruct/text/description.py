"""Meaning of a text about an object: category, groups of parts, arrangement, sizes, materials."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Dimension = Literal["width", "depth", "height", "diameter", "any"]
"""Measured direction; ``any``: the text gives none."""
Position = Literal["", "top", "bottom", "left", "right", "middle", "ends"]
"""Position of a group on the front; ``ends``: on both sides of the others."""
Link = Literal["above", "left", "beside", "between"]
"""Relation of one group to another."""
Side = Literal["", "left", "right", "top", "bottom"]
"""Hinged edge as seen from the front."""
Handles = Literal["", "bar", "knob", "none"]
Stack = Literal["", "row", "column"]
"""Parts of a group beside each other, or above each other."""


def with_article(noun: str) -> str:
    """Return a noun with its indefinite article: ``an oven``."""
    return f"{'an' if noun[:1] in {*'aeiou'} else 'a'} {noun}"


@dataclass(kw_only=True)
class PartGroup:
    """Parts of one kind that the text names together."""

    kind: str
    """Kind of part, a value of ``vocabulary.PARTS``."""
    count: int | None = None
    """None: the text has a plural without a number."""
    position: Position = ""
    stack: Stack = ""
    rows: int | None = None
    columns: int | None = None
    hinge: Side = ""
    weight: float = 1.0
    """Relative size, from words such as ``large``."""
    material: str = ""
    """Word for a material or colour."""
    words: tuple[str, ...] = ()
    """Words that specify the kind, for example ``freezer`` of a drawer."""
    slides: bool = False
    """True for sliding doors."""
    member_hinges: dict[str, Side] = field(default_factory=dict)
    """Hinged edge of single parts, by their position in the group."""
    is_adjective: bool = False
    """True where the kind precedes the object, as in ``two-door cabinet``."""
    subset_of: str = ""
    """Kind of the group that this one is a part of, as in ``six drawers, two on the left``."""


@dataclass(frozen=True, kw_only=True)
class Relation:
    """Relation between two groups by their indices."""

    first: int
    link: Link
    second: int


@dataclass(frozen=True, kw_only=True)
class SeenSize:
    """Size of the object in an image or video, for what its text does not give."""

    width: float
    """Width over height."""
    depth: float
    """Depth over height."""
    height_m: float | None = None
    """Height that the user gives [m]."""

    def size_m(self, dimension: str, height_m: float) -> float:
        """Return the width, depth or height of an object of a height [m]."""
        return height_m * {"width": self.width, "depth": self.depth, "height": 1.0}[dimension]


@dataclass(kw_only=True)
class Description:
    """Content of a text."""

    text: str
    category: str = ""
    """Key of ``vocabulary.CATEGORIES``; empty: none is named."""
    noun: str = ""
    """Word of the text for the object."""
    groups: list[PartGroup] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)
    absent: set[str] = field(default_factory=set)
    """Kinds that the text excludes."""
    only: str = ""
    """Kind after ``only``."""
    sizes_m: dict[str, float] = field(default_factory=dict)
    """Length by dimension [m]."""
    volume_m3: float | None = None
    """Volume of the interior [m^3]."""
    seen: SeenSize | None = None
    """Size in the image or video that belongs to the text."""
    material: str = ""
    """Word for the material or colour of the object."""
    handles: Handles = ""
    handle_material: str = ""
    hinge: Side = ""
    """Hinged edge of all doors without a separate one."""
    stack: Stack = ""
    options: set[str] = field(default_factory=set)
    """Variants such as ``flip cap`` or ``double``."""
    scale: dict[str, float] = field(default_factory=dict)
    """Relative size by dimension, from words such as ``tall``."""
    unknown: list[str] = field(default_factory=list)
    """Words that were not understood, in order."""
    ignored: list[str] = field(default_factory=list)
    """Words that were understood and have no effect, such as ``modern``."""
    assumptions: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    @property
    def volume_text(self) -> str:
        """Return the volume with its unit."""
        return f"{1000.0 * (self.volume_m3 or 0.0):.4g} l"

    def count(self, kind: str) -> int | None:
        """Return the number of parts of a kind; None if the text gives none."""
        counts = [group.count for group in self.groups if group.kind == kind]
        if not counts:
            return 0 if kind in self.absent else None
        if any(count is None for count in counts):
            return None
        return sum(count or 0 for count in counts)

    def of_kind(self, kind: str) -> list[PartGroup]:
        """Return the groups of a kind."""
        return [group for group in self.groups if group.kind == kind]
