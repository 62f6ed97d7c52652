"""Owner of a length in a text: the object, or one of its components, such as a wall or a board."""

from __future__ import annotations

from articulate.reconstruct.text.measures import Measure
from articulate.reconstruct.text.reader import SEPARATORS, Reader
from articulate.reconstruct.text.vocabulary import (
    COLOURS,
    FILLER,
    FIXED_FEATURES,
    MATERIALS,
    NO_EFFECT,
    word_set,
)

COMPONENTS = word_set(
    """
    wall walls side sides board boards sheet sheets slab slabs plank planks pane panes edge edges
    rim rims lip lips border borders front fronts face faces casing housing shell carcass carcase
    insulation lining padding cushion cushions upholstery veneer trim moulding molding skirting
    gasket seal gap gaps recess groove grooves slot slots hole holes rail rails post posts pole
    poles rod rods tube tubes pipe pipes cord cable surround ledge lintel sill
    """
)
"""Nouns of components whose sizes are not those of an object."""
SMALL_PARTS = frozenset(
    {"leg", "handle", "knob", "wheel", "lever", "pedal", "dial", "pull", "spout", "cap", "rack"}
)
"""Kinds of parts whose sizes may follow them: ``legs 10 cm high``."""
MEASURED_BY_PART = frozenset({"screen", "top", "seat", "window", "plate", "drum", "tank"})
"""Fixed parts whose size is that of the object, as in ``a 15 inch screen``."""
FLAT = frozenset({"door", "sliding_window", "laptop"})
"""Objects whose own thickness may be below ``LARGEST_THICKNESS_M``."""
LARGEST_THICKNESS_M = 0.1
"""Greatest thickness of a component, where the text does not name it [m]."""
LARGEST_PART_M = 0.3
"""Greatest size of a part that is named before it [m]."""
BETWEEN = word_set("is are of that which about being each a an the in at only made")
"""Words between a component and its size."""


def is_component_size(reader: Reader, measures: tuple[Measure, ...]) -> bool:
    """Return whether the lengths at the reader's position belong to a component."""
    if len(measures) > 1:
        return _is_part(reader, reader.at + 1, measures[0].dimension)
    (measure,) = measures
    if "each" in {reader.before, reader.following}:
        return True
    if reader.object_follows() and measure.dimension != "thickness":
        return _is_part(reader, reader.at + 1, measure.dimension)
    return _follows(reader, measure) or _precedes(reader, measure) or _is_thin(reader, measure)


def _length_m(measure: Measure) -> float | None:
    return None if measure.unit_m is None else measure.value * measure.unit_m


def _is_part(reader: Reader, at: int, dimension: str) -> bool:
    """Return whether a part that may have its own size starts at a word."""
    category = reader.out.category
    _, kind = reader.part_at(at)
    if not kind or (category in FLAT - {"laptop"} and dimension != "thickness"):
        return False
    own = kind in FIXED_FEATURES.get(category, frozenset()) & MEASURED_BY_PART
    return not own or dimension == "thickness"


def _follows(reader: Reader, measure: Measure) -> bool:
    """Return whether a component follows the length, as in ``4 cm thick walls``."""
    at, made_of = reader.at + 1, False
    tokens = [*reader.tokens, "."]
    while at < len(reader.tokens):
        word = tokens[at]
        if reader.part_at(at)[1] or word not in {*MATERIALS, *COLOURS, *NO_EFFECT}:
            break
        made_of |= word in MATERIALS
        at += 1
    word = tokens[at]
    if word in COMPONENTS or _is_part(reader, at, measure.dimension):
        return True
    length = _length_m(measure)
    if length is None or length >= LARGEST_THICKNESS_M or measure.dimension != "any":
        return False
    if word in SEPARATORS or word in FILLER:
        return made_of  # "18 mm plywood"
    return word.isalpha()


def _precedes(reader: Reader, measure: Measure) -> bool:
    """Return whether a component precedes the length, as in ``walls 4 cm thick``."""
    at = reader.at - 1
    while at >= 0 and reader.tokens[at] in BETWEEN:
        at -= 1
    if at < 0:
        return False
    _, kind = reader.part_at(at)
    if reader.tokens[at] in COMPONENTS:
        return True
    if measure.dimension == "thickness":
        return bool(kind)
    length = _length_m(measure)
    small = length is not None and length < LARGEST_PART_M
    return small and kind in SMALL_PARTS


def _is_thin(reader: Reader, measure: Measure) -> bool:
    """Return whether a thickness is too small for the object."""
    length = _length_m(measure)
    return (
        measure.dimension == "thickness"
        and reader.out.category not in FLAT
        and length is not None
        and length < LARGEST_THICKNESS_M
    )
